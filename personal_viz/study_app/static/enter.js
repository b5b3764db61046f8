// Trades the token in the link's fragment (never sent in a URL, never logged) for a session, then opens the study.
// On the open link (/join) it asks for a personal link first; this browser remembers it, so that nobody has two. On a
// computer that several people use, the next one says so and gets an own link. A phone or a small screen is turned away
// before anything is sent: nobody has come, and the link stays good for a computer.
"use strict";
(async () => {
  const message = document.getElementById("message");
  const words = JSON.parse(document.getElementById("words").textContent);
  const REMEMBERED = "personal-study-token";

  const device = () => {
    let webgl2 = false;
    try {
      webgl2 = document.createElement("canvas").getContext("webgl2") !== null;
    } catch {
      // none
    }
    return {
      webgl2,
      width: Math.round(window.innerWidth / 100) * 100,
      height: Math.round(window.innerHeight / 100) * 100,
      dpr: Math.round(window.devicePixelRatio * 4) / 4 || 1,
      touch: navigator.maxTouchPoints > 0,
    };
  };

  const isTooSmall = () => {
    const { width, height } = document.querySelector("main").dataset;
    const isCoarse = window.matchMedia("(pointer: coarse)").matches;
    // A system may show everything at 200 %. A page that is zoomed out has a ratio under 1 on the same screen, and a
    // phone has 2 to 4 on a small one; its pen is a fine pointer.
    const scale = isCoarse ? 1 : Math.max(1, window.devicePixelRatio || 1);
    const sides = [scale * window.screen.width, scale * window.screen.height];
    const isTouched = isCoarse && !window.matchMedia("(any-pointer: fine)").matches;
    return isTouched || Math.max(...sides) < Number(width) || Math.min(...sides) < Number(height);
  };

  const post = (path, body) =>
    fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

  const explain = (status, otherwise) => {
    message.textContent =
      { 429: words["enter.too_many"], 503: words["enter.closed"] }[status] || otherwise;
  };

  const remember = (token) => {
    try {
      window.localStorage.setItem(REMEMBERED, token);
    } catch {
      // a browser that keeps nothing: the address holds the link too
    }
  };

  const remembered = () => {
    try {
      return window.localStorage.getItem(REMEMBERED);
    } catch {
      return null;
    }
  };

  const isSomebodyElse = () =>
    new Promise((resolve) => {
      message.textContent = words["enter.was_it_you"];
      const choices = document.getElementById("choices");
      choices.hidden = false;
      for (const [id, isOther] of [["same", false], ["other", true]]) {
        document.getElementById(id).addEventListener("click", () => {
          choices.hidden = true;
          message.textContent = words["enter.opening"];
          resolve(isOther);
        });
      }
      document.getElementById("same").focus();
    });

  const enter = async (token) => {
    const reply = await post("/enter", { token, device: device() });
    if (reply.ok) {
      window.location.replace((await reply.json()).page);
      return true;
    }
    explain(reply.status, words["enter.unknown"]);
    return reply.status !== 401;
  };

  const join = async () => {
    const given = new URLSearchParams(window.location.search);
    const arrival = {};
    for (const name of ["PROLIFIC_PID", "STUDY_ID", "SESSION_ID"]) {
      if (given.get(name)) arrival[name] = given.get(name);
    }
    const before = arrival.PROLIFIC_PID ? null : remembered();
    if (before && !(await isSomebodyElse()) && (await enter(before))) return;
    const reply = await post("/join", arrival);
    if (!reply.ok) {
      explain(reply.status, words["enter.incomplete"]);
      return;
    }
    const { token, code } = await reply.json();
    if (!token) {
      message.textContent = words[code ? "enter.full_code" : "enter.full"];
      document.getElementById("code").textContent = code || "";
      document.getElementById("paid").hidden = !code;
      return;
    }
    if (!arrival.PROLIFIC_PID) remember(token);
    await enter(token);
  };

  if (isTooSmall()) {
    document.title = `${words["enter.phone"]} - ${document.title}`;
    document.querySelector("h1").textContent = words["enter.phone"];
    message.textContent = words["enter.phone_text"];
    document.getElementById("more").hidden = false;
    return;
  }
  try {
    const token = window.location.hash.slice(1);
    if (token) {
      await enter(token);
    } else if (window.location.pathname === "/join") {
      await join();
    } else {
      message.textContent = words["enter.no_link"];
    }
  } catch {
    message.textContent = words["enter.unreachable"];
  }
})();

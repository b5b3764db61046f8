// Trades the token in the link's fragment for a cookie, then asks for the study's progress every three seconds.
"use strict";
(() => {
  const EVERY_MS = 3000;
  const SVG = "http://www.w3.org/2000/svg";
  const at = (id) => document.getElementById(id);
  const drawn = {};
  let timer = null;
  let isLooking = false;

  const tell = (text, isAlarm = false) => {
    at("message").textContent = text;
    at("message").className = isAlarm ? "alarm" : "";
  };

  const make = (name, content = "", className = "") => {
    const element = document.createElement(name);
    element.append(...(Array.isArray(content) ? content : [String(content)]));
    if (className) element.className = className;
    return element;
  };

  const bar = (parts, whole) => {
    const element = make("div", "", "bar");
    element.setAttribute("aria-hidden", "true");
    for (const [name, count] of parts) {
      if (!count) continue;
      const part = make("i", "", name);
      part.style.width = `${(100 * count) / Math.max(1, whole)}%`;
      element.append(part);
    }
    return element;
  };

  // A part of the page is built again only when what it shows has changed.
  const whenChanged = (id, shown, draw) => {
    const text = JSON.stringify(shown);
    if (drawn[id] === text) return;
    drawn[id] = text;
    draw(shown);
  };

  const rows = (id, shown, cells) => whenChanged(id, shown, () => at(id).replaceChildren(
    ...shown.map((one) => make("tr", cells(one)))));

  const summary = (found) => {
    const { study, study_version, is_pilot, num_done, num_all } = found.progress;
    document.title = `${num_done}/${num_all} – ${study}`;
    at("study").textContent = study;
    at("version").textContent = study_version.slice(0, 12);
    at("pilot").hidden = !is_pilot;
    at("done").textContent = num_done;
    at("planned").textContent = num_all;
    at("done-bar").style.width = `${(100 * num_done) / Math.max(1, num_all)}%`;
    at("free").textContent = found.free;
    at("full").hidden = !found.is_nearly_full;
    at("backups").textContent = found.backups;
    whenChanged("counts", found.counts, (counts) => at("counts").replaceChildren(...counts.map(([state, words, n]) =>
      make("li", [make("b", n, n ? `state ${state}` : "state not_arrived"), words]))));
    whenChanged("workers", found.workers, (workers) => at("workers").replaceChildren(...workers.map((one) =>
      make("li", [`${one.number}  `, make("span", one.state, `state ${one.state}`),
        one.people ? `, ${one.people} ${one.people === 1 ? "person" : "people"}` : ""]))));
  };

  const slots = (found) => rows("slots", found.progress.slots, (one) => {
    const whole = one.num_done + one.num_held + one.num_free + one.num_failed;
    const filled = make("td", [bar([["done", one.num_done], ["held", one.num_held], ["free", one.num_free],
      ["failed", one.num_failed]], whole)], "slots");
    return [make("td", `${one.task.toUpperCase()} ${one.condition}`), make("td", one.split), filled,
      make("td", `${one.num_done} of ${whole}`, "n"), make("td", one.num_held, "n"), make("td", one.num_free, "n")];
  });

  const ORDER = ["stuck", "active", "away", "refused", "finished", "out"];
  const people = (found) => {
    const all = found.progress.people.map((one, place) => ({ ...one, words: found.people[place] }));
    const came = all.filter((one) => one.state !== "not_arrived");
    came.sort((one, other) => ORDER.indexOf(one.state) - ORDER.indexOf(other.state));
    rows("people", came, (one) => [
      make("td", one.code), make("td", one.task.toUpperCase()), make("td", one.words.state, `state ${one.state}`),
      make("td", one.words.where),
      make("td", [bar([["done", one.num_done]], one.num_planned),
        make("span", `${one.num_done} of ${one.num_planned}`)]),
      make("td", one.words.here === null ? "" : one.words.here ? "open" : "closed", one.words.here ? "" : "quiet"),
      make("td", one.words.heard, "n"),
      ...[one.num_reconnects, one.num_technical, one.num_abandoned].map((count) =>
        make("td", count || "·", count ? "n" : "n quiet")),
    ]);
    const missing = all.filter((one) => one.state === "not_arrived").map((one) => one.code);
    at("others").textContent = missing.length ? `Not arrived: ${missing.join(", ")}` : "";
  };

  const piece = (name, attributes, text = "") => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.textContent = text;
    return element;
  };

  const when = (ms, span) => new Date(ms).toLocaleString(undefined, span > 86400e3
    ? { day: "numeric", month: "short" } : { hour: "2-digit", minute: "2-digit" });

  // Up to the present minute, so that a collection that stands still is seen to.
  const timeline = ({ progress }) => whenChanged("timeline", [progress.timeline, Math.ceil(progress.now_ns / 60e9)], ([points, now]) => {
    const [left, right, top, bottom] = [44, 624, 12, 206];
    const parts = [];
    const most = Math.max(4, progress.num_done);
    const start = (points.length ? points[0].at_ns : progress.now_ns) / 1e6;
    const span = Math.max(60e3, now * 60e3 - start);
    const x = (ms) => left + ((right - left) * (ms - start)) / span;
    const y = (count) => bottom - ((bottom - top) * count) / most;
    for (const count of [0, Math.round(most / 2), most]) {
      parts.push(piece("line", { class: "grid", x1: left, x2: right, y1: y(count), y2: y(count) }));
      parts.push(piece("text", { x: left - 8, y: y(count) + 4, "text-anchor": "end" }, count));
    }
    if (!points.length) {
      parts.push(piece("text", { x: (left + right) / 2, y: (top + bottom) / 2, "text-anchor": "middle" },
        "No counted trial yet"));
    } else {
      const line = points.map((one, place) => (place ? `H${x(one.at_ns / 1e6)}` : `M${x(one.at_ns / 1e6)} ${y(0)}`) +
        `V${y(one.num_done)}`).join("") + `H${x(start + span)}`;
      const end = points[points.length - 1];
      parts.push(piece("path", { class: "area", d: `${line}V${y(0)}Z` }), piece("path", { class: "line", d: line }),
        piece("circle", { class: "dot", cx: x(start + span), cy: y(end.num_done), r: 4 }));
      for (const share of [0, 0.5, 1]) {
        parts.push(piece("text", { x: left + (right - left) * share, y: 230,
          "text-anchor": ["start", "middle", "end"][share * 2] }, when(start + span * share, span)));
      }
    }
    at("timeline").replaceChildren(...parts);
  });

  const look = async () => {
    clearTimeout(timer);
    if (document.hidden || isLooking) return;
    isLooking = true;
    try {
      const reply = await fetch("/progress");
      if (reply.status === 401) {
        at("page").hidden = true;
        tell("This page needs the link that the terminal shows; each start of the study makes a new one.", true);
        return;
      }
      if (reply.ok) {
        const found = await reply.json();
        for (const draw of [summary, timeline, slots, people]) draw(found);
        at("page").hidden = false;
        tell(`Live · ${new Date(found.progress.now_ns / 1e6).toLocaleTimeString()}`);
      } else {
        tell("The study cannot be read just now; still trying.", true);
      }
    } catch {
      tell("The study does not answer: it was stopped, or this machine sleeps. Still trying.", true);
    } finally {
      isLooking = false;
    }
    timer = setTimeout(look, EVERY_MS);
  };

  const begin = async () => {
    const token = window.location.hash.slice(1);
    if (token) {
      window.history.replaceState(null, "", "/");
      try {
        await fetch("/enter", { method: "POST", body: token });
      } catch {
        // the first look tells
      }
    }
    await look();
  };

  document.addEventListener("visibilitychange", look);
  begin();
})();

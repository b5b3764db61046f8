// What the pages of a study do with JavaScript: larger text, being seen as present, the device check. All but the device
// check can be read and answered without it.
"use strict";
(() => {
  const BACK_MS = 5000, REMEMBERED = "personal-large";
  const base = document.body.dataset.base;
  const all = (selector) => document.querySelectorAll(selector);

  // --- larger text, remembered by this browser -------------------------------------------------------------------
  const setLarge = (isLarge) => {
    document.documentElement.classList.toggle("personal-large", isLarge);
    for (const button of all("[data-tool=large]")) button.setAttribute("aria-pressed", isLarge);
    try { localStorage.setItem(REMEMBERED, isLarge ? "1" : ""); } catch { /* private window */ }
  };
  let isLarge = false;
  try { isLarge = localStorage.getItem(REMEMBERED) === "1"; } catch { /* private window */ }
  setLarge(isLarge);
  for (const button of all("[data-tool=large]")) {
    button.hidden = false;
    button.addEventListener("click", () => setLarge(!document.documentElement.classList.contains("personal-large")));
  }

  // --- a second press of the button that was pressed just now answers nothing twice; it need not be sent -----------
  // nor is one to a server that does not answer: the browser's own page would take this one's place. `navigator.onLine`
  // would not tell: it is about the computer's network, and the server may be this computer or may be down.
  const offline = document.querySelector("[data-offline]");
  let sending = "";  // "asked" while the server is asked, then "sure", then "sent"
  const tellLine = async () => {
    let isThere = false;
    try {
      isThere = (await fetch("/page-version", { cache: "no-store", signal: AbortSignal.timeout(BACK_MS) })).ok;
    } catch { /* silent */ }
    offline.hidden = isThere;
    return isThere;
  };
  document.addEventListener("submit", async (event) => {
    if (sending === "sure") { sending = "sent"; return; }
    event.preventDefault();
    if (sending) return;
    sending = "asked";
    sending = await tellLine() ? "sure" : "";
    if (sending) event.target.requestSubmit(event.submitter);
    if (sending === "sure") sending = "";  // a field was emptied meanwhile
  });
  window.addEventListener("pageshow", () => { sending = ""; });

  // --- the code of the last page or of a full study, copied with one press -------------------------------------------
  for (const button of all("[data-copies]")) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      const code = document.querySelector(".code"), told = document.querySelector("[data-copied]");
      try {  // not everywhere: browsers allow it over TLS and on this computer only
        await navigator.clipboard.writeText(code.textContent);
        told.textContent = button.dataset.done;
      } catch {
        window.getSelection().selectAllChildren(code);
        told.textContent = button.dataset.yourself;
      }
    });
  }

  // --- while this page is open its participant is here, and keeps the place in the study ---------------------------
  const stayHere = () => {
    const socket = new WebSocket(location.origin.replace(/^http/, "ws") + base + "here");
    socket.addEventListener("open", () => { offline.hidden = true; });
    socket.addEventListener("close", () => setTimeout(() => { tellLine(); stayHere(); }, BACK_MS));
  };
  if (base) stayHere();

  // --- the device check -----------------------------------------------------------------------------------------
  const device = document.getElementById("device");
  if (!device) return;
  const form = document.querySelector("form[method=post]");
  const hasKeys = device.dataset.keys === "1";
  const webgl2 = (() => {
    try {
      const context = document.createElement("canvas").getContext("webgl2");
      if (context && context.getExtension("WEBGL_lose_context")) context.getExtension("WEBGL_lose_context").loseContext();
      return context !== null;
    } catch { return false; }
  })();
  let hasPressed = false, told = "";
  const showCheck = (name, isOk, otherwise) => {
    const item = device.querySelector("[data-check=" + name + "]");
    if (!item) return;
    const mark = isOk ? device.dataset.ok : otherwise;
    if (item.querySelector("b").textContent !== mark) item.querySelector("b").textContent = mark;
    item.querySelector("[data-yes]").hidden = !isOk;
    item.querySelector("[data-no]").hidden = isOk;
  };
  const look = () => {
    const width = window.innerWidth, height = window.innerHeight;
    const isLarge = width >= Number(device.dataset.width) && height >= Number(device.dataset.height);
    const canShow = isLarge && (webgl2 || device.dataset.webgl !== "1");
    Object.assign(form.webgl2, { value: webgl2 ? "1" : "0" });
    Object.assign(form.width, { value: width });
    Object.assign(form.height, { value: height });
    Object.assign(form.pressed, { value: hasPressed ? "1" : "0" });
    device.querySelector("[data-size]").textContent = width + " x " + height;
    showCheck("webgl", webgl2, device.dataset.notYet);
    showCheck("window", isLarge, device.dataset.notYet);
    showCheck("key", hasPressed, device.dataset.now);
    const isReady = canShow && (hasPressed || !hasKeys);
    const when = { ready: isReady, shown: canShow && !isReady, failed: !canShow };
    for (const choice of all("[data-when]")) choice.hidden = !when[choice.dataset.when];
    document.getElementById("looking").hidden = true;
    device.hidden = false;
    const found = [webgl2, Math.round(width / 100), Math.round(height / 100)].join();
    if (!canShow && found !== told) {  // the researcher learns how often the study cannot be shown
      told = found;
      fetch(form.action, { method: "POST", body: new URLSearchParams(new FormData(form)), redirect: "manual" }).catch(() => {});
    }
  };
  let resizing = 0;
  window.addEventListener("resize", () => { clearTimeout(resizing); resizing = setTimeout(look, 300); });
  window.addEventListener("keydown", (event) => {
    const isW = event.code === "KeyW" || (!event.code && event.key.toLowerCase() === "w");
    if (!isW || event.ctrlKey || event.metaKey || event.altKey || !hasKeys) return;
    hasPressed = true;
    look();
  });
  look();
})();

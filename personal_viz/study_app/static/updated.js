// Stands in every page of a study, before viser's client: it knows which version of the program the page came from.
// Was the study updated since, the gateway refuses the page's websocket; the page then says so in our words and is
// loaded again. That loses nothing: the server rebuilds all of a page from what is stored.
(() => {
  const WORDS = PAGE_WORDS;
  document.documentElement.lang = WORDS.language;
  const MINE = 'PAGE_VERSION', LOADED = 'personal-loaded-again';
  const BEGINS_WITHIN_MS = 8000, ASK_EVERY_MS = 3000, READ_MS = 8000, ONCE_WITHIN_MS = 60000;
  const dialog = document.createElement('dialog');
  dialog.className = 'personal-updated';

  // By itself a page is loaded again once for a reason and once a minute: one that comes back as old as it was, from
  // whatever keeps it on the way, must not be loaded for ever. Nor while somebody chooses keys, or whether to leave.
  const mayLoad = (reason) => {
    if (document.querySelector('dialog.personal-dialog[open]')) return false;
    try {
      const [known, at] = JSON.parse(sessionStorage.getItem(LOADED) || '["", 0]');
      if (known === reason || Date.now() < at + ONCE_WITHIN_MS) return false;
      sessionStorage.setItem(LOADED, JSON.stringify([reason, Date.now()]));
      return true;
    } catch { return false; }  // a browser that keeps nothing
  };
  const show = (served) => {
    if (dialog.open) return;
    const isSoon = mayLoad(served);
    dialog.setAttribute('role', 'alertdialog');
    dialog.setAttribute('aria-labelledby', 'personal-updated-title');
    dialog.setAttribute('aria-describedby', 'personal-updated-text');
    dialog.setAttribute('style', 'width:min(34rem,92vw);padding:1.4rem 1.7rem;border:1px solid var(--personal-edge);' +
      'border-radius:var(--personal-radius-large);color:var(--personal-ink);background:var(--personal-paper);' +
      'font:var(--personal-size)/1.5 var(--personal-font)');
    dialog.innerHTML = '<h2 id="personal-updated-title" style="margin:0 0 .3em;font-size:1.3em"></h2>' +
      '<div id="personal-updated-text"><p></p>' + (isSoon ? '<p></p>' : '') + '</div><p><button autofocus ' +
      'style="padding:.6em 1.1em;border:0;border-radius:var(--personal-radius);background:var(--personal-blue);' +
      'color:var(--personal-on-fill);font:inherit;' +
      'cursor:pointer"></button></p>';
    const texts = ['title', 'text', ...(isSoon ? ['soon'] : []), 'load'];
    const places = dialog.querySelectorAll('h2, div p, button');
    texts.forEach((name, at) => { places[at].textContent = WORDS['updated.' + name]; });
    dialog.querySelector('button').addEventListener('click', () => window.location.reload());
    document.body.append(dialog);
    dialog.showModal();
    if (isSoon) setTimeout(() => window.location.reload(), READ_MS);
  };
  dialog.addEventListener('cancel', (event) => event.preventDefault());  // Escape: nothing of the page works any more
  dialog.addEventListener('keydown', (event) => event.stopPropagation());

  let isAsking = false;
  // 'same' when the server answers and serves this page's version, 'other' when it serves another, which is shown.
  const ask = async () => {
    if (dialog.open) return 'other';
    if (isAsking) return 'silent';
    isAsking = true;
    try {
      const reply = await fetch('/page-version', { cache: 'no-store' });
      if (reply.status === 404) return 'same';  // a program of before this file: a page that is loaded again is its own
      const served = reply.ok ? (await reply.text()).trim() : '';
      if (!/^[\w.-]{1,64}$/.test(served)) return 'silent';
      if (served === MINE) return 'same';
      show(served);
      return 'other';
    } catch {
      return 'silent';
    } finally {
      isAsking = false;
    }
  };
  const timer = setInterval(() => {  // a page whose websocket is refused from the start never gets the page's script
    if (window.personalPage) clearInterval(timer);
    else if (performance.now() > BEGINS_WITHIN_MS) ask();
  }, ASK_EVERY_MS);
  // Graphics that are lost before the page's script has come would leave an empty page, and nobody to say so.
  window.addEventListener('webglcontextlost', () => {
    if (!window.personalPage && mayLoad('graphics-' + performance.timeOrigin)) window.location.reload();
  }, true);
  window.personalVersion = { ask: ask };
})();

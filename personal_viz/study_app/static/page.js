// A participant's page: keys by their place on the keyboard, no auto-repeat, own keys, larger text, and messages to the
// server through a hidden text input of viser's (LABEL). viser sends at most one message of all its inputs within 50 ms
// and forgets those in between, so ours keep away from clicks, carry numbers, and are sent again until acknowledged; a key
// waits until viser is free, because the message with the time of its press has to arrive before it.
(() => {
  if (window.personalPage) return;
  const LABEL = 'messages of this page', EVERY_MS = 120, AGAIN_MS = 2500, PING_MS = 10000, LOST_MS = 12000,
    COMES_BACK_MS = 4000;
  const FREE_MS = 55, AFTER_CLICK_MS = 90, MAX_PENDING = 200, MAX_AT_ONCE = 40;
  const DEFAULT = {
    forward: ['KeyW', 'ArrowUp'], left: ['KeyA', 'ArrowLeft'], right: ['KeyD', 'ArrowRight'],
    look_up: ['KeyR'], look_down: ['KeyF'], stop: ['Enter', 'NumpadEnter'], found: ['Enter', 'NumpadEnter'],
  };
  const VISER = { ArrowUp: 'ArrowUp', ArrowLeft: 'ArrowLeft', ArrowRight: 'ArrowRight', ArrowDown: 'ArrowDown',
    Enter: 'Enter', NumpadEnter: 'Enter', Space: ' ', PageUp: 'PageUp', PageDown: 'PageDown' };
  const WORDS = PAGE_WORDS;
  const say = (key, places) => WORDS[key].replace(/\{(\w+)\}/g, (whole, name) => (places || {})[name] ?? whole);
  const nameOf = (action) => say('script.' + action);
  const state = { seat: '', own: {}, actions: [], pending: [], number: 0, sentAt: 0, sentNumber: 0, acked: 0,
    waitingSince: 0, holdUntil: 0, timer: 0, isDown: false };
  const now = () => performance.now();
  const ours = new WeakSet();

  // --- messages to the server -----------------------------------------------------------------------------------
  const field = () => {
    for (const label of document.querySelectorAll('label'))
      if (label.textContent === LABEL) {
        let around = label;
        while (around && !around.querySelector('input')) around = around.parentElement;
        if (!around) return null;
        around.style.display = 'none';
        return around.querySelector('input');
      }
    return null;
  };
  const type = (text) => {
    const input = field();
    if (!input) return false;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(input, text);
    input.dispatchEvent(new Event('input', { bubbles: true }));
    state.sentAt = now();
    occupy(FREE_MS);
    return true;
  };
  // Time alone does not tell whether viser is free: on a busy page its timers are late. Ours, set after its own, is later.
  let isFree = true, freeing = 0;
  const occupy = (ms) => {
    isFree = false;
    clearTimeout(freeing);
    freeing = setTimeout(() => { isFree = true; passKeys(); }, ms);
  };
  const send = () => {
    clearTimeout(state.timer);
    state.timer = 0;
    if (!state.seat || !state.pending.length) return;
    const wait = Math.max(state.sentAt + EVERY_MS - now(), state.holdUntil - now(), state.isDown ? 60 : 0);
    const isNew = state.pending[state.pending.length - 1].n > state.sentNumber;
    const again = isNew ? 0 : state.waitingSince + AGAIN_MS - now();
    if (wait > 0 || again > 0) { state.timer = setTimeout(send, Math.max(wait, again, 10)); return; }
    const batch = state.pending.slice(0, MAX_AT_ONCE);
    if (type(JSON.stringify({ seat: state.seat, said: batch }))) {
      state.sentNumber = batch[batch.length - 1].n;
      state.waitingSince = now();
    }
    state.timer = setTimeout(send, AGAIN_MS);
  };
  const tell = (message) => {
    if (state.pending.length >= MAX_PENDING) state.pending.shift();
    state.pending.push({ n: ++state.number, t_cli_ms: now(), ...message });
    if (!state.timer || state.pending.length === 1) send();
  };
  const tellPress = (code, t) => {  // unacknowledged: it must not keep the key that follows it waiting
    const action = actionOf(code);
    if (action && state.seat && !state.isDown)
      type(JSON.stringify({ seat: state.seat, said: [{ n: 0, kind: 'press', action: action, code: code, t_cli_ms: t }] }));
  };
  const acknowledge = (number) => {
    const round = now() - state.waitingSince;
    state.pending = state.pending.filter((message) => message.n > number);
    if (number === state.sentNumber && number > state.acked) tellRound(round);
    state.acked = Math.max(state.acked, number);
    showBanner('');
    if (state.pending.length) send();
  };
  let roundAt = -Infinity;
  const tellRound = (round) => {
    if (now() - roundAt < 0.9 * PING_MS) return;
    roundAt = now();
    tell({ kind: 'round_trip', ms: Math.round(round * 10) / 10 });
  };
  const isUpdated = () => document.querySelector('dialog.personal-updated[open]') !== null;
  const isLost = () => state.pending.length > 0 && now() - state.pending[0].t_cli_ms > LOST_MS;
  setInterval(() => {
    const part = document.querySelector('.personal-page h1, .personal-caption');  // the tab is called after the page's part
    const title = (part ? part.textContent + ' - ' : '') + say('study.title');
    if (document.title !== title) document.title = title;
    if (!state.seat) return;
    if (!state.pending.length && now() - state.sentAt > PING_MS) tell({ kind: 'ping' });
    else if (isLost()) {
      if (!isUpdated()) showBanner(say('script.lost'));
      knock();
    }
  }, 1000);
  // viser tries nothing in a hidden tab, and gives up on a server that was away for long. When the server answers again
  // and viser still has not come back, the page is loaded again: the server rebuilds all of it from what is stored.
  // A server of another version does not take this page back; then `updated.js` says so.
  let isKnocking = false, answersSince = 0;
  const knock = async () => {
    if (isKnocking) return;
    isKnocking = true;
    const answer = window.personalVersion ? await window.personalVersion.ask() : 'silent';
    isKnocking = false;
    answersSince = answer === 'same' ? answersSince || now() : 0;
    if (answer === 'other') showBanner('');
    else if (!isLost()) answersSince = 0;
    else if (answersSince && now() - answersSince > COMES_BACK_MS) window.location.reload();
  };

  // --- keys -------------------------------------------------------------------------------------------------------
  const actionOf = (code) => {
    for (const [action, own] of Object.entries(state.own)) if (own === code) return action;
    for (const [action, codes] of Object.entries(DEFAULT))
      if (state.actions.includes(action) && !state.own[action] && codes.includes(code)) return action;
    return null;
  };
  const keyOfCode = (code) => {
    if (/^Key[A-Z]$/.test(code)) return code.slice(3).toLowerCase();
    if (/^(Digit|Numpad)[0-9]$/.test(code)) return code.slice(-1);
    return VISER[code] || null;
  };
  const isOwned = (code) => state.actions.some((action) => DEFAULT[action].includes(code));
  const viserCode = (code) => {  // the key that viser's hotkeys know for this place on the keyboard
    const action = actionOf(code);
    if (action) return DEFAULT[action].includes(code) ? code : DEFAULT[action][0];
    return isOwned(code) ? null : code;
  };
  const codeOf = (event) => event.code || (/^[a-z]$/i.test(event.key) ? 'Key' + event.key.toUpperCase() : event.key);
  const isTrial = () => document.querySelector('.personal-page') === null;
  const isScrolling = (code, target) =>  // a text that was reached with Tab, or a page to read
    /^(Arrow|Page|Home|End)/.test(code) && (target.closest('.scroll') !== null || (code.startsWith('Page') && !isTrial()));
  window.addEventListener('keydown', (event) => {
    if (ours.has(event) || isUpdated()) return;
    const target = event.target instanceof Element ? event.target : document.body;
    if (dialog.open) { dialogKey(event); return; }
    if (target.closest('input, textarea, select')) return;
    if (event.ctrlKey || event.metaKey || event.altKey) {
      if (event.code === 'KeyK' || event.code === 'KeyP') event.stopImmediatePropagation();  // viser's palette
      return;
    }
    const code = codeOf(event);
    const isPress = (code === 'Enter' || code === 'NumpadEnter' || code === 'Space') &&
      target.closest('button, a, summary, [role=button], [tabindex="0"]');
    event.stopImmediatePropagation();
    if (event.repeat) { if (code !== 'Tab' && !isScrolling(code, target)) event.preventDefault(); return; }
    if (isPress) { hold(); return; }  // the browser presses the focused button
    if (isScrolling(code, target)) return;
    const known = viserCode(code);
    const key = known && keyOfCode(known);
    if (!key) return;
    if (isTrial()) event.preventDefault();  // arrows, space and the keys of storeys must not scroll the panel
    waitingKeys.push({ code: code, t: event.timeStamp, twin: { key: key, code: known, bubbles: false, cancelable: true } });
    passKeys();
  }, true);
  const waitingKeys = [];
  const passKeys = () => {
    while (isFree && waitingKeys.length) {
      const { code, t, twin } = waitingKeys.shift();
      tellPress(code, t);
      const event = new KeyboardEvent('keydown', twin);
      ours.add(event);
      document.documentElement.dispatchEvent(event);  // where viser's hotkeys listen; its camera listens further out
    }
  };
  const hold = () => { state.holdUntil = now() + AFTER_CLICK_MS; occupy(AFTER_CLICK_MS); };
  window.addEventListener('pointerdown', () => { state.isDown = true; hold(); }, true);
  const lift = () => { state.isDown = false; hold(); };
  window.addEventListener('pointerup', lift, true);
  window.addEventListener('pointercancel', lift, true);
  let pressed = null;  // the button of the last click: its id, which viser never gives twice, or the element
  window.addEventListener('click', (event) => {
    const target = event.target instanceof Element ? event.target : null;
    const before = pressed;
    const at = target && target.closest('button');
    pressed = at && (at.id || at);
    if (event.detail > 1 && pressed && pressed !== before) {  // a double click that began on a screen that is gone
      setTimeout(() => document.activeElement.blur(), 0);
      pressed = before;
      event.stopImmediatePropagation();
      event.preventDefault();
      return;
    }
    const region = target && target.closest('.scroll');
    if (region) region.blur();  // so that arrows steer again and do not scroll the text that was clicked
    const button = target && target.closest('button');
    if (!button) return;
    if (event.detail > 0) setTimeout(() => button.blur(), 0);  // so that Enter is STOP again and not this button
    if (button.dataset.tool === 'keys') openDialog();
    if (button.dataset.tool === 'large') setLarge(!document.documentElement.classList.contains('personal-large'));
    if (button.dataset.tool === 'leave') openLeaving(button.dataset.text);
    if (button.dataset.tool === 'names') turnNames(button);
  }, true);

  const turnNames = (button) => {
    const isOn = button.parentElement.classList.toggle('personal-shows-names');
    const label = button.querySelector('span > span');  // in room for both of its texts, so that the button stays as it is
    [label.textContent, button.dataset.other] = [button.dataset.other, label.textContent];
    button.setAttribute('aria-pressed', isOn);
  };

  // --- what happens to the page -----------------------------------------------------------------------------------
  const changed = (what) => tell({ kind: 'page', what: what });
  window.addEventListener('focus', (event) => { if (event.target === window) changed('focus'); });
  window.addEventListener('blur', (event) => { if (event.target === window) changed('blur'); });
  document.addEventListener('visibilitychange', () => changed(document.hidden ? 'hidden' : 'visible'));
  window.addEventListener('webglcontextlost', () => changed('context_lost'), true);
  window.addEventListener('online', () => { if (state.seat) tell({ kind: 'ping' }); });
  window.addEventListener('offline', async () => {  // which says nothing about a server on this computer
    const answer = window.personalVersion ? await window.personalVersion.ask() : '';
    if (answer === 'silent') showBanner(say('script.lost'));
  });
  let resizing = 0;
  window.addEventListener('resize', () => {
    clearTimeout(resizing);
    resizing = setTimeout(tellDevice, 300);
  });
  const hasWebgl = () => {
    try {
      const context = document.createElement('canvas').getContext('webgl2');
      if (context && context.getExtension('WEBGL_lose_context')) context.getExtension('WEBGL_lose_context').loseContext();
      return context !== null;
    } catch { return false; }
  };
  let webgl = null;
  const tellDevice = () => {
    if (webgl === null) webgl = hasWebgl();
    tell({ kind: 'device', webgl2: webgl, width: window.innerWidth, height: window.innerHeight });
  };

  // --- larger text, own keys, banner ------------------------------------------------------------------------------
  const remember = (name, value) => { try { localStorage.setItem(name, value); } catch { /* private window */ } };
  const setLarge = (isLarge) => {
    document.documentElement.classList.toggle('personal-large', isLarge);
    remember('personal-large', isLarge ? '1' : '');
    for (const button of document.querySelectorAll('[data-tool=large]')) button.setAttribute('aria-pressed', isLarge);
  };
  try { setLarge(localStorage.getItem('personal-large') === '1'); } catch { /* private window */ }
  const banner = document.createElement('div');
  banner.className = 'personal-banner';
  banner.setAttribute('role', 'alert');
  banner.hidden = true;
  const showBanner = (text) => {
    banner.hidden = !text;
    if (banner.textContent !== text) banner.textContent = text;
    document.documentElement.classList.toggle('personal-lost', Boolean(text));  // nobody looks on while no time is counted
  };
  const dialog = document.createElement('dialog');
  dialog.className = 'personal-dialog';
  dialog.setAttribute('aria-label', say('script.keys'));
  const sign = document.createElement('div');  // stays in the page, so that screen readers hear of each new text
  sign.className = 'personal-sign';
  sign.setAttribute('role', 'alert');
  sign.setAttribute('aria-live', 'assertive');
  document.body.append(banner, sign, dialog);
  let signing = 0;
  const showSign = (text, number, isNews) => {
    clearTimeout(signing);
    sign.textContent = '';
    sign.classList.toggle('personal-sign-news', Boolean(isNews));
    if (text) signing = setTimeout(() => { sign.textContent = text; }, 40);  // a text that comes again is new again
  };
  let asking = '';
  const safe = (text) => text.replace(/[&<>"]/g, (mark) => '&#' + mark.charCodeAt(0) + ';');
  const wordOf = (code) => WORDS['key.' + code] || code.replace(/^Key|^Digit/, '');
  const drawDialog = (note) => {
    const rows = state.actions.map((action) => {
      const codes = state.own[action] ? [state.own[action]] : DEFAULT[action].filter((code) => code !== 'NumpadEnter');
      const text = asking === action ? say('script.press_a_key') : codes.map(wordOf).join(say('script.or'));
      return '<tr><td>' + safe(nameOf(action)) + '</td><td><b>' + safe(text) + '</b></td><td><button data-key="' + action +
        '" aria-label="' + safe(say('script.change_key', { action: nameOf(action) })) + '">' + safe(say('script.change')) +
        '</button></td></tr>';
    });
    dialog.innerHTML = '<h2>' + safe(say('script.keys')) + '</h2><p role="status">' +
      safe(note || say('script.keys_place')) + '</p><table>' + rows.join('') + '</table><p><button data-key="reset">' +
      safe(say('script.usual')) + '</button> <button data-key="close">' + safe(say('script.close')) + '</button></p>';
  };
  const openDialog = () => { asking = ''; dialog.setAttribute('aria-label', say('script.keys')); drawDialog(''); dialog.showModal(); };
  dialog.addEventListener('click', (event) => {
    const wanted = event.target.dataset ? event.target.dataset.key : '';
    if (wanted === 'close') dialog.close();
    else if (wanted === 'withdraw') { dialog.close(); tell({ kind: 'told', name: 'withdraw' }); }
    else if (wanted === 'reset') { state.own = {}; asking = ''; drawDialog(say('script.usual_back')); tellKeys(); }
    else if (wanted) { asking = wanted; drawDialog(say('script.new_key', { action: nameOf(wanted) })); }
  });
  const openLeaving = (text) => {
    asking = '';
    dialog.setAttribute('aria-label', say('leave.title'));
    dialog.innerHTML = '<h2>' + safe(say('leave.title')) + '</h2><p></p><p>' + safe(say('leave.link')) + '</p><p>' +
      '<button data-key="close" autofocus>' + safe(say('leave.no')) + '</button> ' +
      '<button data-key="withdraw">' + safe(say('leave.yes')) + '</button></p>';
    dialog.querySelector('p').textContent = text;
    dialog.showModal();
  };
  const tellKeys = () => tell({ kind: 'keys', keys: state.own });
  const dialogKey = (event) => {
    event.stopImmediatePropagation();
    if (!asking) return;
    event.preventDefault();
    const code = codeOf(event), action = asking;
    if (event.repeat) return;
    asking = '';
    if (code === 'Escape') { drawDialog(''); return; }
    const taken = actionOf(code);
    if (!/^(Key[A-Z]|Arrow(Up|Down|Left|Right)|Enter|NumpadEnter|Space)$/.test(code))  // digits answer questions
      drawDialog(say('script.bad_key'));
    else if (taken && taken !== action) drawDialog(say('script.taken_key', { action: nameOf(taken) }));
    else { state.own = { ...state.own, [action]: code }; drawDialog(say('script.saved')); tellKeys(); }
    const back = dialog.querySelector('[data-key="' + action + '"]');
    if (back) back.focus();
  };

  window.personalPage = {
    begin: (seat, keys, actions) => {
      if (state.seat === seat) return;
      Object.assign(state, { seat: seat, own: keys, actions: actions, sentNumber: 0, waitingSince: 0 });
      showBanner('');
      showSign('');
      const hide = () => { if (field()) { tellDevice(); if (!document.hasFocus()) changed('blur'); } else setTimeout(hide, 30); };
      hide();
    },
    acknowledge: acknowledge,
    sign: showSign,
    shown: () => {  // a new page to read: its heading is where screen readers and the Tab key go on
      const heading = document.querySelector('.personal-page h1');
      if (heading && document.activeElement !== heading) { heading.tabIndex = -1; heading.focus({ preventScroll: true }); }
      const view = document.querySelector('.mantine-ScrollArea-viewport:has(.personal-page)');
      if (view) view.scrollTop = 0;
    },
    begun: () => {  // a new search: what it tells stands at the top
      const view = document.querySelector('.mantine-ScrollArea-viewport:has(.personal-description)');
      if (view) view.scrollTop = 0;
    },
    refresh: () => setLarge(document.documentElement.classList.contains('personal-large')),  // the tools are drawn anew
    reload: () => window.location.reload(),
    goOn: () => {  // to the page without 3-D that comes next
      const [, ticket] = /\/ws\/([^/?&#]+)/.exec(decodeURIComponent(window.location.search)) || [];
      if (ticket) window.location.replace('/page/' + ticket + '/');
    },
  };
})();

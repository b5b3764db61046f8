/* Tells the visitor what is hovered and clicked; panels.py puts in two names. */
(() => {
  if (window.browseChannel) return;
  window.browseChannel = true;
  const queue = [];
  let hovered = '', number = 0, timer = 0;
  const input = () => {
    for (const label of document.querySelectorAll('label'))
      if (label.textContent === 'LABEL') {
        let around = label;
        while (around && !around.querySelector('input')) around = around.parentElement;
        if (around) { around.style.display = 'none'; return around.querySelector('input'); }
      }
    return null;
  };
  const hide = () => { if (!input()) requestAnimationFrame(hide); };
  hide();
  const send = () => {
    timer = 0;
    const field = queue.length ? input() : null;
    if (!field) { if (queue.length) timer = setTimeout(send, EVERY); return; }
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
    set.call(field, (++number) + ' ' + queue.shift());
    field.dispatchEvent(new Event('input', {bubbles: true}));
    timer = setTimeout(send, EVERY);
  };
  const tell = (text) => {
    const last = queue.length - 1;
    if (text.startsWith('hover') && last >= 0 && queue[last].startsWith('hover')) queue[last] = text;
    else queue.push(text);
    if (!timer) send();
  };
  const mark = (name) => {
    for (const on of document.querySelectorAll('.og .near')) on.classList.remove('near');
    if (!name) return;
    for (const node of document.querySelectorAll('.og [data-node="' + name + '"]')) node.classList.add('near');
    for (const edge of document.querySelectorAll('.og [data-ends]')) {
      const ends = edge.dataset.ends.split(' ');
      if (!ends.includes(name)) continue;
      edge.classList.add('near');
      for (const end of ends)
        for (const node of document.querySelectorAll('.og [data-node="' + end + '"]')) node.classList.add('near');
    }
  };
  document.addEventListener('pointerover', (event) => {
    const at = event.target instanceof Element ? event.target.closest('[data-hover]') : null;
    const name = at ? at.dataset.hover : '';
    if (at || hovered) mark(name);
    if (name === hovered) return;
    hovered = name;
    tell('hover ' + name);
  });
  document.documentElement.addEventListener('keydown', (event) => {
    const at = event.target instanceof Element ? event.target.closest('[role=slider]') : null;
    if (at) event.stopPropagation();
  });
  document.addEventListener('click', (event) => {
    const at = event.target instanceof Element ? event.target.closest('[data-click]') : null;
    if (at && !at.disabled) tell(at.dataset.click);
  });
})();

/* Keys of the apps on scans; stage.py puts in the label of the text field that each of some keys leads to,
   and the labels of those from which Enter presses S. */
(() => {
  if (window.stageKeys) return;
  window.stageKeys = true;
  const fields = FIELDS, saving = SAVING;
  const isField = (node) => node instanceof Element && node.closest('input,textarea');
  const fieldOf = (name) => {
    for (const label of document.querySelectorAll('label'))
      if (label.textContent === name) {
        let around = label;
        while (around && !around.querySelector('input')) around = around.parentElement;
        if (around) return around.querySelector('input');
      }
    return null;
  };
  window.addEventListener('keydown', (event) => {
    if (event.repeat && !isField(event.target)) { event.stopImmediatePropagation(); return; }
    if (isField(event.target)) {
      if (event.isComposing || (event.key !== 'Enter' && event.key !== 'Escape')) return;
      event.target.blur();
      event.stopImmediatePropagation();
      if (event.key === 'Escape' || !saving.some((name) => fieldOf(name) === event.target)) return;
      /* viser sends what was typed within 50 ms */
      setTimeout(() => document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 's', bubbles: true})), 200);
      return;
    }
    const field = event.ctrlKey || event.metaKey || event.altKey ? null : fieldOf(fields[event.key.toLowerCase()]);
    if (!field) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    field.focus();
    field.select();
  }, true);
  document.documentElement.addEventListener('keydown', (event) => {
    if (!isField(event.target)) event.stopPropagation();
  });
})();

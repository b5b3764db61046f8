"""From our own HTML in viser's panels to the server: hovering and clicking become text messages in a hidden input.

viser tells nothing about its HTML elements, but it does about text inputs. The script listens on the whole page for
elements with `data-hover` and `data-click`, and types into the input; at most ten messages a second leave, of which
clicks are never dropped. It also marks graph nodes under the mouse at once, without waiting for the server, and keeps
the arrow keys that move a slider from turning viser's camera as well.
"""

from collections.abc import Awaitable, Callable

import viser

LABEL = "messages of this page"
"""By which the script finds its input; viser sends no ids to scripts."""
EVERY_MS = 100
_SCRIPT = """
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
    if (at && !at.disabled) tell('click ' + at.dataset.click);
  });
})();
"""
_NEAR = """
<style>
.og .node.near rect{fill:#ffe9a8;stroke:#a86b00;stroke-width:2.4}
.og .edge.near{opacity:1;stroke-width:3.2}
</style>
"""
Listen = Callable[[str], Awaitable[None]]


def open_channel(client: viser.ClientHandle, listen: Listen) -> None:
    """Sends the script to a browser; each message is given to `listen`: `hover NODE` or `click WORDS`, in order."""
    field = client.gui.add_text(LABEL, "")

    @field.on_update
    async def _(_: object) -> None:
        await listen(field.value.partition(" ")[2])

    script = _SCRIPT.replace("LABEL", LABEL).replace("EVERY", str(EVERY_MS)).replace("&", "&amp;")
    script = script.replace('"', "&quot;").replace("<", "&lt;")
    client.gui.add_html(f'{_NEAR}<img src="data:," style="display:none" alt="" onerror="{script}">')

"""What the widgets, the home, the loader and our own HTML tell a visitor, and the queue from which its thread takes it.

viser tells nothing about its HTML elements, but it does about text inputs: hovering and clicking become text messages
in a hidden input. The script listens on the whole page for elements with `data-hover` and `data-click`, and types into
the input; at most ten messages a second leave, of which clicks are never dropped. It also marks graph nodes under the
mouse at once, without waiting for the server, and keeps the arrow keys that move a slider from turning viser's camera.
"""

import queue
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future
from typing import NamedTuple

import viser

from .catalogue import Wanted
from .library import OpenHome

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


class Filtered(NamedTuple):
    """The filter was changed."""

    wanted: Wanted


class Said(NamedTuple):
    """Our own HTML was hovered or clicked: `hover NODE`, `click WORDS`."""

    words: str


class Stepped(NamedTuple):
    """To an episode before (-1) or after (+1)."""

    by: int


class Slid(NamedTuple):
    """The slider stands at a step of the run."""

    step: int


class BoxClicked(NamedTuple):
    """The box of an object node was clicked in 3-D."""

    index: int


class HomeOpened(NamedTuple):
    """A home that was asked for is there, or cannot be opened."""

    scene: str
    home: "Future[OpenHome]"


Message = Filtered | Said | Stepped | Slid | BoxClicked | HomeOpened


class MessageQueue:
    """Messages in order; of those that overtake each other only the last is handed out."""

    def __init__(self) -> None:
        """Starts empty."""
        self._queue: queue.SimpleQueue[Message | None] = queue.SimpleQueue()

    def put(self, message: Message) -> None:
        """Never waits."""
        self._queue.put(message)

    def end(self) -> None:
        """Ends the iteration, whatever is still to be handed out."""
        self._queue.put(None)

    def __iter__(self) -> Iterator[Message]:
        """Waits for each message; ends after `end`."""
        while (batch := self._next_batch()) is not None:
            yield from batch

    def _next_batch(self) -> list[Message] | None:
        """All messages that are there, at least one; None at the end."""
        batch: list[Message] = []
        message = self._queue.get()
        while message is not None:
            if batch and _overtakes(message, batch[-1]):
                batch.pop()
            batch.append(message)
            if self._queue.empty():
                return batch
            message = self._queue.get()
        return None


def _overtakes(new: Message, old: Message) -> bool:
    """Whether the old message need not be handled any more: sliders, typing and the mouse are faster than homes."""
    if isinstance(new, Said) and isinstance(old, Said):
        return new.words.startswith("hover") and old.words.startswith("hover")
    return isinstance(new, (Filtered, Slid)) and type(new) is type(old)


def open_channel(client: viser.ClientHandle, listen: Listen) -> None:
    """Sends the script to a browser; each message is given to `listen`: `hover NODE` or `click WORDS`, in order."""
    field = client.gui.add_text(LABEL, "")

    @field.on_update
    async def _(_: object) -> None:
        await listen(field.value.partition(" ")[2])

    script = _SCRIPT.replace("LABEL", LABEL).replace("EVERY", str(EVERY_MS)).replace("&", "&amp;")
    script = script.replace('"', "&quot;").replace("<", "&lt;")
    client.gui.add_html(f'{_NEAR}<img src="data:," style="display:none" alt="" onerror="{script}">')

"""The script in a participant's page and the messages that it sends: `static/page.js`, typed on this side.

viser offers no way to run a script or to hear of a page's focus; like `browse.messages` we put a script into an HTML
element and let it type into a hidden text input. What arrives is checked here; nothing in it is trusted.
"""

import functools
import json
import secrets
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import viser

STATIC = Path(__file__).parent / "static"
LABEL = "messages of this page"
"""By which the script finds its input; viser sends no ids to scripts."""
KEY_PATTERN = r"^(Key[A-Z]|Digit[0-9]|Numpad[0-9]|Arrow(Up|Down|Left|Right)|Enter|NumpadEnter|Space)\Z"
Number = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Milliseconds = Annotated[float, msgspec.Meta(ge=0, le=1e12)]
Pixels = Annotated[int, msgspec.Meta(ge=0, le=100_000)]
KeyCode = Annotated[str, msgspec.Meta(pattern=KEY_PATTERN)]
KeyAction = Literal["forward", "left", "right", "look_up", "look_down", "stop"]


class _Said(msgspec.Struct, frozen=True, tag_field="kind", forbid_unknown_fields=True):
    n: Number
    """Place among this page's messages, from 1; 0 = sent once, without an answer."""
    t_cli_ms: Milliseconds
    """The browser's `performance.now`."""


class Device(_Said, frozen=True, tag="device"):
    """What the page has to work with; first message of each connection, and after each resize."""

    webgl2: bool
    width: Pixels
    height: Pixels


class Pressed(_Said, frozen=True, tag="press"):
    """A key is about to be sent as a command."""

    code: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9]{0,32}\Z")]
    """`KeyboardEvent.code`, before any remapping; empty for keys that have none."""


class PageTold(_Said, frozen=True, tag="page"):
    """Something happened to the page."""

    what: Literal["focus", "blur", "hidden", "visible", "context_lost"]


class RoundTrip(_Said, frozen=True, tag="round_trip"):
    """How long a message and its acknowledgement took."""

    ms: Milliseconds


class Ping(_Said, frozen=True, tag="ping"):
    """Is somebody there?"""


class OwnKeys(_Said, frozen=True, tag="keys"):
    """The participant chose these keys; actions that are not named keep theirs."""

    keys: dict[KeyAction, KeyCode]


class Told(_Said, frozen=True, tag="told"):
    """A button of our own HTML (`data-tell`) was pressed."""

    name: Annotated[str, msgspec.Meta(max_length=32)]


Said = Device | Pressed | PageTold | RoundTrip | Ping | OwnKeys | Told
Listen = Callable[[Said], Awaitable[None]]


class _Letter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    seat: str
    said: Annotated[list[Said], msgspec.Meta(max_length=40)]


def said_in(text: str, *, seat: str) -> tuple[Said, ...]:
    """The messages in what the hidden input holds; () when they are damaged or of another connection."""
    try:
        letter = msgspec.json.decode(text, type=_Letter)
    except msgspec.MsgspecError:
        return ()
    return tuple(letter.said) if letter.seat == seat else ()


class PageMessages:
    """What the script in one connection's page tells."""

    def __init__(self, client: viser.ClientHandle, listen: Listen, *, actions: Sequence[KeyAction]) -> None:
        """Hears nothing yet; call `begin` when the participant's keys are known.

        Args:
            client: The connection.
            listen: Told each message once, in order, on viser's event loop: it must only put it on a queue.
            actions: What the participant has keys for.
        """
        self._client, self._listen = client, listen
        self._actions = tuple(actions)
        self._seat = secrets.token_urlsafe(9)
        self._last = 0
        self._begun = client.gui.add_html("")
        self._acknowledged = client.gui.add_html("")
        self._field = client.gui.add_text(LABEL, "")
        self._field.on_update(self._on_text)  # type: ignore[arg-type]  # viser awaits it

    def begin(self, own_keys: Mapping[KeyAction, str]) -> None:
        """Starts the script's reports, with the keys that the participant chose before."""
        told = ",".join(json.dumps(value) for value in (self._seat, dict(own_keys), list(self._actions)))
        self._begun.content = _runs(_call(f"begin({told})"))

    async def _on_text(self, _: object) -> None:
        last = self._last
        for said in said_in(self._field.value, seat=self._seat):
            if said.n == 0 or said.n > self._last:
                self._last = max(self._last, said.n)
                await self._listen(said)
        if self._last > last:
            self._acknowledged.content = _runs(_call(f"acknowledge({self._last})"))


@functools.cache
def script() -> str:
    """`static/page.js`."""
    return (STATIC / "page.js").read_text(encoding="utf-8")


@functools.cache
def style_sheet() -> str:
    """`static/tokens.css` and `static/page.css`."""
    return "".join((STATIC / name).read_text(encoding="utf-8") for name in ("tokens.css", "page.css"))


def page_html(*, panel_width: int) -> str:
    """HTML that puts style sheet and script into a page, once for each connection.

    Args:
        panel_width: Pixels of the side panel.
    """
    return f"<style>:root {{ --personal-panel: {panel_width}px; }}\n{style_sheet()}</style>{_runs(script())}"


def when_shown(call: Literal["shown", "refresh", "reload", "goOn"]) -> str:
    """HTML that calls one of the script's functions as soon as it is in the page."""
    return _runs(_call(f"{call}()"))


def sign_html(text: str, number: int) -> str:
    """HTML that has the script show a line over the picture; empty text = takes it away.

    Args:
        text: Plain text.
        number: Another one has the same text shown and read aloud again.
    """
    return _runs(_call(f"sign({json.dumps(text)},{number})"))


def _call(call: str) -> str:
    """A call of the script, as soon as the page has it."""
    return f"(function go(){{window.personalPage?window.personalPage.{call}:setTimeout(go,20)}})()"


def _runs(source: str) -> str:
    """An invisible picture that cannot be loaded, whose error handler is the script."""
    source = source.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;").replace(">", "&gt;")
    return f'<img src="data:," style="display:none" alt="" onerror="{source}">'

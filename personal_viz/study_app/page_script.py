"""The script in a participant's page, `static/page.js`, and types for the messages that it sends.

viser offers no way to run a script or to learn of a page's focus. Like `browse.panels`, we put a script into an HTML
element and let it type into a hidden text input. Its messages are checked here and never trusted.

A page keeps viser's client and our script for as long as it is open, but a study that was updated and is served again
may use other messages. So a page knows its version, from `static/updated.js` and its websocket's address.
"""

import functools
import hashlib
import html
import json
import re
import secrets
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import viser

from human_study.texts.catalogue import Catalogue
from sim.page_style import TOKENS, tokens_css

STATIC = Path(__file__).parent / "static"
VISER_CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"
PAGE_FILES = ("page.js", "card.css", "page.css", "updated.js")
"""Files of `static` in a page, besides viser's client and the tokens of the design system."""
VISER_TITLE = b"<title>Viser</title>"
SUBPROTOCOL = f"viser-v{viser.__version__}"
"""Websocket subprotocol that viser's client of this version asks for."""
_VERSION_PLACE = "PAGE_VERSION"
"""Placeholder for the version in `updated.js`."""
_WORDS_PLACE = "PAGE_WORDS"
"""Placeholder for the words that a script shows."""
LABEL = "messages of this page"
"""Label by which the script finds its input, because viser sends no ids to scripts."""
KEY_PATTERN = r"^(Key[A-Z]|Digit[0-9]|Numpad[0-9]|Arrow(Up|Down|Left|Right)|Enter|NumpadEnter|Space)\Z"
Number = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Milliseconds = Annotated[float, msgspec.Meta(ge=0, le=1e12)]
Pixels = Annotated[int, msgspec.Meta(ge=0, le=100_000)]
KeyCode = Annotated[str, msgspec.Meta(pattern=KEY_PATTERN)]
KeyAction = Literal["forward", "left", "right", "look_up", "look_down", "stop", "found"]


class _Said(msgspec.Struct, frozen=True, tag_field="kind", forbid_unknown_fields=True):
    n: Number
    """Number of the message within this page, from 1; 0 = sent once, without an answer."""
    t_cli_ms: Milliseconds
    """Time by the browser's `performance.now`."""


class Device(_Said, frozen=True, tag="device"):
    """The page's size and abilities; the first message of each connection, repeated after each resize."""

    webgl2: bool
    width: Pixels
    height: Pixels


class Pressed(_Said, frozen=True, tag="press"):
    """A key is about to be sent as the command of an action."""

    action: KeyAction
    code: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9]{0,32}\Z")]
    """`KeyboardEvent.code`, before any remapping; empty for keys that have none."""


class PageTold(_Said, frozen=True, tag="page"):
    """Something happened to the page."""

    what: Literal["focus", "blur", "hidden", "visible", "context_lost"]


class RoundTrip(_Said, frozen=True, tag="round_trip"):
    """The time that a message and its acknowledgement took."""

    ms: Milliseconds


class Ping(_Said, frozen=True, tag="ping"):
    """The question whether the server is there."""


class OwnKeys(_Said, frozen=True, tag="keys"):
    """The keys that the participant chose; other actions keep theirs."""

    keys: dict[KeyAction, KeyCode]


class Told(_Said, frozen=True, tag="told"):
    """The answer to a question of the page's own dialog, such as whether to withdraw."""

    name: Annotated[str, msgspec.Meta(max_length=32)]


Said = Device | Pressed | PageTold | RoundTrip | Ping | OwnKeys | Told
Listen = Callable[[Said], Awaitable[None]]


class _Letter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    seat: str
    said: Annotated[list[Said], msgspec.Meta(max_length=40)]


def said_in(text: str, *, seat: str) -> tuple[Said, ...]:
    """The messages in the text of the hidden input; () when they are damaged or belong to another connection."""
    try:
        letter = msgspec.json.decode(text, type=_Letter)
    except msgspec.MsgspecError:
        return ()
    return tuple(letter.said) if letter.seat == seat else ()


class PageMessages:
    """Receives the messages of the script in one connection's page."""

    def __init__(self, client: viser.ClientHandle, listen: Listen, *, actions: Sequence[KeyAction]) -> None:
        """Receives nothing yet; call `begin` when the participant's keys are known.

        Args:
            client: The connection.
            listen: Called with each message once, in order, on viser's event loop; it may only put it on a queue.
            actions: Actions for which the participant has keys.
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
def page_html(words: Catalogue) -> str:
    """HTML that puts the style sheets and the script, in a language, into a page, once for each connection."""
    script, *styles = ((STATIC / name).read_text(encoding="utf-8") for name in PAGE_FILES[:3])
    script = script.replace(_WORDS_PLACE, _json(words.under("script", "key", "leave", "study")))
    return f"<style>{tokens_css()}{''.join(styles)}</style>{_runs(script)}"


def when_shown(call: Literal["shown", "begun", "refresh", "reload", "goOn"]) -> str:
    """HTML that calls one of the script's functions as soon as it is in the page."""
    return _runs(_call(f"{call}()"))


def sign_html(text: str, number: int, *, is_news: bool = False) -> str:
    """HTML that makes the script show a line over the picture; an empty text removes the line.

    Args:
        text: Plain text.
        number: A different number makes the same text be shown and read aloud again.
        is_news: Whether the line tells of something new and asks for nothing.
    """
    return _runs(_call(f"sign({json.dumps(text)},{number},{json.dumps(is_news)})"))


@functools.cache
def page_version() -> str:
    """12 hex digits of a hash of this program's version, viser's, and every file of a page."""
    hashed = hashlib.sha256(f"{version('personal-viz')} {viser.__version__}".encode())
    for path in (VISER_CLIENT, TOKENS, *(STATIC / name for name in PAGE_FILES)):
        hashed.update(hashlib.sha256(path.read_bytes()).digest())
    return hashed.hexdigest()[:12]


def page_of(served: str, words: Catalogue) -> bytes:
    """viser's client with our style and our script, which checks whether its version is still the served one."""
    assert re.fullmatch(r"[\w.-]{1,64}", served, re.ASCII), served
    script = (STATIC / "updated.js").read_text(encoding="utf-8").replace(_VERSION_PLACE, served)
    script = script.replace(_WORDS_PLACE, _json(words.under("updated")))
    client = VISER_CLIENT.read_bytes()
    head, begin, rest = client.partition(b"<head>")
    assert begin, f"{VISER_CLIENT}: found no <head>"
    style = f"<style>{tokens_css()}</style>"
    return b"".join(
        (
            head,
            begin,
            f"{style}<script>{script}</script>".encode(),
            rest.replace(VISER_TITLE, f"<title>{html.escape(words('study.title'))}</title>".encode(), 1),
        )
    )


def is_other_viser(offered: Iterable[str]) -> bool:
    """Whether a websocket asks for viser's protocol, but not for that of this version."""
    asked = [name for name in offered if name.startswith("viser-v")]
    return bool(asked) and SUBPROTOCOL not in asked


def _json(words: Mapping[str, str]) -> str:
    """The words as a literal of JavaScript that cannot end a script."""
    return json.dumps(words).replace("<", "\\u003c")


def _call(call: str) -> str:
    """JavaScript that calls the page's script as soon as the page has it."""
    return f"(function go(){{window.personalPage?window.personalPage.{call}:setTimeout(go,20)}})()"


def _runs(source: str) -> str:
    """HTML that runs a script: an invisible picture that cannot be loaded, with the script as its error handler."""
    return f'<img src="data:," style="display:none" alt="" onerror="{html.escape(source)}">'

"""The door to the terminal: names from files and folders are printed without control characters.

A file's name may hold codes that a terminal obeys: colours, another window title, a cleared line, text from right to
left.
While `printable_streams` is in force, `print` shows such characters as JSON would (`\\u001b`), so JSON stays the same
JSON. Tables and progress bars are drawn by `Console`, whose own colours stay while its texts are treated alike.
"""

import contextlib
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, TextIO

import rich.console
from rich.segment import Segment

_REFUSED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""C0 and C1 except tab and newline, marks that turn the direction of text, line separators, bytes that are no UTF-8."""


def printable(text: str) -> str:
    """The text with each control character as `\\uXXXX`; newlines and tabs stay."""
    return _REFUSED.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def one_line(text: str) -> str:
    """`printable` text on one line: each run of white space becomes a single space."""
    return printable(" ".join(text.split()))


class Console(rich.console.Console):
    """Rich's console, whose texts hold no control characters; its own (colours, a moving bar) stay."""

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        for segment in super().render(*arguments, **options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))


class _Printable:
    """A text stream that writes `printable` text."""

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream  # Rich writes to the stream itself, whose colours would else be shown as text

    def write(self, text: str) -> int:
        self.rich_proxied_file.write(printable(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


@contextlib.contextmanager
def printable_streams() -> Iterator[None]:
    """Everything that is printed inside the block is `printable`."""
    out, err = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Printable(out), _Printable(err)  # type: ignore[assignment]
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err

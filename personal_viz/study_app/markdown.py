"""Markdown of the pages that participants read as HTML: the researcher's texts and our own templates.

HTML in a text stays text, links are reduced to their words, and pictures come only from `static`. So nothing in a text
can become a script, lead elsewhere or load anything.
"""

import base64
import functools
import re
from collections.abc import Sequence
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.common.utils import escapeHtml
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token

from .page_script import STATIC

_HEADING = re.compile(r"^#{1,4}\s+(.*)$")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def html_from_markdown(text: str) -> str:
    """HTML of a text; a heading in its first line is left out (`title_of`)."""
    _, body = _split_title(text)
    return _reader().render(body)


def title_of(text: str, *, otherwise: str) -> str:
    """The heading at the beginning of the text as plain words, or `otherwise` where there is none."""
    title, _ = _split_title(text)
    return title or otherwise


def _split_title(text: str) -> tuple[str, str]:
    text = _COMMENT.sub("", text).strip()
    first, _, rest = text.partition("\n")
    heading = _HEADING.match(first.strip())
    return (heading.group(1).strip(), rest) if heading is not None else ("", text)


class _Html(RendererHTML):
    """HTML of our pages: one size of heading, keys as keys, no links, pictures of `static`."""

    def heading_open(self, *_: Any) -> str:
        """A heading, one level below the card's title."""
        return "<h2>"

    def heading_close(self, *_: Any) -> str:
        """The end of `heading_open`."""
        return "</h2>"

    def link_open(self, *_: Any) -> str:
        """The start of a link's words; the link itself is left out, because a page of the study leads nowhere else."""
        return ""

    def link_close(self, *_: Any) -> str:
        """The end of `link_open`."""
        return ""

    def code_inline(self, tokens: Sequence[Token], index: int, *_: Any) -> str:
        """Inline code, shown as a key."""
        return f"<kbd>{escapeHtml(tokens[index].content)}</kbd>"

    def image(self, tokens: Sequence[Token], index: int, *_: Any) -> str:  # pyright: ignore[reportIncompatibleMethodOverride]
        """One of our own pictures; any other picture is replaced by its words."""
        alt, name = tokens[index].content, str(tokens[index].attrs["src"])
        return _picture(name, escapeHtml(alt)) if name in _picture_names() else escapeHtml(alt)


@functools.cache
def _reader() -> MarkdownIt:
    """A reader of CommonMark with tables, in which an indented line is not code."""
    return MarkdownIt("commonmark", {"html": False}, renderer_cls=_Html).enable("table").disable("code")


@functools.cache
def _picture_names() -> frozenset[str]:
    return frozenset(path.name for path in STATIC.glob("*.jpg"))


@functools.cache
def _picture(name: str, alt: str) -> str:
    """A picture of `static`, embedded in the page."""
    data = base64.b64encode((STATIC / name).read_bytes()).decode()
    return f'<img src="data:image/jpeg;base64,{data}" alt="{alt}">'

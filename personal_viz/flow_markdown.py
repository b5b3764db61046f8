"""The researcher's texts (`consent.md`, `instructions.md`) as HTML: headings, paragraphs, lists, bold and italic.

A small part of Markdown, written here so that nothing in a text can become a script or load anything from elsewhere.
"""

import html
import re

_HEADING = re.compile(r"^(#{1,4})\s+(.*)$")
_BULLET = re.compile(r"^\s*[-*]\s+(.*)$")
_NUMBER = re.compile(r"^\s*\d+[.)]\s+(.*)$")
_BOLD = re.compile(r"\*\*(.+?)\*\*")
_ITALIC = re.compile(r"(?<![*\w])[*_](?!\s)(.+?)(?<!\s)[*_](?![*\w])")
_KEY = re.compile(r"`([^`]+)`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def html_from_markdown(text: str) -> str:
    """HTML of a text; its first heading, when it is the first line, is left out (`title_of`).

    Links become their words, because a study's page leads nowhere else.
    """
    _, body = _split_title(text)
    parts: list[str] = []
    lines: list[str] = []
    kind = ""

    def close() -> None:
        nonlocal lines
        if lines:
            inside = " ".join(lines) if kind == "p" else "".join(f"<li>{line}</li>" for line in lines)
            parts.append(f"<{kind}>{inside}</{kind}>")
        lines = []

    for line in body.splitlines():
        heading = _HEADING.match(line)
        bullet, number = _BULLET.match(line), _NUMBER.match(line)
        if heading is not None or not line.strip():
            close()
            kind = ""
            if heading is not None:
                parts.append(f"<h2>{_inline(heading.group(2))}</h2>")
            continue
        item = bullet or number
        new_kind = "ul" if bullet else "ol" if number else kind or "p"
        if new_kind != kind:
            close()
            kind = new_kind
        if item is not None:
            lines.append(_inline(item.group(1)))
        elif kind in ("ul", "ol") and lines:
            lines[-1] += " " + _inline(line.strip())
        else:
            lines.append(_inline(line.strip()))
    close()
    return "".join(parts)


def title_of(text: str, *, otherwise: str) -> str:
    """The heading with which the text begins, as plain words."""
    title, _ = _split_title(text)
    return title or otherwise


def _split_title(text: str) -> tuple[str, str]:
    text = _COMMENT.sub("", text).strip()
    first, _, rest = text.partition("\n")
    heading = _HEADING.match(first.strip())
    return (heading.group(2).strip(), rest) if heading is not None else ("", text)


def _inline(text: str) -> str:
    text = html.escape(_LINK.sub(r"\1", text), quote=False)
    text = _KEY.sub(r"<kbd>\1</kbd>", text)
    return _ITALIC.sub(r"<em>\1</em>", _BOLD.sub(r"<strong>\1</strong>", text))

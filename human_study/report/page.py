"""A report in Markdown as one HTML page that needs no other file."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 78rem; padding: 0 1rem; color: #1b1b1b; }
table { border-collapse: collapse; margin: .6rem 0; font-size: 13px; }
th, td { border: 1px solid #c9c9c9; padding: .25rem .5rem; text-align: left; vertical-align: top; }
thead th { background: #f0f0ee; }
table + p { color: #4d4d4d; font-size: 12.5px; margin: 0 0 1rem; }
figure { margin: 1rem 0; overflow-x: auto; }
figcaption { color: #4d4d4d; font-size: 13px; }
"""


def html_page(markdown: str, pictures: Mapping[str, str]) -> str:
    """The text as a page: the first column of a table names its rows, and pictures stand in the page.

    Args:
        markdown: Headings, paragraphs, tables, and pictures that stand alone.
        pictures: SVG text by name; the pictures that the text names are put into the page.
    """
    reader = MarkdownIt("commonmark", {"html": False}, renderer_cls=_Html).enable("table").disable(["link", "code"])
    tokens = reader.parse(markdown)
    for at, token in enumerate(tokens):
        if token.type == "tr_open" and tokens[at + 1].type == "td_open":
            tokens[at + 1].tag = tokens[at + 3].tag = "th"
        if [child.type for child in token.children or ()] == ["image"]:
            tokens[at - 1].tag = tokens[at + 1].tag = "figure"
    body = reader.renderer.render(tokens, reader.options, {"pictures": pictures})
    title = next((tokens[at + 1].content for at, token in enumerate(tokens) if token.tag == "h1"), "Report")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    )


class _Html(RendererHTML):
    """HTML with pictures drawn in place."""

    def image(self, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
        """The picture and its caption; a picture that is not at hand is replaced by its name."""
        name = str(tokens[index].attrs["src"])
        caption = self.renderInlineAsText(tokens[index].children or (), options, env)
        drawn = env["pictures"].get(name, "")
        inline = drawn[drawn.index("<svg") :] if "<svg" in drawn else escape(name)
        return f"{inline}<figcaption>{escape(caption)}</figcaption>"

"""The elements and the text of an HTML page."""

from html.parser import HTMLParser

VOID = ("img", "br", "input", "meta", "link", "hr")
"""Elements without an end tag."""


class Tags(HTMLParser):
    """All elements with their attributes, all text, and whether every element is closed in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self._is_in_order = True
        self.feed(page)

    @property
    def is_balanced(self) -> bool:
        """Whether every element is closed in order."""
        return self._is_in_order and not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        self._is_in_order &= self._open[-1:] == [tag]
        self._open = self._open[:-1]

    def handle_data(self, data: str) -> None:
        self.text += data

"""The texts beside the picture: query and paragraph, or the present search of a home sequence and its messages.

A view holds what may be known in its search, so nothing of a later one reaches the browser.
"""

import html
import re

import viser

from human_study.texts.catalogue import Catalogue
from human_study.trial.views import Note, PanView, PogView, SearchView

from ..page_script import when_shown
from .page import Page

_WORD = re.compile(r"[^\W\d_]+(?:-[^\W\d_]+)*")


class TaskTexts:
    """The query and the messages of the present search in a page's panel, until the next `Page.clear`."""

    def __init__(self, page: Page, *, has_history: bool) -> None:
        """Shows nothing yet.

        Args:
            page: The participant's page.
            has_history: Whether messages of earlier searches can be read again.
        """
        self._page, self._has_history = page, has_history
        self._search: int | None = None
        self._query: viser.GuiHtmlHandle | None = None
        self._messages: viser.GuiHtmlHandle | None = None

    def add_query(self, view: PanView | PogView) -> None:
        """Adds the query and, of a sequence, the number of the search."""
        self._query = self._page.client.gui.add_html(query_html(view, self._page.words))
        self._page.add(self._query)

    def add_description(self, view: PanView | PogView) -> None:
        """Adds the text of an episode, or the messages of a sequence."""
        self._search = view.search
        if view.num_searches is None:
            task, words = view.task, self._page.words
            self._page.add(self._page.client.gui.add_html(description_html(task.description, task.queries[0], words)))
            return
        self._messages = self._page.client.gui.add_html(self._messages_html(view))
        self._page.add(self._messages)

    def show(self, view: PanView | PogView) -> None:
        """Draws the changes of the view; a search that begins is shown from the top of the panel."""
        if view.num_searches is None or self._query is None or self._messages is None:
            return
        query = query_html(view, self._page.words)
        if self._query.content != query:
            self._query.content = query
        if view.search != self._search:
            self._search = view.search
            self._messages.content = self._messages_html(view)

    def _messages_html(self, view: SearchView) -> str:
        return messages_html(view, self._page.words, has_history=self._has_history)


def query_html(view: PanView | PogView, words: Catalogue) -> str:
    """HTML of the query; in a sequence below the number of the search and, where all are wanted, of marks."""
    query = f'<p class="personal-query">{html.escape(view.task.queries[0])}</p>'
    if view.num_searches is None:
        return query
    line = search_name(view, words)
    if view.is_for_all:
        count = view.num_marks if isinstance(view, PanView) else len(view.marks)
        line += " \N{MIDDLE DOT} " + words("search.one_mark" if count == 1 else "search.marks", count=count)
    shown = f'<p class="personal-search" data-search="{view.search}" role="status" aria-live="polite">'
    return f"{shown}{html.escape(line)}</p>{query}"


def search_name(view: SearchView, words: Catalogue) -> str:
    """ "Search 3 of 7"."""
    return words("search.number", number=view.search + 1, all=view.num_searches)


def news_of(view: SearchView, words: Catalogue) -> str:
    """The line over the picture when a search begins after another one; empty in the first one."""
    if view.num_searches is None or view.search == 0:
        return ""
    is_told = any(note.search == view.search for note in view.notes)
    key = "search.next_told" if is_told else "search.next"
    return words(key, search=search_name(view, words), query=view.query)


def messages_html(view: SearchView, words: Catalogue, *, has_history: bool) -> str:
    """HTML of the messages, the newest first, each with the search before which it came.

    Args:
        view: A view of a sequence.
        words: The study's language.
        has_history: Whether messages of earlier searches can be read again.
    """
    pattern = name_pattern(view.query, "\n".join(note.text for note in view.notes))
    told = "".join(_note_html(note, view, words, pattern) for note in reversed(view.notes))
    is_told = any(note.search == view.search for note in view.notes)
    none = "" if is_told else f'<p class="personal-quiet">{html.escape(words("message.none"))}</p>'
    kept = html.escape(words("message.kept" if has_history else "message.gone"))
    return (
        '<div class="personal-text personal-description scroll" tabindex="0" role="region" '
        f'aria-label="{html.escape(words("message.title"))}">{names_button_html(words) if pattern else ""}'
        f'<p class="personal-quiet">{kept}</p>{none}{told}</div>{when_shown("begun")}'
    )


def _note_html(note: Note, view: SearchView, words: Catalogue, pattern: str) -> str:
    is_new = note.search == view.search and view.search > 0
    date = html.escape(words("message.date", search=note.search + 1))
    new = f' <b class="personal-new">{html.escape(words("message.new"))}</b>' if is_new else ""
    lines = "".join(f"<p>{names_html(line, pattern)}</p>" for line in re.split(r"\n+", note.text) if line.strip())
    return (
        f'<article class="personal-note{" personal-note-new" if is_new else ""}"><h2>{date}{new}</h2>{lines}</article>'
    )


def description_html(description: str, query: str, words: Catalogue) -> str:
    """HTML of the paragraph; where it has names of the query, a button above it highlights them."""
    pattern = name_pattern(query, description)
    tool = names_button_html(words) if pattern else ""
    return (
        '<div class="personal-text personal-description scroll" tabindex="0" role="region" '
        f'aria-label="{html.escape(words("task.description"))}">{tool}<p>{names_html(description, pattern)}</p></div>'
    )


def name_pattern(query: str, text: str) -> str:
    """A regular expression for the names of the query in a text; empty where it has none."""
    return "|".join(rf"\b{re.escape(name)}\b" for name in names_in(query, text))


def names_button_html(words: Catalogue) -> str:
    """HTML of the button that highlights names in the element around it."""
    on, off = (html.escape(words(f"task.names_{state}")) for state in ("on", "off"))
    return (
        f'<button type="button" data-tool="names" data-other="{off}" aria-pressed="false">'
        f'<span class="personal-room" data-before="{on}" data-after="{off}"><span>{on}</span></span></button>'
    )


def names_html(text: str, pattern: str) -> str:
    """HTML of a text, in which what the pattern finds can be highlighted."""
    escaped = [html.escape(part) for part in (re.split(f"({pattern})", text) if pattern else [text])]
    escaped[1::2] = [f'<span class="personal-name">{part}</span>' for part in escaped[1::2]]
    return "".join(escaped)


def names_in(query: str, description: str) -> tuple[str, ...]:
    """The words of the query that are names: with a capital in both texts, once or more inside a sentence.

    Only these texts are read. The people of the ownership graph are ground truth, which the page must not know.
    """
    asked = [match[0] for match in _WORD.finditer(query)]
    told = {match[0] for match in _WORD.finditer(description)}
    inside = {
        match[0]
        for text in (query, description)
        for match in _WORD.finditer(text)
        if not _begins(text[: match.start()])
    }
    return tuple(dict.fromkeys(word for word in asked if word[0].isupper() and word in told & inside))


def _begins(before: str) -> bool:
    """Whether a sentence begins after this text."""
    return re.search(r"(?:^|[.!?:])\W*$", before) is not None

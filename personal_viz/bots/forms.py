"""Answers the pages of a study that are HTML forms; a bot finds buttons by their labels, as people do."""

import contextlib
import http.client
import json
import re
from collections.abc import Collection
from dataclasses import dataclass
from html.parser import HTMLParser
from typing import NamedTuple
from urllib.parse import urlencode, urlsplit

from human_study.design.study import Language, StudyConfig
from human_study.texts.catalogue import catalogue_of
from human_study.texts.quiz import questions_for
from sim.errors import StudyError
from sim.types import TaskKind

ENTER_S = 60.0
"""Longest wait for the gateway's answers."""
MOST_PAGES = 200
"""Largest number of pages in a row; a bot that answers more goes round in circles."""
DEVICE = {"webgl2": "1", "width": "1280", "height": "800", "pressed": "1"}
"""Fields that a bot's browser sends from the device check."""
_LEADS_ON = (
    *("device.continue", "consent.agree", "instructions.read", "instructions.start", "page.next", "page.go_on"),
    *("survey.send", "problem.paused.again"),
)
"""Words of the buttons that lead on; no page has two of them."""


@dataclass(frozen=True, slots=True)
class Session:
    """A session that the gateway gave for a personal link."""

    origin: str
    cookie: str
    page: str
    """Path of the participant's pages."""
    view: str
    """Address of viser's page."""


class Reply(NamedTuple):
    """The gateway's reply to a request."""

    status: int
    where: str
    """Path and query to which it leads; empty if it does not lead elsewhere."""
    text: str
    cookie: str
    """Its cookies, as a browser sends them back."""


@dataclass(frozen=True, slots=True)
class LastPage:
    """A page at which a bot stops."""

    place: str
    """A place as `human_study.journey` names it: `finished`, `pause`, ..."""
    completion_code: str | None


def right_answers(config: StudyConfig, task: TaskKind = "pan") -> frozenset[str]:
    """The labels of all right answers in the quiz of a task's participants."""
    return frozenset(question.answers[0] for question in questions_for(config, task, config.conditions(task)))


def open_session(link: str) -> Session:
    """Trades a personal link's token for a session, as the entry page does.

    Raises:
        StudyError: The gateway does not let the bot in, or cannot be reached.
    """
    origin, _, token = link.partition("/#")
    reply = ask(origin, "/enter", body=json.dumps({"token": token}), kind="application/json")
    try:
        told = json.loads(reply.text)
        return Session(origin, reply.cookie, told["page"], told["view"])
    except (ValueError, KeyError):
        raise StudyError(
            f"{origin}/enter: answered {reply.status} {reply.text[:200]!r}; expected a session for a personal link. "
            "Check that the study is being served."
        ) from None


def answer_pages(
    session: Session, answers: frozenset[str] = frozenset(), *, language: Language = "en"
) -> LastPage | None:
    """Answers page after page.

    Args:
        session: The participant's session.
        answers: The right answers to the quiz.
        language: The study's language.

    Returns:
        None if viser's page comes next, else the page from which nothing leads on.

    Raises:
        StudyError: A page has no answer, or the gateway does not answer.
    """
    words = catalogue_of(language)
    labels = [*answers, *(words(key) for key in _LEADS_ON)]
    completion_code = re.compile(f'aria-label="{re.escape(words("end.completion_code"))}">([^<]+)<')
    path, fields = session.page, None
    for _ in range(MOST_PAGES):
        body = None if fields is None else urlencode(fields)
        reply = ask(session.origin, path, cookie=session.cookie, body=body)
        if reply.where.startswith("/view/"):
            return None
        if reply.where:
            path, fields = reply.where, None
            continue
        form = _Page(reply.text)
        pressed = form.press(labels)
        if reply.status != 200 or not form.place:
            raise StudyError(
                f"{session.origin}: a page answered with {reply.status}; expected one that a bot can read."
            )
        if pressed is None:
            code = completion_code.search(reply.text)
            return LastPage(form.place, code.group(1) if code else None)
        path, fields = pressed
    raise StudyError(f"{session.origin}: {MOST_PAGES} pages came one after the other; expected an end of them.")


def ask(
    origin: str,
    path: str,
    *,
    cookie: str = "",
    body: str | None = None,
    kind: str = "application/x-www-form-urlencoded",
) -> Reply:
    """The reply to a GET, or to a POST if there is a body of this kind; redirects are not followed.

    Raises:
        StudyError: The address does not answer in time.
    """
    parts = urlsplit(origin)
    make = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    headers = {"Cookie": cookie, "Origin": origin} | ({} if body is None else {"Content-Type": kind})
    try:
        with contextlib.closing(make(parts.netloc, timeout=ENTER_S)) as connection:
            connection.request("GET" if body is None else "POST", path, body, headers)
            found = connection.getresponse()
            text = found.read().decode()
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise StudyError(f"{origin}: {error}; expected a page. Check that the study is being served.") from None
    where = urlsplit(found.headers.get("Location", ""))
    given = (line.partition(";")[0] for line in found.headers.get_all("Set-Cookie") or ())
    return Reply(found.status, where._replace(scheme="", netloc="", fragment="").geturl(), text, "; ".join(given))


class _Page(HTMLParser):
    """The forms of a page and their buttons."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.place = ""
        """Where the participant is."""
        self._form: dict[str, str] = {}
        """Attributes of the last form."""
        self._fields: dict[str, str] = {}
        """Values of its hidden inputs."""
        self._buttons: list[_Button] = []
        self._in_button = False
        self.feed(text)

    def press(self, labels: Collection[str]) -> tuple[str, dict[str, str] | None] | None:
        """(address, fields to post or None) of the button with one of these labels; None if there is none."""
        return next((self._sent(button) for button in self._buttons if button.label.strip() in labels), None)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes forms, their hidden fields and their buttons."""
        given = {name: value or "" for name, value in attrs}
        if tag == "main":
            self.place = given.get("data-place", "")
        elif tag == "form":
            self._form, self._fields = given, {}
        elif tag == "input":
            self._fields[given["name"]] = given.get("value", "")
        elif tag == "button" and self._form:
            self._in_button = True
            self._buttons.append(_Button(self._form, self._fields, given))

    def handle_endtag(self, tag: str) -> None:
        """A button's label ends with it."""
        self._in_button = self._in_button and tag != "button"

    def handle_data(self, data: str) -> None:
        """Adds to the label of a button."""
        if self._in_button:
            self._buttons[-1].label += data

    def _sent(self, button: "_Button") -> tuple[str, dict[str, str] | None]:
        fields = button.fields | (DEVICE if self.place == "device" else {})
        if "name" in button.given:
            fields |= {button.given["name"]: button.given.get("value", "")}
        action = button.form["action"]
        if button.form.get("method") == "post":
            return action, fields
        return action + (f"?{urlencode(fields)}" if fields else ""), None


@dataclass(slots=True)
class _Button:
    """A button with the attributes and the fields of its form."""

    form: dict[str, str]
    fields: dict[str, str]
    given: dict[str, str]
    """The button's own attributes."""
    label: str = ""

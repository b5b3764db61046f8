"""The pages of a study that are HTML forms, as bots answer them: buttons are found by their labels, as people do.

Cards between trials have buttons with the same labels.
"""

import http.client
import http.cookies
import json
import re
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any
from urllib.parse import urlencode, urlsplit

from human_study.design.study import StudyConfig
from human_study.texts.quiz import questions_for
from sim.errors import StudyError
from sim.types import TaskKind

ENTER_S = 60.0
"""Longest wait for the gateway's answers."""
MOST_PAGES = 200
"""Most pages in a row; a bot that answers more goes round in circles."""
DEVICE = {"webgl2": "1", "width": "1280", "height": "800", "pressed": "1"}
"""What a bot's browser says of itself."""
LEADS_ON = (r"^begin", r"^start", r"^next", r"^continue$", r"^go on", r"^i agree", r"^i have read", r"^try again")
"""Labels that lead on, the likeliest first."""
_COMPLETION_CODE = re.compile(r'aria-label="Completion code">([^<]+)<')


@dataclass(frozen=True, slots=True)
class Session:
    """What the gateway gave for a personal link."""

    origin: str
    cookie: str
    page: str
    """Path of the participant's pages."""
    view: str
    """Address of viser's page."""


@dataclass(frozen=True, slots=True)
class LastPage:
    """A page at which a bot stops."""

    place: str
    """`finished`, `pause` and the like, as `human_study.journey` says."""
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
    body = json.dumps({"token": token}).encode()
    headers = {"Content-Type": "application/json", "Origin": origin}
    try:
        with urllib.request.urlopen(urllib.request.Request(f"{origin}/enter", body, headers), timeout=ENTER_S) as reply:
            told = json.load(reply)
            cookie = http.cookies.SimpleCookie()
            for line in reply.headers.get_all("Set-Cookie") or []:
                cookie.load(line)
        pair = "; ".join(f"{name}={morsel.value}" for name, morsel in cookie.items())
        return Session(origin, pair, told["page"], told["view"])
    except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
        raise StudyError(
            f"{origin}/enter: {error}; expected a session for a personal link. Check that the study is being served."
        ) from None


def answer_pages(session: Session, answers: frozenset[str] = frozenset()) -> LastPage | None:
    """Answers page after page.

    Args:
        session: Of the participant.
        answers: The right answers to the quiz.

    Returns:
        None when viser's page comes next, else the page from which nothing leads on.

    Raises:
        StudyError: A page has no answer, or the gateway does not answer.
    """
    path, fields = session.page, None
    for _ in range(MOST_PAGES):
        status, where, text = _ask(session, path, fields)
        if where.startswith("/view/"):
            return None
        if where:
            path, fields = where, None
            continue
        form = _Forms(text)
        pressed = form.press(answers)
        if status != 200 or not form.place:
            raise StudyError(f"{session.origin}: a page answered with {status}; expected one that a bot can read.")
        if pressed is None:
            code = _COMPLETION_CODE.search(text)
            return LastPage(form.place, code.group(1) if code else None)
        path, fields = pressed
    raise StudyError(f"{session.origin}: {MOST_PAGES} pages came one after the other; expected an end of them.")


def _ask(session: Session, path: str, fields: Mapping[str, str] | None) -> tuple[int, str, str]:
    """(status, where it leads, text) of a page; fields are posted."""
    parts = urlsplit(session.origin)
    kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    connection = kind(parts.netloc, timeout=ENTER_S)
    headers = {"Cookie": session.cookie, "Origin": session.origin}
    try:
        if fields is None:
            connection.request("GET", path, headers=headers)
        else:
            headers["Content-Type"] = "application/x-www-form-urlencoded"
            connection.request("POST", path, urlencode(fields), headers)
        reply = connection.getresponse()
        text = reply.read().decode()
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise StudyError(f"{session.origin}: {error}; expected a page. Check that the study is being served.") from None
    finally:
        connection.close()
    where = urlsplit(reply.headers.get("Location", ""))
    return reply.status, where.path + (f"?{where.query}" if where.query else ""), text


@dataclass(slots=True)
class _Button:
    form: "dict[str, Any]"
    name: str | None
    value: str
    label: str = ""


@dataclass(slots=True)
class _Read:
    place: str = ""
    forms: list[dict[str, Any]] = field(default_factory=list)
    buttons: list[_Button] = field(default_factory=list)


class _Forms(HTMLParser):
    """The forms of a page and their buttons."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self._read = _Read()
        self._in_button = False
        self.feed(text)

    @property
    def place(self) -> str:
        """Where the participant is."""
        return self._read.place

    def press(self, answers: frozenset[str]) -> tuple[str, dict[str, str] | None] | None:
        """(address, fields to post or None) of the button that leads on; None where none does."""
        patterns = [*(f"^{re.escape(answer)}$" for answer in answers), *LEADS_ON]
        for pattern in patterns:
            for button in self._read.buttons:
                if re.search(pattern, button.label.strip(), re.IGNORECASE):
                    return self._sent(button)
        return None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes forms, their hidden fields and their buttons."""
        given = {name: value or "" for name, value in attrs}
        if tag == "main":
            self._read.place = given.get("data-place", "")
        elif tag == "form":
            self._read.forms.append({"method": given.get("method", "get"), "action": given["action"], "fields": {}})
        elif tag == "input" and self._read.forms:
            self._read.forms[-1]["fields"][given["name"]] = given.get("value", "")
        elif tag == "button" and self._read.forms:
            self._in_button = True
            self._read.buttons.append(_Button(self._read.forms[-1], given.get("name"), given.get("value", "")))

    def handle_endtag(self, tag: str) -> None:
        """A button's label ends with it."""
        if tag == "button":
            self._in_button = False

    def handle_data(self, data: str) -> None:
        """A button's label."""
        if self._in_button:
            self._read.buttons[-1].label += data

    def _sent(self, button: _Button) -> tuple[str, dict[str, str] | None]:
        fields = dict(button.form["fields"])
        if self.place == "device":
            fields |= DEVICE
        if button.name is not None:
            fields[button.name] = button.value
        if button.form["method"] == "post":
            return button.form["action"], fields
        return button.form["action"] + (f"?{urlencode(fields)}" if fields else ""), None

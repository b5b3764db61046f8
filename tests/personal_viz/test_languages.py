"""A study in another language: nothing of the program's own is left in English, on any page, card or panel."""

import io
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, cast, get_args
from unittest.mock import MagicMock

import numpy as np
import pytest
import viser
from PIL import Image

from human_study.design.study import StudyPog
from human_study.journey import AssignedTrial, Person, StageEntry
from human_study.texts import catalogue as catalogue_module
from human_study.texts import words as words_module
from human_study.texts.catalogue import WORDS_FILE, Catalogue, catalogue_of
from human_study.texts.participants import leave_text, practice_text, trial_name
from human_study.texts.quiz import questions_for
from human_study.trial.events import MapKind
from human_study.trial.views import LookView, Mark, MarkedObject, Note, PanView, PogView, RateView
from personal_viz.study_app.gateway.pages import Pages
from personal_viz.study_app.home.surfaces import HomeSurface, MapView
from personal_viz.study_app.home.top_view import STRIP, TopView
from personal_viz.study_app.page_script import LABEL, STATIC, page_html, page_of, sign_html
from personal_viz.study_app.recruit_codes import EndCode
from personal_viz.study_app.screens.camera import storey_names
from personal_viz.study_app.screens.cards import (
    Problem,
    begin_card,
    card_after,
    problem_card,
    rate_card,
    welcome_back_card,
)
from personal_viz.study_app.screens.look import LookScreen
from personal_viz.study_app.screens.page import Page
from personal_viz.study_app.screens.pan import PanScreen, key_name
from personal_viz.study_app.screens.pog import PogScreen
from sim.types import EpisodeKey, GridSpec, Task
from tests.human_study.small_world import study
from tests.human_study.stores import do_next

from .test_pages import CODE, DEVICE, Taking, enter
from .test_pages import taking as taking  # a fixture

OPEN, CLOSE = "⟦", "⟧"
_SPOKEN = ("aria-label", "alt", "title", "placeholder", "data-ok", "data-not-yet", "data-now", "data-text")
"""Attributes whose words people read or hear."""


class Shown(HTMLParser):
    """The words of a page: its text without scripts and styles, and the attributes that are read."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts = [""]
        self._silent = 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._silent += tag in ("script", "style")
        self.texts += [value or "" for name, value in attrs if name in _SPOKEN or name.startswith("data-before")]

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in ("script", "style")

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self.texts[0] += data


def left_in_english(page: str) -> list[str]:
    """Words of a page that did not come from the language."""
    return [left for text in Shown(page).texts if (left := re.sub(r"[^A-Za-z]+", " ", outside(text)).strip())]


def outside(text: str) -> str:
    """A text without everything between the marks."""
    while (shorter := re.sub(rf"{OPEN}[^{OPEN}{CLOSE}]*{CLOSE}", "", text)) != text:
        text = shorter
    return text


@pytest.fixture
def marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Catalogue]:
    """English with every word between marks, in place of English."""
    languages = tmp_path / "languages"
    shutil.copytree(catalogue_of("en").folder, languages / "en")
    words = languages / "en" / WORDS_FILE
    text = re.sub(r'^(?!language)(\w+) = "(.*)"$', rf'\1 = "{OPEN}\2{CLOSE}"', words.read_text("utf-8"), flags=re.M)
    words.write_text(text, encoding="utf-8")
    passages = languages / "en" / "passages.md"
    names = re.findall(r"macro (\w+)\(", passages.read_text("utf-8"))
    passages.write_text("".join(f"{{% macro {name}() %}}{OPEN}{name}{CLOSE}{{% endmacro %}}\n" for name in names))
    for name in ("pages.md", "welcome.md", "practice.md"):
        (languages / "en" / name).write_text(f"# {OPEN}title{CLOSE}\n\n{OPEN}text{CLOSE}\n", encoding="utf-8")
    quiz = [OPEN + text + CLOSE for text in ("question", "- right", "- wrong", "why")]
    (languages / "en" / "quiz.md").write_text(
        f"## one\n\n{quiz[0]}\n\n- {quiz[1]}\n- {quiz[2]}\n\n> {quiz[3]}\n", encoding="utf-8"
    )
    for module in (catalogue_module, words_module):
        monkeypatch.setattr(module, "LANGUAGES", languages)
    catalogue_of.cache_clear()
    yield catalogue_of("en")
    catalogue_of.cache_clear()


TEXTS = {f"told/{name}-pan.md": f"# {OPEN}title{CLOSE}\n\n{OPEN}text{CLOSE}" for name in ("consent", "instructions")}


@pytest.mark.parametrize("withdraw", ["delete", "keep"])
def test_no_page_has_a_word_that_is_not_of_the_study_s_language(
    marked: Catalogue, taking: Callable[..., Taking], withdraw: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.personal_viz.test_pages.TEXTS", TEXTS)
    who = taking(
        end=EndCode("1234", "https://example.org/"),
        privacy={"on_withdraw": withdraw},
        breaks={"every": 1, "sitting_max": 2, "sitting_gap_s": 0.0},
        survey={"questions": ["age", "homes"], "eligibility": [f"{OPEN}I am tall{CLOSE}"]},
    )
    seen: list[str] = []

    def look(*, page: str = "1") -> None:
        assert left_in_english(who.page(page=page)) == []
        seen.append(who.place())

    assert left_in_english(who.client.get("/").text) == []
    look()
    who.send(**DEVICE)
    look()
    who.send(choice="agree", eligible_0="yes")
    for number in ("1", "2"):
        look(page=number)
    who.send(choice="read")
    (question,) = questions_for(who.store.config, "pan", ("none",))
    for answer in question.answers[1], question.answers[0]:
        look()
        who.send(answer=answer)
    look()
    who.send(answer=question.answers[0])
    for _ in range(2):
        do_next(who.store, CODE)
        look()
        who.send(choice="next")
    assert left_in_english(who.client.get(f"{who.address}leave").text) == []
    do_next(who.store, CODE)
    look()
    who.send(choice="send", age="18_24")
    look()
    assert seen == [
        *("device", "consent", "instructions", "instructions", "quiz", "quiz", "quiz", "break", "pause", "survey"),
        "finished",
    ]


@pytest.mark.parametrize("place", ["declined", "withdrawn", "screened_out", "full"])
def test_no_early_end_has_a_word_that_is_not_of_the_study_s_language(
    marked: Catalogue, taking: Callable[..., Taking], place: Any
) -> None:
    who = taking(end=EndCode("1234", "https://example.org/"), recruit={"kind": "prolific"})
    enter(who, "arrived", place)
    assert left_in_english(who.page()) == []
    assert who.place() == place
    pages = Pages(who.store, texts=TEXTS)
    assert left_in_english(pages.message("paused")) == []


class Recorder:
    """Stands for a client of viser: remembers every string that it is given to show."""

    def __init__(self, told: list[str]) -> None:
        self.__dict__["told"] = told

    def __getattr__(self, name: str) -> Any:
        return self.__dict__.setdefault(name, Recorder(self.told))

    def __setattr__(self, name: str, value: object) -> None:
        self._keep(value)

    def __call__(self, *given: object, **options: object) -> Any:
        for value in (*given, *options.values()):
            self._keep(value)
        return Recorder(self.told)

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def _keep(self, value: object) -> None:
        if isinstance(value, str):
            self.told.append(value)
        elif isinstance(value, tuple | list):
            for part in value:
                self._keep(part)


_NOT_SHOWN = {
    *(
        "red",
        "green",
        "gray",
        "blue",
        "dark",
        "top",
        "bottom",
    ),  # viser's colours; names of folders, whose heads are hidden
    *("W", "A", "D", "R", "F", "enter", "arrowup", "arrowdown", "arrowleft", "arrowright", "pageup", "pagedown"),
}
_IN_THE_CLOSED_PALETTE = re.compile(r"[a-z_]+ \(\w+\)|move the mark \w+")
"""Labels of viser's commands; the palette that would list them never opens."""


@pytest.fixture
def screen(marked: Catalogue) -> Callable[[], tuple[Page, list[str]]]:
    """Makes a page, and the list of what it shows."""

    def make() -> tuple[Page, list[str]]:
        told: list[str] = []
        return Page(cast(viser.ClientHandle, Recorder(told)), marked), told

    return make


def require_marked(told: list[str]) -> None:
    """Everything that a page showed came from the language."""
    shown = [text for text in told if text not in _NOT_SHOWN and not _IN_THE_CLOSED_PALETTE.fullmatch(text)]
    assert len(shown) > 2
    assert [(text, left) for text in shown if (left := left_in_english(text))] == []


def marked_text(text: str) -> str:
    return f"{OPEN}{text}{CLOSE}"


TASK = Task("pan", marked_text("Mira lives here."), (marked_text("Find Mira's chair."),))


async def nothing(_: object = None) -> None:
    """Sends nothing."""


def test_walking_shows_no_word_that_is_not_of_the_study_s_language(screen: Callable[..., Any]) -> None:
    page, told = screen()
    view = PanView(TASK, np.zeros((2, 2, 3), np.uint8), step=1, is_armed=False, is_over=False, left_s=90)
    shown = PanScreen(page, view, nothing, caption=marked_text("Search"), encode=lambda _: b"")
    page.own_keys = {"forward": "ArrowUp", "stop": "Space"}
    for change in ({"is_armed": True}, {"is_giving_up": True}, {"is_blocked": True, "step": 2}):
        shown.show(replace(view, **change))
    armed = page.words("pan.armed", keys=key_name("Space", page.words))
    assert sign_html(armed, 0) in told, "STOP has another key"
    page.tools(has_keys=True, on_leave=leave_text(study()))
    require_marked(told)


def options(words: Catalogue, shown: StudyPog) -> dict[str, Any]:
    """Further arguments of a screen that shows a home with two storeys."""
    storeys = storey_names(words, "british", (0, 1))
    return {"caption": marked_text("Search"), "storeys": storeys, "shown": shown}


@pytest.mark.parametrize("is_map", [False, True])
def test_pointing_shows_no_word_that_is_not_of_the_study_s_language(screen: Callable[..., Any], is_map: bool) -> None:
    page, told = screen()
    surface = MagicMock(spec=MapView if is_map else HomeSurface, is_map=is_map, camera_moved=nothing)
    view = PogView(TASK, (0.0, 3.0), 0, None, is_over=False, left_s=90)
    item = MarkedObject(marked_text("chair"), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    mark = Mark((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0)
    given = options(page.words, StudyPog(object_names="demand", pointing="snap"))
    shown = PogScreen(page, view, nothing, surface=surface, things=[item.category], **given)
    on_item = replace(mark, item=item)
    marked = replace(view, mark=on_item, marks=(on_item,), is_giving_up=True)
    search = {"num_searches": 7, "search": 2, "query": view.task.queries[0], "notes": (Note(TASK.description, 2),)}
    of_all = replace(view, **search, is_for_all=True)
    for changed in (
        replace(view, mark=mark, marks=(mark,)),
        marked,
        of_all,
        replace(of_all, mark=mark, marks=(mark, on_item)),
    ):
        shown.show(changed)
    told += [label for call in surface.show_marks.call_args_list for _, label in call.args[0]]
    require_marked(told)


@pytest.mark.parametrize("what", get_args(MapKind))
def test_looking_shows_no_word_that_is_not_of_the_study_s_language(screen: Callable[..., Any], what: Any) -> None:
    page, told = screen()
    home = MagicMock()
    home.shown_in.return_value = MagicMock(spec=HomeSurface, camera_moved=nothing)
    home.copies.maps = (TopView(GridSpec((0.0, 0.0), 1.0, (2, 2)), 0.0, marked_text("storey"), _png()),)
    view = LookView(what, (0.0,), 0, wait_s=70, left_s=100)
    shown = LookScreen(page, view, nothing, home=home, **options(page.words, StudyPog(object_names="demand")))
    shown.show(replace(view, wait_s=0, left_s=None))
    require_marked(told)


def _png() -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (2, 2 + STRIP)).save(buffer, "PNG")
    return buffer.getvalue()


def test_no_card_has_a_word_that_is_not_of_the_study_s_language(screen: Callable[..., Any]) -> None:
    page, told = screen()
    config = study(flow=("device", "consent"), task=("pan",))
    done = [trial(1, phase="practice", is_over=True), trial(2, is_over=True), trial(3)]
    interrupted = [trial(2, is_over=True), trial(3)]
    cards = [
        *(problem_card(problem, page.words) for problem in get_args(Problem)),
        problem_card("lost_picture", page.words, of_sequences=True),
        rate_card(RateView((1, 2, 3, 4, 5)), page.words),
        begin_card(config, somebody([trial(1, phase="practice"), trial(2)])),
        begin_card(config, somebody([trial(1, phase="practice", is_over=True), trial(2)])),
        welcome_back_card(config, somebody(done)),
        card_after(config, somebody(done), done[1]),
        card_after(config, somebody(interrupted), trial(7), feedback=practice_text(config, "pan", None)),
    ]
    for card in cards:
        assert card is not None
        page.card(card, nothing)
    require_marked(told)
    assert {trial_name(config, somebody(done), one)[0] for one in done} == {OPEN}


def trial(order_no: int, *, phase: Any = "main", is_over: bool = False) -> AssignedTrial:
    """A trial of PAN."""
    key = EpisodeKey("easy", "Home", str(order_no))
    return AssignedTrial(order_no, phase, "pan", "none", key, is_begun=is_over, end="done" if is_over else None)


def somebody(trials: list[AssignedTrial]) -> Person:
    """A participant who has passed all pages."""
    stages = tuple(StageEntry(stage, {}, 1) for stage in ("device_ok", "consented"))
    return Person("p01", "pan", True, stages, tuple(trials))


def test_the_scripts_of_the_pages_have_no_words_of_their_own(marked: Catalogue) -> None:
    """Literals of two words and more are of the language, or are code."""
    code = re.compile(r"[.#:\[\]<>=(){};/]|^use strict$|^\w+ \w+=")
    for path in STATIC.glob("*.js"):
        source = re.sub(r"//.*|/\*.*?\*/", "", path.read_text(encoding="utf-8"))
        literals = re.findall(r"'([^'\n]*)'|\"([^\"\n]*)\"|`([^`]*)`", source)
        texts = [text for found in literals for text in found if re.search(r"[A-Za-z]{2,} [A-Za-z]{2,}", text)]
        assert [text for text in texts if not code.search(text) and text != LABEL] == [], path.name
    for text in (page_html(marked), page_of("v", marked).decode()):
        assert OPEN in text or json.dumps(OPEN)[1:-1] in text


def test_a_study_in_german_is_german_from_the_link_to_the_code(taking: Callable[..., Taking]) -> None:
    who = taking(language="de", privacy={"on_withdraw": "delete"})
    entry = who.client.get("/").text
    assert '<html lang="de">' in entry
    assert "Die Studie wird geöffnet" in entry
    assert "Ihr Browser wird geprüft" in who.page()
    who.send(**DEVICE)
    assert "Sind Sie einverstanden und möchten Sie teilnehmen?" in who.page()
    who.send(choice="agree")
    assert "<kbd>W</kbd> oder <kbd>↑</kbd>" in who.page(page="3")
    assert "Ihre Antwort ist richtig, wenn der Roboter" in " ".join(who.page(page="2").split())
    who.send(choice="read")
    for question in questions_for(who.store.config, "pan", ("none",)):
        assert question.text in who.page()
        who.send(answer=question.answers[0])
    assert who.page() == ""
    for _ in range(3):
        do_next(who.store, CODE)
    shown = who.page()
    assert "<h1>Vielen Dank!</h1>" in shown
    assert 'aria-label="Abschlusscode">ABCD1234<' in shown
    assert "Was Sie in Ihren Suchen getan haben, wird gelöscht" in taking_leave(who)


def taking_leave(who: Taking) -> str:
    """What the page of somebody who wants to leave says of the answers."""
    return leave_text(who.store.config)

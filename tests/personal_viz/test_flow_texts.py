"""Pages around the trials: texts, questions, cards, and the messages of the page's script."""

import base64
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from human_study.design.study import Condition, StudyConfig, StudyDataset
from human_study.journey import Journey
from human_study.texts.catalogue import catalogue_of
from human_study.texts.participants import instruction_texts
from human_study.texts.quiz import QuizRound, questions_for
from personal_viz.screenshots.study_pages import MAX_BYTES, SIZE, small_jpeg
from personal_viz.study_app.markdown import html_from_markdown, title_of
from personal_viz.study_app.page_script import STATIC, Device, OwnKeys, Pressed, Told, page_html, said_in
from personal_viz.study_app.screens.cards import Card, card_html, progress_html
from sim.types import TaskKind

from .html_tags import Tags


def config(**choices: object) -> StudyConfig:
    """A study of both tasks."""
    return StudyConfig(study="flow", dataset=StudyDataset(sha256="0" * 64), task=("pan", "pog"), **choices)


def tags_in(text: str) -> list[str]:
    """All tags of a text whose tags are closed in order."""
    tags = Tags(text)
    assert tags.is_balanced
    return [tag for tag, _ in tags.found]


def test_markdown_becomes_headings_paragraphs_lists_and_tables() -> None:
    text = "# Consent\n\nWe **store** *keys*.\nOn two lines.\n\n- one\n- two\n  more\n\n1. first\n\n## Contact\nme"
    assert title_of(text, otherwise="x") == "Consent"
    assert " ".join(html_from_markdown(text).split()) == (
        "<p>We <strong>store</strong> <em>keys</em>. On two lines.</p> <ul> <li>one</li> <li>two more</li> </ul> "
        "<ol> <li>first</li> </ol> <h2>Contact</h2><p>me</p>"
    )
    made = html_from_markdown("# Keys\n\n| Key | Robot |\n|---|---|\n| `W` | walks |\n| A | turns |\n")
    assert tags_in(made) == ["table", "thead", "tr", "th", "th", "tbody", "tr", "td", "kbd", "td", "tr", "td", "td"]
    assert "|" not in made


def test_nothing_in_a_text_can_become_a_script_or_a_link_elsewhere() -> None:
    text = "Hi <script>alert(1)</script> [click](http://evil) ![pic](http://evil/x.png) <!-- note --> & `W`"
    made = html_from_markdown(text)
    assert tags_in(made) == ["p", "kbd"]
    assert "click pic" in made
    assert "http" not in made
    assert "note" not in made
    assert "&lt;script&gt;" in made


@pytest.mark.parametrize("task", ["pan", "pog"])
def test_instructions_and_questions_fit_task_and_conditions(task: TaskKind) -> None:
    conditions = ("none", "topdown") if task == "pan" else ("map_first",)
    pages = ("# Our study\n\nHello.", *instruction_texts(config(), task, conditions))
    assert title_of(pages[0], otherwise="x") == "Our study"
    words = " ".join(html_from_markdown(page) for page in pages)
    assert ("500" in words) == (task == "pan")
    assert ("map of the home from above" in words) == (task == "pan")
    assert ("<table>" in words) == (task == "pan")
    tags_in(words)
    names = [question.name for question in questions_for(config(), task, conditions)]
    assert names == (
        ["distance", "stop", "whose", "gone", "feedback"]
        if task == "pan"
        else ["mark", "middle", "confirm", "whose", "order", "feedback"]
    )


@pytest.mark.parametrize(
    ("task", "conditions", "shown"),
    [
        ("pan", ("none",), ["how-pan.jpg"]),
        ("pan", ("none", "topdown"), ["how-pan.jpg", "how-topdown.jpg"]),
        ("pan", ("glb", "topdown", "none"), ["how-pan.jpg", "how-topdown.jpg", "how-glb.jpg"]),
        ("pog", ("map_open",), ["how-pog.jpg"]),
        ("pog", ("map_first",), ["how-pog.jpg", "how-map-first.jpg"]),
        ("pog", ("map_open", "map_2d"), ["how-pog.jpg", "how-map-2d.jpg"]),
        ("pog", ("map_2d",), ["how-map-2d.jpg"]),
    ],
)
def test_people_see_a_picture_of_every_condition_that_they_will_meet(
    task: TaskKind, conditions: tuple[Condition, ...], shown: list[str]
) -> None:
    body = "".join(html_from_markdown(page) for page in instruction_texts(config(), task, conditions))
    found = re.findall(r'<img src="data:image/jpeg;base64,([^"]+)" alt="([^"]+)">', body)
    assert [base64.b64decode(data) for data, _ in found] == [(STATIC / name).read_bytes() for name in shown]
    assert len({alt for _, alt in found}) == len(found)


def test_people_who_never_see_a_home_in_3d_are_not_told_how_to_turn_it() -> None:
    words = " ".join("".join(instruction_texts(config(), "pog", ("map_2d",))).split())
    assert "**Turn**" not in words
    assert "without its ceiling" not in words
    assert "from straight above" in words
    assert "Give up this search" in words


@pytest.mark.parametrize("actions", ["paper4", "paper6"])
def test_the_table_of_keys_names_the_keys_and_buttons_that_work(actions: str) -> None:
    study = config(actions=actions)
    keys = dict(re.findall(r"(\w+): \[([^\]]+)\]", (STATIC / "page.js").read_text(encoding="utf-8")))
    names = {"ArrowUp": "↑", "ArrowLeft": "←", "ArrowRight": "→", "Enter": "Enter", "NumpadEnter": None}
    expected = []
    for action in study.action_set:
        codes = re.findall(r"'(\w+)'", keys[action.value])
        shown = [name for code in codes if (name := names.get(code, code.removeprefix("Key")))]
        expected.append((" or ".join(f"`{name}`" for name in shown), catalogue_of("en")(f"pan.{action.value}")))
    text = "".join(instruction_texts(study, "pan", ("none",)))
    rows = [row.split(" | ") for row in re.findall(r"^\| (`.*) \|$", text, flags=re.MULTILINE)]
    found = [(key.split(", ")[0], button.split(", ")[0]) for key, button, _ in rows]
    assert sorted(found) == sorted(expected)


def test_pictures_are_small_and_of_one_size() -> None:
    paths = sorted(STATIC.glob("how-*.jpg"))
    assert len(paths) == 8
    for path in paths:
        assert path.stat().st_size <= 60_000
        with Image.open(path) as picture:
            assert picture.size == (760, 475)


def test_the_time_of_the_look_is_said() -> None:
    assert "for at most 1 minute." in " ".join("".join(instruction_texts(config(), "pan", ("glb",))).split())
    assert "for at most 2 minutes." in " ".join("".join(instruction_texts(config(), "pog", ("map_first",))).split())
    assert "What you see of a home" not in "".join(instruction_texts(config(), "pan", ("none",)))


def test_a_wrong_answer_leaves_the_question_and_is_counted_once() -> None:
    questions = questions_for(config(), "pan", ("none",))
    quiz = QuizRound(questions)
    first = questions[0]
    assert not quiz.answer(first.answers[1])
    assert not quiz.answer(first.answers[2])
    assert quiz.present is first
    for question in questions:
        assert quiz.answer(question.answers[0])
    assert quiz.present is None
    assert quiz.wrong == [first.name]


def test_the_right_answer_is_not_always_the_first_and_stays_where_it_is() -> None:
    questions = questions_for(config(), "pan", ("none",))
    places = {question.shuffled([seed]).index(question.answers[0]) for question in questions for seed in range(20)}
    assert places == {0, 1, 2}
    assert questions[0].shuffled([1, 2]) == questions[0].shuffled([1, 2])


def test_progress_is_said_in_words_and_to_screen_readers() -> None:
    bar = progress_html(config(), Journey("trial", num_done=3, num_all=12))
    assert "3 of 12 searches done" in bar
    assert '<progress max="12" value="3"' in bar
    assert tags_in(bar) == ["progress", "p"]
    card = Card("Title <b>", "<p>x</p>", parts=("A", "B", "C"), part=1)
    assert '<li class="now" aria-current="step">B</li>' in card_html(card, catalogue_of("en"))
    assert "<h1>Title &lt;b&gt;</h1>" in card_html(card, catalogue_of("en"))


def letter(*said: dict, seat: str = "s") -> str:
    """The text of the hidden input."""
    return json.dumps({"seat": seat, "said": [{"n": 1, "t_cli_ms": 5.5, **message} for message in said]})


def test_messages_of_the_page_are_typed() -> None:
    text = letter(
        {"kind": "device", "webgl2": True, "width": 1280, "height": 720},
        {"kind": "press", "action": "forward", "code": "KeyZ"},
        {"kind": "keys", "keys": {"forward": "KeyI"}},
        {"kind": "told", "name": "withdraw"},
    )
    assert said_in(text, seat="s") == (
        Device(n=1, t_cli_ms=5.5, webgl2=True, width=1280, height=720),
        Pressed(n=1, t_cli_ms=5.5, action="forward", code="KeyZ"),
        OwnKeys(n=1, t_cli_ms=5.5, keys={"forward": "KeyI"}),
        Told(n=1, t_cli_ms=5.5, name="withdraw"),
    )
    assert said_in(text, seat="another connection") == ()


@pytest.mark.parametrize(
    "message",
    [
        {"kind": "device", "webgl2": True, "width": -1, "height": 720},
        {"kind": "device", "webgl2": True, "width": 10**9, "height": 720},
        {"kind": "press", "action": "forward", "code": "K" * 33},
        {"kind": "press", "action": "forward", "code": "KeyW", "t_cli_ms": -1.0},
        {"kind": "press", "action": "forward", "code": "KeyW", "t_cli_ms": "1"},
        {"kind": "keys", "keys": {"forward": "Escape"}},
        {"kind": "keys", "keys": {"fly": "KeyW"}},
        {"kind": "page", "what": "stolen"},
        {"kind": "round_trip", "ms": 1e300},
        {"kind": "act"},
        {"kind": "ping", "more": 1},
    ],
)
def test_a_message_that_the_script_never_sends_is_dropped(message: dict) -> None:
    assert said_in(letter(message), seat="s") == ()


@pytest.mark.parametrize(
    "text", ["", "1 hello", "[]", "{", '{"seat":"s"}', '{"seat":"s","said":[' + "{}," * 50 + "{}]}"]
)
def test_damaged_letters_are_dropped(text: str) -> None:
    assert said_in(text, seat="s") == ()


def test_the_script_survives_being_an_attribute() -> None:
    source = page_html(catalogue_of("en"))
    assert tags_in(source) == ["style", "img"]

    script = dict(Tags(source).found)["img"]["onerror"] or ""
    before, _, after = (STATIC / "page.js").read_text(encoding="utf-8").partition("PAGE_WORDS")
    assert script.startswith(before)
    assert script.endswith(after)


def test_a_screenshot_becomes_a_picture_that_is_small_enough() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (200, 320, 3), dtype=np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(noise).resize((1280, 800), Image.Resampling.NEAREST).save(buffer, "PNG")
    found = small_jpeg(buffer.getvalue())
    with Image.open(io.BytesIO(found)) as picture:
        assert (picture.format, picture.size) == ("JPEG", SIZE)
    plain = io.BytesIO()
    Image.new("RGB", (1280, 800), "white").save(plain, "PNG")
    assert len(small_jpeg(plain.getvalue())) < MAX_BYTES

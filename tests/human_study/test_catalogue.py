"""The languages of a study: complete, used, and refused where a text or a place is missing."""

import ast
import datetime
import itertools
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from human_study.design.study import Condition, Language
from human_study.texts.catalogue import LANGUAGES, WORDS_FILE, catalogue_of, load_catalogue, places_in
from human_study.texts.documents import ethics_documents
from human_study.texts.participants import freeze_texts, instruction_texts, told_name, welcome_text, write_texts
from human_study.texts.quiz import questions_for
from human_study.texts.words import filled, open_places, words_of
from sim.errors import StudyError
from sim.types import SUCCESS_RULES, TaskKind

from .small_world import FILLED, paged_study, plan

ROOT = Path(__file__).parents[2]
PLACES = (ROOT / "human_study", ROOT / "personal_viz")
OTHERS = tuple(language for language in get_args(Language) if language != "en")
HISTORIES = ("visible", "hidden", "both")
ARMS: dict[TaskKind, tuple[tuple[Condition, ...], ...]] = {
    "pan": (("none",), ("topdown", "glb")),
    "pog": (("map_2d",), ("map_first", "map_open", "map_2d")),
}


@pytest.mark.parametrize("language", get_args(Language))
def test_participants_read_one_word_for_one_thing(language: Language) -> None:
    """No text for participants uses a second word for a thing that has one (`one_word.toml`)."""
    words = tomllib.loads(Path(__file__).with_name("one_word.toml").read_text("utf-8"))[language]
    texts = dict(catalogue_of(language).texts)
    for path in (LANGUAGES / language).glob("*.md"):
        texts[path.name] = re.sub(r"\{#.*?#\}|\{%.*?%\}|\{\{.*?\}\}", " ", path.read_text("utf-8"), flags=re.DOTALL)
    assert len(texts) > 200
    read = "\n".join(re.sub(r"\{\w+\}", "", text) for text in texts.values())
    for word, others in words.items():
        assert re.search(rf"\b{word}", read), word
        used = {other: where for other in others for where, text in texts.items() if _has_word(other, text)}
        assert used == {}, f"these mean the same as {word!r}"


def _has_word(word: str, text: str) -> bool:
    return re.search(rf"\b{word}s?\b", re.sub(r"\{\w+\}", "", text), flags=re.IGNORECASE) is not None


def strings_in(node: ast.AST) -> Iterator[str]:
    """Constant strings below a node, and f-strings with a star for each value."""
    inside = {id(part) for text in ast.walk(node) if isinstance(text, ast.JoinedStr) for part in text.values}
    for part in ast.walk(node):
        if isinstance(part, ast.JoinedStr):
            yield "".join(str(value.value) if isinstance(value, ast.Constant) else "*" for value in part.values)
        elif isinstance(part, ast.Constant) and isinstance(part.value, str) and id(part) not in inside:
            yield part.value


def keys_in(pattern: str, text: str, ends: str) -> Iterator[str]:
    """Keys that a pattern finds in a text; with a star where more of the key follows."""
    for key in re.findall(pattern, text):
        yield key[0] + ("*" if key[1].strip() == ends else "")


def modules() -> Iterator[ast.AST]:
    """Our modules."""
    for path in itertools.chain(*(folder.rglob("*.py") for folder in PLACES)):
        yield ast.parse(path.read_text("utf-8"))


def keys_named() -> set[str]:
    """Everything in modules, templates and scripts that may be a key of the catalogue, or a pattern of keys."""
    found = {text for module in modules() for text in strings_in(module)}
    for path in (ROOT / "personal_viz").rglob("*.html"):
        found |= set(keys_in(r'"([\w.]+)"( ~)?', path.read_text("utf-8"), "~"))
    for path in (ROOT / "personal_viz").rglob("*.js"):
        found |= set(keys_in(r"'([\w.]+)'( \+)?", path.read_text("utf-8").replace('"', "'"), "+"))
    return found


def keys_called() -> set[str]:
    """Keys with which a catalogue is called."""
    found: set[str] = set()
    for module in modules():
        for node in ast.walk(module):
            if isinstance(node, ast.Call) and node.args and _is_catalogue(node.func):
                found |= {text for text in strings_in(node.args[0]) if text.strip("*")}
    for path in (ROOT / "personal_viz").rglob("*.html"):
        found |= set(re.findall(r'\bwords\("([\w.]+)"(?! ~)', path.read_text("utf-8")))
    for path in (ROOT / "personal_viz").rglob("*.js"):
        text = path.read_text("utf-8").replace('"', "'")
        found |= set(re.findall(r"\b(?:say\(|words\[|WORDS\[)'([\w.]+)'(?! \+)", text))
    return found


def _is_catalogue(called: ast.expr) -> bool:
    if isinstance(called, ast.Call):
        return isinstance(called.func, ast.Name) and called.func.id == "catalogue_of"
    name = called.attr if isinstance(called, ast.Attribute) else called.id if isinstance(called, ast.Name) else ""
    return name in ("words", "told")


def is_used(key: str, used: set[str]) -> bool:
    """Whether a key, or a pattern that begins with the key's table and fits it, is used."""
    table = key.partition(".")[0]
    patterns = [
        re.escape(name).replace(r"\*", r"[\w.-]+") for name in used if "*" in name and name.startswith(f"{table}.")
    ]
    return key in used or any(re.fullmatch(pattern, key) for pattern in patterns)


@pytest.mark.parametrize("language", OTHERS)
def test_every_language_has_the_keys_places_and_files_of_english(language: str) -> None:
    other, english = catalogue_of(language), catalogue_of("en")
    assert other.language == language
    assert set(other.texts) == set(english.texts)
    for key, text in english.texts.items():
        assert places_in(other.texts[key]) == places_in(text), key
        assert bool(other.texts[key].strip()) == bool(text.strip()), key
    assert {path.name for path in other.folder.iterdir()} == {path.name for path in english.folder.iterdir()}


def test_every_word_is_used_and_every_use_has_a_word() -> None:
    texts = catalogue_of("en").texts
    named = keys_named()
    named |= {f"number.{name}" for name in named}
    assert not {key for key in texts if not is_used(key, named)}
    called = keys_called()
    assert len(called) > 100
    assert not {key for key in called if not any(is_used(known, {key}) for known in texts)}


@pytest.mark.parametrize("language", OTHERS)
@pytest.mark.parametrize("task", get_args(TaskKind))
def test_every_language_tells_the_same_rules(task: TaskKind, language: Language) -> None:
    """Numbers, keys, pictures, pages and questions are those of English."""
    rules = SUCCESS_RULES if task == "pan" else SUCCESS_RULES[:1]
    pointings, told = ("free", "snap"), ({}, *({"sequences": {"sha256": "0", "history": name}} for name in HISTORIES))
    for rule, arms, pointing, kind in itertools.product(rules, ARMS[task], pointings, told):
        conditions = paged_study(**kind).conditions(task) if kind else arms
        choices = {
            **kind,
            "confidence": not kind,
            "task": (task,),
            "success": rule,
            "actions": "paper6",
            "pan_max_s": 90.0,
        }
        choices |= {"pog": {"pointing": pointing, "answer_max_s": 60.0}}
        english = paged_study(**choices, practice={"pan": 1, "pog": 1}, **FILLED)
        other = english.model_copy(update={"language": language})
        for told in (english, other):
            assert welcome_text(told, task).startswith("# ")
        pages, theirs = (instruction_texts(told, task, conditions) for told in (english, other))
        assert [facts_in(page) for page in theirs] == [facts_in(page) for page in pages]
        questions, asked = (questions_for(told, task, conditions) for told in (english, other))
        for question, same in zip(questions, asked, strict=True):
            assert (same.name, len(same.answers)) == (question.name, len(question.answers))
            assert facts_in(same.because) == facts_in(question.because)
            assert facts_in(same.answers[0]) == facts_in(question.answers[0])
            assert same.text != question.text


def facts_in(text: str) -> tuple[list[str], list[str], list[str]]:
    """Numbers, keys and pictures in a text."""
    numbers = re.findall(r"\d+(?:[.,]\d+)?", re.sub(r"\(.*?\.jpg\)|3-D", "", text))
    return (
        sorted(number.replace(",", ".") for number in numbers),
        re.findall(r"`([^`]+)`", text),
        re.findall(r"\((how-[\w-]+\.jpg)\)", text),
    )


@pytest.mark.parametrize("language", OTHERS)
@pytest.mark.parametrize("withdraw", ["delete", "keep"])
def test_a_study_in_another_language_is_told_in_it_from_consent_to_the_board_s_sheet(
    withdraw: str, language: Language, tmp_path: Path
) -> None:
    filled_in = {**FILLED, "privacy": {"on_withdraw": withdraw, "retention": "2030-02-01"}}
    config = paged_study(language=language, **filled_in)
    drawn = plan(config)
    freeze_texts(tmp_path, config, drawn)
    words, english = (words_of(config, catalogue=catalogue_of(name)) for name in (language, "en"))
    for name in ("consent.md", "instructions.md"):
        told = (tmp_path / told_name(name, "pan")).read_text("utf-8")
        assert told != filled(name, english)
        assert not open_places(told)
    told = {"ethics": {**FILLED["ethics"], "language_model": "Ihre Texte liest ein Sprachmodell."}, "comments": True}
    asked = paged_study(language=language, **{**filled_in, **told, "survey": {"questions": ["age"]}})
    freeze_texts(tmp_path, asked, plan(asked))  # names all of these
    consent = (tmp_path / "consent.md").read_text("utf-8")
    for wrong in (
        "Kein Wort geht an ein Sprachmodell.",
        "Es gibt keine Umfrage.",
        "Wir stellen keine Fragen über Sie.",
    ):
        (tmp_path / "consent.md").write_text(f"{consent}\n{wrong}\n", encoding="utf-8")
        with pytest.raises(StudyError, match=r"consent\.md: says"):
            freeze_texts(tmp_path, asked, plan(asked))
    documents = ethics_documents(config, drawn)
    assert (
        documents["information_sheet.md"].splitlines()[0]
        == filled("information_sheet.md", words_sheet(words)).splitlines()[0]
    )
    assert documents["protocol.md"].startswith("# Study protocol") or "##" in documents["protocol.md"]


def words_sheet(words: dict[str, object]) -> dict[str, object]:
    """The words of the information sheet."""
    return words | {"per_task": [], "pay_sentence": ""}


def test_a_text_that_nobody_changed_follows_the_study_s_language(tmp_path: Path) -> None:
    write_texts(tmp_path, "en")
    (tmp_path / "instructions.md").write_text("# My own\n", encoding="utf-8")
    write_texts(tmp_path, "de")
    assert (tmp_path / "consent.md").read_text("utf-8") == (LANGUAGES / "de" / "consent.md").read_text("utf-8")
    assert (tmp_path / "instructions.md").read_text("utf-8") == "# My own\n"


def test_english_leaves_a_study_s_digest_and_another_language_does_not() -> None:
    assert paged_study(language="en").study_version == paged_study().study_version
    assert paged_study(language="de").study_version != paged_study().study_version
    with pytest.raises(ValueError, match="language"):
        paged_study(language="xx")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (('title = "PersONAL study"\n', ""), "study.title is missing"),
        (("{done} of {all} searches done", "{done} searches done"), r"page.done has the places \['done'\] instead"),
        (("{done} of {all} searches done", "{done of {all}"), "page.done cannot be filled in"),
        (("[study]\n", '[study]\nmotto = "Find it"\n'), "study.motto is unknown"),
        (('language = "en"', ""), "language is missing"),
        (("[study]", "[study"), "cannot be read"),
    ],
)
def test_a_damaged_language_is_one_line_with_file_and_key(
    change: tuple[str, str], problem: str, tmp_path: Path
) -> None:
    text = (LANGUAGES / "en" / WORDS_FILE).read_text("utf-8")
    assert change[0] in text
    (tmp_path / WORDS_FILE).write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(StudyError, match=rf"words\.toml: .*{problem}.*; expected") as raised:
        load_catalogue(tmp_path)
    assert "\n" not in str(raised.value)


def test_a_folder_without_words_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"words\.toml: cannot be read"):
        load_catalogue(tmp_path)


def test_numbers_have_the_units_and_the_comma_of_the_language() -> None:
    english, german = catalogue_of("en"), catalogue_of("de")
    assert [english.length(metres) for metres in (0.1, 0.01, 1, 1.5)] == [
        "10 centimetres",
        "1 centimetre",
        "1 metre",
        "1.5 metres",
    ]
    assert [german.length(metres) for metres in (0.1, 1, 1.5)] == ["10 Zentimeter", "1 Meter", "1,5 Meter"]
    assert [english.duration(seconds) for seconds in (1, 45, 60, 90, 120)] == [
        "1 second",
        "45 seconds",
        "1 minute",
        "90 seconds",
        "2 minutes",
    ]
    assert [german.duration(seconds) for seconds in (1, 2.5, 60)] == ["1 Sekunde", "2,5 Sekunden", "1 Minute"]
    assert [english.countdown(seconds) for seconds in (1, 59, 65)] == ["1 second", "59 seconds", "1:05 minutes"]
    assert [english.waiting_time(seconds) for seconds in (1, 61, 7200)] == ["1 minute", "2 minutes", "2 hours"]
    day = datetime.date(2030, 2, 1)
    assert (english.date(day), german.date(day)) == ("2030-02-01", "01.02.2030")

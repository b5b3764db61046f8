"""The frozen study file, and tokens."""

import datetime
import hashlib
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
import yaml
from pydantic import BaseModel, ValidationError

from human_study.design.secrets import new_id, new_token, token_hash, token_matches
from human_study.design.study import StudyAggregate, StudyConfig, StudyDataset, load_study, save_study
from human_study.design.study_yaml import field_told, json_from_yaml
from sim.errors import StudyError
from sim.types import Action, Camera

from .small_world import episode, study

EXAMPLE = """
study: personal-pan-2026
version: 1
dataset: {sha256: "abc", splits: {easy: 50, medium: 50, hard: 50}, stratify: scene, max_per_scene: 5, seed: 7}
task: pan            # pan | pog
actions: paper4
steps: 500
success: paper
design: {kind: house-once, raters_per_episode: 5, trials_per_person: 30, overbook: 1.15}
memory: {arms: [none, topdown], by: scene_half, max_s: 60}
practice: {pan: 2}
checks: {every: 15}
breaks: {every: 10, sitting_max: 30}
resume_within_s: 600
lease_s: 900
aggregate: {total: mean_of_splits, weight: trials}
primary: [human_minus_agent_SR, memory_effect_SR]
privacy: {platform_id: none, retention: 2027-12-31, on_withdraw: delete}
recruit: {kind: local}   # local | link | prolific (codes in secrets.toml)
"""


def test_the_example_of_the_specification_reads(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(EXAMPLE)
    config = load_study(tmp_path)
    assert (config.task, config.memory.arms, config.memory.max_s) == (("pan",), ("none", "topdown"), 60.0)
    assert config.dataset.splits == {"easy": 50, "medium": 50, "hard": 50}
    assert config.privacy.retention == datetime.date(2027, 12, 31)
    assert config.design.trials_per_person == 30


def test_the_study_version_is_the_hash_of_the_choices() -> None:
    config = StudyConfig(study="pilot", dataset=StudyDataset(sha256="0"), task=("pan",))
    text = '{"dataset":{"sha256":"0"},"study":"pilot","task":["pan"]}'
    assert config.canonical_json() == text
    assert config.study_version == hashlib.sha256(text.encode()).hexdigest()
    assert study(steps=500).study_version == study().study_version
    assert study(steps=499).study_version != study().study_version


def test_a_field_of_a_later_version_leaves_running_studies_alone() -> None:
    class LaterConfig(StudyConfig):
        breaks_every: int = 10

    values = study().model_dump()
    assert LaterConfig(**values).study_version == study().study_version
    assert LaterConfig(**values, breaks_every=5).study_version != study().study_version


def test_intervals_of_a_study_without_the_field_take_episodes_for_random_and_its_version_stays(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(EXAMPLE)
    old = load_study(tmp_path)
    assert old.aggregate.intervals == "episodes"
    assert old.study_version == "37e363a130291f559d8592b767675fb3e6c0d49ebbfd3dd64c3f558cd6587142"
    new = old.model_copy(update={"aggregate": StudyAggregate(intervals="homes")})
    assert new.study_version != old.study_version


@pytest.mark.parametrize("word", ["none", "No", " nothing. ", "-", "n/a", "Keine", "nein", "'\"\"'"])
@pytest.mark.parametrize("field", ["ethics: {language_model: %s}", "survey: {eligibility: [%s]}"])
def test_a_word_that_says_there_is_none_is_not_printed_for_participants(field: str, word: str, tmp_path: Path) -> None:
    quoted = word if word.startswith("'") else f"'{word}'"
    (tmp_path / "study.yaml").write_text(EXAMPLE + field % quoted)
    with pytest.raises(StudyError, match=r"expected: .*leave it empty if there is none\. Correct the field"):
        load_study(tmp_path)


def test_a_text_that_begins_with_such_a_word_is_one_for_participants(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(EXAMPLE + "ethics: {language_model: None of your data leaves this room.}")
    assert load_study(tmp_path).ethics.language_model == "None of your data leaves this room."


def test_a_study_file_comes_back_as_it_was_and_is_never_replaced(tmp_path: Path) -> None:
    config = study(camera={"width": 320, "height": 240}, actions="paper6", privacy={"retention": "2027-12-31"})
    path = save_study(tmp_path, config)
    assert load_study(tmp_path) == config
    assert save_study(tmp_path, config) == path
    with pytest.raises(StudyError, match="A study never changes"):
        save_study(tmp_path, study(steps=9))
    assert load_study(tmp_path) == config
    assert config.robot_camera == Camera(320, 240, 79.0, 0.88)
    assert Action.LOOK_UP in config.action_set


def written_fields(model: type[BaseModel], above: str = "") -> Iterator[str]:
    """Dotted names of all fields of a study file."""
    for name, field in model.model_fields.items():
        parts = [field.annotation, *get_args(field.annotation)]  # a block may be left out
        kind = next((part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)), None)
        if kind is not None:
            yield from written_fields(kind, f"{above}{name}.")
        else:
            yield f"{above}{name}"


def test_a_study_file_tells_the_meaning_the_values_and_the_default_of_every_field(tmp_path: Path) -> None:
    choices = {"design": {"overbook": 1.2}, "sequences": {"sha256": "0"}}
    lines = save_study(tmp_path, study(**choices)).read_text().splitlines()
    assert lines[0] == "# yaml-language-server: $schema=study.schema.json"
    schema = json.loads((tmp_path / "study.schema.json").read_text())
    for place in written_fields(StudyConfig):
        *parents, name = place.split(".")
        (number,) = [
            number
            for number, line in enumerate(lines)
            if line.startswith("  " * len(parents) + f"{name}:")
            and (not parents or section_of(lines, number) == parents)
        ]
        meaning, allowed = field_told(schema, place)
        assert meaning, f"{place} has no line under it"
        comments = list(itertools.takewhile(lambda line: line.strip().startswith("#"), reversed(lines[:number])))
        said = " ".join(line.strip().removeprefix("#").strip() for line in reversed(comments))
        assert f"{meaning} {allowed}" in said
    assert (
        "  # 1.15 makes 15 % more links than needed; the people who use them get the trials that others leave." in lines
    )
    assert lines[lines.index("  overbook: 1.2") - 1] == "  #   number from 1 to 3; default 1.0"
    assert lines[lines.index("actions: paper4") - 1] == "#   paper4 | paper6; default paper4"


def section_of(lines: list[str], number: int) -> list[str]:
    """The section of an indented line."""
    return [next(line for line in reversed(lines[:number]) if line[:1] not in (" ", "#", "")).removesuffix(":")]


@pytest.mark.parametrize(
    "text",
    [
        "a: b # c",
        "two\nlines\n",
        "'\"",
        "{[",
        "- x",
        "null",
        "2026-11-22",
        "ü\u2028x",
        "\u001b[31m",
        " ",
        "%",
        "9" * 300,
    ],
)
def test_any_text_comes_back_from_a_study_file(tmp_path: Path, text: str) -> None:
    config = study(ethics={"pay": text}, exclusions={"late": text}, dataset={"sha256": "x", "scenes": [text]})
    save_study(tmp_path, config)
    assert load_study(tmp_path) == config


def test_the_schema_takes_study_files_and_refuses_what_the_program_refuses(tmp_path: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    save_study(tmp_path, study(task=["pan", "pog"], privacy={"retention": "2027-12-31"}))
    checked = jsonschema.Draft202012Validator(json.loads((tmp_path / "study.schema.json").read_text()))
    written = json.loads(json_from_yaml(tmp_path / "study.yaml", expected="", advice=""))
    assert checked.is_valid(written)
    assert checked.is_valid(json.loads(json.dumps(yaml.safe_load(EXAMPLE), default=str)))
    for change in ({"steps": 501}, {"actions": "all"}, {"desing": {}}, {"design": {"kind": "random"}}):
        assert not checked.is_valid(written | change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_steps": 3}, "max_steps is 3; expected: Extra inputs are not permitted"),
        ({"desing": {}}, "Extra inputs are not permitted. Did you mean 'design'? Correct the field"),
        (
            {"memory": {"arm": ["none"]}},
            "memory.arm is ['none']; expected: Extra inputs are not permitted. Did you mean",
        ),
        ({"steps": 501}, "steps is 501; expected: Input should be less than or equal to 500"),
        ({"actions": "all"}, "actions is 'all'; expected: Input should be 'paper4' or 'paper6'"),
        ({"actions": "paper"}, "Input should be 'paper4' or 'paper6'. Did you mean 'paper"),
        ({"study": "../up"}, "study is '../up'"),
        ({"task": ["pan", "pan"]}, "each of task once"),
        ({"memory": {"arms": ["none", "none"]}}, "each of memory.arms once"),
        ({"design": {"kind": "random"}}, "design.kind is 'random'"),
        ({"privacy": {"retention": "soon"}}, "privacy.retention is 'soon'"),
        ({"resume_within_s": float("inf")}, "resume_within_s is inf"),
        ({"memory": {"min_s": 5, "max_s": 2}}, "min_s at most max_s, found 5 and 2"),
        ({"memory": {"max_s": 0}}, "memory.max_s is 0; expected: Input should be greater than 0"),
        ({"pog": {"look_min_s": 300}}, "look_min_s at most look_max_s, found 300 and 120"),
        ({"pog": {"look_max_s": 0}}, "pog.look_max_s is 0"),
        ({"hidden_max_s": -1}, "hidden_max_s is -1"),
        ({"primary": ["memory_effect_SR", "people are better"]}, "primary.1 is 'people are better'"),
        ({"primary": ["human_minus_agent_success"]}, "with one of SR, SPL, SoftSPL, DTG, steps, time as MEASURE"),
    ],
)
def test_a_bad_study_file_names_the_field(tmp_path: Path, change: dict[str, object], message: str) -> None:
    values = study().model_dump(mode="json") | change
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(StudyError) as caught:
        load_study(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("study: [", r"study\.yaml, line \d+: is not YAML"),
        ("- a", "holds list; expected fields such as study:"),
        ("!!python/object/apply:os.getcwd []", r"study\.yaml, line 1: is not YAML"),
        ("study: a\n2026-11-22: b", r"line 2: is not YAML \(found key '2026-11-22', which is no text"),
        ("study: a\n? [1, 2]\n: b", r"line 2: is not YAML \(found key 'sequence', which is no text"),
        ("study: &x [*x]", r"study\.yaml: holds a value that cannot be used \(Circular reference"),
        ("study: a\nsteps: " + "9" * 5000, r"line 2: is not YAML \(found '9{40}', which cannot be read"),
        ("steps: 0x" + "f" * 5000, r"study\.yaml: holds a value that cannot be used \(Exceeds the limit"),
        ("study: 2026-99-99", r"line 1: is not YAML \(found '2026-99-99', which cannot be read"),
        ("study: " + "[" * 5000, r"study\.yaml: is nested too deeply"),
        ("study: a\nsteps: 5\nstudy: b", r"line 3: is not YAML \(found 'study' twice; expected each field once"),
        ("memory:\n  max_s: 5\n  max_s: 6", r"line 3: is not YAML \(found 'max_s' twice"),
    ],
)
def test_a_file_that_is_no_study_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(StudyError, match=message) as caught:
        load_study(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_folder_without_a_study_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="personal-viz study init"):
        load_study(tmp_path)
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(StudyError, match=r"study\.json: is of an earlier version.*check-db, then export"):
        load_study(tmp_path)


def test_participants_see_the_studys_query_and_limits() -> None:
    task = study(query_index=1, steps=7).task_for(episode(), "pan")
    assert (task.queries, task.max_steps, len(task.actions)) == (("Where is it?",), 7, 4)
    with pytest.raises(StudyError, match="has 2 queries; expected 0 to 1"):
        study(query_index=2).task_for(episode(), "pan")


def test_tokens_are_128_bit_and_match_only_their_own_hash() -> None:
    token = new_token()
    assert len(token) == 22
    assert token_hash("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert token_matches("abc", token_hash("abc"))
    assert not token_matches("abd", token_hash("abc"))


def test_ids_are_26_safe_characters_in_order_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.time_ns", lambda: 1_469_918_176_385 * 10**6)
    first = new_id()
    monkeypatch.setattr("time.time_ns", lambda: 1_469_918_176_386 * 10**6)
    assert first.startswith("01ARYZ6S41")  # the example of the ULID specification
    assert len(first) == 26
    assert first < new_id()


def test_choices_of_pointing_do_not_change_a_study_that_leaves_them_as_they_were() -> None:
    assert "pointing" not in study(pog={"pointing": "free"}).canonical_json()
    assert study(pog={"pointing": "free"}).study_version == study(pog={}).study_version
    assert study(pog={"pointing": "snap"}).study_version != study(pog={}).study_version
    same = {"pog": {"room_names": "off", "object_names": "auto"}, "storey_names": "numbers"}
    assert study(**same).study_version == study(pog={}).study_version
    assert study(pog={"object_names": "on"}).study_version != study(pog={}).study_version


def test_a_survey_needs_a_page_that_asks_for_consent() -> None:
    survey = {"questions": ["age"]}
    assert study(flow=("consent",), survey=survey).survey.questions == ("age",)
    with pytest.raises(ValidationError, match=r"survey\.questions only with consent in flow"):
        study(flow=("instructions",), survey=survey)
    with pytest.raises(ValidationError, match=r"each of survey\.questions once"):
        study(flow=("consent",), survey={"questions": ["age", "age"]})
    with pytest.raises(ValidationError, match="Input should be"):
        study(flow=("consent",), survey={"questions": ["shoe_size"]})


def test_fields_of_later_versions_leave_the_hash_of_earlier_studies_alone() -> None:
    assert study().study_version == study(survey={}, smallest_effect=None, sample_size_reason="").study_version
    assert '"survey"' not in study().canonical_json()
    assert study(smallest_effect=5.0).study_version != study().study_version


def test_facts_for_the_report_can_be_written_at_any_time_and_change_no_hash(tmp_path: Path) -> None:
    later = study(reporting={"preregistration": "registry.example/17"})
    assert later.study_version == study().study_version
    save_study(tmp_path, study())
    save_study(tmp_path, later)
    assert load_study(tmp_path) == later

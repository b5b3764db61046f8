"""`personal-viz study status`, on a study that is written at the same time."""

import dataclasses
import io
import json
import re
import sys
from pathlib import Path

import pytest
from rich.console import Console

from human_study.journey import Place
from human_study.store.progress import PersonProgress, State
from personal_viz.cli.study import status
from personal_viz.cli.study.status import MIN_WIDTH, StudyStatus, page, progress_now
from personal_viz.study_app.operator.progress_view import place_words
from sim.errors import StudyError
from tests.human_study.finished import study_with_trials
from tests.human_study.small_world import CANARY
from tests.human_study.stores import KEY, opened

from .busy_studies import busy_study


def person(place: Place, state: State = "active", *, trial_no: int | None = None, is_in_trial: bool = False):
    """A participant with ten counted trials."""
    return PersonProgress("p01", "pan", place, state, 2, 10, trial_no, trial_no, is_in_trial, 5.0, 0, 0, 0)


def test_the_tables_show_the_place_of_everybody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study_with_trials(tmp_path)
    assert StudyStatus(study=tmp_path).run() == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "pilot" in lines
    assert any("2 of 6 counted trials" in line for line in lines)
    assert "PAN none easy 1 2 0 0 3" in lines
    rows = [re.sub(r"\d+ s ", "now ", line) for line in lines if line.startswith("p0")]
    assert rows == [
        "p01 POG active before trial 2 of 3 p01/2 1/3 now · · ·",
        "p02 PAN active before trial 2 of 3 p02/2 1/3 now · 1 ·",
    ]


def test_people_who_may_need_help_come_first_and_those_who_never_came_last(tmp_path: Path) -> None:
    busy_study(tmp_path).close()
    found = progress_now(tmp_path)
    people = [dataclasses.replace(one, state="stuck") if one.code == "p06" else one for one in found.people]
    console = Console(width=MIN_WIDTH, file=io.StringIO(), record=True)
    console.print(page(dataclasses.replace(found, people=tuple(people))))
    text = console.export_text()
    assert re.findall(r"^ +(p\d+) ", text, re.MULTILINE) == ["p06", "p01", "p02", "p03", "p05", "p04"]
    assert "4 active, 1 stuck?, 1 out, 12 not arrived" in text
    assert text.rstrip().endswith("Not arrived: " + ", ".join(f"p{number:02d}" for number in range(7, 19)))


def test_the_json_is_one_document_without_outcomes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study_with_trials(tmp_path)
    assert StudyStatus(study=tmp_path, json=True).run() == 0
    text = capsys.readouterr().out
    found = json.loads(text)
    assert [(one["code"], one["num_done"], one["num_technical"]) for one in found["people"]] == [
        ("p01", 1, 0),
        ("p02", 1, 1),
    ]
    assert (found["num_done"], found["num_all"]) == (2, 6)
    assert all(word not in text for word in ("success", '"spl"', "dtg", "distance", '"stop"', '"click"', CANARY))


def test_a_study_that_is_open_elsewhere_can_be_looked_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with opened(tmp_path) as (store, trial):
        store.append(trial.trial_id, trial.epoch, KEY)
        assert StudyStatus(study=tmp_path, json=True).run() == 0
        store.append(trial.trial_id, trial.epoch, KEY)
    assert json.loads(capsys.readouterr().out)["people"][1]["is_in_trial"]


def test_watching_shows_what_is_new_until_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(tmp_path) as (store, _):
        seen: list[int] = []

        class Terminal(io.StringIO):
            def write(self, text: str) -> int:
                if text.strip():
                    seen.append(json.loads(text)["people"][1]["num_reconnects"])
                    if seen == [0]:
                        store.open_trial("p02", 1)
                    if seen[-1] == 1:
                        raise KeyboardInterrupt
                return len(text)

        monkeypatch.setattr(status, "EVERY_S", 0.0)
        monkeypatch.setattr(sys, "stdout", Terminal())
        assert StudyStatus(study=tmp_path, json=True, watch=True).run() == 0
    assert (seen[0], seen[-1]) == (0, 1)


def test_a_folder_without_a_study_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="expected a study"):
        StudyStatus(study=tmp_path).run()


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (person("trial", trial_no=3, is_in_trial=True), "trial 3 of 10"),
        (person("trial", trial_no=3), "before trial 3 of 10"),
        (person("pause"), "between two sittings"),
        (person("dropped_out", "out"), "dropped out"),
    ],
)
def test_places_are_said_in_words(shown: PersonProgress, words: str) -> None:
    assert place_words(shown) == words

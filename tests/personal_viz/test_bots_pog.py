"""Simulated POG participants: what they see of a home, where they click, and the counts of what they did."""

import json
from pathlib import Path

import numpy as np
import pytest

from human_study.design.study import StudyBreaks, StudyPog, StudyPractice
from human_study.store.records import read_study
from human_study.trial.commands import Click, Confirm, Start
from human_study.trial.events import ShownStorey
from human_study.trial.session import PogSession
from personal_viz.bots.crowd import run_bots
from personal_viz.bots.forms import right_answers
from personal_viz.bots.page import BotPage, Element
from personal_viz.bots.records import KINDS, BotCount, BotLog, Pointed, Ray, Sent, count_bots
from personal_viz.bots.server import Server
from personal_viz.bots.site import Person, Site, make_bot_study
from personal_viz.cli.study.bots import StudyBots
from personal_viz.cli.study.verify import StudyVerify
from sim.errors import StudyError
from sim.tasks.run_files import Answer
from sim.types import EpisodeKey, TaskKind
from tests.human_study.small_world import SCENE_DIGEST, episode, study
from tests.human_study.stores import open_planned, plan_homes
from tests.human_study.trials import ray_down

from .invented import invented_dataset

RESULT = {
    "participants",
    "seconds",
    "actions",
    "frames",
    "ack_p50_ms",
    "ack_p95_ms",
    "key_to_frame_p50_ms",
    "key_to_frame_p95_ms",
    "lost",
    "duplicated",
}
"""Figures that the issue and readers of the document ask for."""
CONDITIONS = ("map_2d", "map_open", "map_first")
_DOWN = (0.0, -1.0, 0.0)


def test_bots_know_the_right_answers_of_their_own_task() -> None:
    config = study(task=("pan", "pog"))
    assert "Click again: the mark moves" in right_answers(config, "pog")
    assert "Click again: the mark moves" not in right_answers(config, "pan")
    assert "Press STOP (or Enter) twice" not in right_answers(config, "pog")


def pog_click(ray: Ray, *, is_move: bool = False) -> Click:
    """A click that met the floor; for a moved mark the server makes the ray, with a camera at its origin."""
    origin, direction = ray
    camera = origin if is_move else (9.0, 9.0, 9.0)
    pointed = ray_down(*origin).model_copy(update={"direction": direction, "camera_position": camera})
    return Click(pointed, (origin[0], 0.0, origin[2]))


def counted(folder: Path, commands: list[tuple[float, Click | Confirm]], log: BotLog, *, twice: int = 0) -> BotCount:
    """The counts after a trial of these commands (at these seconds); the last `twice` events stored twice."""
    config = study(task=("pog",), pog={"conditions": ("map_open",)})
    session = PogSession(
        key=EpisodeKey("easy", "room", "0"),
        task=config.task_for(episode(), "pog"),
        storeys=(0.0,),
        scene_digest=SCENE_DIGEST,
    )
    events = [*session.handle(Start(), 0.0).events]
    for at_s, command in commands:
        events += session.handle(command, at_s).events
    events += events[len(events) - twice :]
    with open_planned(folder, config, plan_homes(config, ["room"])) as store:
        trial = store.open_trial(log.code, 1)
        store.append_many(trial.trial_id, trial.epoch, tuple(events))
    return count_bots(folder, [log])


def ray_at(x: float) -> Ray:
    return ((x, 8.0, 0.0), (0.001, -1.0, 0.0))


def clicked_at(*places: float) -> list[Pointed]:
    return [Pointed(0.0, (x, 0.0), ray_at(x)) for x in places]


def test_every_click_is_looked_for_by_itself(tmp_path: Path) -> None:
    log = BotLog("p01", "random", task="pog", points=clicked_at(1, 2, 3, 4), answers=[Sent(0.0)])
    log.points[3].was_cut_off = True
    commands = [(1.0, pog_click(ray_at(1))), (2.0, pog_click(ray_at(2))), (3.0, pog_click(ray_at(9))), (4.0, Confirm())]
    found = counted(tmp_path, commands, log)
    assert (found.sent, found.stored) == (4, 2)
    assert found.lost == ("p01 (random): click 3 of 4",)
    assert (found.cut_off, found.duplicated, found.unknown) == (1, 0, 1)
    assert found.answers == 1


def test_a_click_that_came_too_soon_is_stored_as_dropped_and_not_lost(tmp_path: Path) -> None:
    log = BotLog("p01", "impatient", task="pog", points=clicked_at(1, 2))
    found = counted(tmp_path, [(1.0, pog_click(ray_at(1))), (1.01, pog_click(ray_at(2)))], log)
    assert (found.stored, found.lost, found.dropped) == (1, (), {"rate": 1})


def test_an_answer_without_its_confirmation_is_lost_and_a_second_one_is_a_duplicate(tmp_path: Path) -> None:
    log = BotLog("p01", "random", task="pog", points=clicked_at(1), answers=[Sent(0.0)])
    found = counted(tmp_path / "lost", [(1.0, pog_click(ray_at(1)))], log)
    assert found.lost == ("p01 (random): an answer of 1",)
    assert found.answers == 0
    commands = [(1.0, pog_click(ray_at(1))), (2.0, Confirm())]
    found = counted(tmp_path / "twice", commands, log, twice=2)
    assert (found.lost, found.duplicated, found.answers) == ((), 2, 1)  # the click and its confirmation


def test_moves_of_the_mark_are_counted_by_their_number(tmp_path: Path) -> None:
    moved = pog_click(((1.1, 8.0, 0.0), _DOWN), is_move=True)
    points = [*clicked_at(1), Pointed(0.0, (1.0, 0.0)), Pointed(0.0, (1.1, 0.0))]
    log = BotLog("p01", "random", task="pog", points=points)
    found = counted(tmp_path / "lost", [(1.0, pog_click(ray_at(1))), (2.0, moved)], log)
    assert (found.stored, found.lost) == (2, ("p01 (random): a move of the mark",))
    points[2].was_cut_off = True
    found = counted(tmp_path / "cut off", [(1.0, pog_click(ray_at(1))), (2.0, moved)], log)
    assert (found.stored, found.lost, found.cut_off, found.unknown) == (2, (), 1, 0)


def test_a_bot_knows_which_mark_answers_a_click_and_which_a_move() -> None:
    (clicked,), moved = clicked_at(1.0), Pointed(0.0, (1.0, 0.0))
    assert clicked.is_marked_by((1.01, 0.7, -0.01))  # the ray met something above the floor
    assert not clicked.is_marked_by((1.1, 0.0, 0.0))
    assert moved.is_marked_by((1.0, 0.0, 0.1))
    assert not moved.is_marked_by((1.0, 0.0, 0.0))


def test_one_more_mark_is_no_storey_of_a_home_with_one_storey() -> None:
    page = BotPage()
    for number, label in enumerate(("Set one more mark", "Take back the last mark", "Confirm the marks")):
        page.elements[label] = Element(label, "GuiButtonMessage", {"label": label, "order": number})
    assert page.storey_button(0) is None
    page.elements["storey"] = Element("storey", "GuiButtonMessage", {"label": "Show first floor", "order": -1})
    assert page.storey_button(0) == page.elements["storey"]
    assert page.storey_button(1) is None


def everybody(task: TaskKind, *codes: str) -> list[Person]:
    return [Person(code, task, f"link of {code}") for code in codes]


def test_people_of_both_tasks_are_taken_in_the_plans_order() -> None:
    site = Site(
        Path("s"), Path("d"), None, (*everybody("pan", "p01", "p100", "p03"), *everybody("pog", "p02", "p04")), None
    )
    assert [person.code for person in site.people(("pan", "pog"))] == ["p01", "p02", "p03", "p04", "p100"]
    assert site.people(("pog",)) == everybody("pog", "p02", "p04")


def test_too_few_participants_of_a_task_are_said_before_anybody_comes_in() -> None:
    site = Site(Path("s"), Path("d"), None, tuple(everybody("pan", "p01")), None)
    with pytest.raises(StudyError, match="has 0 POG participants; expected at least 1"):
        run_bots(site, participants=1, seconds=1, rate=1, kinds=("random",), seed=0, tasks=("pog",))


@pytest.mark.release
def test_bots_that_know_the_target_answer_rightly_under_all_conditions(tmp_path: Path) -> None:
    """The golden bot: practice, counted trials, a break, the question how sure; every stored trial verifies."""
    dataset = tmp_path / "dataset"
    invented_dataset(dataset, name="BotHome", seed=3, episodes_per_split=1)
    make_bot_study(
        tmp_path,
        participants=1,
        seed=3,
        dataset=dataset,
        task=("pog",),
        pog=StudyPog(conditions=CONDITIONS),
        practice=StudyPractice(pog=1),
        breaks=StudyBreaks(every=2, sitting_max=None),
        confidence=True,
    )
    with Server(tmp_path / "study", dataset) as server:
        site = server.start()
        figures = run_bots(site, participants=3, seconds=240, rate=12, kinds=("shortest",), seed=1, tasks=("pog",))
    assert (figures.tasks, figures.problems) == ({"pog": 3}, ())
    assert (figures.finished, figures.answers) == (3, 12)  # a practice trial and three counted ones each
    assert (figures.lost, figures.duplicated, figures.unknown, figures.cut_off) == (0, 0, 0, 0)
    with read_study(tmp_path / "study") as reader:
        people = [reader.participant(code) for code in reader.codes()]
        trials = [trial for code in reader.codes() for trial in reader.trials(code)]
        climbed = {
            trial.condition
            for trial in trials
            if trial.trial_id is not None
            for stored in reader.events(trial.trial_id)
            if isinstance(stored.event, ShownStorey)
        }
    assert climbed == {"map_2d"}  # the practice home has two storeys, and practice is under the first condition
    assert all({"quiz_passed", "break_ended", "finished"} <= {entry.stage for entry in one.stages} for one in people)
    assert {trial.condition for trial in trials if trial.phase == "main"} == set(CONDITIONS)
    answers = [trial.outcome for trial in trials]
    assert all(isinstance(answer, Answer) and answer.reason == "click" for answer in answers)
    measures = [answer.measures for answer in answers if isinstance(answer, Answer) and answer.measures is not None]
    assert len(measures) == 12
    assert sum(one.success for one in measures) == 12
    assert StudyVerify(study=tmp_path / "study", dataset=dataset, store=False).run() == 0


@pytest.mark.slow
def test_every_kind_takes_part_in_both_tasks_and_nothing_is_lost(
    small_home_root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("personal_viz.bots.walker.DROP_CHANCE", 0.2)  # many times in a few seconds
    chosen = StudyBots(dataset=small_home_root, seconds=12.0, rate=3.0, task="both", kinds=KINDS, seed=4, json=True)
    assert chosen.run() == 0
    found = json.loads(capsys.readouterr().out)
    assert found["tasks"] == {"pan": 5, "pog": 5}
    assert (found["lost"], found["duplicated"], found["unknown"], found["problems"]) == (0, 0, 0, [])
    assert found["connections"] > 10
    assert found["frames"] > 10
    assert found["clicks"] > 10
    assert found["answers"] > 3
    assert found["actions"] > max(20, found["clicks"])
    assert 0 < found["click_to_mark_p50_ms"] <= found["click_to_mark_max_ms"]
    assert set(found) >= RESULT
    assert found["dropped"].get("busy", 0) + found["dropped"].get("rate", 0) > 0  # the impatient ones
    assert 0 < found["ack_p50_ms"] <= found["ack_p95_ms"] <= found["ack_max_ms"]
    assert found["ack_p50_ms"] <= found["key_to_frame_p50_ms"]
    assert np.isfinite(found["server_cpu_ms_per_action"])

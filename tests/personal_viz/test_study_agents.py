"""Agents on exactly what a study's people do: episodes, limits and homes of the plan, and what is refused."""

import shutil
from pathlib import Path

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import StudyMemory, StudyPractice, load_study
from personal_viz.cli.grounding.ground import Ground
from personal_viz.cli.runs.run import Run
from personal_viz.cli.runs.study_walks import study_walks, walk_terms
from personal_viz.study_app.planned_study import PlannedStudy, open_planned
from sim.errors import StudyError
from sim.tasks.run_files import read_run
from sim.types import PAPER4, EpisodeKey

from .flow_studies import plan_small

STEPS = 12


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A planned study of both tasks with three looks, 12 steps, four actions and the second paraphrase."""
    choices = {
        "task": ("pan", "pog"),
        "memory": StudyMemory(arms=("none", "topdown", "glb")),
        "practice": StudyPractice(pan=0, pog=0),
        "steps": STEPS,
        "query_index": 1,
    }
    return plan_small(tmp_path_factory.mktemp("planned"), **choices)


def opened(study: Path, task: str = "pan") -> PlannedStudy:
    return open_planned(Run(study=study, agent="random"), task)


def planned(study: Path, task: str, condition: str) -> set[EpisodeKey]:
    """The episodes of a condition, straight from the plan's people."""
    people = load_plan(study, load_study(study)).participants
    trials = [trial for person in people for trial in person.trials if trial.phase == "main"]
    return {trial.key for trial in trials if (trial.task, trial.condition) == (task, condition)}


def test_an_agent_without_looks_plays_the_plans_episodes_once_with_the_limits_of_people(study: Path) -> None:
    assert Run(study=study, agent="random").run() == 0
    run = read_run(study / "runs" / "flow-random-seed0")
    assert {item.key for item in run.episodes} == planned(study, "pan", "none")
    assert len(run.episodes) == 2
    assert all(len(item.steps) <= STEPS for item in run.episodes)
    assert {step.action for item in run.episodes for step in item.steps} <= set(PAPER4)
    assert (run.info.condition, run.info.labels, run.info.dataset_digest) == (
        "none",
        False,
        load_study(study).dataset.sha256,
    )
    told = {name: run.info.config[name] for name in ("actions", "max_steps", "clutter", "study", "study_conditions")}
    assert told == {
        "actions": "paper4",
        "max_steps": 12,
        "clutter": 0,
        "study": "flow",
        "study_conditions": "none,memory_glb,memory_topdown",
    }
    assert run.info.config["study_version"] == load_study(study).study_version


def test_agents_read_and_may_do_what_people_may(study: Path) -> None:
    found = opened(study)
    for episode in found.dataset.episodes():
        assert walk_terms(found).task(episode) == found.config.task_for(episode, "pan")
    assert walk_terms(found).camera == found.config.robot_camera


def test_each_look_that_an_agent_can_take_is_a_run_of_its_own(study: Path, tmp_path: Path) -> None:
    found = opened(study)
    walks = study_walks(found, frozenset({"glb"}), out=tmp_path, seed=3)
    assert [(walk.conditions, walk.condition) for walk in walks] == [
        (("none", "topdown"), "none"),
        (("glb",), "memory_glb"),
    ]
    assert [walk.look_at and walk.look_at.kind for walk in walks] == [None, "glb"]
    assert [set(walk.keys) for walk in walks] == [planned(study, "pan", "none"), planned(study, "pan", "glb")]
    only = StudyMemory(arms=("topdown",))
    other = opened(plan_small(tmp_path / "other", memory=only, practice=StudyPractice(pan=0, pog=0)))
    (blind,) = study_walks(other, frozenset(), out=tmp_path, seed=3)
    assert (blind.conditions, blind.condition) == (("topdown",), "no exposure")


def test_a_grounder_answers_the_plans_episodes_on_all_storeys(study: Path) -> None:
    assert Ground(study=study, method="center").run() == 0
    run = read_run(study / "runs" / "flow-ground-center-oracle-hashed-all-storeys-seed0")
    assert {answer.key for answer in run.answers} == planned(study, "pog", "map_first")
    assert not any(answer.storey_given for answer in run.answers)
    assert (run.info.config["study_conditions"], run.info.config["query_index"]) == ("map_first", 1)


def test_options_that_say_what_the_plan_says_are_refused(study: Path) -> None:
    with pytest.raises(
        StudyError, match=r"--split: found \('easy',\) beside --study; expected none, because the study"
    ):
        Run(study=study, agent="random", split=("easy",)).run()
    with pytest.raises(StudyError, match="--clutter: found 1 beside --study"):
        Ground(study=study, method="center", clutter=1).run()
    with pytest.raises(StudyError, match="--labels: found 'on' beside --study"):
        Run(study=study, agent="random", labels="on").run()


def test_a_study_without_the_task_and_another_dataset_are_refused(study: Path, tmp_path: Path) -> None:
    walks = plan_small(tmp_path, practice=StudyPractice(pan=0, pog=0))
    with pytest.raises(StudyError, match=r"study.yaml: task is 'pan'; expected 'pog' among them.*personal-viz run"):
        Ground(study=walks, method="center").run()
    other = tmp_path / "other"
    shutil.copytree(study.parent / "dataset", other)
    moved = (tmp_path / "dataset").rename(tmp_path / "moved")
    with pytest.raises(StudyError, match=r"the dataset of the plan is no longer at .*dataset; expected it there"):
        opened(walks)
    assert open_planned(Run(study=walks, agent="random", dataset=moved), "pan").dataset.root == moved
    next((other / "easy" / "content").glob("*.json.gz")).unlink()
    with pytest.raises(StudyError, match=r"--dataset .*other: has digest .*; expected .*, the study's"):
        open_planned(Run(study=walks, agent="random", dataset=other), "pan")

"""Agents in the home sequences of a study: its set, limits, actions and paraphrase, and beside its people."""

from pathlib import Path
from typing import ClassVar

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import StudyPractice, save_study
from human_study.sequence_report.source import read_sequences
from human_study.trial.commands import GiveUp
from personal_viz.cli.grounding.ground import Ground
from personal_viz.cli.runs.run import Run
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.study_app.planned_study import open_planned
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.errors import PersonalVizError, StudyError
from sim.sequences.runs import SequenceRun, read_sequence_runs
from sim.tasks.run_files import read_run_info
from sim.types import Action, Observation, Task
from tests.human_study import stores
from tests.human_study.sequence_trials import do_sequence, home_of, sequence_study
from tests.sim.home_story import MESSAGES, SUBTASKS, told_in

from .flow_studies import plan_small

STEPS = 40
FIRST = {"messages": MESSAGES[:2], "subtasks": SUBTASKS[:3]}
"""A search for one object, one for all, and one after news."""


@pytest.fixture(scope="module")
def study(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with 40 steps, four actions and the second paraphrase, in which each task has one person who gave up."""
    root = tmp_path_factory.mktemp("told")
    story = told_in(small_home_root, root / "set", **FIRST)
    config = sequence_study(
        dataset={"sha256": PersonalDataset(small_home_root).digest()},
        sequences={"sha256": SequenceSet(root / "set").digest(), "history": "hidden"},
        steps=STEPS,
        actions="paper4",
        query_index=1,
    )
    save_study(root / "study", config)
    assert StudyPlanVerb(root / "study", small_home_root, sequences=root / "set", pilot=True).run() == 0
    plan, home = load_plan(root / "study", config), home_of(small_home_root, [story])
    with stores.open_planned(root / "study", config, plan) as store:
        for person in plan.participants:
            do_sequence(store, person.code, 1, story, home, [GiveUp()] * 2 * len(story.record.subtasks))
    return root / "study"


def only_run(folder: Path) -> SequenceRun:
    (run,) = read_sequence_runs(folder)
    return run


class ToldWhat:
    """Follows sequences: notes its task and the queries, and says FOUND."""

    follows_sequences = True
    tasks: ClassVar[list[Task]] = []
    queries: ClassVar[list[str]] = []

    def reset(self, task: Task, camera: object, *, seed: int, keep_memory: bool = False) -> None:
        self.tasks.append(task)

    def act(self, observation: Observation) -> Action:
        if observation.query is not None:
            self.queries.append(observation.query)
        return Action.FOUND


def told_what(**_: object) -> ToldWhat:
    return ToldWhat()


@pytest.mark.slow
def test_agents_walk_what_people_walk_and_stand_beside_them(study: Path) -> None:
    assert Run(study=study, agent="shortest-path").run() == 0
    assert Run(study=study, agent="random", ignore_messages=True).run() == 0
    assert Ground(study=study, method="rpg", phrases="rules").run() == 0
    runs = study / "runs"
    walked = only_run(runs / "sequences-shortest-path-invented-seed0")
    assert [search.reason for search in walked.end.searches] == ["found", "steps", "found"]
    assert [search.measures.num_steps for search in walked.end.searches if search.reason == "steps"] == [STEPS]
    assert {step.action for step in walked.steps} <= {Action.FORWARD, Action.LEFT, Action.RIGHT, Action.FOUND}
    info = read_run_info(runs / "sequences-shortest-path-invented-seed0")
    told = ("actions", "max_steps", "query_index", "study", "study_conditions")
    assert [info.config[name] for name in told] == ["paper4", STEPS, 1, "sequences", "history_hidden"]

    source = read_sequences([study])
    assert source is not None
    assert source.left_out == ()
    assert [one.who for one, _ in source.agents] == ["random", "rpg", "shortest-path"]


def test_an_agent_reads_and_may_do_what_people_may(study: Path, tmp_path: Path) -> None:
    told = Run(study=study, agent=f"{__name__}:told_what", out=tmp_path)
    assert told.run() == 0
    planned = open_planned(told, "pan")
    assert planned.sequences is not None
    (sequence,) = SequenceSet(planned.sequences).sequences()
    assert ToldWhat.tasks == [planned.config.sequence_task_for(sequence, "pan")]
    assert ToldWhat.queries == [subtask.query[1] for subtask in sequence.record.subtasks]


def test_options_and_sets_that_do_not_fit_the_study_are_refused(
    study: Path, small_home_root: Path, tmp_path: Path
) -> None:
    with pytest.raises(PersonalVizError, match="--shard beside --study of home sequences: expected one of them"):
        Run(study=study, agent="random", shard="1/2").run()
    with pytest.raises(PersonalVizError, match="--sweep beside --study of home sequences: expected one of them"):
        Ground(study=study, method="rpg", sweep="blur=0,1").run()
    with pytest.raises(StudyError, match=r"--split: found \('easy',\) beside --study"):
        Run(study=study, agent="random", split=("easy",)).run()
    told_in(small_home_root, tmp_path / "other", messages=MESSAGES[:1], subtasks=SUBTASKS[:1])
    with pytest.raises(StudyError, match=r"--sequences .*other: has digest .*; expected .*, the study's"):
        Run(study=study, agent="random", sequences=tmp_path / "other").run()
    moved = study.parent / "set"
    moved.rename(tmp_path / "moved")
    with pytest.raises(PersonalVizError, match=f"{moved}: found no file of sequences"):
        Run(study=study, agent="random").run()
    try:
        assert Run(study=study, agent="random", sequences=tmp_path / "moved", out=tmp_path).run() == 0
    finally:
        (tmp_path / "moved").rename(moved)


@pytest.mark.slow
def test_a_set_beside_a_study_of_episodes_is_refused(study: Path, tmp_path: Path) -> None:
    plan_small(tmp_path, task=("pan", "pog"), practice=StudyPractice(pan=0, pog=0))
    with pytest.raises(StudyError, match="found a set for a study of episodes"):
        Run(study=tmp_path / "study", agent="random", sequences=study.parent / "set").run()
    with pytest.raises(
        PersonalVizError, match="--ignore-messages: found no --sequences; expected it too, or a --study"
    ):
        Run(study=tmp_path / "study", agent="random", ignore_messages=True).run()
    with pytest.raises(
        PersonalVizError, match="--ignore-messages: found no --sequences; expected it too, or a --study"
    ):
        Ground(study=tmp_path / "study", method="rpg", ignore_messages=True).run()

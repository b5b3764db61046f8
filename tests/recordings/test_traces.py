"""The names under which runs are shown, and the choice of the best two."""

import pytest

from recordings.traces import best_two, common_episode, names_of, select_traces
from sim.errors import RecordingError
from sim.tasks.run_files import EpisodeRun, Run

from .conftest import KEY, info


def test_runs_with_equal_ids_or_unusual_names_get_distinct_labels(agent_run: Run, human_run: Run) -> None:
    labels = [trace.label for trace in select_traces([agent_run, agent_run, human_run, agent_run], KEY)]
    assert labels == ["straight.agent", "straight.agent-2", "study-P07", "straight.agent-3"]


def test_the_only_common_episode_is_found_and_others_are_named(agent_run: Run, human_run: Run) -> None:
    assert common_episode([agent_run, human_run]) == KEY
    other = agent_run.episodes[0].model_copy(
        update={"start": agent_run.episodes[0].start.model_copy(update={"episode_id": "8"})}
    )
    both = agent_run.model_copy(update={"episodes": (*agent_run.episodes, other)})
    with pytest.raises(
        RecordingError, match=r"2 episodes that all hold: easy/BoxHouse/7, easy/BoxHouse/8; expected one"
    ):
        common_episode([both])
    with pytest.raises(RecordingError, match=r"no episode that all hold \(straight.agent has 1, study has 1\)"):
        common_episode([agent_run.model_copy(update={"episodes": (other,)}), human_run])
    with pytest.raises(RecordingError, match="no run: found no episode"):
        common_episode([])


def measured(run: Run, name: str, *, kind: str = "agent", steps: int | None = None, **figures: object) -> Run:
    """The run with another name and other figures for the rule `paper`."""
    (walk,) = run.episodes
    measures = walk.end.measures
    assert measures is not None
    paper = measures.rules["paper"]
    assert paper is not None
    rules = measures.rules | {"paper": paper.model_copy(update=figures)}
    taken = walk.steps[:steps]
    changed = measures.model_copy(update={"rules": rules, "num_steps": len(taken)})
    walk = walk.model_copy(update={"end": walk.end.model_copy(update={"measures": changed}), "steps": taken})
    return Run(info=info(name, who_kind=kind), episodes=(walk,))


def test_the_best_person_and_the_best_agent_are_shown(agent_run: Run, answer_run: Run) -> None:
    runs = [
        measured(agent_run, "lost", success=False, spl=0.0, dtg=0.5),
        measured(agent_run, "direct", spl=0.9),
        measured(agent_run, "detour", spl=0.7),
        measured(agent_run, "far", kind="human", success=False, spl=0.0, dtg=3.0),
        measured(agent_run, "near", kind="human", success=False, spl=0.0, dtg=2.0),
        measured(agent_run, "gone", kind="human", success=False, spl=0.0, dtg=None),
        answer_run,
    ]
    assert [trace.label for trace in best_two(select_traces(runs, KEY))] == ["near", "direct"]


def test_without_people_the_two_best_agents_are_shown_and_runs_without_measures_come_last(
    agent_run: Run, answer_run: Run
) -> None:
    first, second = measured(agent_run, "long", spl=0.9), measured(agent_run, "short", spl=0.9, steps=20)
    third = measured(agent_run, "third", spl=0.8)
    assert [trace.label for trace in best_two(select_traces([third, first, second], KEY))] == ["short", "long"]
    (walk,) = agent_run.episodes
    unmeasured = EpisodeRun(start=walk.start, steps=walk.steps, end=walk.end.model_copy(update={"measures": None}))
    runs = [Run(info=info("import"), episodes=(unmeasured,)), agent_run]
    assert [trace.label for trace in best_two(select_traces(runs, KEY))] == ["straight.agent", "import"]
    assert best_two(select_traces([answer_run], KEY)) == ()


@pytest.mark.parametrize(
    ("who", "title"),
    [("my_package.agents:make", "agents"), ("agents:make", "agents"), ("v1.2: mine", "v1.2: mine"), ("human", "human")],
)
def test_titles_name_the_module_of_a_plug_in(who: str, title: str) -> None:
    assert names_of(info("run", who=who), "P07") == ("run-P07", f"{title}-P07")

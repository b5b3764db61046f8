"""Agents run episodes: each run is on disk when it is finished, and the agent that knows the goal reaches it."""

from dataclasses import replace
from pathlib import Path

import pytest

from personal_viz.cli.runs.import_runs import Import
from personal_viz.cli.runs.run import Run
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, PersonalVizError, SceneError
from sim.homes.open_home import open_scene
from sim.tasks.agent_makers import AgentMaker, MakesPlugin, MakesShortestPath
from sim.tasks.agents import RandomAgent
from sim.tasks.looks import HomeLook
from sim.tasks.pan import PanEnv
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import EpisodeRun, read_run
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import AgentJob, WalkTerms, play_episode, run_agent
from sim.types import PAPER4, Action, Camera, Observation, Task

from .synthetic import write_dataset


class FailsAtTheThird:
    """Stops at once in two episodes, then raises."""

    def __init__(self) -> None:
        self._episodes = 0

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self._episodes += 1
        if self._episodes == 3:
            raise ValueError("out of ideas")

    def act(self, observation: Observation) -> Action:
        return Action.STOP


def job(root: Path, scene: str, *, agent: AgentMaker) -> AgentJob:
    """All episodes of a scene."""
    keys = tuple(episode.key for episode in PersonalDataset(root).episodes(scenes=(scene,)))
    return AgentJob(root, scene, keys, scenes_dir=None, agent=agent, seed=0)


def writer_in(folder: Path) -> RunWriter:
    return RunWriter(
        folder, make_run_info("a", who="a", who_kind="agent", scene_kind="invented", dataset_digest="d", seed=0)
    )


def is_success(episode: EpisodeRun) -> bool:
    """Whether the run succeeded under the rule `paper`."""
    rule = episode.end.measures.rules["paper"] if episode.end.measures else None
    return rule is not None and rule.success


@pytest.mark.slow
def test_episodes_finished_before_an_error_of_the_agent_are_on_disk(demo_root: Path, tmp_path: Path) -> None:
    work = job(demo_root, "Demo", agent=MakesPlugin(f"{__name__}:FailsAtTheThird"))
    writer, on_disk = writer_in(tmp_path / "a"), []
    with pytest.raises(AgentError, match="raised ValueError: out of ideas"):
        run_agent(
            [work], writer, processes=1, on_episode=lambda: on_disk.append(len(read_run(tmp_path / "a").episodes))
        )
    assert on_disk == [1, 2]
    assert [run.key for run in read_run(tmp_path / "a").episodes] == list(work.keys[:2])


@pytest.mark.slow
def test_the_agent_that_knows_the_goal_reaches_it_in_an_invented_home(demo_root: Path, tmp_path: Path) -> None:
    work = job(demo_root, "Demo", agent=MakesShortestPath())
    run_agent([work], writer_in(tmp_path / "a"), processes=1)
    runs = read_run(tmp_path / "a").episodes
    assert len(runs) == len(work.keys)
    assert [str(run.key) for run in runs if not is_success(run)] == []


@pytest.mark.slow
def test_shortest_path_for_habitat_walks_to_a_view_point_and_is_named_so(demo_root: Path, tmp_path: Path) -> None:
    options = {**OPTIONS, "agent": "shortest-path", "dataset": demo_root, "out": tmp_path, "limit": 4}
    assert Run(**options, rule="habitat").run() == 0
    found = read_run(tmp_path / "shortest-path-habitat-invented-seed0")
    assert (found.info.who, found.info.made_for) == ("shortest-path-habitat", "habitat")
    assert [str(item.key) for item in found.episodes if not item.end.measures.rules["habitat"].success] == []
    assert Run(**options).run() == 0
    plain = read_run(tmp_path / "shortest-path-invented-seed0").info
    assert (plain.who, plain.made_for) == ("shortest-path", "paper")


def test_only_the_agent_that_knows_the_goal_accepts_a_rule(demo_root: Path, tmp_path: Path) -> None:
    options = {**OPTIONS, "dataset": demo_root, "out": tmp_path, "rule": "habitat"}
    with pytest.raises(AgentError, match=r"--rule: found 'habitat' for --agent random; expected it with --agent short"):
        Run(**options).run()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "each"),
    [
        pytest.param("6s7QHgap2fW", 5, marks=pytest.mark.slow),
        *[
            pytest.param(name, None, marks=pytest.mark.release)
            for name in ("TEEsavR23oF", "4ok3usBNeis", "5cdEh9F2hJL", "6s7QHgap2fW", "BAbdmeyTvMZ")
        ],
    ],
)
def test_the_agent_that_knows_the_goal_reaches_it_in_schematic_homes(
    name: str, each: int | None, dataset_root: Path, tmp_path: Path
) -> None:
    # on all 31 homes it reaches 2000 of 2000
    whole = job(dataset_root, name, agent=MakesShortestPath())
    run_agent([replace(whole, keys=whole.keys[:each])], writer_in(tmp_path / "a"), processes=1)
    runs = read_run(tmp_path / "a").episodes
    assert len(runs) == (each or len(whole.keys)) > 0
    assert sum(is_success(run) for run in runs) >= 0.99 * len(runs)


def test_homes_of_different_kinds_do_not_run_together(demo_root: Path, tmp_path: Path) -> None:
    write_dataset(tmp_path / "mixed")
    for folder in ("easy", "medium", "hard"):
        for path in (demo_root / folder / "content").glob("Demo.json.gz"):
            target = tmp_path / "mixed" / folder / "content" / path.name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    (tmp_path / "mixed" / "scenes").mkdir()
    (tmp_path / "mixed" / "scenes" / "Demo.plan.json").write_bytes(
        (demo_root / "scenes" / "Demo.plan.json").read_bytes()
    )
    options = {**OPTIONS, "dataset": tmp_path / "mixed", "out": tmp_path / "runs"}
    with pytest.raises(SceneError, match=r"found scene kinds invented \(Demo\), schematic \(\w+\); expected one kind"):
        Run(**options).run()
    assert not (tmp_path / "runs").exists()
    assert Run(**{**options, "scene": ("Demo",), "limit": 1}).run() == 0
    assert read_run(tmp_path / "runs" / "random-invented-seed0").info.scene_kind == "invented"


OPTIONS = {
    "agent": "random",
    "scenes_dir": None,
    "scene": (),
    "split": (),
    "limit": None,
    "seed": 0,
    "jobs": 1,
    "run_id": None,
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"limit": 0}, r"--limit is 0; expected a whole number from 1"),
        ({"limit": -3}, r"--limit is -3; expected"),
        ({"jobs": 0}, r"--jobs is 0; expected"),
        ({"jobs": -1}, r"--jobs is -1; expected"),
        ({"run_id": "a/b"}, r"--run-id is 'a/b'; expected 1 to 80 letters"),
        ({"run_id": ".a"}, r"--run-id is '\.a'; expected"),
    ],
)
def test_bad_options_are_refused_in_one_line_before_any_work(tmp_path: Path, change: dict, message: str) -> None:
    nowhere = tmp_path / "nowhere"
    with pytest.raises(PersonalVizError, match=message) as caught:
        Run(**{**OPTIONS, "dataset": nowhere, "out": nowhere, **change}).run()
    assert "\n" not in str(caught.value)
    if "run_id" in change:
        with pytest.raises(PersonalVizError, match=message):
            Import(files=(), dataset=nowhere, scenes_dir=None, out=nowhere, who="a", **change).run()
    assert not nowhere.exists()


class Looks:
    """Writes down what it is told, and stops at once."""

    looks = frozenset({"topdown"})

    def __init__(self) -> None:
        self.told: list[object] = []

    def look(self, home: HomeLook) -> None:
        self.told.append(home)

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self.told.append((task.max_steps, keep_memory))

    def act(self, observation: Observation) -> Action:
        return Action.STOP


def test_an_agent_looks_at_the_home_before_it_knows_the_task_and_keeps_what_it_saw(demo_root: Path) -> None:
    episode = next(iter(PersonalDataset(demo_root).episodes(scenes=("Demo",))))
    agent, look, terms = Looks(), HomeLook("topdown"), WalkTerms(actions=PAPER4, max_steps=7, query_index=1)
    env = PanEnv(episode.start, open_scene(PersonalDataset(demo_root), "Demo").navigation, renderer=None, max_steps=7)
    task = terms.task(episode)
    assert (task.actions, task.max_steps, task.queries) == (PAPER4, 7, (episode.record.query[1],))
    play_episode(agent, env, task, seed=0, look=look)
    assert agent.told == [look, (7, True)]
    play_episode(agent, env, task, seed=0)
    assert agent.told[2:] == [(7, False)]
    for other, kind in ((agent, "glb"), (RandomAgent(), "topdown")):
        with pytest.raises(AgentError, match=rf"cannot take a look of kind '{kind}'.*Run it without"):
            play_episode(other, env, task, seed=0, look=HomeLook(kind))

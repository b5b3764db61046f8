"""Home sequences as tasks: what is told when, agents search by search, scores, files, and the known answers."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, sequence_from_episode
from sim.errors import RunFileError, TaskStateError
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.sequences.figures import memory_gain, sequence_figures
from sim.sequences.playing import SequenceJob, open_job, run_sequences
from sim.sequences.runs import (
    SEQUENCES_FILE,
    SequenceRun,
    read_sequence_runs,
)
from sim.sequences.scoring import run_from_sequence_env, score_search, search_reason
from sim.sequences.searches import prompts_of, search_episode, sequence_key, sequence_task
from sim.sequences.writer import SequenceWriter
from sim.tasks.agent_makers import MakesPlugin, MakesShortestPath
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.tasks.provenance import make_run_info
from sim.tasks.rules import reaches_target
from sim.tasks.runner import play
from sim.types import PAPER6, SEQUENCE7, Action, Camera, Observation, Pose, Task

from .home_story import MESSAGES, SCENE, SUBTASKS, subtask, told_in


@pytest.fixture(scope="module")
def home(small_home_root: Path) -> Scene:
    return open_scene(PersonalDataset(small_home_root), SCENE)


@pytest.fixture(scope="module")
def story(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """Folder of the set, and its sequence."""
    out = tmp_path_factory.mktemp("set")
    return out, told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)


def job(root: Path, out: Path, **more: Any) -> SequenceJob:
    """The oracle in all sequences of a set."""
    from sim.episodes.sequence_files import SequenceSet

    keys = tuple(sequence_key(one) for one in SequenceSet(out).sequences())
    return SequenceJob(
        root, SCENE, keys, sequences=out, scenes_dir=None, seed=0, **{"agent": MakesShortestPath(), **more}
    )


def played(root: Path, out: Path, **more: Any) -> list[SequenceRun]:
    one = job(root, out, **more)
    run = open_job(one)
    return [run(key) for key in one.keys]


def test_messages_and_queries_come_when_their_search_begins(home: Scene, story: tuple[Path, HomeSequence]) -> None:
    _, sequence = story
    task = sequence_task(sequence, max_steps=3)
    assert (task.description, task.queries, task.actions) == (MESSAGES[0]["text"], ("Find Cy's towel",), SEQUENCE7)
    env = PanEnv(sequence.start, home.navigation, renderer=None, max_steps=3, prompts=prompts_of(sequence))
    seen = [env.reset()]
    for action in (Action.FOUND, Action.FOUND, Action.FOUND, Action.LEFT, Action.LEFT, Action.LEFT, Action.FOUND):
        seen.append(env.step(action))
    armchair = "Find Ada's armchair"
    assert [observation.query for observation in seen] == [
        "Find Cy's towel", armchair, None, armchair, None, None, "Find Ada's bed", "Find Cy's towel",
    ]  # fmt: skip
    assert [observation.message for observation in seen] == [
        None, None, None, MESSAGES[1]["text"], None, None, MESSAGES[2]["text"], None,
    ]  # fmt: skip
    assert env.search_ends == (1, 3, 6, 7)
    again = PanEnv(sequence.start, home.navigation, renderer=None, max_steps=3, prompts=prompts_of(sequence))
    assert again.restore(env.steps).query == "Find Cy's towel"
    assert again.search_ends == env.search_ends
    last = env.step(Action.STOP)
    assert (last.query, env.end_reason) == (None, "stop")


def test_found_belongs_to_sequences_only(home: Scene, story: tuple[Path, HomeSequence]) -> None:
    env = PanEnv(story[1].start, home.navigation, renderer=None)
    env.reset()
    with pytest.raises(TaskStateError, match="found action 'found' in an episode; expected it in home sequences only"):
        env.step(Action.FOUND)
    assert env.steps == ()


def test_the_oracle_that_hears_the_messages_is_right_and_the_one_that_does_not_falls_for_the_old(
    small_home_root: Path, story: tuple[Path, HomeSequence]
) -> None:
    (hears,), (ignores,) = (played(small_home_root, story[0], ignores_messages=deaf) for deaf in (False, True))
    found = sequence_figures([hears])
    assert [search.succeeds("paper") for search in hears.end.searches] == 6 * [True]
    assert (found.sr_changed, found.sr_stale, found.sr_revisit, found.stale, found.lag) == (1, 1, 1, 0, 0)
    assert (found.recall, found.precision, found.composite) == (1, 1, 1)
    deaf = sequence_figures([ignores])
    assert (deaf.sr_changed, deaf.sr_stale, deaf.stale) == (0, 0, 1)
    assert deaf.lag == (2 + 1) / 2
    assert (deaf.sr_fresh, deaf.sr_revisit) == (found.sr_fresh, found.sr_revisit)
    gain = memory_gain([(hears, ignores)])
    assert (gain.n, gain.sr, gain.sr_all, gain.interval_all) == (1, 0, 3 / 6, None)
    elsewhere = [
        run.model_copy(update={"start": run.start.model_copy(update={"scene": "Other"})}) for run in (hears, hears)
    ]
    low, high = memory_gain([(hears, ignores), (elsewhere[0], elsewhere[1])]).interval_all or (0, 0)
    assert (low + high) / 2 == pytest.approx(3 / 12)
    assert memory_gain([]).sr_all is None


def test_an_agent_that_cannot_carry_its_memory_is_new_in_each_search(
    small_home_root: Path, story: tuple[Path, HomeSequence]
) -> None:
    (kept,), (new,) = (played(small_home_root, story[0], keeps_memory=on) for on in (True, False))
    assert kept.steps == new.steps
    assert all(search.succeeds("paper") for search in kept.end.searches)


def test_all_right_objects_are_wanted_once_each(home: Scene, story: tuple[Path, HomeSequence]) -> None:
    _, sequence = story
    env = PanEnv(sequence.start, home.navigation, renderer=None, prompts=prompts_of(sequence))
    env.reset()
    env.step(Action.FOUND)
    ways = [target.view_points[0].agent_state.position for target in sequence.targets[1]]
    walk_to(env, home, ways[0])
    env.step(Action.FOUND)
    env.step(Action.LEFT)
    env.step(Action.FOUND)
    walk_to(env, home, ways[1])
    env.step(Action.FOUND)
    env.step(Action.FOUND)
    env.step(Action.STOP)
    run = run_from_sequence_env(sequence, env, scene_digest=home.digest, navigation=home.navigation)
    both = run.end.searches[1]
    assert both.all is not None
    assert (both.reason, both.all.recall, both.all.precision) == ("found", 1, pytest.approx(2 / 3))
    assert both.measures is not None
    assert both.all.best_m is not None
    assert 0.5 * both.measures.path_m < both.all.best_m <= both.measures.path_m
    assert [search.reason for search in run.end.searches[2:]] == ["stop", "unreached", "unreached", "unreached"]
    assert not any(search.succeeds("paper") for search in run.end.searches[2:])


def test_goat_bench_counts_found_within_a_quarter_metre_of_walking_from_a_view_point(
    home: Scene, story: tuple[Path, HomeSequence]
) -> None:
    _, sequence = story
    target = sequence.targets[0][0]
    target = target.model_copy(update={"view_points": target.original_view_points[:1]})
    sequence = replace(sequence, targets=((target,), *sequence.targets[1:]))
    views = np.array([target.view_points[0].agent_state.position])
    around = home.navigation.points_within(views, 0.4, max_dy=0.2)
    places = np.array([place for place in around if reaches_target(place.tolist(), target)])
    walks = home.navigation.distances(places, views)
    near, far = places[walks == walks[walks < 0.25].max()][0], places[walks == walks[walks > 0.25].min()][0]
    ends = []
    for x, y, z in (near.tolist(), far.tolist()):
        env = PanEnv(Pose((x, y, z), 0.0), home.navigation, renderer=None, prompts=prompts_of(sequence))
        env.reset()
        env.step(Action.FOUND)
        ends.append(score_search(sequence, 0, env, scene_digest=home.digest, navigation=home.navigation))
    assert [end.succeeds("goat") for end in ends] == [True, False]
    near_by, far_by = ([end.succeeds(rule) for rule in ("paper", "paper-strict", "authors", "habitat")] for end in ends)
    assert near_by == far_by
    assert near_by[0], "the radius of rule paper"


def test_a_first_mark_in_the_last_step_ends_no_search_for_all(home: Scene, story: tuple[Path, HomeSequence]) -> None:
    _, sequence = story
    env = PanEnv(sequence.start, home.navigation, renderer=None, max_steps=1, prompts=prompts_of(sequence)[1:2])
    env.reset()
    env.step(Action.FOUND)
    assert (env.search_ends, env.end_reason) == ((1,), "steps")
    assert search_reason(env.steps, is_for_all=True) == "steps"
    assert search_reason(env.steps, is_for_all=False) == "found"
    assert search_reason(2 * env.steps, is_for_all=True) == "found"


def test_the_oracle_marks_two_objects_from_one_place(small_home_root: Path, tmp_path: Path) -> None:
    intro = {**MESSAGES[0], "adds": [["Ada", "chair_21"], ["Ada", "chair_22"]]}
    chairs = subtask("Ada", "chair", ["chair_21", "chair_22"], "fresh", 0, mode="all")
    told_in(small_home_root, tmp_path, messages=[intro], subtasks=[chairs])
    (run,) = played(small_home_root, tmp_path)
    (search,) = run.end.searches
    assert search.all is not None
    assert (search.all.recall, search.all.precision) == (1, 1)
    assert search.leg_m == search.all.best_m


def walk_to(env: PanEnv, home: Scene, place: tuple[float, float, float]) -> None:
    """Walks the oracle's way near a place."""
    for _ in range(200):
        here = env.pose
        if np.hypot(here.position[0] - place[0], here.position[2] - place[2]) < 0.3:
            return
        nexts = []
        for turns in range(12):
            probe = PanEnv(here, home.navigation, renderer=None)
            for action in (*[Action.LEFT] * turns, Action.FORWARD):
                probe.step(action)
            nexts.append(home.navigation.distances(np.array([probe.pose.position]), np.array([place]))[0])
        for action in (*[Action.LEFT] * int(np.argmin(nexts)), Action.FORWARD):
            env.step(action)
    raise AssertionError("no way")


def test_one_search_has_the_measures_of_its_episode(small_home_root: Path, home: Scene, tmp_path: Path) -> None:
    episode = next(PersonalDataset(small_home_root).episodes())
    (tmp_path / "content").mkdir()
    alone = told_in(small_home_root, tmp_path, messages=MESSAGES[:1], subtasks=SUBTASKS[:1])
    record = sequence_from_episode(episode)
    sequence = replace(alone, record=record, targets=(episode.targets,), goals=alone.goals)
    as_episode = play(ShortestPathAgent(episode, home.navigation), episode, home, pictures=False)
    env = PanEnv(sequence.start, home.navigation, renderer=None, prompts=prompts_of(sequence))
    env.reset()
    for step in as_episode.steps:
        env.step(Action.FOUND if step.action is Action.STOP else step.action)
    run = run_from_sequence_env(sequence, env, scene_digest=home.digest, navigation=home.navigation)
    (search,) = run.end.searches
    assert search.measures == as_episode.end.measures
    figures, paper = sequence_figures([run]), search.measures.rules["paper"] if search.measures else None
    assert paper is not None
    assert (figures.progress, figures.partial, figures.composite, figures.csr, figures.cgt) == (1, 1, 1, 1, 1)
    assert figures.ppl == figures.spl == paper.spl
    assert search_episode(sequence, 0).record.info == episode.record.info


def test_truth_does_not_depend_on_names_or_on_messages_that_nobody_asks_about(
    small_home_root: Path, story: tuple[Path, HomeSequence], tmp_path: Path
) -> None:
    (before,) = played(small_home_root, story[0])
    renamed = eval_names(MESSAGES, SUBTASKS, {"Ada": "Bo", "Bo": "Cy", "Cy": "Ada"})
    told_in(small_home_root, tmp_path / "renamed", messages=renamed[0], subtasks=renamed[1])
    (after,) = played(small_home_root, tmp_path / "renamed")
    assert (after.steps, after.end) == (before.steps, before.end)
    told_in(small_home_root, tmp_path / "fewer", messages=MESSAGES[:2], subtasks=[*SUBTASKS[:3], *SUBTASKS[4:]])
    without = next(iter(played(small_home_root, tmp_path / "fewer")))
    told_in(small_home_root, tmp_path / "more", messages=MESSAGES, subtasks=[*SUBTASKS[:3], *SUBTASKS[4:]])
    with_it = next(iter(played(small_home_root, tmp_path / "more")))
    assert without.steps == with_it.steps
    assert [search.measures for search in without.end.searches] == [search.measures for search in with_it.end.searches]


def eval_names(
    messages: list[dict[str, Any]], subtasks: list[dict[str, Any]], names: dict[str, str]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The story with other names of people."""

    def edges(found: list[list[str]]) -> list[list[str]]:
        return [[names[owner], thing] for owner, thing in found]

    told = [{**one, "adds": edges(one["adds"]), "removes": edges(one.get("removes", []))} for one in messages]
    return told, [{**one, "owner": names[one["owner"]]} for one in subtasks]


def test_runs_are_appended_read_back_and_resumed(
    small_home_root: Path, story: tuple[Path, HomeSequence], tmp_path: Path
) -> None:
    info = make_run_info(
        "oracle",
        who="shortest-path",
        who_kind="agent",
        scene_kind="invented",
        dataset_digest="0" * 64,
        seed=0,
        config={},
    )
    folder = tmp_path / "oracle"
    writer = SequenceWriter(folder, info)
    run_sequences([job(small_home_root, story[0])], writer, processes=1)
    (run,) = read_sequence_runs(folder)
    assert [run] == played(small_home_root, story[0])
    with (folder / SEQUENCES_FILE).open("a") as file:
        file.write('{"kind":"sequence","split":"hard"')
    again = SequenceWriter(folder, info)
    assert again.done == {run.key}
    text = (folder / SEQUENCES_FILE).read_text()
    assert read_sequence_runs(folder) == (run,)
    (folder / SEQUENCES_FILE).write_text(text.replace('"kind":"step"', '"kind":"answer"', 1))
    with pytest.raises(RunFileError, match=r"sequences\.jsonl:2: kind is 'answer'; expected one of"):
        read_sequence_runs(folder)


class Listener:
    """Notes what it is told, turns, and stops in its third step of a search."""

    def __init__(self) -> None:
        """Nothing was told yet."""
        self.tasks: list[Task] = []
        self.seen: list[Observation] = []
        self.kept: list[bool] = []
        self.carried: list[Any] = []

    def carry(self, T_map_start: Any) -> None:
        self.carried.append(T_map_start)

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self.tasks.append(task)
        self.kept.append(keep_memory)

    def act(self, observation: Observation) -> Action:
        self.seen.append(observation)
        return (Action.LEFT, Action.FORWARD, Action.STOP)[observation.step]


LISTENER = Listener()


def listener() -> Listener:
    """The one listener of this process."""
    return LISTENER


def test_an_agent_for_episodes_does_search_after_search(
    small_home_root: Path, story: tuple[Path, HomeSequence]
) -> None:
    name = MakesPlugin(f"{__name__}:listener")
    (run,) = played(small_home_root, story[0], agent=name, keeps_memory=True)
    assert [step.action for step in run.steps].count(Action.FOUND) == 7  # twice where all are wanted
    first, *others = LISTENER.seen[0], *LISTENER.seen[3::3]
    assert len(others) == 5
    for observation in others:
        assert (observation.step, observation.gps, observation.compass) == (0, pytest.approx((0.0, 0.0)), 0.0)
        assert observation.T_start_camera == pytest.approx(first.T_start_camera)
        assert (observation.message, observation.query) == (None, None)
    assert LISTENER.kept == [False] + 5 * [True]
    assert LISTENER.carried[0][:3, 3] == pytest.approx(others_place(run), abs=1e-9)
    assert [task.actions for task in LISTENER.tasks] == 6 * [PAPER6]
    told = [MESSAGES[0]["text"], MESSAGES[1]["text"], MESSAGES[2]["text"]]
    assert [task.description for task in LISTENER.tasks] == [
        told[0], told[0], "\n".join(told[:2]), "\n".join(told), "\n".join(told), "\n".join(told),
    ]  # fmt: skip


def others_place(run: SequenceRun) -> list[float]:
    """Where the second search began, in the frame of the start."""
    from sim.frames import T_world_agent

    start = run.poses[0]
    return (np.linalg.inv(T_world_agent(start)) @ np.array([*run.poses[3].position, 1.0]))[:3].tolist()

"""Home sequences in Gymnasium: its checker, what is told when, rewards, and no ground truth before the end."""

import json
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import DatasetError, TaskStateError
from sim.sequences.gym_env import SequenceGymEnv
from sim.sequences.playing import SequenceJob, open_job
from sim.sequences.runs import SequenceRun
from sim.sequences.searches import sequence_key
from sim.tasks.agent_makers import MakesShortestPath
from sim.tasks.gym_env import PanGymEnv
from sim.types import SEQUENCE7, Action, Camera

from .home_story import MESSAGES, SCENE, SUBTASKS, told_in

SMALL = Camera(32, 24)
STOP, LEFT, FOUND = 0, 2, 6


@pytest.fixture(scope="module")
def story(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[SequenceSet, HomeSequence]:
    out = tmp_path_factory.mktemp("set")
    sequence = told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)
    return SequenceSet(out), sequence


@pytest.fixture(scope="module")
def env(small_home_root: Path, story: tuple[SequenceSet, HomeSequence]) -> SequenceGymEnv:
    return SequenceGymEnv(PersonalDataset(small_home_root), story[0], pictures=False, max_steps=3)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"pictures": False, "actions": (Action.STOP, Action.LEFT, Action.FOUND)}])
def test_gymnasiums_checker_finds_no_problem(
    small_home_root: Path, story: tuple[SequenceSet, HomeSequence], options: dict
) -> None:
    spec = EnvSpec(
        "HomeSequences-v0",
        entry_point=SequenceGymEnv,
        kwargs={"dataset": PersonalDataset(small_home_root), "sequences": story[0], "camera": SMALL, **options},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(spec, render_mode="rgb_array").unwrapped)


def test_observations_are_those_of_pan_with_messages_and_the_present_query(
    small_home_root: Path, env: SequenceGymEnv
) -> None:
    pan = PanGymEnv(PersonalDataset(small_home_root), pictures=False)
    observation, info = env.reset(seed=0)
    assert set(observation) == {*pan.reset(seed=0)[0], "message"}
    assert env.action_space == spaces.Discrete(7)
    assert info == {"episode_key": "hard/Small/told", "collided": False}
    seen, ends = [observation], []
    for action in (FOUND, FOUND, FOUND, LEFT, LEFT, LEFT, FOUND, LEFT):
        observation, _, terminated, truncated, info = env.step(action)
        seen.append(observation)
        ends.append(info.get("search"))
        assert (terminated, truncated) == (False, False)
    armchair, bed, towel = "Find Ada's armchair", "Find Ada's bed", "Find Cy's towel"
    assert [one["query"] for one in seen] == [towel] + 5 * [armchair] + [bed, towel, towel]
    assert [one["message"] for one in seen] == ["", "", "", MESSAGES[1]["text"], "", "", MESSAGES[2]["text"], "", ""]
    assert {one["description"] for one in seen} == {MESSAGES[0]["text"]}
    assert all(one in env.observation_space for one in seen)
    assert ends == [
        {"index": 0, "reason": "found"}, None, {"index": 1, "reason": "found"}, None, None,
        {"index": 2, "reason": "steps"}, {"index": 3, "reason": "found"}, None,
    ]  # fmt: skip


def test_stop_or_the_end_of_the_last_search_terminates(env: SequenceGymEnv) -> None:
    env.reset()
    observation, reward, terminated, truncated, info = env.step(STOP)
    assert (reward, terminated, truncated, info["search"]) == (0.0, True, False, {"index": 0, "reason": "stop"})
    assert (observation["query"], observation["message"]) == ("Find Cy's towel", "")
    assert [search["reason"] for search in info["sequence_end"]["searches"]] == ["stop"] + 5 * ["unreached"]
    with pytest.raises(TaskStateError, match="after the end"):
        env.step(LEFT)
    env.reset()
    ends = [env.step(LEFT)[2:4] for _ in range(3 * len(SUBTASKS))]
    assert ends == [(False, False)] * (len(ends) - 1) + [(True, False)]


@pytest.mark.parametrize("knows_all", [True, False])
def test_each_search_that_succeeds_gives_one_and_the_end_gives_the_scores_of_runs(
    small_home_root: Path, story: tuple[SequenceSet, HomeSequence], knows_all: bool
) -> None:
    run = oracle(small_home_root, story, ignores_messages=not knows_all)
    env = SequenceGymEnv(PersonalDataset(small_home_root), story[0], pictures=False)
    env.reset()
    results = [env.step(SEQUENCE7.index(step.action)) for step in run.steps]
    rewards = [reward for _, reward, _, _, info in results if "search" in info]
    assert rewards == ([1.0] * 6 if knows_all else [1.0, 1.0, 0.0, 0.0, 1.0, 0.0])
    assert sum(reward for _, reward, *_ in results) == sum(rewards)
    assert results[-1][2:4] == (True, False)
    assert results[-1][4]["sequence_end"] == run.end.model_dump()


def test_one_of_two_objects_that_are_wanted_gives_nothing(
    small_home_root: Path, story: tuple[SequenceSet, HomeSequence]
) -> None:
    run = oracle(small_home_root, story)
    env = SequenceGymEnv(PersonalDataset(small_home_root), story[0], pictures=False)
    env.reset()
    marks, ends = 0, []
    for step in run.steps:
        *_, reward, _, _, info = env.step(SEQUENCE7.index(step.action))
        if "search" in info:
            ends.append(reward)
        marks += step.action is Action.FOUND
        if marks == 2:  # the towel, and the first armchair
            *_, reward, _, _, info = env.step(FOUND)
            break
    assert (ends, reward, info["search"]) == ([1.0], 0.0, {"index": 1, "reason": "found"})


def oracle(root: Path, story: tuple[SequenceSet, HomeSequence], **more: Any) -> SequenceRun:
    """The walk of the agent that knows the goals."""
    key = sequence_key(story[1])
    job = SequenceJob(
        root, SCENE, (key,), sequences=story[0].root, scenes_dir=None, agent=MakesShortestPath(), seed=0, **more
    )
    return open_job(job)(key)


def test_an_agent_gets_no_truth_and_nothing_before_its_time(
    env: SequenceGymEnv, story: tuple[SequenceSet, HomeSequence]
) -> None:
    names = [name for edge in MESSAGES[0]["adds"] for name in edge if "_" in name]
    later = [MESSAGES[1]["text"], MESSAGES[2]["text"], "Ada's bed"]
    observation, info = env.reset()
    told = [str(observation) + json.dumps(info)]
    for action in (LEFT, FOUND, FOUND, LEFT):
        observation, *_, info = env.step(action)
        told.append(str(observation) + json.dumps(info))
        assert "sequence_end" not in info
    assert not [name for name in (*names, *later, "stale", "old_object") if name in "".join(told)]
    assert MESSAGES[1]["text"] in str(env.step(FOUND)[0]) + str(env.step(FOUND)[0])


def test_sequences_that_are_not_there_are_refused(
    small_home_root: Path, story: tuple[SequenceSet, HomeSequence], env: SequenceGymEnv
) -> None:
    dataset = PersonalDataset(small_home_root)
    with pytest.raises(DatasetError, match=r"found no sequence in splits \['easy'\] of scenes \['Small'\]"):
        SequenceGymEnv(dataset, story[0], splits=("easy",))
    with pytest.raises(DatasetError, match="found no scene 'Nowhere'"):
        SequenceGymEnv(dataset, story[0], scenes=("Nowhere",))
    with pytest.raises(TaskStateError, match=r"expected one of this environment's 1 episodes, such as 'hard/Small/to"):
        env.reset(options={"episode": "hard/Small/other"})
    env.reset(options={"episode": "hard/Small/told"})
    assert env.episode_key == sequence_key(story[1])


@pytest.mark.slow
def test_several_environments_run_in_one_vector_environment(
    small_home_root: Path, story: tuple[SequenceSet, HomeSequence]
) -> None:
    dataset = PersonalDataset(small_home_root)
    made = [lambda: SequenceGymEnv(dataset, story[0], pictures=False, max_steps=2) for _ in range(2)]
    vector = gymnasium.vector.SyncVectorEnv(made)
    vector.reset(seed=5)
    *_, terminated, _, infos = vector.step(np.array([STOP, FOUND]))
    assert terminated.tolist() == [True, False]
    assert infos["search"]["reason"].tolist() == ["stop", "found"]
    vector.close()

"""In a home sequence no agent, environment or task holds later messages, later queries, answers, or old objects."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.sequences.gym_env import SequenceGymEnv
from sim.sequences.playing import SequenceJob, open_job
from sim.sequences.pointing import PointSearches
from sim.sequences.searches import sequence_key
from sim.tasks.agent_makers import MakesPlugin
from sim.types import SEQUENCE7, Action, Camera, Observation, Task

from .home_story import MESSAGES, SCENE, SUBTASKS, leaks, marked_story, told_in

NUM_SEARCHES = len(SUBTASKS)
SEEN: list[tuple[int, str]] = []
"""What the spy of this process was given: the number of the present search, and everything as text."""


@pytest.fixture(scope="module")
def marked(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """A set of the marked story, and the story."""
    out = tmp_path_factory.mktemp("set")
    messages, subtasks = marked_story()
    return out, told_in(small_home_root, out, messages=messages, subtasks=subtasks)


@pytest.fixture(autouse=True)
def nothing_seen() -> None:
    SEEN.clear()


class Spy:
    """Keeps everything that it is given, and ends each search in its second step."""

    follows_sequences = False

    def __init__(self) -> None:
        """No search has begun."""
        self.search = -1

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self.search += not self.follows_sequences
        SEEN.append((max(self.search, 0), str((dataclasses.asdict(task), camera, seed, keep_memory))))

    def carry(self, T_map_start: Any) -> None:
        """Makes it an agent that does all searches itself."""

    def act(self, observation: Observation) -> Action:
        self.search += observation.query is not None
        SEEN.append((self.search, str(dataclasses.asdict(observation))))
        return self.end

    end = Action.STOP


class Follower(Spy):
    """A spy that reads the messages itself."""

    follows_sequences, end = True, Action.FOUND


def test_the_check_finds_everything_that_is_planted(marked: tuple[Path, HomeSequence]) -> None:
    _, sequence = marked
    found = leaks(str(sequence), 0)
    assert {"MESSAGE-1", "MESSAGE-2", "QUERY-1", "QUERY-5", "CAPTION-CANARY", "SENTENCE-CANARY"} <= set(found)
    assert {name for _, name in MESSAGES[0]["adds"]} <= set(found)
    assert not {"MESSAGE-1", "QUERY-2"} & set(leaks(str(sequence), 2))


@pytest.mark.parametrize("ignores", [False, True])
@pytest.mark.parametrize("agent", ["Spy", "Follower"])
def test_an_agent_gets_nothing_before_its_time(
    small_home_root: Path, marked: tuple[Path, HomeSequence], agent: str, ignores: bool
) -> None:
    key = sequence_key(marked[1])
    run = open_job(
        SequenceJob(
            small_home_root,
            SCENE,
            (key,),
            sequences=marked[0],
            scenes_dir=None,
            seed=0,
            agent=MakesPlugin(f"{__name__}:{agent}"),
            keeps_memory=agent == "Spy",
            ignores_messages=ignores,
        )
    )(key)
    assert (run.end.reason, len(run.end.searches)) == ("stop", NUM_SEARCHES)
    assert {search for search, _ in SEEN} == set(range(NUM_SEARCHES))
    assert [found for search, text in SEEN if (found := leaks(text, search))] == []
    told = [text for _, text in SEEN if "MESSAGE-2" in text or "MESSAGE-1" in text]
    assert bool(told) == (not ignores)
    assert any("QUERY-5" in text for _, text in SEEN)


def test_gymnasium_gives_nothing_before_its_time(small_home_root: Path, marked: tuple[Path, HomeSequence]) -> None:
    env = SequenceGymEnv(PersonalDataset(small_home_root), SequenceSet(marked[0]), pictures=False)
    found, search, seen = SEQUENCE7.index(Action.FOUND), 0, 0
    observation, info = env.reset(seed=1)
    terminated = False
    while not terminated:
        assert leaks(str((observation, info)), search) == []
        observation, _, terminated, _, info = env.step(found)
        search += "search" in info
        seen += 1
    assert (search, seen) == (NUM_SEARCHES, NUM_SEARCHES + 1)
    assert "sequence_end" in info


@pytest.mark.parametrize("ignores", [False, True])
def test_tasks_of_pointing_tell_nothing_before_its_time(marked: tuple[Path, HomeSequence], ignores: bool) -> None:
    searches = PointSearches(marked[1], storeys=[(0.0, 0.0)], ignores_messages=ignores)
    for search in range(NUM_SEARCHES):
        told = str((dataclasses.asdict(searches.task), searches.message, searches.query))
        assert leaks(told, search) == []
        assert f"QUERY-{search}" in told
        assert ("MESSAGE-2" in told) == (search >= 3 and not ignores)
        searches.answer(())

"""`check_agent`: our agents keep the contract, and each breach of it is named."""

import math
import random
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import sim.checks
from sim.checks import check_agent, check_home, check_trials
from sim.tasks.agents import RandomAgent, ShortestPathAgent
from sim.types import Action, Camera
from tests.sim.worlds import episode, goal, view_point

QUICK = {"steps": 6, "camera": Camera(32, 24)}


class Walker:
    """Keeps the contract: the seed decides its turns and steps, and it remembers only when asked to."""

    def reset(self, task, camera, *, seed, keep_memory=False) -> None:
        self.task, self.rng = task, np.random.default_rng(seed)

    def act(self, observation):
        return self.task.actions[int(self.rng.integers(1, 4))]


@pytest.mark.slow
def test_the_random_agent_passes() -> None:
    assert check_agent(RandomAgent) == []
    assert check_agent(RandomAgent(), **QUICK) == []


def test_agents_that_follow_the_shortest_path_or_stop_at_once_pass() -> None:
    scene = check_home()
    start = check_trials(scene)[0].start
    places = scene.navigation.points_within(np.array([start.position]), 4.0, max_dy=1.0)
    x, y, z = places[np.argmax(np.hypot(*(places - start.position).T[[0, 2]]))].tolist()
    search = episode(goal((x, y + 0.5, z), (view_point((x, y, z)),)), start=start.position, yaw=start.yaw)
    assert check_agent(lambda: ShortestPathAgent(search, scene.navigation), **QUICK) == []

    class Stopper(Walker):
        def act(self, observation):
            return Action.STOP

    assert check_agent(Stopper) == []


class Words(Walker):
    def act(self, observation):
        return "forward"


class Nothing(Walker):
    def act(self, observation):
        return None


class AlwaysLooks(Walker):
    def act(self, observation):
        return Action.LOOK_UP


class Paints(Walker):
    def act(self, observation):
        observation.rgb[:] = 0
        return super().act(observation)


class ClipsDepth(Walker):
    def act(self, observation):
        np.clip(observation.depth_m, 0.5, 5.0, out=observation.depth_m)
        return super().act(observation)


class Divides(Walker):
    def act(self, observation):
        return 1 / observation.step


class OldSignature(Walker):
    def reset(self, task, camera, *, seed) -> None:
        super().reset(task, camera, seed=seed)


class NoSeed(Walker):
    def reset(self, task, camera) -> None:
        super().reset(task, camera, seed=0)


class OwnDice(Walker):
    def act(self, observation):
        return random.choice((Action.FORWARD, Action.LEFT, Action.RIGHT))


class Counts(Walker):
    """Breaks the contract: its count of actions continues over episodes."""

    def __init__(self) -> None:
        self.acted = 0

    def act(self, observation):
        self.acted += 1
        return Action.LEFT if self.acted <= 3 else Action.RIGHT


@pytest.mark.parametrize(
    ("agent", "found"),
    [
        (Words, "task with 6 actions, step 1: act() returned 'forward' of type str; expected an Action of ['stop', "),
        (Nothing, "step 1: act() returned None of type NoneType; expected an Action"),
        (AlwaysLooks, "task with 4 actions, step 1: act() returned <Action.LOOK_UP: 'look_up'>; expected an Action of"),
        (Paints, "act() changed the array observation.rgb; expected it to be left as it is"),
        (ClipsDepth, "act() changed the array observation.depth_m"),
        (Divides, "step 1: Divides.act() raised ZeroDivisionError: division by zero. Correct the agent."),
        (OldSignature, "keep_memory=True, step 1: OldSignature.reset() raised TypeError"),
        (NoSeed, "task with 6 actions, step 1: NoSeed.reset() raised TypeError"),
        (
            OwnDice,
            "a new agent does something else, with the same observations; expected the seed to decide everything",
        ),
        (
            Counts,
            "after another episode it does something else, with the same observations; expected reset() to forget",
        ),
    ],
)
def test_each_breach_and_nothing_else_is_named(agent: type, found: str) -> None:
    problems = check_agent(agent, **QUICK)
    assert len(problems) == 1, problems
    assert found in problems[0]


class Hashes(Walker):
    """Chooses actions by Python's hash of a word, which differs between processes."""

    def act(self, observation):
        return self.task.actions[1 + hash(f"{observation.step} words") % 3]


@pytest.mark.slow
def test_an_agent_that_differs_between_processes_is_named() -> None:
    (problem,) = check_agent(Hashes, **QUICK)
    assert "a second process does something else" in problem


def test_an_instance_that_does_not_repeat_itself_is_named_without_guessing_why() -> None:
    for agent in (Counts(), OwnDice()):
        problems = check_agent(agent, **{**QUICK, "steps": 20})
        assert len(problems) == 1
        assert "it does something else when reset again" in problems[0]
        assert "expected determinism, and nothing kept without keep_memory" in problems[0]


def test_missing_methods_and_factories_that_fail_or_work_only_once_are_named() -> None:
    assert check_agent(object()) == [
        "agent: found no method reset(); expected one, because the contract needs it. Correct the plug-in."
    ]
    assert check_agent(lambda: 1 / 0) == ["<lambda>() raised ZeroDivisionError: division by zero. Correct the agent."]
    assert "agent is 'walker'; expected your own as package.module:factory" in check_agent("walker")[0]
    (problem,) = check_agent("no_such_package.agent:make")
    assert "ModuleNotFoundError" in problem
    made = [Walker()]
    (problem,) = check_agent(made.pop, **QUICK)
    assert "a second agent: list.pop() raised IndexError: pop from empty list. Correct the agent." in problem


@pytest.mark.slow
def test_an_agent_is_loaded_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_walker.py").write_text("from tests.sim.test_checks import Walker as make\n")
    monkeypatch.syspath_prepend(tmp_path)
    try:
        assert check_agent("my_walker:make", **QUICK) == []
    finally:
        sys.modules.pop("my_walker", None)


def test_a_slow_agent_breaks_no_rule_but_causes_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    class Thinks(Walker):
        def act(self, observation):
            begin = time.perf_counter()
            while time.perf_counter() - begin < 0.02:
                math.sqrt(2)
            return super().act(observation)

    monkeypatch.setattr(sim.checks, "SLOW_S", 0.01)
    with pytest.warns(UserWarning, match="s per action; runs will take long"):
        assert check_agent(Thinks, **{**QUICK, "steps": 2}) == []


class Follower(Walker):
    """Keeps the contract: reads messages and queries itself, and ends a search after three actions."""

    follows_sequences = True

    def reset(self, task, camera, *, seed, keep_memory=False) -> None:
        super().reset(task, camera, seed=seed)
        self.told, self.since = [], 0

    def act(self, observation):
        if observation.query is not None:
            self.told.append((observation.query, observation.message))
            self.since = 0
        self.since += 1
        return Action.FOUND if self.since > 3 and Action.FOUND in self.task.actions else super().act(observation)


def test_agents_pass_in_home_sequences_search_by_search_or_by_themselves() -> None:
    class Stopper(Walker):  # classes in functions are not sent to a second process, which takes long
        def act(self, observation):
            return Action.STOP if observation.step == 2 else super().act(observation)

    class Listener(Follower):
        pass

    listener = Listener()
    for agent in (Stopper, Listener, listener):
        assert check_agent(agent, **QUICK, sequences=True) == []
    (first, nothing), (second, news) = listener.told
    assert (nothing, first != second, "gave" in news) == (None, True, True)


class Greedy(Follower):
    """Breaks the contract: it says FOUND in episodes too."""

    def act(self, observation):
        return Action.FOUND


class CannotCarry(Walker):
    """Breaks the contract: it cannot go on from another start."""

    def carry(self, start) -> None:
        raise NotImplementedError("one start only")


class Hoards(Walker):
    """Breaks the contract: what it heard in a sequence stays, without keep_memory too."""

    def __init__(self) -> None:
        self.heard = 0

    def act(self, observation):
        self.heard += "gave" in self.task.description
        return Action.LEFT if self.heard < 3 else Action.RIGHT


class CannotRepeatItself(Walker):
    """Breaks the contract: it fails in the second search of a home that it remembers."""

    def reset(self, task, camera, *, seed, keep_memory=False) -> None:
        super().reset(task, camera, seed=seed)
        if keep_memory and "gave" in task.description:
            raise ValueError("news")


@pytest.mark.parametrize(
    ("agent", "found"),
    [
        (Greedy, "task with 6 actions, step 1: act() returned <Action.FOUND: 'found'>; expected an Action of ['stop',"),
        (CannotCarry, "sequence of 2 searches, keep_memory=True, step 7: CannotCarry.carry() raised NotImplemented"),
        (
            CannotRepeatItself,
            "sequence of 2 searches, keep_memory=True, step 7: CannotRepeatItself.reset() raised ValueError: news",
        ),
        (
            Hoards,
            "sequence of 2 searches, seed 0: from step 1 on after another episode it does something else, with the "
            "same observations; expected reset() to forget",
        ),
    ],
)
def test_a_breach_in_a_home_sequence_is_named(agent: type, found: str) -> None:
    problems = check_agent(agent, **QUICK, sequences=True)
    assert len(problems) == 1, problems
    assert found in problems[0]


def test_home_sequences_are_checked_on_request_only() -> None:
    assert check_agent(lambda: CannotCarry(), **QUICK) == []


class HashesNews(Follower):
    """Chooses actions by Python's hash of a message, which differs between processes."""

    def act(self, observation):
        news = self.told[-1][1] if self.told else None
        return self.task.actions[1 + hash(f"{observation.step} {news}") % 3] if news else super().act(observation)


@pytest.mark.slow
def test_an_agent_that_differs_between_processes_in_a_sequence_alone_is_named() -> None:
    (problem,) = check_agent(HashesNews, steps=12, camera=Camera(32, 24), sequences=True)
    assert "sequence of 2 searches, seed 0: from step" in problem
    assert "a second process does something else" in problem

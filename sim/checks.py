"""Checks that users run on their own agents; ours pass the same ones. Needs no dataset: the home is made from a seed.

from sim.checks import check_agent

problems = check_agent("my_package.my_agent:make")
assert not problems, "\\n".join(problems)
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache, partial

import numpy as np

from sim.errors import AgentError
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene
from sim.plugins import call_plugin, made_of, second_answer
from sim.render.raycast import Raycaster
from sim.sequences.playing import SearchBySearch, sequence_agent
from sim.tasks.agents import Agent, next_action
from sim.tasks.pan import PanEnv
from sim.types import PAPER4, PAPER6, SEQUENCE7, TURN_STEP, Action, Camera, Observation, Pose, Prompt, Task

STEPS = 40
"""Actions in each trial episode, unless the agent stops before: a look around, which takes 12, and a walk."""
METHODS = ("reset", "act")
"""Methods of an agent."""
SLOW_S = 2.0
"""A mean time per action above this causes a warning: 500 steps then take a quarter of an hour."""
_HOME_SEED = 1


@dataclass(frozen=True, slots=True)
class Trial:
    """One short episode, or home sequence, of a check."""

    name: str
    task: Task
    start: Pose
    seed: int
    prompts: tuple[Prompt, ...] = ()
    """The searches of a home sequence."""


def check_agent(
    agent: Agent | Callable[[], Agent] | str,
    *,
    steps: int = STEPS,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    sequences: bool = False,
) -> list[str]:
    """Runs an agent for a few steps in a small invented home and lists how it breaks the contract of `Agent`.

    It checks that `reset` and `act` exist and take their arguments; every answer is an `Action` of the task, with six
    actions and with four; observation arrays stay as they were; the same task, seed and observations give the same
    actions, also after another episode (nothing is kept without `keep_memory`), and in a second process, where Python's
    `hash()` gives other numbers; nothing is raised. A slow agent breaks no rule, but causes a `UserWarning`. The second
    process is left out for an agent that cannot be sent there, such as a class defined in a script.

    Args:
        agent: An agent, a function without arguments that makes one, or its name as package.module:factory. With a
            function or a name, new agents are made for comparison, so that lack of determinism and memory that
            outlives a reset can be told apart.
        steps: Actions per trial episode, and per search of a home sequence.
        camera: The agent's camera; the default is the one that runs use.
        sequences: Whether it must also do a home sequence of two searches, with and without its memory: itself where
            it has `follows_sequences`, else one search after the other, with `carry` if it has one.

    Returns:
        One sentence per violation; empty = the contract is kept.
    """
    try:
        first = made_of(agent, methods=METHODS, kind="agent")
    except AgentError as error:
        return [str(error)]
    scene = check_home()
    six, four = check_trials(scene)
    checkup = _Checkup(scene, camera, steps)
    repeated = [six, check_sequence(scene)] if sequences else [six]
    answers = {}
    for trial in repeated:
        before = checkup.actions_of(first, trial)
        if before is None:
            break
        answers[trial.name] = before
        checkup.actions_of(first, four)
        again = checkup.actions_of(first, trial)
        fresh = None if first is agent else checkup.actions_of_new(agent, trial)
        checkup.problems += _differences(trial, before, again=again, fresh=fresh)
        checkup.actions_of(first, trial, keep_memory=True)
    if not checkup.problems:
        checkup.problems += _in_second_process(agent, repeated, answers, camera=camera, steps=steps)
    return list(dict.fromkeys(checkup.problems))


def _in_second_process(
    agent: Agent | Callable[[], Agent] | str,
    trials: list[Trial],
    before: dict[str, list[Action]],
    *,
    camera: Camera,
    steps: int,
) -> list[str]:
    """Problems of the same trials in a new process, where Python's `hash()` gives other numbers."""
    try:
        play = partial(_actions, trials=trials, camera=camera, steps=steps)
        second = second_answer(agent, play, methods=METHODS)
    except AgentError as error:
        return [str(error)]
    what, wanted = "a second process does something else", "the seed to decide everything"
    return [
        _difference(trial, before[trial.name], after, what, wanted)
        for trial, after in zip(trials, second[0] if second else (), strict=False)
        if after != before[trial.name]
    ]


def _actions(agent: Agent, *, trials: list[Trial], camera: Camera, steps: int) -> list[list[Action]]:
    """The agent's actions in each trial."""
    checkup = _Checkup(check_home(), camera, steps)
    return [checkup.actions_of(agent, trial) or [] for trial in trials]


@cache
def check_home() -> Scene:
    """The small invented home in which agents are checked; made once per process."""
    return scene_from_plan(invent_plan("Check", seed=_HOME_SEED))


def check_trials(scene: Scene) -> tuple[Trial, Trial]:
    """Two different tasks at two different places: one with all six actions, one with four."""
    thing = scene.objects[0].category
    trials = []
    for number, (name, actions) in enumerate((("Ada", PAPER6), ("Tom", PAPER4))):
        rng = np.random.default_rng([_HOME_SEED, number])
        x, y, z = scene.navigation.random_point(rng, storey_y=scene.navigation.storey_heights[0]).tolist()
        task = Task("pan", f"{name} owns the {thing} in this home.", (f"Find {name}'s {thing}",), actions=actions)
        trials.append(
            Trial(f"task with {len(actions)} actions", task, Pose((x, y, z), number * TURN_STEP), seed=number)
        )
    return trials[0], trials[1]


def check_sequence(scene: Scene) -> Trial:
    """A home sequence of two searches, of which the second is about something that was given away."""
    first, _ = check_trials(scene)
    thing = scene.objects[0].category
    prompts = (Prompt(f"Find Ada's {thing}"), Prompt(f"Find Tom's {thing}", f"Ada gave the {thing} to Tom."))
    task = replace(first.task, actions=SEQUENCE7)
    return replace(first, name=f"sequence of {len(prompts)} searches", task=task, prompts=prompts)


class _Checkup:
    """Plays trials and collects violations."""

    def __init__(self, scene: Scene, camera: Camera, steps: int) -> None:
        self.problems: list[str] = []
        self._scene, self._renderer = scene, Raycaster(scene.mesh)
        self._camera, self._steps = camera, steps

    def actions_of(self, agent: Agent, trial: Trial, *, keep_memory: bool = False) -> list[Action] | None:
        """The agent's actions in the trial; None when a violation ended it."""
        env = PanEnv(
            trial.start,
            self._scene.navigation,
            renderer=self._renderer,
            camera=self._camera,
            max_steps=self._steps,
            prompts=trial.prompts,
        )
        if trial.prompts:
            agent = sequence_agent(partial(_same_agent, agent), trial.start, keeps_memory=keep_memory)
        more = {"keep_memory": True} if keep_memory and not isinstance(agent, SearchBySearch) else {}
        where = f"{trial.name}{', keep_memory=True' if keep_memory else ''}"
        actions: list[Action] = []
        spent_s = -time.perf_counter()
        try:
            call_plugin("agent", agent.reset, trial.task, self._camera, seed=trial.seed, **more)
            spent_s += time.perf_counter()
            observation = env.reset()
            while not env.is_over:
                arrays = _copied_arrays(observation)
                spent_s -= time.perf_counter()
                action = next_action(agent, trial.task, observation)
                spent_s += time.perf_counter()
                self._require_unchanged(arrays, observation)
                actions.append(action)
                observation = env.step(action)
        except AgentError as error:
            self.problems.append(f"{where}, step {len(actions) + 1}: {error}")
            return None
        if spent_s / len(actions) > SLOW_S:
            warnings.warn(f"{where}: {spent_s / len(actions):.1f} s per action; runs will take long.", stacklevel=3)
        return actions

    def actions_of_new(self, agent: Agent | Callable[[], Agent] | str, trial: Trial) -> list[Action] | None:
        """The actions of another agent of this kind; None when it cannot be made, or a violation ended it."""
        try:
            made = made_of(agent, methods=METHODS, kind="agent")
        except AgentError as error:
            self.problems.append(f"{trial.name}, a second agent: {error}")
            return None
        return self.actions_of(made, trial)

    def _require_unchanged(self, before: dict[str, np.ndarray], observation: Observation) -> None:
        for name, array in before.items():
            if not np.array_equal(array, getattr(observation, name)):
                self.problems.append(
                    f"act() changed the array observation.{name}; expected it to be left as it is. Work on a copy."
                )


def _same_agent(agent: Agent, index: int, here: Pose, marks: tuple[Pose, ...]) -> Agent | None:
    """The agent of each search; it is asked once."""
    return None if marks else agent


def _copied_arrays(observation: Observation) -> dict[str, np.ndarray]:
    values = {field.name: getattr(observation, field.name) for field in fields(observation)}
    return {name: value.copy() for name, value in values.items() if isinstance(value, np.ndarray)}


def _differences(
    trial: Trial, before: list[Action], *, again: list[Action] | None, fresh: list[Action] | None
) -> list[str]:
    """The problem where a new agent, or the same agent after another episode, repeats a trial with other actions."""
    if fresh is not None and fresh != before:
        return [_difference(trial, before, fresh, "a new agent does something else", "the seed to decide everything")]
    if again is None or again == before:
        return []
    if fresh is None:
        what, wanted = "it does something else when reset again", "determinism, and nothing kept without keep_memory"
    else:
        what, wanted = "after another episode it does something else", "reset() to forget without keep_memory"
    return [_difference(trial, before, again, what, wanted)]


def _difference(trial: Trial, before: list[Action], after: list[Action], what: str, wanted: str) -> str:
    same = next(
        (i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a is not b), min(len(before), len(after))
    )
    return (
        f"{trial.name}, seed {trial.seed}: from step {same + 1} on {what}, with the same observations; "
        f"expected {wanted}. Draw from np.random.default_rng(seed) made in reset(), and clear everything else there."
    )

"""Scores a finished run of a home sequence search by search, with the rules of episodes."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.optimize import linear_sum_assignment

from sim.episodes.schema import Goal
from sim.episodes.sequence_files import HomeSequence
from sim.tasks.pan import PanEnv
from sim.tasks.rules import reaches_target, score_run, success_region
from sim.tasks.run_files import Step
from sim.types import Action, Pose
from sim.walk.navigation_map import NavigationMap

from .runs import AllMeasures, SearchEnd, SearchReason, SequenceEnd, SequenceRun, SequenceStart
from .searches import old_target, search_episode


def run_from_sequence_env(
    sequence: HomeSequence, env: PanEnv, *, scene_digest: str, navigation: NavigationMap
) -> SequenceRun:
    """The finished run of `env`, each search scored under every rule."""
    reason = env.end_reason
    assert reason is not None, "the sequence is not over"
    start, record = sequence.start, sequence.record
    searches = [
        score_search(sequence, index, env, scene_digest=scene_digest, navigation=navigation)
        for index in range(len(record.subtasks))
    ]
    return SequenceRun(
        start=SequenceStart(
            split=record.split,
            scene=sequence.key.scene,
            sequence_id=record.sequence_id,
            position=start.position,
            yaw=start.yaw,
        ),
        steps=env.steps,
        end=SequenceEnd(reason=reason, searches=tuple(searches)),
    )


def score_search(
    sequence: HomeSequence, index: int, env: PanEnv, *, scene_digest: str, navigation: NavigationMap
) -> SearchEnd:
    """One search of `env`, scored under every rule; a search that is not over yet counts as unreached."""
    begin, end = (0, *env.search_ends)[index : index + 2] if index < len(env.search_ends) else (0, 0)
    scored = _Search(sequence, index, navigation)
    return scored.end(env.poses[begin : end + 1], env.steps[begin:end], scene_digest=scene_digest)


def search_reason(last: Action) -> SearchReason:
    """Why a search ended whose last action this was."""
    return "found" if last is Action.FOUND else "stop" if last is Action.STOP else "steps"


class _Search:
    """One search with its truth."""

    def __init__(self, sequence: HomeSequence, index: int, navigation: NavigationMap) -> None:
        self._sequence, self._index, self._navigation = sequence, index, navigation
        self._subtask, self._targets = sequence.record.subtasks[index], sequence.targets[index]
        self._episode = search_episode(sequence, index)

    def end(self, poses: Sequence[Pose], steps: Sequence[Step], *, scene_digest: str) -> SearchEnd:
        """What came of it; `poses` are those where it began and after each step. Without steps it never began."""
        subtask, index = self._subtask, self._index
        reason: SearchReason = "unreached"
        measures = found_old = None
        if steps:
            reason = search_reason(steps[-1].action)
            measures = score_run(
                self._episode,
                poses,
                stopped=reason == "found",
                navigation=self._navigation,
                collisions=sum(step.collided for step in steps),
                scene_digest=scene_digest,
            )
        marks = _marks(poses, steps, ends_with_two=subtask.mode == "all" and reason == "found")
        old = old_target(self._sequence, index)
        if old is not None:
            found_old = any(reaches_target(mark, old) for mark in marks)
        told = range(1, len(self._sequence.record.messages))
        return SearchEnd(
            kind=subtask.kind,
            reason=reason,
            message=subtask.message,
            is_after_news=any(
                self._sequence.record.messages[message].before <= index
                for message in told
                if message != subtask.message
            ),
            leg_m=self._leg_m(),
            measures=measures,
            is_at_old=found_old,
            all=self._all(poses, marks) if subtask.mode == "all" and steps else None,
        )

    def _leg_m(self) -> float | None:
        """The shortest walk from a right object of the search before, or from the start."""
        sequence, index = self._sequence, self._index
        begins = [_before(target) for target in sequence.targets[index - 1]] if index else [sequence.start.position]
        return _finite(self._walk(begins, self._targets))

    def _all(self, poses: Sequence[Pose], marks: Sequence[Sequence[float]]) -> AllMeasures:
        """Recall and precision of the marks, each for one right object at most, and the best walk to all of them."""
        hits = np.array([[reaches_target(mark, target) for target in self._targets] for mark in marks], float)
        rows, columns = linear_sum_assignment(hits.reshape(len(marks), len(self._targets)), maximize=True)
        num_hits = int(hits[rows, columns].sum()) if len(marks) else 0
        orders = permutations(self._targets)
        best_m = min(self._along([poses[0].position, *map(_before, order)], order) for order in orders)
        return AllMeasures(
            recall=num_hits / len(self._targets),
            precision=num_hits / len(marks) if marks else 0.0,
            best_m=_finite(best_m),
        )

    def _along(self, places: Sequence[Sequence[float]], order: Sequence[Goal]) -> float:
        """Metres of walking from each place to the next object."""
        return sum(self._walk([place], (target,)) for place, target in zip(places, order, strict=False))

    def _walk(self, begins: Sequence[Sequence[float]], targets: tuple[Goal, ...]) -> float:
        """Least metres from one of these places to where FOUND at one of the objects succeeds; inf = no path."""
        region = success_region(replace(self._episode, targets=targets), self._navigation)
        if not len(region):
            return float("inf")
        return float(self._navigation.distances(np.array(begins), region).min())


def _marks(poses: Sequence[Pose], steps: Sequence[Step], *, ends_with_two: bool) -> list[tuple[float, float, float]]:
    """Places of the robot's feet at each FOUND; the second of two that end a search marks nothing."""
    found = [pose.position for pose, step in zip(poses[1:], steps, strict=False) if step.action is Action.FOUND]
    return found[:-1] if ends_with_two else found


def _before(target: Goal) -> tuple[float, float, float]:
    """A place before the object: its first view point."""
    return target.view_points[0].agent_state.position


def _finite(metres: float) -> float | None:
    return metres if np.isfinite(metres) else None

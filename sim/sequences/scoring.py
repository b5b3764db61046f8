"""Scores a finished run of a home sequence search by search, with the rules of episodes."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.episodes.schema import Goal
from sim.episodes.sequence_files import HomeSequence
from sim.tasks.pan import PanEnv
from sim.tasks.rules import reaches_target, score_run, success_region
from sim.tasks.run_files import Step
from sim.types import Action, Pose
from sim.walk.navigation_map import NavigationMap

from .runs import AllMeasures, SearchEnd, SearchReason, SequenceEnd, SequenceRun, SequenceStart
from .searches import is_after_news, old_target, search_episode


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
    scored = _Search(sequence, index, navigation)
    if index >= len(env.search_ends):
        return scored.end((), (), reason="unreached", scene_digest=scene_digest)
    begin, end = (0, *env.search_ends)[index : index + 2]
    poses, steps, why = env.poses[begin : end + 1], env.steps[begin:end], env.search_reasons[index]
    reason: SearchReason
    if why == "giveup" or why == "timeout":
        reason = why
    else:
        reason = search_reason(steps, is_for_all=sequence.record.subtasks[index].mode == "all")
    return scored.end(poses, steps, reason=reason, scene_digest=scene_digest)


def search_reason(steps: Sequence[Step], *, is_for_all: bool) -> SearchReason:
    """Why a search with these steps ended."""
    last = [step.action for step in steps[-2:]]
    if last[-1] is Action.STOP:
        return "stop"
    is_found = last == 2 * [Action.FOUND] if is_for_all else last[-1] is Action.FOUND
    return "found" if is_found else "steps"


def marking_steps(steps: Sequence[Step], *, ends_with_two: bool) -> list[int]:
    """Indexes of a search's steps with FOUND; the second of two that end a search marks nothing."""
    found = [place for place, step in enumerate(steps) if step.action is Action.FOUND]
    return found[:-1] if ends_with_two else found


def all_measures(hits: NDArray[np.float64], *, best_m: float | None) -> AllMeasures:
    """Recall and precision of the marks of a search for all, each for one right object at most.

    Args:
        hits: (N, M) 1 where a mark is at a right object, 0 elsewhere.
        best_m: The shortest walk to all right objects; None = no path.
    """
    num_marks, num_right = hits.shape
    num_hits = int(hits[linear_sum_assignment(hits, maximize=True)].sum())
    return AllMeasures(recall=num_hits / num_right, precision=num_hits / num_marks if num_marks else 0.0, best_m=best_m)


class _Search:
    """One search with its truth."""

    def __init__(self, sequence: HomeSequence, index: int, navigation: NavigationMap) -> None:
        self._sequence, self._index, self._navigation = sequence, index, navigation
        self._subtask, self._targets = sequence.record.subtasks[index], sequence.targets[index]
        self._episode = search_episode(sequence, index)

    def end(
        self, poses: Sequence[Pose], steps: Sequence[Step], *, reason: SearchReason, scene_digest: str
    ) -> SearchEnd:
        """What came of it; `poses` are those where it began and after each step. Without poses it never began."""
        subtask, index = self._subtask, self._index
        measures = found_old = None
        if poses:
            measures = score_run(
                self._episode,
                poses,
                stopped=reason == "found",
                navigation=self._navigation,
                collisions=sum(step.collided for step in steps),
                scene_digest=scene_digest,
            )
        ends_with_two = subtask.mode == "all" and reason == "found"
        marks = [poses[place + 1].position for place in marking_steps(steps, ends_with_two=ends_with_two)]
        old = old_target(self._sequence, index)
        if old is not None:
            wrong = [mark for mark in marks if not any(reaches_target(mark, target) for target in self._targets)]
            found_old = any(reaches_target(mark, old) for mark in wrong)
        return SearchEnd(
            kind=subtask.kind,
            reason=reason,
            message=subtask.message,
            is_after_news=is_after_news(self._sequence, index),
            leg_m=self._leg_m(),
            measures=measures,
            is_at_old=found_old,
            all=self._all(poses, marks) if subtask.mode == "all" and poses else None,
        )

    def _leg_m(self) -> float | None:
        """The shortest walk from a right object of the search before, or from the start; to all objects if wanted."""
        sequence, index = self._sequence, self._index
        begins = [_before(target) for target in sequence.targets[index - 1]] if index else [sequence.start.position]
        return _finite(self._best_m(begins) if self._subtask.mode == "all" else self._walk(begins, self._targets).min())

    def _all(self, poses: Sequence[Pose], marks: Sequence[Sequence[float]]) -> AllMeasures:
        """Recall and precision of the marks, and the best walk to all right objects."""
        hits = np.array([[reaches_target(mark, target) for target in self._targets] for mark in marks], float)
        best_m = _finite(self._best_m([poses[0].position]))
        return all_measures(hits.reshape(len(marks), len(self._targets)), best_m=best_m)

    def _best_m(self, begins: Sequence[Sequence[float]]) -> float:
        """Metres of the shortest walk from one of these places to all right objects, in the best order."""
        places = [*begins, *map(_before, self._targets)]
        walks = np.array([self._walk(places, (target,)) for target in self._targets]).T
        first, between = walks[: len(begins)].min(axis=0), walks[len(begins) :]
        bests = {frozenset((last,)): {last: float(walk)} for last, walk in enumerate(first)}
        """The shortest walk to each set of objects, by the object reached last."""
        for count in range(2, len(self._targets) + 1):
            for reached in map(frozenset, combinations(range(len(self._targets)), count)):
                bests[reached] = {
                    last: min(walk + between[before, last] for before, walk in bests[reached - {last}].items())
                    for last in reached
                }
        return min(bests[frozenset(range(len(self._targets)))].values())

    def _walk(self, begins: Sequence[Sequence[float]], targets: tuple[Goal, ...]) -> NDArray[np.float64]:
        """(N,) metres from each of these places to where FOUND at one of the objects succeeds; inf = no path."""
        region = success_region(replace(self._episode, targets=targets), self._navigation)
        if not len(region):
            return np.full(len(begins), np.inf)
        return self._navigation.distances(np.array(begins), region)


def _before(target: Goal) -> tuple[float, float, float]:
    """A place before the object: its first view point."""
    return target.view_points[0].agent_state.position


def _finite(metres: float) -> float | None:
    return float(metres) if np.isfinite(metres) else None

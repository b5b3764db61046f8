"""POG in a home sequence: one search after the other is told, and each takes the points of an answer."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from sim.episodes.schema import Goal, Vector3
from sim.episodes.sequence_files import HomeSequence
from sim.tasks.rules import score_answer
from sim.types import Task

from .runs import AllMeasures, SearchEnd, SequenceEnd, SequenceRun, SequenceStart
from .scoring import all_measures
from .searches import is_after_news, old_target, prompts_of, search_episode, sequence_task, task_so_far


class PointSearches:
    """The searches of a sequence. `task` tells what may be known now; the truth stays inside until `run`."""

    def __init__(
        self,
        sequence: HomeSequence,
        *,
        storeys: Sequence[tuple[float, float]],
        query_index: int = 0,
        ignores_messages: bool = False,
    ) -> None:
        """Begins with the first search.

        Args:
            sequence: The sequence.
            storeys: The home's, as of `sim.tasks.rules.scene_storeys`.
            query_index: Which of a query's paraphrases is read.
            ignores_messages: Whether nothing is told after the intro.
        """
        self._sequence, self._storeys = sequence, storeys
        self._prompts = prompts_of(sequence, query_index=query_index, ignores_messages=ignores_messages)
        self._whole = dataclasses.replace(sequence_task(sequence, query_index=query_index), kind="pog")
        self._ends: list[SearchEnd] = []

    @property
    def index(self) -> int:
        """The present search; the number of searches once all are over."""
        return len(self._ends)

    @property
    def is_over(self) -> bool:
        """Whether every search has its answer."""
        return self.index == len(self._prompts)

    @property
    def message(self) -> str | None:
        """What is told before the present search; None = nothing."""
        return self._prompts[self.index].message

    @property
    def query(self) -> str:
        """The object to find now."""
        return self._prompts[self.index].query

    @property
    def is_for_all(self) -> bool:
        """Whether each right object is to be marked."""
        return self._prompts[self.index].is_for_all

    @property
    def task(self) -> Task:
        """The present search as an episode's task: the description is all that was told so far."""
        news = [
            (prompt.message, index) for index, prompt in enumerate(self._prompts[: self.index + 1]) if prompt.message
        ]
        return task_so_far(self._whole, news, self.query, self.index)

    def answer(self, points: Sequence[Vector3], *, without: Literal["giveup", "timeout"] = "giveup") -> None:
        """Takes the answer of the present search, which ends it.

        Args:
            points: World points, best first; where all objects are wanted, one for each. () = no answer.
            without: Why there is none.
        """
        sequence, index = self._sequence, self.index
        subtask, episode = sequence.record.subtasks[index], search_episode(sequence, index)
        measures, old = score_answer(episode, points, storeys=self._storeys), old_target(sequence, index)
        marked = points if self.is_for_all else points[:1]
        self._ends.append(
            SearchEnd(
                kind=subtask.kind,
                reason="found" if points else without,
                message=subtask.message,
                is_after_news=is_after_news(sequence, index),
                leg_m=None,
                measures=None,
                is_at_old=None if old is None else self._is_at(old, marked),
                all=self._all(points) if self.is_for_all else None,
                answer=measures,
                points=tuple(points),
            )
        )

    def run(self) -> SequenceRun:
        """The finished run."""
        assert self.is_over, "the sequence is not over"
        record, start = self._sequence.record, self._sequence.start
        return SequenceRun(
            start=SequenceStart(
                task="pog",
                split=record.split,
                scene=self._sequence.key.scene,
                sequence_id=record.sequence_id,
                position=start.position,
                yaw=start.yaw,
            ),
            steps=(),
            end=SequenceEnd(reason="click", searches=tuple(self._ends)),
        )

    def _is_at(self, old: Goal, marked: Sequence[Vector3]) -> bool:
        """Whether one of these points is at the object that was right before, and at no right one."""
        right = self._hits(marked, self._sequence.targets[self.index]).any(axis=1)
        return bool((self._hits(marked, (old,))[:, 0] > right).any())

    def _hits(self, points: Sequence[Vector3], targets: Sequence[Goal]) -> np.ndarray:
        """(N, M) which points are right for which targets."""
        episode = search_episode(self._sequence, self.index)
        found = [
            [score_answer(dataclasses.replace(episode, targets=(target,)), (point,), storeys=self._storeys).success]
            for point in points
            for target in targets
        ]
        return np.array(found, float).reshape(len(points), len(targets))

    def _all(self, points: Sequence[Vector3]) -> AllMeasures:
        """Recall and precision of points."""
        return all_measures(self._hits(points, self._sequence.targets[self.index]), best_m=None)

"""Failures of grounding runs: how many of which kind, and a drawn sample with the map, the goal and the reason."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grounding.report.asked_again import AnswerAgain, AskAgain
from grounding.report.failures import KINDS, Failure, FailureKind, failure_of, reasons
from grounding.report.rows import row_name, variant_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode, Goal
from sim.tasks.rules import scene_storeys
from sim.tasks.run_files import Answer, Run, RunInfo


@dataclass(frozen=True, slots=True)
class KindCount:
    """Failures of one kind of one method on one map variant, over all its runs."""

    table: str
    """Title of the map variant."""
    method: str
    kind: FailureKind
    n: int
    of: int
    """All failures of the method there."""


@dataclass(frozen=True, slots=True)
class DrawnFailure:
    """One failure of the sample."""

    table: str
    method: str
    info: RunInfo
    episode: Episode
    answer: Answer
    failure: Failure
    reasons: tuple[str, ...]
    """Sentences from the grounder's own layers."""
    again: AnswerAgain
    goals: tuple[Goal, ...]
    """All objects of the home."""

    @property
    def file_name(self) -> str:
        """Of its picture."""
        split, scene, number = self.episode.key
        return f"failure-{self.info.run_id}-{split}-{scene}-{number}.svg"


@dataclass(frozen=True, slots=True)
class Gallery:
    """All that is said of failures."""

    counts: tuple[KindCount, ...]
    drawn: tuple[DrawnFailure, ...]


class _Homes:
    """Episodes, objects and storeys of the homes that are asked for, each read once."""

    def __init__(self, dataset: PersonalDataset) -> None:
        self._dataset = dataset
        self._episodes: dict[str, dict[object, Episode]] = {}
        self._goals: dict[str, tuple[Goal, ...]] = {}
        self._storeys: dict[str, list[tuple[float, float]]] = {}

    def failure(self, answer: Answer) -> tuple[Episode, Failure]:
        """The episode of a wrong answer, and what is wrong."""
        scene = answer.scene
        if scene not in self._goals:
            self._goals[scene] = tuple(self._dataset.goals(scene).values())
            self._storeys[scene] = scene_storeys(self._goals[scene])
            self._episodes[scene] = {item.key: item for item in self._dataset.episodes(scenes=(scene,))}
        episode = self._episodes[scene][answer.key]
        return episode, failure_of(episode, answer, goals=self._goals[scene], storeys=self._storeys[scene])

    def goals(self, scene: str) -> tuple[Goal, ...]:
        """All objects of a home that `failure` was asked of."""
        return self._goals[scene]


def failure_gallery(
    runs: Sequence[Run], dataset: PersonalDataset, *, beside: Sequence[Path] = (), per_method: int, seed: int
) -> Gallery:
    """Counts over all failures, and a sample of each method's.

    Args:
        runs: Of agents on this dataset; people's are left out.
        dataset: With the episodes.
        beside: Folders that hold the run folders: maps lie there too.
        per_method: Most failures that are drawn of each method on each map variant.
        seed: Of the sample, which is the same for the same runs.

    Raises:
        PersonalVizError: The dataset is damaged, or a map cannot be made again.
    """
    homes, asking = _Homes(dataset), AskAgain(dataset, beside=beside)
    counts: list[KindCount] = []
    drawn: list[DrawnFailure] = []
    for (table, method), failures in _failures(runs, homes).items():
        of_kind: Counter[FailureKind] = Counter(found[3].kind for found in failures)
        counts += [KindCount(table, method, kind, of_kind[kind], len(failures)) for kind in KINDS if of_kind[kind]]
        rng = np.random.default_rng(seed)
        chosen = sorted(rng.choice(len(failures), size=min(per_method, len(failures)), replace=False).tolist())
        for info, episode, answer, failure in (failures[index] for index in chosen):
            again = asking.ask(info, answer, episode)
            sentences = tuple(reasons(episode, again))
            goals = homes.goals(episode.key.scene)
            drawn.append(DrawnFailure(table, method, info, episode, answer, failure, sentences, again, goals))
    return Gallery(tuple(counts), tuple(drawn))


_Found = tuple[RunInfo, Episode, Answer, Failure]


def _failures(runs: Sequence[Run], homes: _Homes) -> dict[tuple[str, str], list[_Found]]:
    found: dict[tuple[str, str], list[_Found]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: run.info.run_id):
        if run.info.who_kind == "human":
            continue
        where = (variant_of(run.info).title, row_name(run.info))
        found[where] += _wrong(run, homes)
    return found


def _wrong(run: Run, homes: _Homes) -> Iterator[_Found]:
    for answer in sorted(run.answers, key=lambda answer: answer.key):
        if answer.measures is not None and not answer.measures.success and answer.reason != "technical":
            episode, failure = homes.failure(answer)
            yield run.info, episode, answer, failure

"""Failures of grounding runs: how many of which kind, and a drawn sample with the map, the goal and the reason."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from grounding.report.asked_again import AnswerAgain, AskAgain
from grounding.report.failures import KINDS, Failure, FailureKind, failure_of, reasons
from grounding.report.rows import row_name, variant_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode, Goal
from sim.tasks.rules import scene_storeys
from sim.tasks.run_files import Answer, Run, RunInfo
from sim.types import EpisodeKey


@dataclass(frozen=True, slots=True)
class KindCount:
    """Number of failures of one kind of one method on one map variant, over all its runs."""

    table: str
    """Title of the map variant."""
    dataset_digest: str
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
        """Name of its picture."""
        split, scene, number = self.episode.key
        return f"failure-{self.info.run_id}-{split}-{scene}-{number}.svg"


@dataclass(frozen=True, slots=True)
class Gallery:
    """Counts of all failures, and the sample that is drawn."""

    counts: tuple[KindCount, ...]
    drawn: tuple[DrawnFailure, ...]


def failure_gallery(
    runs: Sequence[Run], dataset: PersonalDataset, *, beside: Sequence[Path] = (), per_method: int, seed: int
) -> Gallery:
    """Counts over all failures, and a sample of each method's.

    Args:
        runs: Runs on this dataset; people's are left out.
        beside: Folders that hold the run folders: maps are there too.
        per_method: Most failures that are drawn of each method on each map variant.
        seed: Seed of the sample, which is the same for the same runs.

    Raises:
        PersonalVizError: The dataset is damaged, or a map cannot be made again.
    """

    @cache
    def home(scene: str) -> tuple[dict[EpisodeKey, Episode], tuple[Goal, ...], list[tuple[float, float]]]:
        """Episodes, objects and storeys of a home."""
        goals = tuple(dataset.goals(scene).values())
        return {item.key: item for item in dataset.episodes(scenes=(scene,))}, goals, scene_storeys(goals)

    found: dict[tuple[str, str], list[tuple[RunInfo, Answer, Failure]]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: run.info.run_id):
        where = (variant_of(run.info).title, row_name(run.info))
        for answer in sorted(run.answers, key=lambda answer: answer.key):
            is_wrong = answer.measures is not None and not answer.measures.success and answer.reason != "technical"
            if is_wrong and run.info.who_kind == "agent":
                episodes, goals, storeys = home(answer.scene)
                failure = failure_of(episodes[answer.key], answer, goals=goals, storeys=storeys)
                found[where].append((run.info, answer, failure))
    asking = AskAgain(dataset, beside=beside)
    counts: list[KindCount] = []
    drawn: list[DrawnFailure] = []
    for (table, method), failures in found.items():
        of_kind: Counter[FailureKind] = Counter(failure.kind for _, _, failure in failures)
        digest, total = failures[0][0].dataset_digest, len(failures)
        counts += [KindCount(table, digest, method, kind, of_kind[kind], total) for kind in KINDS if of_kind[kind]]
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(failures), size=min(per_method, len(failures)), replace=False)
        for info, answer, failure in (failures[index] for index in sorted(chosen.tolist())):
            episodes, goals, _ = home(answer.scene)
            episode = episodes[answer.key]
            again = asking.ask(info, answer, episode)
            why = tuple(reasons(episode, again))
            drawn.append(DrawnFailure(table, method, info, episode, answer, failure, why, again, goals))
    return Gallery(tuple(counts), tuple(drawn))

"""Compares the ways of PAN trials: with the shortest path, people among themselves, and agents with people.

The measures are those of `sim.walk.ways`; docs/metrics.md has their formulas.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.homes.kind import scene_label
from sim.tasks.run_files import EpisodeRun
from sim.types import EpisodeKey
from sim.walk.ways import Apart, Decisions, apart, apart_from_path, parting_decision

from ..export.text_tables import csv_lines
from .measures import WAYS
from .trials import GroupRow, TrialGroup, row_label

ShortestPaths = Mapping[EpisodeKey, NDArray[np.float64]]
"""Corners (K, 3) of the shortest path from an episode's start to its success region, world metres."""
SHORTEST = "shortest path"
"""What a trial is compared with, in the CSV, where it is no other trial."""
_COLUMNS = (
    "episode",
    "split",
    "scene",
    "condition",
    "who",
    "participant",
    "other",
    "dtw_m",
    "ndtw",
    "end_m",
    "decision",
)
_HEADS = (*_COLUMNS, "scene_kind", "scene_label")


@dataclass(frozen=True, slots=True)
class WayPair:
    """Two trials of one episode."""

    people: TrialGroup
    """The group of the first trial."""
    other_group: TrialGroup
    """The same group, or that of an agent."""
    key: EpisodeKey
    participant: str
    other: str
    """The other person, or the agent."""
    apart: Apart
    decision: int | None
    """The first decision that differs, from 1; None = they did the same throughout."""


class WayRow(GroupRow):
    """How far apart the ways of two trials of one episode are: two people's, or a person's and an agent's.

    Figures are quartiles over the episodes of the mean over an episode's pairs.
    """

    num_episodes: int
    num_pairs: int
    num_same: int
    """Pairs that did the same throughout; they have no decision."""
    dtw_m: tuple[float, float, float]
    """Dynamic time warping, metres per place of the longer way."""
    end_m: tuple[float, float, float]
    """Metres between the ends."""
    decision: tuple[float, float, float] | None
    """The first decision that differs, from 1; None where no pair has one."""


def with_ways(group: TrialGroup, shortest: ShortestPaths) -> TrialGroup:
    """The group with the measures `WAYS` of every trial that has a run and a shortest path."""
    trials = group.trials.copy()
    found = [
        None if path is None or not isinstance(item, EpisodeRun) else apart_from_path(_way(item), path)
        for item, path in zip(trials["item"], map(shortest.get, trials["key"]), strict=True)
    ]
    figures = [(each.dtw_m, each.ndtw, each.end_m) if each else (np.nan,) * 3 for each in found]
    trials[list(WAYS)] = np.array(figures, float).reshape(-1, len(WAYS))
    return replace(group, trials=trials)


def way_pairs(people: TrialGroup, other: TrialGroup) -> list[WayPair]:
    """All pairs of trials of one episode; `other` is an agent's group, or the people's own for pairs of people."""
    first, second = _walked(people), _walked(other)
    is_own = other is people
    return [
        WayPair(
            people,
            other,
            key,
            one.participant,
            another.participant if is_own else row_label(other.who, other.condition),
            apart(one.way, another.way),
            parting_decision(one.decisions, another.decisions),
        )
        for key, runs in sorted(first.items())
        for one, another in (
            itertools.combinations(runs, 2) if is_own else itertools.product(runs, second.get(key, ()))
        )
    ]


def way_rows(pairs: Iterable[WayPair]) -> list[WayRow]:
    """A row for the people of each condition among themselves, and one for each agent beside them."""
    groups: dict[tuple[int, int], list[WayPair]] = defaultdict(list)
    for pair in pairs:
        groups[id(pair.people), id(pair.other_group)].append(pair)
    return [_row(found) for found in groups.values()]


def ways_csv(groups: Sequence[TrialGroup], pairs: Iterable[WayPair]) -> str:
    """One line per trial beside its shortest path, and one per pair of trials; empty cells where there is no figure."""
    lines = [*_path_lines(groups), *_pair_lines(pairs)]
    return csv_lines(_HEADS, sorted(lines, key=lambda line: [str(cell) for cell in line[:7]]))


def _row(pairs: Sequence[WayPair]) -> WayRow:
    people, other = pairs[0].people, pairs[0].other_group
    decided = [(pair.key, float(pair.decision)) for pair in pairs if pair.decision is not None]
    return WayRow(
        **people.people_names,
        who=people.who if other is people else f"{people.who} - {row_label(other.who, other.condition)}",
        num_episodes=len({pair.key for pair in pairs}),
        num_pairs=len(pairs),
        num_same=len(pairs) - len(decided),
        dtw_m=_quartiles([(pair.key, pair.apart.dtw_m) for pair in pairs]),
        end_m=_quartiles([(pair.key, pair.apart.end_m) for pair in pairs]),
        decision=_quartiles(decided) if decided else None,
    )


def _quartiles(values: Iterable[tuple[EpisodeKey, float]]) -> tuple[float, float, float]:
    """Quartiles over the episodes of the mean within each."""
    by_key: dict[EpisodeKey, list[float]] = defaultdict(list)
    for key, value in values:
        by_key[key].append(value)
    lower, median, upper = np.quantile([np.mean(found) for found in by_key.values()], [0.25, 0.5, 0.75])
    return float(lower), float(median), float(upper)


class _Walked(NamedTuple):
    """What a trial walked."""

    participant: str
    way: NDArray[np.float64]
    decisions: Decisions


def _walked(group: TrialGroup) -> dict[EpisodeKey, list[_Walked]]:
    """What was walked at each episode, in the PAN trials that have a run."""
    found: dict[EpisodeKey, list[_Walked]] = defaultdict(list)
    for participant, item in zip(group.trials["participant"], group.trials["item"], strict=True):
        if isinstance(item, EpisodeRun):
            found[item.key].append(_Walked(str(participant), _way(item), item.decisions))
    return found


def _way(run: EpisodeRun) -> NDArray[np.float64]:
    """(T + 1, 3) feet at the start and after each step."""
    return np.array([pose.position for pose in run.poses], float)


def _path_lines(groups: Sequence[TrialGroup]) -> Iterator[tuple[object, ...]]:
    for group in (group for group in groups if group.task == "pan"):
        for trial in group.trials[group.trials["ndtw"].notna()].itertuples():
            told = (trial.episode, trial.split, trial.scene, group.condition, group.who, trial.participant, SHORTEST)
            figures = (trial.dtw, trial.ndtw, trial.end_apart, None)
            yield (*told, *figures, group.scene_kind, scene_label(group.scene_kind))


def _pair_lines(pairs: Iterable[WayPair]) -> Iterator[tuple[object, ...]]:
    for pair in pairs:
        group, figures = pair.people, pair.apart
        told = (str(pair.key), pair.key.split, pair.key.scene, group.condition, group.who, pair.participant, pair.other)
        yield (
            *told,
            figures.dtw_m,
            None,
            figures.end_m,
            pair.decision,
            group.scene_kind,
            scene_label(group.scene_kind),
        )

"""The figures of a comparison of agents: success and its interval by home, and paired differences to the control.

Outcomes of the same episodes -> `GroupFigures` of each kind of homes -> `SearchDocument` (docs/figures/search.json).
"""

import datetime
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from grounding.report.statistics import HomeDraws, Range, mean_of_splits
from sim.errors import RunFileError
from sim.homes.plan import HOMES_VERSION
from sim.tasks.run_files import Measures
from sim.types import EpisodeKey, SceneKind

GEOMETRY = "vlfm-geometry"
"""The control: VLFM's loop, in which a frontier is worth going to because it is near, not for what pictures show."""
_SEED = 0
_MODEL = ConfigDict(frozen=True, extra="forbid")


class Search(NamedTuple):
    """What a row is of."""

    agent: str
    level: str
    """Name of the oracle perception; empty for agents that see nothing."""


class Outcome(NamedTuple):
    """How an episode ended."""

    key: EpisodeKey
    success: bool
    """By rule `paper`."""
    spl: float
    """0 to 1, by rule `paper`."""
    at_view_point: bool | None
    """Success by rule `habitat`; None where the target has no view point that can be reached."""
    num_steps: int

    @classmethod
    def of(cls, key: EpisodeKey, measures: Measures) -> "Outcome":
        """The outcome that the measures of a run say; a target without a place to stop at counts as not found."""
        paper, habitat = measures.rules["paper"], measures.rules["habitat"]
        return cls(
            key,
            success=paper is not None and paper.success,
            spl=0.0 if paper is None else paper.spl,
            at_view_point=None if habitat is None else habitat.success,
            num_steps=measures.num_steps,
        )


class SearchRow(BaseModel):
    """An agent at a level; shares in percent, means of the splits' means, intervals at 95 % by resampled homes."""

    model_config = _MODEL
    agent: str
    level: str
    sr: float
    sr_by_home: Range | None
    spl: float
    spl_by_home: Range | None
    sr_at_view_point: float
    """Of the episodes whose target has a view point that can be reached."""
    num_steps: float
    """Mean."""
    beside_geometry: float | None
    """SR minus the control's on the same episodes with the same perception, percentage points; None for the control and
    for agents that see nothing."""
    beside_geometry_by_home: Range | None
    successes: str
    """One character per episode, in their order: 1 = success."""


class GroupFigures(BaseModel):
    """All rows on the same episodes."""

    model_config = _MODEL
    homes: SceneKind
    num_homes: int
    episodes: tuple[str, ...]
    rows: tuple[SearchRow, ...]


class SearchDocument(BaseModel):
    """docs/figures/search.json."""

    model_config = _MODEL
    created_utc: str
    git_commits: tuple[str, ...]
    """Code of the runs."""
    homes_version: int
    groups: tuple[GroupFigures, ...]


def search_document(groups: Sequence[GroupFigures], *, git_commits: Iterable[str | None]) -> SearchDocument:
    """The document of the groups, made now; a long comparison may hold runs of several commits."""
    return SearchDocument(
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        git_commits=tuple(sorted({commit or "unknown" for commit in git_commits})),
        homes_version=HOMES_VERSION,
        groups=tuple(groups),
    )


def group_figures(homes: SceneKind, found: Mapping[Search, Sequence[Outcome]]) -> GroupFigures:
    """The rows of outcomes; every run holds the same episodes.

    Raises:
        RunFileError: Two runs hold different episodes.
    """
    runs = {name: sorted(outcomes, key=lambda each: str(each.key)) for name, outcomes in found.items()}
    (keys, *others) = dict.fromkeys(tuple(each.key for each in outcomes) for outcomes in runs.values())
    if others:
        raise RunFileError(
            f"runs in {homes} homes: found runs of {len(keys)} and {len(others[0])} episodes; expected the same "
            "episodes in all. Delete the run folders of one of them and run the comparison again."
        )
    draws = HomeDraws([key.scene for key in keys], seed=_SEED)
    return GroupFigures(
        homes=homes,
        num_homes=len({key.scene for key in keys}),
        episodes=tuple(map(str, keys)),
        rows=tuple(_row(name, runs, keys, draws) for name in runs),
    )


def _row(
    name: Search, runs: Mapping[Search, Sequence[Outcome]], keys: Sequence[EpisodeKey], draws: HomeDraws
) -> SearchRow:
    scenes, splits = [key.scene for key in keys], [key.split for key in keys]
    outcomes = runs[name]
    success = _column(outcomes, "success")
    known = [each for each in outcomes if each.at_view_point is not None]
    spl = _column(outcomes, "spl")
    control = runs.get(Search(GEOMETRY, name.level)) if name.agent != GEOMETRY else None
    gain = None if control is None else success - _column(control, "success")
    return SearchRow(
        agent=name.agent,
        level=name.level,
        sr=100 * mean_of_splits(success, splits),
        sr_by_home=draws.interval(success, scenes, splits),
        spl=100 * mean_of_splits(spl, splits),
        spl_by_home=draws.interval(spl, scenes, splits),
        sr_at_view_point=100 * mean_of_splits(_column(known, "at_view_point"), [each.key.split for each in known]),
        num_steps=float(_column(outcomes, "num_steps").mean()),
        beside_geometry=None if gain is None else 100 * mean_of_splits(gain, splits),
        beside_geometry_by_home=None if gain is None else draws.interval(gain, scenes, splits),
        successes="".join(str(int(each.success)) for each in outcomes),
    )


def _column(outcomes: Sequence[Outcome], name: str) -> NDArray[np.float64]:
    return np.array([getattr(each, name) for each in outcomes], np.float64)

"""Computes the paper's POG table of run folders, with curves and paired differences; numbers only, no drawing.

Oracle maps, maps of schematic homes, of invented homes and of scans each have their own tables, and so does each
variant of a map (encoder, noise, storey given or not). The paper's figures stand beside ours with the note that they
were measured on its HM3D maps, which are none of these.
"""

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.episodes.editions import edition_of
from sim.homes.kind import scene_label
from sim.tasks.run_files import Run

from .curves import DistancePoint, KnobCurve, distance_curve, knob_curves
from .rows import MapVariant, MethodTrials, method_trials, ordered_splits
from .sources import PAPER_POG, pog_notes
from .statistics import FEWEST_HOMES, HomeDraws, Range, Shares, mean_of_shares, mean_of_splits, wilson

TOTAL = "total"
"""Plain mean of the splits, as in the paper's column."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class PogCell(Shares):
    """One method in one split, or in total; percent."""

    split: str
    n: int
    """Episodes."""
    k: float
    """Number of successes; a fraction if trials of an episode were averaged."""
    by_episode: Range
    num_homes: int


class PogRow(BaseModel):
    """One method."""

    model_config = _MODEL
    name: str
    who: str
    is_human: bool
    cells: tuple[PogCell, ...]
    """One cell per split, then the total."""
    curve: tuple[DistancePoint, ...]
    num_trials: int
    num_fallbacks: int
    """Trials in which the language model gave nothing that can be used (`Answer.fell_back`)."""
    run_ids: tuple[str, ...]
    seeds: tuple[int, ...]
    commits: tuple[str, ...]
    """Commits of the code that made the runs."""
    paper: tuple[float, float, float, float] | None
    """The paper's figures for a method of this name, on its own maps."""


class PogDifference(BaseModel):
    """Two methods on the episodes that both answered: total, in percentage points."""

    model_config = _MODEL
    first: str
    second: str
    n: int
    first_minus_second: float
    by_home: Range | None
    only_first: float
    """Episodes that only the first got right."""
    only_second: float


class PogTable(BaseModel):
    """One map variant."""

    model_config = _MODEL
    title: str
    scene_kind: str
    scene_label: str
    """The warning that results in homes of this kind must carry; empty for scans and oracle maps."""
    dataset_digest: str
    edition: str
    options: dict[str, str | int | float | bool | None]
    notes: tuple[str, ...]
    """The notes beside the figures in every form (`pog_notes`)."""
    num_homes: int
    rows: tuple[PogRow, ...]
    differences: tuple[PogDifference, ...]

    @property
    def has_home_intervals(self) -> bool:
        """Whether there are enough homes for intervals by home."""
        return self.num_homes >= FEWEST_HOMES


class PogReport(BaseModel):
    """All numbers in a report of POG runs."""

    model_config = _MODEL
    tables: tuple[PogTable, ...]
    curves: tuple[KnobCurve, ...]
    seed: int
    """Seed of the bootstrap."""


def pog_report(runs: Sequence[Run], *, seed: int = 0) -> PogReport:
    """Tables, differences and curves of run folders with POG answers.

    Raises:
        RunFileError: A run holds no answer, an answer was never scored, or two runs hold the same trial.
    """
    rows = method_trials(runs)
    by_variant: dict[MapVariant, list[MethodTrials]] = defaultdict(list)
    for row in rows:
        by_variant[row.variant].append(row)
    tables = [_table(variant, found, seed=seed) for variant, found in with_people(by_variant).items()]
    kinds = ("oracle-map", "schematic", "invented", "scan")
    tables.sort(key=lambda table: (kinds.index(table.scene_kind), table.title))
    return PogReport(tables=tuple(tables), curves=knob_curves(rows, seed=seed), seed=seed)


def with_people(by_variant: dict[MapVariant, list[MethodTrials]]) -> dict[MapVariant, list[MethodTrials]]:
    """Adds people to every table with their kind of homes and episodes; without such a table they get their own."""
    found = {variant: list(rows) for variant, rows in by_variant.items()}
    for people, rows in by_variant.items():
        if people.options:
            continue
        maps = [v for v in found if v.options and people == MapVariant(v.scene_kind, v.dataset_digest)]
        for variant in maps:
            found[variant] += rows
        if maps:
            del found[people]
    return found


def _table(variant: MapVariant, rows: Sequence[MethodTrials], *, seed: int) -> PogTable:
    draws = HomeDraws([home for row in rows for home in row.homes], seed=seed)
    return PogTable(
        title=variant.title,
        scene_kind=variant.scene_kind,
        scene_label=scene_label(variant.scene_kind),
        dataset_digest=variant.dataset_digest,
        edition=edition_of(variant.dataset_digest),
        options=dict(variant.options),
        notes=pog_notes([info for row in rows for info in row.runs]),
        num_homes=len({home for row in rows for home in row.homes}),
        rows=tuple(_row(row, draws) for row in rows),
        differences=tuple(
            difference
            for first, second in combinations(rows, 2)
            if (difference := _difference(second, first, draws)) is not None
        ),
    )


def _row(row: MethodTrials, draws: HomeDraws) -> PogRow:
    cells = [_cell(row, split, draws) for split in ordered_splits(row.splits)]
    return PogRow(
        name=row.name,
        who=row.who,
        is_human=row.is_human,
        cells=(*cells, _total_cell(row, cells, draws)),
        curve=distance_curve(row, draws),
        num_trials=row.num_trials,
        num_fallbacks=row.num_fallbacks,
        run_ids=tuple(info.run_id for info in row.runs),
        seeds=tuple(sorted({info.seed for info in row.runs if info.seed is not None})),
        commits=tuple(sorted({info.git_commit or "unknown" for info in row.runs})),
        paper=PAPER_POG.get("human" if row.is_human else row.who),
    )


def _cell(row: MethodTrials, split: str, draws: HomeDraws) -> PogCell:
    here = np.array([name == split for name in row.splits])
    homes = [home for home, is_here in zip(row.homes, here, strict=True) if is_here]
    n, k = len(homes), float(row.success[here].sum())
    three = None if row.top3 is None else row.top3[here]
    shares = dict(draws.shares(row.success[here], three, homes, [split] * n))
    shares["sr"] = 100 * k / n
    return PogCell(
        split=split,
        n=n,
        k=round(k, 6),
        by_episode=Range(*(100 * value for value in wilson(k, n))),
        num_homes=len(set(homes)),
        **shares,
    )


def _total_cell(row: MethodTrials, cells: Sequence[PogCell], draws: HomeDraws) -> PogCell:
    shares = dict(draws.shares(row.success, row.top3, row.homes, row.splits))
    shares["sr"] = float(np.mean([cell.sr for cell in cells]))
    return PogCell(
        split=TOTAL,
        n=sum(cell.n for cell in cells),
        k=round(sum(cell.k for cell in cells), 6),
        by_episode=mean_of_shares([cell.sr for cell in cells], [cell.by_episode for cell in cells]),
        num_homes=len(set(row.homes)),
        **shares,
    )


def _difference(first: MethodTrials, second: MethodTrials, draws: HomeDraws) -> PogDifference | None:
    """The paired difference of two rows; None if no episode was answered by both."""
    places = {key: index for index, key in enumerate(second.keys)}
    pairs = [(index, places[key]) for index, key in enumerate(first.keys) if key in places]
    if not pairs:
        return None
    ours, theirs = (np.array(side) for side in zip(*pairs, strict=True))
    a, b = first.success[ours], second.success[theirs]
    homes, splits = ([values[index] for index in ours] for values in (first.homes, first.splits))
    return PogDifference(
        first=first.name,
        second=second.name,
        n=len(pairs),
        first_minus_second=100 * mean_of_splits(a - b, splits),
        by_home=draws.interval(a - b, homes, splits),
        only_first=round(float(np.maximum(a - b, 0).sum()), 6),
        only_second=round(float(np.maximum(b - a, 0).sum()), 6),
    )

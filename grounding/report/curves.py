"""The numbers of a POG report's curves: over the allowed distance, and over an option in which runs differ."""

from collections import defaultdict
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from .rows import RADII, MapVariant, MethodTrials
from .statistics import HomeDraws, Range, mean_of_splits, percent

KNOBS = ("object_noise", "view_noise", "cell_noise", "confusion", "paraphrase", "blur")
"""Options over which a curve is drawn if runs differ in only one of them."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class DistancePoint(BaseModel):
    """Share of answers within a distance (metres), total, percent."""

    model_config = _MODEL
    metres: float
    sr: float
    """Success rate of first answers, percent."""
    by_home: Range | None
    top3: float | None
    """Success rate of the nearest of three; None for people and for runs with the first distance only."""
    top3_by_home: Range | None


class KnobPoint(BaseModel):
    """A method at one value of an option, total, percent."""

    model_config = _MODEL
    value: float
    sr: float
    by_home: Range | None
    top3: float | None
    """None for people, who give one point."""
    top3_by_home: Range | None
    n: int
    """Episodes."""
    num_homes: int
    table: str
    """Title of the table with this value."""


class KnobCurve(BaseModel):
    """A method over the values of one option; everything else is the same."""

    model_config = _MODEL
    knob: str
    title: str
    """The map variant without the option."""
    scene_kind: str
    dataset_digest: str
    name: str
    points: tuple[KnobPoint, ...]


def distance_curve(row: MethodTrials, draws: HomeDraws) -> tuple[DistancePoint, ...]:
    """A method's shares within each of RADII."""
    return tuple(_distance_point(row, index, draws) for index in range(len(RADII)))


def knob_curves(rows: Sequence[MethodTrials], *, seed: int) -> tuple[KnobCurve, ...]:
    """A curve for each method and option with at least two values on maps that differ only in this option.

    Args:
        rows: Rows of all maps.
        seed: Seed of the bootstrap; all values of a curve get the same draws of homes.
    """
    curves = []
    for knob in KNOBS:
        groups: dict[tuple[MapVariant, str], dict[float, MethodTrials]] = defaultdict(dict)
        for row in rows:
            if row.variant.options:
                groups[row.variant.without(knob), row.name][float(dict(row.variant.options).get(knob) or 0)] = row
        for (variant, name), values in groups.items():
            if len(values) > 1:
                points = tuple(_knob_point(value, values[value], seed=seed) for value in sorted(values))
                curve = KnobCurve(
                    knob=knob,
                    title=variant.title,
                    scene_kind=variant.scene_kind,
                    dataset_digest=variant.dataset_digest,
                    name=name,
                    points=points,
                )
                curves.append(curve)
    return tuple(curves)


def _distance_point(row: MethodTrials, index: int, draws: HomeDraws) -> DistancePoint:
    within = row.within[:, index]
    within3 = None if row.top3_within is None else row.top3_within[:, index]
    return DistancePoint(
        metres=float(RADII[index]),
        sr=100 * mean_of_splits(within, row.splits),
        by_home=percent(draws.interval(within, row.homes, row.splits)),
        top3=None if within3 is None else 100 * mean_of_splits(within3, row.splits),
        top3_by_home=None if within3 is None else percent(draws.interval(within3, row.homes, row.splits)),
    )


def _knob_point(value: float, row: MethodTrials, *, seed: int) -> KnobPoint:
    draws = HomeDraws(row.homes, seed=seed)
    return KnobPoint(
        value=value,
        sr=100 * mean_of_splits(row.success, row.splits),
        by_home=percent(draws.interval(row.success, row.homes, row.splits)),
        top3=100 * mean_of_splits(row.top3, row.splits) if row.is_ranked else None,
        top3_by_home=percent(draws.interval(row.top3, row.homes, row.splits)) if row.is_ranked else None,
        n=len(row.keys),
        num_homes=len(set(row.homes)),
        table=row.variant.title,
    )

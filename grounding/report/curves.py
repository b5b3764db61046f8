"""The numbers of a POG report's curves: over the allowed distance, and over an option in which runs differ."""

from collections import defaultdict
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from .rows import RADII, MapVariant, MethodTrials
from .statistics import HomeDraws, Shares

KNOBS = ("object_noise", "view_noise", "cell_noise", "confusion", "paraphrase", "blur")
"""Options over which a curve is drawn if runs differ in only one of them."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class DistancePoint(Shares):
    """Share of answers within a distance, total."""

    metres: float


class KnobPoint(Shares):
    """A method at one value of an option, total."""

    value: float
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

    All values of a curve get the same draws of homes.
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
    three = None if row.top3_within is None else row.top3_within[:, index]
    shares = draws.shares(row.within[:, index], three, row.homes, row.splits)
    return DistancePoint(metres=float(RADII[index]), **dict(shares))


def _knob_point(value: float, row: MethodTrials, *, seed: int) -> KnobPoint:
    shares = HomeDraws(row.homes, seed=seed).shares(row.success, row.top3, row.homes, row.splits)
    return KnobPoint(
        value=value, n=len(row.keys), num_homes=len(set(row.homes)), table=row.variant.title, **dict(shares)
    )

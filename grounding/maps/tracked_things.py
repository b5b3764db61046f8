"""The things of a growing object map: points thinned to voxels, sums of features, and the merging of views."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

VOXEL = 0.05
"""Points are thinned to one per cube of this side, metres."""
_AXIS = 1 << 20


@dataclass(frozen=True, slots=True)
class View:
    """One thing in one view."""

    points: NDArray[np.float64]
    """(P, 3) thinned surface points, map frame; P >= 1."""
    feature: NDArray[np.float64]
    """(E,) unit vector, or zero when the encoder gave nothing."""
    quality: float
    """Trust in the feature, in (0, 1]."""
    caption: str = ""
    number: int | None = None
    """Number from a source that recognises things; None = compare points and features."""


@dataclass
class Thing:
    """One thing, merged over views. Mutable, because it grows."""

    points: NDArray[np.float64]
    """(P, 3) thinned."""
    feature_sum: NDArray[np.float64]
    """(E,) sum of quality times unit feature."""
    views: int
    captions: Counter[str] = field(default_factory=Counter)
    numbers: set[int] = field(default_factory=set)
    _tree: KDTree | None = None
    _box: tuple[list[float], list[float]] | None = None

    @property
    def feature(self) -> NDArray[np.float64]:
        """(E,) unit vector; zero when the encoder never gave one."""
        length = np.linalg.norm(self.feature_sum)
        return self.feature_sum / length if length > 0 else self.feature_sum

    @property
    def box(self) -> tuple[list[float], list[float]]:
        """Lowest and highest corner, metres."""
        if self._box is None:
            self._box = self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist()
        return self._box

    def may_touch(self, other: "Thing", *, within: float) -> bool:
        """Whether the two boxes are this near (metres) to each other; cheap, and always True if two points are."""
        (low, high), (other_low, other_high) = self.box, other.box
        return all(
            low[axis] - within <= other_high[axis] and other_low[axis] - within <= high[axis] for axis in range(3)
        )

    def overlap(self, points: NDArray[np.float64], *, within: float) -> float:
        """Share of the points (P, 3) that are within this many metres of one of the thing's points."""
        tree = self._tree = self._tree or KDTree(self.points)
        found, _ = tree.query(points, distance_upper_bound=within)
        return float(np.isfinite(found).sum() / len(points))

    def take(self, other: "Thing") -> None:
        """Adds the points and features of another record of the same thing to this one."""
        self.points = thinned(np.concatenate([self.points, other.points]))
        self.feature_sum = self.feature_sum + other.feature_sum
        self.views += other.views
        self.captions.update(other.captions)
        self.numbers |= other.numbers
        self._tree = self._box = None


@dataclass(frozen=True, slots=True)
class MergeRule:
    """Decides whether two sets of points are one thing."""

    merge_m: float
    """Points this near (metres) to each other overlap."""
    min_share: float
    """Least share of the smaller set that overlaps the other."""
    min_cosine: float
    """Least cosine of the features; ignored where one thing has none."""

    def match(self, thing: Thing, other: Thing) -> float:
        """The overlapping share, or 0 if they are two things."""
        if thing.numbers and other.numbers:
            return 1.0 if thing.numbers & other.numbers else 0.0
        if not thing.may_touch(other, within=self.merge_m):
            return 0.0
        if thing.feature_sum.any() and other.feature_sum.any() and thing.feature @ other.feature < self.min_cosine:
            return 0.0
        small, large = (other, thing) if len(other.points) <= len(thing.points) else (thing, other)
        share = large.overlap(small.points, within=self.merge_m)
        return share if share >= self.min_share else 0.0


def thing_of_view(view: View) -> Thing:
    """A thing that was seen once."""
    captions = Counter([view.caption] if view.caption else [])
    return Thing(view.points, view.quality * view.feature, 1, captions, set() if view.number is None else {view.number})


def add_view(things: list[Thing], view: View, rule: MergeRule) -> None:
    """Adds a view to the thing that it overlaps most, or to the list as a new one."""
    new = thing_of_view(view)
    shares = [rule.match(thing, new) for thing in things]
    best = int(np.argmax(shares)) if shares else -1
    if best >= 0 and shares[best] > 0:
        things[best].take(new)
    else:
        things.append(new)


def merged(things: list[Thing], rule: MergeRule) -> list[Thing]:
    """New things, where things that have grown into each other are merged; the first keeps its place."""
    kept: list[Thing] = []
    for thing in things:
        copy = Thing(thing.points, thing.feature_sum, thing.views, Counter(thing.captions), set(thing.numbers))
        shares = [rule.match(other, copy) for other in kept]
        if shares and max(shares) > 0:
            kept[int(np.argmax(shares))].take(copy)
        else:
            kept.append(copy)
    return kept if len(kept) == len(things) else merged(kept, rule)


def thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean of the points (P, 3) in each cube of VOXEL metres, in an order that depends on the places only."""
    cubes = np.floor(points / VOXEL).astype(np.int64) + _AXIS // 2
    keys = (cubes[:, 0] * _AXIS + cubes[:, 1]) * _AXIS + cubes[:, 2]
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse.reshape(-1), column) for column in points.T]
    return np.column_stack(sums) / counts[:, None]

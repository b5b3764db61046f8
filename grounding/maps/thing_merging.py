"""Merges the masks of many views into things where nobody tells which masks show the same thing.

Masks of a view -> cubes of 5 cm -> compared with the cubes of the known things that the view can show -> things grow
-> things that share cubes are joined -> `Thing`s, without the cubes and things that too few views confirm.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from sim.types import Frame

from ..perception.segments import Segments
from .storeys import points_at
from .tracked_things import EVERY_PIXEL, Thing, cube_keys
from .view_quality import NEAR, distance_weight

_JUMP, _JUMP_SHARE = 0.05, 0.03
"""Depths that differ by more are two surfaces: metres, plus a share of the depth."""
_CLEAN_SHARE = 0.2
"""A mask with a smaller share of pixels away from depth jumps keeps them all: thin things are nothing but borders."""
_LEAST_VISIBLE = 5
"""Fewer visible points of a thing say nothing about the masks in which they are."""
_LEAST_VOTES = 0.4
"""A cube is part of a thing if it was in the thing's mask in this share of the views that found the thing and show the
cube."""
_LEAST_FOUND = 0.25
"""A thing stays if it was found in this share of the views that can show it, plus one view."""
_OFTEN = 5
"""Where the median mask shows a thing that this many views found, a thing that only one view found is an error."""
_LOST = 0.5
"""A thing that shares this part of its cubes with one thing whose claim is stronger is a piece of it."""
_TIDY_EVERY = 50
"""After this many views, things that the views do not confirm are dropped, so that long recordings stay fast."""
_PART = 0.1
"""Parts of a thing that are farther apart than one empty cube of this side (metres) are separate."""


@dataclass(frozen=True, slots=True)
class MergeRule:
    """Decides whether two sets of points are one thing.

    What fully covers each other is one thing whatever the features say, as those of a view can be wrong. A set that
    lies wholly in a much larger one may be its piece or a cup on a table: then the features must agree.
    """

    merge_m: float
    """Points this near (metres) to each other overlap."""
    min_share: float
    """Least share of the smaller set that overlaps the other."""
    min_cosine: float
    """Least cosine of the features of a set and a much larger one around it; also assumed for things without one."""

    def scores(
        self, share: NDArray[np.float64], other_share: NDArray[np.float64], cosine: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How well two sets fit; -inf if they are two things. Takes arrays of any one shape.

        Args:
            share: Share of the first set that overlaps the second.
            other_share: Share of the second set that overlaps the first.
            cosine: Of their features; nan if one has none.
        """
        total = share + other_share + np.where(np.isnan(cosine), self.min_cosine, cosine)
        is_one = (np.maximum(share, other_share) >= self.min_share) & (total >= 1 + self.min_cosine)
        return np.where(is_one, total, -np.inf)


class UnknownThings:
    """Things of a source that cuts each view on its own."""

    def __init__(self, rule: MergeRule, *, max_depth: float) -> None:
        """Starts without things; farther returns do not count, planar metres."""
        self._rule, self._max_depth = rule, max_depth
        self._things: list[_Growing] = []
        self._num_views = 0

    def add(self, frame: Frame, found: Segments, features: NDArray[np.float64]) -> None:
        """Adds each mask to the thing that it fits best, or as a new thing; features (M, E) are unit vectors or zero.

        A view without masks counts too: it does not confirm the things that it can show.
        """
        view = _View.of(frame, found.masks, self._max_depth)
        things = self._things
        sight = _sight(things, frame, view)
        scores = self._rule.scores(*_shares(sight, view), _cosines([thing.feature for thing in things], features))
        masks_of: dict[int, list[int]] = {}
        for index in np.flatnonzero([len(cubes.keys) > 0 for cubes in view.cubes]).tolist():
            best = int(scores[:, index].argmax()) if things else 0
            is_known = bool(things) and scores[best, index] > -np.inf
            masks_of.setdefault(best if is_known else -1 - index, []).append(index)
        for thing, share in zip(things, sight.shares.tolist(), strict=True):
            thing.visible += share
        for best, indices in masks_of.items():
            thing = things[best] if best >= 0 else _Growing(np.zeros(features.shape[1]), visible=1.0)
            thing.take(view, indices, sight.keys[sight.owners == best], features, found.captions)
            if best < 0:
                things.append(thing)
        self._num_views += 1
        if self._num_views % _TIDY_EVERY == 0:
            self._things = [thing for thing in things if thing.is_confirmed]

    def things(self) -> list[Thing]:
        """The things that enough views confirm."""
        views = np.array([thing.views for thing in self._things], np.int64)
        least = 2 if len(views) and np.median(np.repeat(views, views)) >= _OFTEN else 1
        kept = [thing for thing in self._things if thing.is_confirmed and thing.views >= least]
        kept = _joined([thing.with_cubes(thing.cubes.voted()) for thing in kept], self._rule)
        owners = _owners(kept)
        things = []
        for index, thing in enumerate(kept):
            points = _largest_part(thing.cubes.points[owners[index] == index])
            things.append(Thing(points, thing.feature_sum, thing.views, thing.captions))
        return things


@dataclass(frozen=True, slots=True)
class _Cubes:
    """Cubes of VOXEL metres with sums over views."""

    keys: NDArray[np.int64]
    """(P,) ascending `cube_keys`."""
    sums: NDArray[np.float64]
    """(P, 6) sum of x, y, z of the pixels in a cube and their number; number of views whose mask of the thing holds the
    cube, and number of views that show both the cube and the thing."""

    @classmethod
    def of(cls, parts: "Iterable[_Cubes]") -> "_Cubes":
        """All cubes of some parts."""
        parts = list(parts)
        keys = np.concatenate([part.keys for part in parts])
        order = np.argsort(keys, kind="stable")
        keys, firsts = np.unique(keys[order], return_index=True)
        sums = np.concatenate([part.sums for part in parts])[order]
        return cls(keys, np.add.reduceat(sums, firsts, axis=0) if len(keys) else sums)

    @classmethod
    def of_pixels(cls, keys: NDArray[np.int64], points: NDArray[np.float64]) -> "_Cubes":
        """The cubes of one mask, from the key and the point (N, 3) of each pixel."""
        found, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
        sums = np.ones((len(found), 6))
        for axis in range(3):
            sums[:, axis] = np.bincount(inverse.reshape(-1), points[:, axis], len(found))
        sums[:, 3] = counts
        return cls(found, sums)

    @property
    def points(self) -> NDArray[np.float64]:
        """(P, 3) mean of the pixels in each cube."""
        return self.sums[:, :3] / self.sums[:, 3:4]

    def voted(self) -> "_Cubes":
        """The cubes that the views confirm."""
        is_part = self.sums[:, 4] >= _LEAST_VOTES * self.sums[:, 5]
        return _Cubes(self.keys[is_part], self.sums[is_part])


_NOTHING = _Cubes(np.empty(0, np.int64), np.empty((0, 6)))


@dataclass
class _Growing:
    """A thing while views are added."""

    feature_sum: NDArray[np.float64]
    """(E,) sum of quality times unit feature."""
    visible: float
    """Sum over views of the share of its points that nothing hides."""
    cubes: _Cubes = _NOTHING
    views: int = 0
    """Number of views in which it was found."""
    captions: Counter[str] = field(default_factory=Counter)

    @property
    def is_confirmed(self) -> bool:
        """Whether enough of the views that can show it found it."""
        return self.views >= _LEAST_FOUND * (self.visible + 1)

    @property
    def feature(self) -> NDArray[np.float64]:
        """(E,) unit vector, or zero."""
        return self.feature_sum / (np.linalg.norm(self.feature_sum) or 1.0)

    def take(
        self,
        view: "_View",
        indices: Sequence[int],
        visible_keys: NDArray[np.int64],
        features: NDArray[np.float64],
        captions: Sequence[str],
    ) -> None:
        """Adds the masks of one view with these indices; cubes that the view shows outside of them lose a vote."""
        found = _Cubes.of(view.cubes[index] for index in indices)
        found.sums[:, 4:] = 1
        outside = np.setdiff1d(visible_keys, found.keys)
        missed = np.zeros((len(outside), 6))
        missed[:, 5] = 1
        self.cubes = _Cubes.of([self.cubes, found, _Cubes(outside, missed)])
        self.feature_sum = self.feature_sum + distance_weight(view.depths[indices]) @ features[indices]
        self.views += 1
        self.captions.update(captions[index] for index in indices if captions and captions[index])

    def with_cubes(self, cubes: _Cubes) -> "_Growing":
        """The same thing with other cubes."""
        return _Growing(self.feature_sum, self.visible, cubes, self.views, self.captions)

    @classmethod
    def of(cls, pieces: "Sequence[_Growing]") -> "_Growing":
        """One thing of which these are pieces."""
        return cls(
            np.sum([piece.feature_sum for piece in pieces], axis=0),
            max(piece.visible for piece in pieces),
            _Cubes.of(piece.cubes for piece in pieces),
            sum(piece.views for piece in pieces),
            sum((piece.captions for piece in pieces), Counter()),
        )


class _View(NamedTuple):
    """The masks of one view, at every 2nd pixel."""

    masks: NDArray[np.bool_]
    """(M, h, w)."""
    depth: NDArray[np.float32]
    """(h, w) metres; nan where there is none or it does not count."""
    cubes: tuple[_Cubes, ...]
    """Cubes of each mask, away from depth jumps."""
    depths: NDArray[np.float64]
    """(M,) median depth of each mask, metres; inf for a mask without depth."""

    @classmethod
    def of(cls, frame: Frame, masks: NDArray[np.bool_], max_depth: float) -> "_View":
        """The view's masks and their cubes."""
        depth = frame.depth_m[::EVERY_PIXEL, ::EVERY_PIXEL]
        is_valid = (depth >= NEAR) & (depth <= max_depth)
        coarse, depth = masks[:, ::EVERY_PIXEL, ::EVERY_PIXEL], np.where(is_valid, depth, np.float32(np.nan))
        is_clean = is_valid & ~_jumps(depth)
        points, keys = np.zeros((*depth.shape, 3)), np.zeros(depth.shape, np.int64)
        is_needed = is_valid & coarse.any(axis=0)
        points[is_needed] = points_at(frame, np.argwhere(is_needed) * EVERY_PIXEL)
        keys[is_needed] = cube_keys(points[is_needed])
        cubes, depths = [], np.full(len(masks), np.inf)
        for index, mask in enumerate(coarse):
            used, whole = mask & is_clean, mask & is_valid
            if used.sum() < _CLEAN_SHARE * whole.sum():
                used = whole
            cubes.append(_Cubes.of_pixels(keys[used], points[used]))
            if used.any():
                depths[index] = np.median(depth[used])
        return cls(coarse, depth, tuple(cubes), depths)


class _Sight(NamedTuple):
    """The points of the known things that one view shows."""

    owners: NDArray[np.int64]
    """(P,) ascending index of the thing of each point."""
    keys: NDArray[np.int64]
    """(P,) cube of each point."""
    is_part: NDArray[np.bool_]
    """(P,) whether the views so far confirm the cube."""
    vu: tuple[NDArray[np.int64], NDArray[np.int64]]
    """Rows (P,) and columns (P,) in the view's masks."""
    shares: NDArray[np.float64]
    """(T,) share of each thing's points that lie in the picture and are not hidden; seen or looked through."""

    @property
    def num_things(self) -> int:
        """T."""
        return len(self.shares)


def _sight(things: Sequence[_Growing], frame: Frame, view: _View) -> _Sight:
    """Projects all things into a view; a point is seen where the depth is its own."""
    cubes = [thing.cubes for thing in things]
    sizes = np.array([len(part.keys) for part in cubes], np.int64)
    sums = np.concatenate([part.sums for part in (*cubes, _NOTHING)])
    points = sums[:, :3] / sums[:, 3:4]
    points_camera = (points - frame.T_world_camera[:3, 3]) @ frame.T_world_camera[:3, :3]
    index = np.flatnonzero(points_camera[:, 2] >= NEAR)
    x, y, z = points_camera[index].T
    fx, fy, cx, cy = frame.camera.lens
    v = np.floor((y / z * fy + cy) / EVERY_PIXEL).astype(np.int64)
    u = np.floor((x / z * fx + cx) / EVERY_PIXEL).astype(np.int64)
    is_inside = (u >= 0) & (u < view.depth.shape[1]) & (v >= 0) & (v < view.depth.shape[0])
    index, z, v, u = index[is_inside], z[is_inside], v[is_inside], u[is_inside]
    behind = view.depth[v, u] - z  # nan compares as False
    near = _JUMP + _JUMP_SHARE * z
    owners = np.repeat(np.arange(len(things)), sizes)
    is_part = sums[:, 4] >= _LEAST_VOTES * sums[:, 5]
    unhidden = np.bincount(owners[index], is_part[index] & (behind >= -near), len(things))
    shares = unhidden / np.maximum(np.bincount(owners, is_part, len(things)), 1)
    is_seen = np.abs(behind) <= near
    index = index[is_seen]
    keys = np.concatenate([part.keys for part in (*cubes, _NOTHING)])[index]
    return _Sight(owners[index], keys, is_part[index], (v[is_seen], u[is_seen]), shares)


def _shares(sight: _Sight, view: _View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(T, M) share of each thing's visible points in each mask, and of each mask's cubes that each thing holds."""
    num_points = len(sight.owners)
    if not num_points or not len(view.masks):
        nothing = np.zeros((sight.num_things, len(view.masks)))
        return nothing, nothing
    parts, points = sight.is_part.astype(float), np.arange(num_points)
    by_thing = csr_array((parts, (sight.owners, points)), (sight.num_things, num_points))
    visible = np.bincount(sight.owners, parts, sight.num_things)[:, None]
    inside = by_thing @ view.masks[:, *sight.vu].T.astype(float)
    end = np.array([np.iinfo(np.int64).max])
    keys = np.unique(np.concatenate([*(cubes.keys for cubes in view.cubes), end]))
    holds = np.zeros((len(keys), len(view.masks)))  # the last row is for points in no mask's cube
    for index, cubes in enumerate(view.cubes):
        holds[np.searchsorted(keys, cubes.keys), index] = 1 / max(1, len(cubes.keys))
    place: NDArray[np.int64] = np.searchsorted(keys, sight.keys)
    held = by_thing @ holds[np.where(keys[place] == sight.keys, place, -1)]
    return np.where(visible >= _LEAST_VISIBLE, inside / np.maximum(visible, 1), 0), held


def _cosines(features: Sequence[NDArray[np.float64]], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) between N and M unit vectors; nan where one is zero."""
    rows = np.array(features).reshape(-1, others.shape[1])
    is_known = np.outer(np.linalg.norm(rows, axis=1), np.linalg.norm(others, axis=1)) > 0
    return np.where(is_known, rows @ others.T, np.nan)


def _joined(things: Sequence[_Growing], rule: MergeRule) -> list[_Growing]:
    """Things, of which those that share their cubes are one; the first keeps its place."""
    if len(things) < 2:
        return list(things)
    root = np.arange(len(things))
    for first, second in (*_pieces(things), *_touching(things, rule)):
        low, high = sorted((root[first], root[second]))
        root[root == high] = low
    groups = [np.flatnonzero(root == index).tolist() for index in np.unique(root)]
    if len(groups) == len(things):
        return list(things)
    return _joined([_Growing.of([things[index] for index in group]) for group in groups], rule)


def _pieces(things: Sequence[_Growing]) -> Iterator[tuple[int, int]]:
    """Yields things and the things of which they are pieces, whatever their features say."""
    for index, owners in enumerate(_owners(things)):
        lost = np.bincount(owners, minlength=len(things))
        lost[index] = 0
        if len(owners) and lost.max() >= _LOST * len(owners):
            yield index, int(lost.argmax())


def _touching(things: Sequence[_Growing], rule: MergeRule) -> Iterator[tuple[int, int]]:
    """Yields pairs of things that are one by the rule."""
    points = [thing.cubes.points for thing in things]
    low = np.array([these.min(axis=0, initial=np.inf) for these in points])
    high = np.array([these.max(axis=0, initial=-np.inf) for these in points])
    trees = [KDTree(these) for these in points]
    cosines = _cosines([thing.feature for thing in things], np.array([thing.feature for thing in things]))
    is_near = (low[:, None] <= high + rule.merge_m).all(axis=2)
    for first, second in np.argwhere(np.triu(is_near & is_near.T, 1)).tolist():
        share, other_share = (
            np.isfinite(trees[one].query(points[other], distance_upper_bound=rule.merge_m)[0]).mean()
            for one, other in ((second, first), (first, second))
        )
        if rule.scores(share, other_share, cosines[first, second]) > -np.inf:
            yield first, second


def _owners(things: Sequence[_Growing]) -> list[NDArray[np.int64]]:
    """For each cube of each thing, the thing with the strongest claim to it: most views, then size, then the first."""
    sizes = np.array([len(thing.cubes.keys) for thing in things], np.int64)
    owners = np.repeat(np.arange(len(things)), sizes)
    keys = np.concatenate([_NOTHING.keys, *(thing.cubes.keys for thing in things)])
    votes = np.concatenate([_NOTHING.sums[:, 4], *(thing.cubes.sums[:, 4] for thing in things)])
    order = np.lexsort((owners, -sizes[owners], -votes, keys))
    _, firsts, inverse = np.unique(keys[order], return_index=True, return_inverse=True)
    strongest = np.empty(len(keys), np.int64)
    strongest[order] = owners[order][firsts][inverse.reshape(-1)]
    return np.split(strongest, np.cumsum(sizes))[: len(things)]


def _largest_part(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points (P, 3) of the largest part, without specks beside it."""
    if not len(points):
        return points
    cells = np.floor(points / _PART).astype(np.int64)
    cells -= cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) + 1, bool)
    grid[tuple(cells.T)] = True
    labels: NDArray[np.int32] = ndimage.label(grid, np.ones((3, 3, 3)))[0]  # type: ignore[index]  # scipy's stubs
    part = labels[tuple(cells.T)]
    return points[part == np.bincount(part).argmax()]


def _jumps(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(h, w) at depth jumps; nan = no depth. Over any plane, however slanted, 1 / depth changes evenly."""
    inverse, least = 1 / depth, (_JUMP + _JUMP_SHARE * depth) / depth**2
    jumps = np.zeros(depth.shape, bool)
    jumps[1:-1] |= np.abs(inverse[:-2] - 2 * inverse[1:-1] + inverse[2:]) > least[1:-1]
    jumps[:, 1:-1] |= np.abs(inverse[:, :-2] - 2 * inverse[:, 1:-1] + inverse[:, 2:]) > least[:, 1:-1]
    return jumps

"""Measures object maps of simulated walks: how many things each real object becomes, and how many objects are found.

Nobody tells the map builder which masks show the same object. The oracle's masks and features have stated faults;
`depth` takes the masks of `DepthRegions`, which needs no model, and the features without faults.
"""

import time
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy import ndimage
from scipy.spatial import KDTree

from grounding.encoders.hashed import HashedWords
from grounding.maps.home_map import HomeMemory, ObjectMap
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.occupancy import MAX_DEPTH
from grounding.maps.storeys import ViewOptions, points_at
from grounding.perception.oracle_perception import OraclePerception, PerceptionOptions
from grounding.perception.segment_depth import DepthRegions
from grounding.perception.segments import InstanceIds, Segments, ViewSegmenter
from sim.mesh import SceneObject
from sim.types import Frame

from ..harness import Progress, Values
from .walks import handheld_walk

_SEEN_PIXELS, _SEEN_VIEWS = 100, 2
"""An object counts as seen if it has at least 100 pixels with depth in each of at least two views."""
_LARGE = 0.2
"""Least longest side (metres) of the objects in `found_share`."""
_CUBE = 0.05
"""Seen surfaces are one point per cube of this side, metres."""
_CUBES, _MOST_IDS = 1 << 14, 1 << 16
"""Cubes along each axis, and ids: bounds of the numbers that stand for both."""
_ON, _FAR = 0.5, 0.15
"""A thing shows the object on which this share of its points lie; points farther than this (metres) from every seen
surface lie on none."""
_COVERED, _REACH = 0.3, 0.075
"""An object is found by a thing that shows it, if this share of its seen points are this near (metres) to the thing."""
_GHOST_RADIUS = (8, 30)
"""Pixels."""
_SMOOTH = 8.0
"""Wrong borders are wavy with about this wavelength, pixels."""


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of masks and features; those of the features come back in each view anew."""

    missed: float = 0.0
    """Probability that a mask is missing."""
    split: float = 0.0
    """Probability that a mask is cut into two through its middle."""
    joined: float = 0.0
    """Probability that a mask also covers a neighbour, which then has no mask of its own."""
    border: float = 0.0
    """Standard deviation of the borders' places, pixels."""
    ghosts: float = 0.0
    """Mean number of masks per view, 16 to 60 pixels wide, that cover any part of the picture."""
    swapped: float = 0.0
    """Probability that an object looks like another object of the home in a view."""
    view_noise: float = 0.0
    """Error of the vectors of patches, as in `PerceptionOptions`."""


FAULTS = {
    "mild": Faults(missed=0.1, split=0.05, joined=0.05, border=1.0, ghosts=0.2, swapped=0.02, view_noise=0.015),
    "strong": Faults(missed=0.3, split=0.15, joined=0.15, border=2.0, ghosts=1.0, swapped=0.1, view_noise=0.03),
}
"""Fault levels; the noise makes the cosine of two views of a patch 0.85 and 0.59 on average."""


class ThingsSettings(BaseModel):
    """Which walks are mapped."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    seeds: tuple[int, ...] = tuple(range(40))
    """One walk each."""
    frames: int = 300
    """Pictures of each walk."""


@dataclass(frozen=True, slots=True)
class Score:
    """Counts for one map of one walk."""

    things: int
    """Things in the map."""
    seen: int
    """Objects that the walk saw."""
    large: int
    """Seen objects over 0.2 m."""
    found: int
    """Large objects that were found."""
    seconds: float = 0.0
    """Time of the map builder without its encoder and segmenter."""
    views: int = 0
    """Number of views of the walk."""


def measure_things(settings: ThingsSettings, progress: Progress) -> Values:
    """Maps each walk with masks of each fault level, and with `DepthRegions`.

    Returns:
        For `mild`, `strong` and `depth`, over all walks together: `things_per_object`, all things of the maps
        (fragments, ghosts and walls too) over all seen objects; `found_share` of the seen objects over 0.2 m;
        `ms_per_view` of the map builder, without encoder and segmenter.
    """
    scores: dict[str, list[Score]] = {}
    for seed in settings.seeds:
        progress(f"things of walk {seed}")
        walk = handheld_walk(seed, num_frames=settings.frames)
        found = things_of_walk(
            walk.frames(with_ids=True), walk.scene.objects, walk.scene.navigation.storey_heights, seed=seed
        )
        for name, score in found.items():
            scores.setdefault(name, []).append(score)
    return {name: _pooled(found) for name, found in scores.items()}


def things_of_walk(
    frames: Iterable[Frame], objects: Sequence[SceneObject], floors: Sequence[float], *, seed: int
) -> dict[str, Score]:
    """The score of a map of the frames for each fault level and for `depth`.

    Args:
        frames: Views with the simulator's ids.
        objects: The home's objects.
        floors: Heights of the home's floors, metres.
        seed: Of the faults.
    """
    builders = _builders(objects, floors, seed)
    truth = SeenObjects(objects)
    for frame in frames:
        truth.add(frame)
        for builder in builders.values():
            builder.add(frame)
    surfaces = truth.surfaces()
    return {
        name: replace(surfaces.score(builder.finish()), seconds=builder.seconds, views=truth.views)
        for name, builder in builders.items()
    }


class FaultyMasks:
    """A `ViewSegmenter` that cuts the simulator's ids into masks with faults, without saying which ids they are."""

    name = "oracle-perception masks with faults"

    def __init__(self, faults: Faults, *, seed: int) -> None:
        """Draws depend on the seed and the pose of the view."""
        self._faults, self._seed = faults, seed

    def segment(self, frame: Frame) -> Segments:
        """The masks of one view in a random order."""
        rng = _rng_of_view(frame, self._seed, 0)
        wavy = replace(frame, ids=_displaced(frame.instance_ids, self._faults.border, rng))
        masks = list(InstanceIds().segment(wavy).masks)
        masks = _joined(masks, self._faults.joined, rng)
        masks = [part for mask in masks for part in _split(mask, self._faults.split, rng)]
        masks = [mask for mask in masks if rng.random() >= self._faults.missed]
        masks += [_disc(frame.instance_ids.shape, rng) for _ in range(rng.poisson(self._faults.ghosts))]
        return Segments(np.array(masks, bool).reshape(-1, *frame.instance_ids.shape)[rng.permutation(len(masks))])


class FaultyFeatures:
    """Encodes views with ids: hashed words of each object's category, with faults."""

    def __init__(self, objects: Sequence[SceneObject], faults: Faults, *, seed: int) -> None:
        """Draws depend on the seed and the pose of the view; places without an object show clutter."""
        options = PerceptionOptions(view_noise=faults.view_noise, background="clutter", seed=seed)
        self._oracle = OraclePerception(
            HashedWords(), {thing.instance_id: thing.category for thing in objects}, options=options
        )
        self._ids = np.array([thing.instance_id for thing in objects], np.int32)
        self._swapped, self._seed = faults.swapped, seed
        self.name, self.dim = self._oracle.name, self._oracle.dim

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit rows."""
        return self._oracle.encode_patches([self._mistaken(frame) for frame in frames])

    def _mistaken(self, frame: Frame) -> Frame:
        rng = _rng_of_view(frame, self._seed, 1)
        looks = np.arange(int(self._ids.max()) + 1, dtype=np.int32)
        is_swapped = rng.random(len(self._ids)) < self._swapped
        looks[self._ids[is_swapped]] = rng.choice(self._ids, int(is_swapped.sum()))
        return replace(frame, ids=looks[frame.instance_ids])


class SeenObjects:
    """Collects the surfaces that the views of a walk show, with the object of each."""

    def __init__(self, objects: Sequence[SceneObject]) -> None:
        """Starts without views."""
        self.views = 0
        """Number of views so far."""
        self._large = {thing.instance_id for thing in objects if max(thing.size) >= _LARGE}
        self._num_views = np.zeros(max(thing.instance_id for thing in objects) + 1, np.int64)
        self._cubes = np.empty(0, np.int64)

    def add(self, frame: Frame) -> None:
        """Adds what one view shows."""
        self.views += 1
        ids = frame.instance_ids
        is_valid = (frame.depth_m > 0) & (frame.depth_m <= MAX_DEPTH)
        counts = np.bincount(ids[is_valid], minlength=len(self._num_views))
        self._num_views += counts >= _SEEN_PIXELS
        is_inner = ndimage.minimum_filter(ids, 3) == ndimage.maximum_filter(ids, 3)  # depth of edges is mixed
        rc = np.argwhere((is_valid & is_inner)[::2, ::2]) * 2
        cubes = np.floor(points_at(frame, rc) / _CUBE).astype(np.int64) + _CUBES // 2
        keys = np.ravel_multi_index((ids[rc[:, 0], rc[:, 1]], *cubes.T), (_MOST_IDS, _CUBES, _CUBES, _CUBES))
        self._cubes = np.union1d(self._cubes, keys)

    def surfaces(self) -> "Surfaces":
        """The truth of the whole walk."""
        ids, *cubes = np.unravel_index(self._cubes, (_MOST_IDS, _CUBES, _CUBES, _CUBES))
        points = (np.column_stack(cubes).astype(np.float64) - _CUBES // 2 + 0.5) * _CUBE
        seen = np.flatnonzero((self._num_views >= _SEEN_VIEWS) & (np.bincount(ids, minlength=len(self._num_views)) > 0))
        seen = [number for number in seen.tolist() if number]
        return Surfaces(points, ids, tuple(seen), tuple(number for number in seen if number in self._large))


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The seen surfaces of a walk's home."""

    points: NDArray[np.float64]
    """(P, 3) world metres."""
    ids: NDArray[np.int64]
    """(P,) object of each point, 0 = wall, floor, ceiling or stairs."""
    seen: tuple[int, ...]
    """Objects that count as seen."""
    large: tuple[int, ...]
    """Those of them over 0.2 m."""

    def score(self, memory: HomeMemory) -> Score:
        """Compares a map with the truth."""
        tree = KDTree(self.points)
        things = []
        for storey in memory.storeys:
            assert isinstance(storey.memory, ObjectMap)
            things += [item.points.astype(np.float64) for item in storey.memory.objects]
        found = set()
        for points in things:
            distances, nearest = map(np.asarray, tree.query(points, distance_upper_bound=_FAR))
            counts = np.bincount(self.ids[nearest[np.isfinite(distances)]], minlength=1)
            best = int(counts.argmax())
            if best in self.large and counts[best] >= _ON * len(points) and self._covered(best, points) >= _COVERED:
                found.add(best)
        return Score(len(things), len(self.seen), len(self.large), len(found))

    def _covered(self, number: int, points: NDArray[np.float64]) -> float:
        distances, _ = KDTree(points).query(self.points[self.ids == number], distance_upper_bound=_REACH)
        return float(np.isfinite(distances).mean())


class _Timed:
    """A map builder whose time is measured without that of its encoder and segmenter."""

    def __init__(self, encoder: FaultyFeatures, segmenter: ViewSegmenter, floors: Sequence[float]) -> None:
        self.name, self.dim = encoder.name, encoder.dim
        self.seconds = 0.0
        self._encoder, self._segmenter = encoder, segmenter
        self._builder = ObjectMapBuilder(self, self, views=ViewOptions(floors=floors))  # type: ignore[arg-type]

    def add(self, frame: Frame) -> None:
        began = time.perf_counter()
        self._builder.add(frame)
        self.seconds += time.perf_counter() - began

    def finish(self) -> HomeMemory:
        began = time.perf_counter()
        memory = self._builder.finish()
        self.seconds += time.perf_counter() - began
        return memory

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        began = time.perf_counter()
        patches = self._encoder.encode_patches(frames)
        self.seconds -= time.perf_counter() - began
        return patches

    def segment(self, frame: Frame) -> Segments:
        began = time.perf_counter()
        segments = self._segmenter.segment(frame)
        self.seconds -= time.perf_counter() - began
        return segments


def _builders(objects: Sequence[SceneObject], floors: Sequence[float], seed: int) -> dict[str, _Timed]:
    builders = {
        name: _Timed(FaultyFeatures(objects, faults, seed=seed), FaultyMasks(faults, seed=seed), floors)
        for name, faults in FAULTS.items()
    }
    exact = FaultyFeatures(objects, Faults(), seed=seed)
    return builders | {"depth": _Timed(exact, DepthRegions(floors=floors), floors)}


def _pooled(scores: Sequence[Score]) -> Values:
    seen, large = sum(score.seen for score in scores), sum(score.large for score in scores)
    return {
        "things_per_object": sum(score.things for score in scores) / seen if seen else None,
        "found_share": sum(score.found for score in scores) / large if large else None,
        "ms_per_view": 1000 * sum(score.seconds for score in scores) / max(1, sum(score.views for score in scores)),
    }


def _rng_of_view(frame: Frame, seed: int, stream: int) -> np.random.Generator:
    pose = np.ascontiguousarray(frame.T_world_camera, np.float64).tobytes()
    return np.random.default_rng([seed, stream, zlib.crc32(pose)])


def _displaced(ids: NDArray[np.int32], spread: float, rng: np.random.Generator) -> NDArray[np.int32]:
    """Ids (H, W) whose borders are moved by smooth random steps with this standard deviation, pixels."""
    if not spread:
        return ids
    steps = ndimage.gaussian_filter(rng.normal(size=(2, *ids.shape)), (0, _SMOOTH / 2, _SMOOTH / 2))
    rows, cols = np.indices(ids.shape) + np.round(steps * spread / steps.std()).astype(np.int64)
    return ids[rows.clip(0, ids.shape[0] - 1), cols.clip(0, ids.shape[1] - 1)]


def _joined(masks: list[NDArray[np.bool_]], share: float, rng: np.random.Generator) -> list[NDArray[np.bool_]]:
    """The masks, some of which are one with a mask that touches them."""
    left = list(masks)
    for mask in masks:
        if rng.random() >= share or not any(mask is other for other in left):
            continue
        around = ndimage.binary_dilation(mask, iterations=2)
        near = [other for other in left if other is not mask and np.logical_and(around, other).any()]
        if near:
            other = near[int(rng.integers(len(near)))]
            left = [one for one in left if one is not mask and one is not other] + [mask | other]
    return left


def _split(mask: NDArray[np.bool_], share: float, rng: np.random.Generator) -> list[NDArray[np.bool_]]:
    """The mask, or its two parts on both sides of a line through its middle."""
    angle = rng.uniform(0, np.pi)
    if rng.random() >= share:
        return [mask]
    rows, cols = np.nonzero(mask)
    side = np.zeros_like(mask)
    side[rows, cols] = (rows - rows.mean()) * np.sin(angle) + (cols - cols.mean()) * np.cos(angle) > 0
    return [side, mask & ~side]


def _disc(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_]:
    row, col, radius = rng.uniform(0, shape[0]), rng.uniform(0, shape[1]), rng.uniform(*_GHOST_RADIUS)
    rows, cols = np.indices(shape)
    return (rows - row) ** 2 + (cols - col) ** 2 <= radius**2

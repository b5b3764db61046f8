"""Object maps from posed pictures: masks become points with a feature, and views of one thing become one instance."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.types import Camera, Frame

from ..encoders.protocol import DenseEncoder
from ..perception.segments import Segments, ViewSegmenter
from .grid_map import encoded_patches
from .home_map import HomeMemory, ObjectInstance, ObjectMap
from .storeys import Storeys, ViewOptions
from .thing_merging import MergeRule, UnknownThings
from .tracked_things import KnownThings, Thing
from .view_quality import patch_pixels

MERGE_RULE = MergeRule(merge_m=0.05, min_share=0.3, min_cosine=0.7)
"""When masks of several views show one thing."""
_LEAST_POINTS = 5
"""Things with fewer points, one per 5 cm cube, are left out."""
_LEAST_IN_PATCH = 0.25
"""A patch counts for a mask that covers at least this share of it; the mask's best patch always counts."""


class ObjectMapBuilder:
    """Builds the occupancy and the list of things of each storey."""

    def __init__(
        self,
        encoder: DenseEncoder,
        segmenter: ViewSegmenter,
        *,
        views: ViewOptions = ViewOptions(),  # noqa: B008 - frozen value
    ) -> None:
        """Starts an empty map; with `InstanceIds` as segmenter the simulator's own ids separate the things."""
        self.name = f"objects of {segmenter.name}"
        """Map files keep this name; it contains "oracle-perception" where the masks are ground truth."""
        self._encoder, self._segmenter = encoder, segmenter
        self._views = views
        self.reset()

    def reset(self) -> None:
        """Forgets all views."""
        self._storeys = Storeys(self._views)
        self._known = KnownThings(max_depth=self._views.max_depth)
        self._unknown = UnknownThings(MERGE_RULE, max_depth=self._views.max_depth)

    def add(self, frame: Frame) -> None:
        """Adds a view; some wait until a batch is full or until the robot is off the stairs."""
        self._place(self._storeys.take(frame))

    def finish(self) -> HomeMemory:
        """The map of all views since `reset`; things without any feature are left out."""
        self._place(self._storeys.rest())
        things = [
            thing
            for thing in (*self._known.things(), *self._unknown.things())
            if len(thing.points) >= _LEAST_POINTS and thing.feature_sum.any()
        ]
        heights = np.array([np.median(thing.points[:, 1]) for thing in things])
        storeys = self._storeys.index_of(heights) if len(things) else np.empty(0, np.int64)
        centre = _middle(things)

        def memory_of(index: int) -> ObjectMap:
            objects = tuple(_instance(thing) for thing, at in zip(things, storeys, strict=True) if at == index)
            floor_y = self._storeys.floors[index]
            return ObjectMap(objects, floor_y, self._encoder.name, self._encoder.dim, centre, MERGE_RULE.merge_m)

        return self._storeys.home(memory_of)

    def _place(self, frames: Sequence[Frame]) -> None:
        if not frames:
            return
        for frame, patches in zip(frames, encoded_patches(self._encoder, frames), strict=True):
            found = self._segmenter.segment(frame)
            features = features_of_masks(found, frame.camera, patches)
            (self._known if found.ids else self._unknown).add(frame, found, features)


def _instance(thing: Thing) -> ObjectInstance:
    caption = thing.captions.most_common(1)[0][0] if thing.captions else ""
    return ObjectInstance(
        thing.points.astype(np.float32), thing.feature.astype(np.float32), caption, float(thing.views)
    )


def features_of_masks(found: Segments, camera: Camera, patches: NDArray[np.float32]) -> NDArray[np.float64]:
    """(M, E) unit mean of the patches (h, w, E) that each mask covers; zero where they are."""
    shares = _shares_of_patches(found.masks, camera, patches.shape[:2])
    used = np.flatnonzero(shares.any(axis=0))  # a product with all patches is the most work of a view
    rows = patches.reshape(-1, patches.shape[2])[used]
    features = (shares[:, used].astype(np.float32) @ rows).astype(np.float64)
    lengths = np.array([np.linalg.norm(row) or 1.0 for row in features])
    return features / lengths.reshape(-1, 1)


def _shares_of_patches(masks: NDArray[np.bool_], camera: Camera, shape: tuple[int, int]) -> NDArray[np.float64]:
    """(M, h*w) share of each patch that each mask covers; small shares are 0 unless a mask has nothing better."""
    pixels = patch_pixels(camera, shape)
    shares = masks[:, pixels[..., 0], pixels[..., 1]].mean(axis=2)
    least = np.minimum(_LEAST_IN_PATCH, shares.max(axis=1, keepdims=True))
    return np.where(shares >= least, shares, 0.0)


def _middle(things: Sequence[Thing]) -> tuple[float, float]:
    """Middle of the bounds of all points; the origin where there are none."""
    if not things:
        return (0.0, 0.0)
    xz = np.concatenate([thing.points[:, [0, 2]] for thing in things])
    x, z = ((xz.min(axis=0) + xz.max(axis=0)) / 2).tolist()
    return (x, z)

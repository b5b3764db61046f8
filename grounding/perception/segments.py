"""The `ViewSegmenter` protocol, which cuts a view into things, and the simulator's instance ids as one segmenter."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Frame

_LEAST_PIXELS = 30
"""Things with fewer pixels in a view are not found."""


@dataclass(frozen=True, slots=True)
class Segments:
    """The things in one view."""

    masks: NDArray[np.bool_]
    """(M, H, W) pixels of each thing; they may overlap."""
    captions: tuple[str, ...] = ()
    """A name for each thing, or () from a source without names."""
    ids: tuple[int, ...] = ()
    """The same number in two views means the same thing; () from a source that cannot tell."""

    def __post_init__(self) -> None:
        for name, values in (("captions", self.captions), ("ids", self.ids)):
            if values and len(values) != len(self.masks):
                raise AgentError(
                    f"segmenter: gave {len(self.masks)} masks and {len(values)} {name}; expected as many, or none. "
                    "Correct the segmenter."
                )


class ViewSegmenter(Protocol):
    """Finds the things in a view from its colours and depth."""

    @property
    def name(self) -> str:
        """The segmenter's name, which becomes part of the map's name."""
        ...

    def segment(self, frame: Frame) -> Segments:
        """Masks of the view's size; the same view gives the same masks."""
        ...


class InstanceIds:
    """The simulator's own ids as a segmenter: perfect masks, and perfect matching across views. Ground truth."""

    name = "oracle-perception instance ids"

    def __init__(self, captions: Mapping[int, str] | None = None) -> None:
        """Takes a caption for each id."""
        self._captions = captions or {}

    def segment(self, frame: Frame) -> Segments:
        """One mask per id in view.

        Raises:
            AgentError: The view has no instance ids.
        """
        if frame.ids is None:
            raise AgentError(
                "object map: the view has no instance ids; expected those of the simulator. Give a segmenter for "
                "views of a real robot."
            )
        counts = np.bincount(frame.instance_ids.ravel().clip(min=0))
        counts[0] = 0
        ids = np.flatnonzero(counts >= _LEAST_PIXELS)
        masks = frame.instance_ids[None] == ids[:, None, None].astype(np.int32)
        captions = tuple(self._captions.get(int(number), "") for number in ids)
        return Segments(masks, captions if any(captions) else (), tuple(int(number) for number in ids))

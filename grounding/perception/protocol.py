"""The protocols of perception: what an agent that looks for a described thing asks of models, or of ground truth.

Observation -> `Perception.frame_of` -> `Frame` -> score, features, detections, masks -> an agent's maps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.tasks.observers import Detection
from sim.types import Frame, Observation

from ..encoders.protocol import DenseEncoder


class ImageTextScorer(Protocol):
    """How well a whole picture fits a text. `grounding.checks.check_scorer` tests a plug-in."""

    def score(self, frame: Frame, texts: Sequence[str]) -> NDArray[np.float32]:
        """(K,) cosine of the picture with each text, in [-1, 1]. Real models read `frame.rgb` only."""
        ...


class Detector(Protocol):
    """Finds what a text names in pictures. `grounding.checks.check_detector` tests a plug-in."""

    def set_query(self, text: str) -> None:
        """Says what to find from now on."""
        ...

    def detect(self, frame: Frame) -> list[Detection]:
        """The boxes that may show it, in any order, with scores in [0, 1]; AgentError if there is no query yet."""
        ...


class Segmenter(Protocol):
    """The pixels of a detected thing. `grounding.checks.check_segmenter` tests a plug-in."""

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        """(H, W) the thing's pixels, none outside its box."""
        ...


@dataclass(frozen=True, slots=True)
class Perception:
    """What an agent sees with. Models see pictures; oracle perception also sees the simulator's ids."""

    name: str
    """Names the models, or the oracle with its faults, in runs and tables."""
    frame_of: Callable[[Observation], Frame]
    """The picture in the observation's frame; for oracle perception with the ids of its pixels, which no agent reads
    itself. Oracle perception was made for one start: agents that keep a map give it observations in that frame."""
    scorer: ImageTextScorer
    encoder: DenseEncoder
    detector: Detector
    segmenter: Segmenter

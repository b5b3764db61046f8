"""The checks of scorers, detectors and segmenters name each breach of their contracts."""

from dataclasses import replace

import numpy as np
import pytest

from grounding.checks import check_detector, check_scorer, check_segmenter
from grounding.encoders.hashed import HashedWords
from grounding.perception.encoder_scorer import EncoderScorer
from grounding.perception.oracle_detector import OracleDetector, oracle_level
from grounding.perception.oracle_perception import OraclePerception
from grounding.perception.segmenters import DepthRegion, IdRegion

CAPTIONS = {1: "red wooden chair beside the window", 2: "large white sofa"}


class Scorer(EncoderScorer):
    def __init__(self) -> None:
        super().__init__(OraclePerception(HashedWords(), CAPTIONS))


class Finder(OracleDetector):
    def __init__(self, level="clean") -> None:
        errors = oracle_level(level, seed=5)
        super().__init__(OraclePerception(HashedWords(), CAPTIONS, options=errors.perception), faults=errors.detector)


def mild() -> Finder:
    return Finder("mild")


def strong() -> Finder:
    return Finder("strong")


@pytest.mark.slow
@pytest.mark.parametrize("make", [Finder, mild, strong])
def test_oracle_detectors_keep_the_contract(make) -> None:
    assert check_detector(make) == []


@pytest.mark.slow
def test_our_scorer_and_segmenters_keep_the_contract() -> None:
    assert check_scorer(Scorer) == []
    assert check_segmenter(DepthRegion) == []
    assert check_segmenter(IdRegion) == []


class Doubled(Scorer):
    def score(self, frame, texts):
        return 2 * super().score(frame, texts)


class Wide(Scorer):
    def score(self, frame, texts):
        return super().score(frame, texts).astype(np.float64)


class Relative(Scorer):
    """Scores that sum to 1, so that they depend on the other texts."""

    def score(self, frame, texts):
        scores = np.exp(super().score(frame, texts))
        return (scores / scores.sum()).astype(np.float32)


class Counting(Scorer):
    calls = 0

    def score(self, frame, texts):
        self.calls += 1
        return (super().score(frame, texts) / self.calls).astype(np.float32)


@pytest.mark.parametrize(
    ("scorer", "message"),
    [
        (Doubled, "largest score is"),
        (Wide, "dtype is 'float64'; expected float32"),
        (Relative, "change when a text is scored alone"),
        (Counting, "change with the order of calls and texts"),
        (object, "found no method score"),
    ],
)
def test_a_bad_scorer_is_named(scorer, message: str) -> None:
    (problem,) = check_scorer(scorer)
    assert message in problem


class Eager(Finder):
    """Detects without a query."""

    def detect(self, frame):
        return super().detect(frame) if self._query else []


class Turned(Finder):
    """Boxes with rows and columns exchanged."""

    def detect(self, frame):
        found = super().detect(frame)
        return [replace(item, box=(item.box[1], item.box[0], item.box[3], item.box[2])) for item in found]


class Percent(Finder):
    def detect(self, frame):
        return [replace(item, score=100 * item.score) for item in super().detect(frame)]


class Tracking(Finder):
    """Answers only the first time it sees a thing."""

    def __init__(self) -> None:
        super().__init__()
        self._known: set = set()

    def detect(self, frame):
        found = [item for item in super().detect(frame) if item.box not in self._known]
        self._known |= {item.box for item in found}
        return found


class Painting(Finder):
    def detect(self, frame):
        frame.rgb[0, 0] += 1
        return super().detect(frame)


@pytest.mark.parametrize(
    ("detector", "message"),
    [
        (Eager, "answer before any query is 'given'; expected AgentError"),
        (Turned, "a box is"),
        (Percent, "; expected 0 to 1. Correct the plug-in"),
        (Tracking, "answers after another query, in another order is 'others'"),
        (Painting, "a picture after the call is 'changed'"),
    ],
)
def test_a_bad_detector_is_named(detector, message: str) -> None:
    (problem,) = check_detector(detector)
    assert message in problem


class Everything(DepthRegion):
    def mask(self, frame, detection):
        return np.ones(frame.depth_m.shape, bool)


class Cropped(DepthRegion):
    def mask(self, frame, detection):
        return super().mask(frame, detection)[:-1]


class Soft(DepthRegion):
    def mask(self, frame, detection):
        return super().mask(frame, detection).astype(np.float32)


class Blind(DepthRegion):
    def mask(self, frame, detection):
        return np.zeros(frame.depth_m.shape, bool)


class Upside(DepthRegion):
    def mask(self, frame, detection):
        return super().mask(frame, detection)[::-1]


@pytest.mark.parametrize(
    ("segmenter", "message"),
    [
        (Everything, "pixels outside the box"),
        (Cropped, "shape is (119, 160)"),
        (Soft, "dtype is 'float32'; expected bool"),
        (Blind, "masks of the room's boxes is 'all empty'"),
        (Upside, "pixels outside the box"),
    ],
)
def test_a_bad_segmenter_is_named(segmenter, message: str) -> None:
    (problem,) = check_segmenter(segmenter)
    assert message in problem

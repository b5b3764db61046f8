"""The checks that users run on their own scorers, detectors and segmenters; ours pass the same ones.

The pictures are those of room.py: a room with a red and a blue box, whose instance ids are 1 and 2.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.plugins import own_name, problems_of
from sim.tasks.observers import Detection
from sim.types import Frame

from ..perception.boxes import boxes_of_ids, pixels_in_box
from ..perception.protocol import Detector, ImageTextScorer, Segmenter
from .answers import require, require_vectors
from .room import check_views

_TEXTS = ("red wooden chair beside the window", "large white sofa", "oval mirror with a golden frame")
_TOLERANCE = 1e-3
"""Allowed difference of numbers that should be equal."""
_NUM_VIEWS = 4


def check_scorer(scorer: ImageTextScorer | Callable[[], ImageTextScorer] | str) -> list[str]:
    """How a scorer breaks the contract of `ImageTextScorer`, here and in a second process.

    Args:
        scorer: The object, a factory, or its name as package.module:factory.

    Returns:
        The first breach; empty = the contract is kept.
    """
    return problems_of(scorer, _require_scorer, methods=("score",), again=_scores, kind="scorer")


def check_detector(detector: Detector | Callable[[], Detector] | str) -> list[str]:
    """How a detector breaks the contract of `Detector`, here and in a second process.

    Args:
        detector: The object, a factory, or its name as package.module:factory. Only a factory's detector, which has no
            query yet, can be asked whether it refuses to detect without one.

    Returns:
        The first breach; empty = the contract is kept.
    """
    is_new = isinstance(detector, str | type) or not hasattr(detector, "set_query")
    return problems_of(
        detector,
        partial(_require_detector, is_new=is_new),
        methods=("set_query", "detect"),
        again=_numbers,
        kind="detector",
    )


def check_segmenter(segmenter: Segmenter | Callable[[], Segmenter] | str) -> list[str]:
    """How a segmenter breaks the contract of `Segmenter`, here and in a second process.

    Args:
        segmenter: The object, a factory, or its name as package.module:factory.

    Returns:
        The first breach; empty = the contract is kept.
    """
    return problems_of(segmenter, _require_segmenter, methods=("mask",), again=_masks, kind="segmenter")


def _frames() -> list[Frame]:
    """Views of the room that show a box."""
    frames = [view.frame for view in check_views()]
    return [frame for frame in frames if frame.instance_ids.any()][:_NUM_VIEWS]


def _require_scorer(scorer: ImageTextScorer) -> None:
    where, frames = f"scorer {own_name(scorer, type(scorer).__name__)!r}", _frames()
    before = [_copies(frame) for frame in frames]
    first = [scorer.score(frame, _TEXTS) for frame in frames]
    for scores in first:
        require_vectors(scores, (len(_TEXTS),), where)
        largest = float(np.abs(scores).max())
        require(largest <= 1 + _TOLERANCE, where, "largest score", largest, "a cosine, at most 1")
    turned = [scorer.score(frame, _TEXTS[::-1])[::-1] for frame in reversed(frames)][::-1]
    worst = float(np.abs(np.array(turned) - first).max())
    require(worst <= _TOLERANCE, where, "change with the order of calls and texts", worst, f"at most {_TOLERANCE}")
    alone = float(scorer.score(frames[0], _TEXTS[:1])[0])
    change = abs(alone - float(first[0][0]))
    require(change <= _TOLERANCE, where, "change when a text is scored alone", change, f"at most {_TOLERANCE}")
    require_vectors(scorer.score(frames[0], ()), (0,), f"{where}, no texts")
    _require_unchanged(frames, before, where)


def _scores(scorer: ImageTextScorer) -> NDArray[np.float32]:
    return scorer.score(_frames()[0], _TEXTS)


def _require_detector(detector: Detector, *, is_new: bool) -> None:
    where, frames = f"detector {own_name(detector, type(detector).__name__)!r}", _frames()
    if is_new:
        _require_query(detector, frames[0], where)
    before = [_copies(frame) for frame in frames]
    first = _found(detector)
    for frame, detections in zip(frames, first, strict=True):
        for detection in detections:
            _require_detection(detection, frame, where)
    detector.set_query(_TEXTS[1])
    detector.detect(frames[0])
    detector.set_query(_TEXTS[0])
    again = [_sorted(detector.detect(frame)) for frame in reversed(frames)][::-1]
    same = all(map(_alike, again, first))
    require(same, where, "answers after another query, in another order", "others", "the same to the same question")
    _require_unchanged(frames, before, where)


def _require_query(detector: Detector, frame: Frame, where: str) -> None:
    try:
        detector.detect(frame)
    except AgentError:
        return
    require(False, where, "answer before any query", "given", "AgentError: nobody said what to find")


def _require_detection(detection: Detection, frame: Frame, where: str) -> None:
    require(isinstance(detection, Detection), where, "an answer", detection, "sim.tasks.observers.Detection")
    (left, top, right, bottom), camera = detection.box, frame.camera
    inside = 0 <= left < right <= camera.width and 0 <= top < bottom <= camera.height
    expected = f"left < right in 0 to {camera.width} and top < bottom in 0 to {camera.height}, in pixels"
    require(inside, where, "a box", detection.box, expected)
    require(0 <= detection.score <= 1, where, "a score", detection.score, "0 to 1")
    require(bool(detection.label), where, "a label", detection.label, "a word or more")


def _found(detector: Detector) -> list[list[Detection]]:
    """The detections of the check's query, sorted, in each picture."""
    detector.set_query(_TEXTS[0])
    return [_sorted(detector.detect(frame)) for frame in _frames()]


def _sorted(detections: list[Detection]) -> list[Detection]:
    return sorted(detections, key=lambda item: (item.label, *np.round([*item.box, item.score], 2).tolist()))


def _alike(first: list[Detection], second: list[Detection]) -> bool:
    one, two = _table(first), _table(second)
    return one.shape == two.shape and bool(np.allclose(one, two, atol=_TOLERANCE))


def _numbers(detector: Detector) -> list[NDArray[np.float64]]:
    """(N, 5) boxes and scores in each picture."""
    return [_table(found) for found in _found(detector)]


def _table(found: list[Detection]) -> NDArray[np.float64]:
    return np.array([[*item.box, item.score] for item in found], float).reshape(-1, 5)


def _require_segmenter(segmenter: Segmenter) -> None:
    where, questions = f"segmenter {own_name(segmenter, type(segmenter).__name__)!r}", _questions()
    before = [_copies(frame) for frame, _ in questions]
    first = _masks(segmenter)
    for (frame, detection), mask in zip(questions, first, strict=True):
        require(isinstance(mask, np.ndarray), where, "type", type(mask).__name__, "a numpy array")
        require(mask.dtype == bool, where, "dtype", str(mask.dtype), "bool")
        require(mask.shape == frame.depth_m.shape, where, "shape", mask.shape, f"the picture's {frame.depth_m.shape}")
        outside = mask.copy()
        outside[pixels_in_box(detection.box, mask.shape)] = False
        num = int(outside.sum())
        require(num == 0, where, f"pixels outside the box {detection.box}", num, "none: check rows and columns")
    require(any(mask.any() for mask in first), where, "masks of the room's boxes", "all empty", "the boxes' pixels")
    again = [segmenter.mask(frame, detection) for frame, detection in reversed(questions)][::-1]
    same = all(map(np.array_equal, again, first))
    require(same, where, "answers in another order", "others", "the same to the same question")
    _require_unchanged([frame for frame, _ in questions], before, where)


def _questions() -> list[tuple[Frame, Detection]]:
    """Views with the box around what they show of the room's boxes, exact and a little larger."""
    asked = []
    for frame in _frames():
        for number, (left, top, right, bottom) in boxes_of_ids(frame.instance_ids).items():
            for grown in (0.0, 2.5):
                box = (left - grown, top - grown, right + grown, bottom + grown)
                asked.append((frame, Detection(f"box {number}", box, 0.5)))
    return asked


def _masks(segmenter: Segmenter) -> list[NDArray[np.bool_]]:
    return [segmenter.mask(frame, detection) for frame, detection in _questions()]


def _copies(frame: Frame) -> list[NDArray]:
    return [frame.rgb.copy(), frame.depth_m.copy(), frame.T_world_camera.copy()]


def _require_unchanged(frames: list[Frame], before: list[list[NDArray]], where: str) -> None:
    after = [[frame.rgb, frame.depth_m, frame.T_world_camera] for frame in frames]
    same = all(all(map(np.array_equal, one, two)) for one, two in zip(before, after, strict=True))
    require(same, where, "a picture after the call", "changed", "unchanged")

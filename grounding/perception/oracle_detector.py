"""Oracle detection: boxes from the instance ids of a picture, with adjustable errors, and three named levels of them.

Queries are matched to the objects' captions as oracle perception perceives them, confusions included, so that an
agent's features and its detector make the same mistakes. Runs made with it rank agents; they do not predict success on
pictures.
"""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Literal, NamedTuple, get_args

import numpy as np

from sim.errors import AgentError, did_you_mean
from sim.tasks.observers import Detection
from sim.types import Frame

from .boxes import Box, boxes_of_ids, detections_from_boxes
from .named_things import checked_query, is_category, names_category, require_query
from .oracle_perception import BOX, FALSE, MISS, SCORE, OraclePerception, PerceptionOptions, ids_of, view_key

Level = Literal["clean", "mild", "strong"]
SeenShare = Callable[[Frame, int], float]
"""Share of an object's pixels that a frame shows: the rest is hidden by other things, or beyond the picture's edge."""
_LEAST_FALSE, _MOST_FALSE = 0.05, 0.4
"""Sides of false detections as shares of the picture's, drawn evenly on a logarithmic scale."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """A share that rises, or falls, along a straight line from 0 at `never` to 1 at `always`; both are reached."""

    never: float
    always: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.never) and math.isfinite(self.always)) or self.never == self.always:
            raise AgentError(
                f"perception: a ramp goes from {self.never!r} to {self.always!r}; expected two different numbers. "
                "Leave the ramp out for no effect."
            )

    def __call__(self, value: float) -> float:
        """The share at a value, 0 to 1."""
        return min(1.0, max(0.0, (value - self.never) / (self.always - self.never)))

    def __str__(self) -> str:
        return f"{self.never:g}..{self.always:g}"


@dataclass(frozen=True, slots=True)
class DetectorFaults:
    """Errors of the oracle detector.

    An object's `clearness` in a view is `far` x `small` x `hidden`. It is found with probability
    (1 - miss) x clearness; the errors of its box and score are doubled where clearness is 0. Objects that are mistaken
    for others in all views come from `PerceptionOptions.confusion`.
    """

    miss: float = 0.0
    """Probability of missing an object in a view even if it is near, large and wholly seen."""
    far: Ramp | None = None
    """Over the median depth of the object's pixels, metres; None = distance does not matter."""
    small: Ramp | None = None
    """Over the side of a square with as many pixels as the view shows of the object, pixels."""
    hidden: Ramp | None = None
    """Over the share of the object's pixels that are seen, 0 to 1."""
    false_rate: float = 0.0
    """Mean number of detections of nothing per picture (Poisson), at random places."""
    box_jitter: float = 0.0
    """Standard deviation of each side of a box, as a share of its width or height."""
    score_noise: float = 0.0
    """Standard deviation of a score."""
    match: Literal["text", "category"] = "text"
    """`text`: like an open-vocabulary detector, scores are cosines of the query with captions, and an object's category
    alone finds all objects of the category. `category`: like a detector with a list of classes, the head noun alone
    counts and all scores are 1 before noise."""
    least_similarity: float = 0.5
    """Least cosine of the query with a caption; 1 for the caption itself. 0.5 lets captions match that share half of
    their words, as real detectors answer "white chair" with chairs of other colours."""

    def __post_init__(self) -> None:
        for name in ("miss", "false_rate", "box_jitter", "score_noise"):
            value, most = getattr(self, name), 1 if name == "miss" else math.inf
            if not (math.isfinite(value) and 0 <= value <= most):
                expected = "0 to 1" if name == "miss" else "0 or more"
                raise AgentError(f"perception: {name} is {value!r}; expected {expected}. Try 0.1.")

    def clearness(self, *, distance: float, side: float, seen: float) -> float:
        """How clearly a view shows an object, 0 to 1; distance in metres, side in pixels, seen as a share."""
        shares = [ramp(value) for ramp, value in self._ramps(distance, side, seen) if ramp is not None]
        return math.prod(shares)

    def _ramps(self, distance: float, side: float, seen: float) -> list[tuple[Ramp | None, float]]:
        return [(self.far, distance), (self.small, side), (self.hidden, seen)]


@dataclass(frozen=True, slots=True)
class OracleLevel:
    """All errors of oracle perception: those of features and scores, and those of detections."""

    perception: PerceptionOptions
    detector: DetectorFaults

    @property
    def settings(self) -> str:
        """Every setting that is not the default, as one string for rows of tables; `no faults` if there is none."""
        changed = [
            f"{field.name}={value:g}" if isinstance(value, float) else f"{field.name}={value}"
            for part in (self.perception, self.detector)
            for field in fields(part)
            if field.name != "seed" and (value := getattr(part, field.name)) != field.default
        ]
        return ", ".join(changed) or "no faults"


def oracle_level(level: Level, *, seed: int = 0) -> OracleLevel:
    """The errors of a named level.

    `clean` has none. The others are set by hand, to span what open-vocabulary detectors do; no detector was measured.
    `mild`: an object that is near and free is found in 4 of 5 views. Depth cameras end at 5 m, and what is found beyond
    is rarely kept, so finding fades from 3 to 8 m. COCO calls things below 32 pixels small, and detectors lose most of
    them: from 40 pixels down to 8. A false detection in 50 pictures is ten in the longest episode. One object in ten is
    always taken for another. `strong`: half of the views, 2 to 6 m, 64 down to 16 pixels, one false detection in ten
    pictures, and one object in four is another. A box edge is off by 5 % and 15 % of its side, a cosine by 0.05 and
    0.15: two captions with half of their words in common are then told apart in nearly all views, and in most.

    Raises:
        AgentError: There is no such level.
    """
    match level:
        case "clean":
            return OracleLevel(PerceptionOptions(seed=seed), DetectorFaults())
        case "mild":
            perception = PerceptionOptions(
                view_noise=0.05, object_noise=0.05, confusion=0.1, background="clutter", seed=seed
            )
            faults = DetectorFaults(
                miss=0.2, far=Ramp(8, 3), small=Ramp(8, 40), hidden=Ramp(0.1, 0.6),
                false_rate=0.02, box_jitter=0.05, score_noise=0.05,
            )  # fmt: skip
        case "strong":
            perception = PerceptionOptions(
                view_noise=0.15, object_noise=0.1, confusion=0.25, background="clutter", seed=seed
            )
            faults = DetectorFaults(
                miss=0.5, far=Ramp(6, 2), small=Ramp(16, 64), hidden=Ramp(0.2, 0.8),
                false_rate=0.1, box_jitter=0.15, score_noise=0.15,
            )  # fmt: skip
        case _:
            raise AgentError(
                f"perception: oracle level is {level!r}; expected one of {', '.join(get_args(Level))}."
                f"{did_you_mean(level, get_args(Level))} Choose one."
            )
    return OracleLevel(perception, faults)


class _View(NamedTuple):
    """What the last view shows, whatever is asked for."""

    frame: Frame | None
    key: tuple[int, int]
    """The view's `view_key`."""
    boxes: dict[int, Box]
    """By instance id."""
    clearness: dict[int, float]
    """By instance id, of the objects that were asked for."""


class OracleDetector:
    """A `Detector` that reads instance ids. Draws depend on seed, home, object and view, not on the order of calls."""

    def __init__(
        self,
        perception: OraclePerception,
        *,
        categories: Mapping[int, str] | None = None,
        faults: DetectorFaults | None = None,
        seen_share: SeenShare | None = None,
    ) -> None:
        """Takes what is known of the home.

        Args:
            perception: The captions as perceived, their text encoder, the home and the seed.
            categories: Instance id to category; needed for `match="category"` and for queries that name only one.
            faults: Errors; none by default.
            seen_share: Tells how much of an object a view shows; None = all objects count as wholly seen.
        """
        self.faults = faults or DetectorFaults()
        self.name = f"{perception.name} detector"
        self._perception = perception
        self._categories = _perceived_categories(perception, categories or {})
        self._seen_share = seen_share
        self._vectors = perception.encode_texts(list(perception.perceived.values()))
        self._query = ""
        self._view = _View(None, (0, 0), {}, {})
        self._matches: dict[int, float] = {}
        self._matches_of: dict[str, dict[int, float]] = {}

    def set_query(self, text: str) -> None:
        """Says what to find; raises AgentError for a text without words."""
        self._query = checked_query(text, self.name)
        if self._query not in self._matches_of:
            self._matches_of[self._query] = self._matching()
        self._matches = self._matches_of[self._query]

    @property
    def matches(self) -> dict[int, float]:
        """Instance id to similarity of all objects that the query finds; for failure analysis, never for agents."""
        return dict(self._matches)

    def detect(self, frame: Frame) -> list[Detection]:
        """The boxes of matching objects in view and of false detections, best first.

        Raises:
            AgentError: There is no query yet, or the frame has no instance ids.
        """
        require_query(self._query, self.name)
        if frame is not self._view.frame:  # agents ask for several texts in one view
            self._view = _View(frame, view_key(frame), boxes_of_ids(ids_of(frame)), {})
        key, boxes = self._view.key, self._view.boxes
        seen = [self._seen(frame, key, number, boxes[number]) for number in self._matches if number in boxes]
        found = [item for item in seen if item is not None] + self._false(frame, key)
        table = np.array([[*box, score] for box, score in found], float).reshape(-1, 5)
        return detections_from_boxes(table[:, :4], table[:, 4], frame, label=self._query)

    def _matching(self) -> dict[int, float]:
        if self.faults.match == "category":
            return {number: 1.0 for number, name in self._categories.items() if names_category(self._query, name)}
        cosines = self._vectors @ self._perception.encode_texts([self._query])[0]
        found = {}
        for number, cosine in zip(self._perception.perceived, cosines.tolist(), strict=True):
            if is_category(self._query, self._categories.get(number, "")):
                cosine = 1.0
            if cosine >= self.faults.least_similarity:
                found[number] = min(1.0, cosine)
        return found

    def _seen(self, frame: Frame, key: tuple[int, int], number: int, box: Box) -> tuple[Box, float] | None:
        """The box and score of an object in view; None where the view misses it."""
        faults, clearness = self.faults, self._view.clearness.get(number)
        if clearness is None:
            clearness = self._view.clearness[number] = self._clearness(frame, number)
        if self._perception.rng(MISS, number, *key).random() >= (1 - faults.miss) * clearness:
            return None
        spread = 2 - clearness
        if faults.box_jitter:
            moves = self._perception.rng(BOX, number, *key).normal(0, faults.box_jitter * spread, 4)
            width, height = box[2] - box[0], box[3] - box[1]
            box = tuple((np.array(box) + moves * (width, height, width, height)).tolist())
        score = self._matches[number]
        if faults.score_noise:
            noise = self._perception.rng(SCORE, number, *key, zlib.crc32(self._query.encode()))
            score += noise.normal(0, faults.score_noise * spread)
        return box, score

    def _clearness(self, frame: Frame, number: int) -> float:
        """How clearly a view shows an object, 0 to 1."""
        faults = self.faults
        if not (faults.far or faults.small or faults.hidden):
            return 1.0
        pixels = frame.instance_ids == number
        seen = self._seen_share(frame, number) if self._seen_share and faults.hidden else 1.0
        distance, side = float(np.median(frame.depth_m[pixels])), math.sqrt(np.count_nonzero(pixels))
        return faults.clearness(distance=distance, side=side, seen=seen)

    def _false(self, frame: Frame, key: tuple[int, int]) -> list[tuple[Box, float]]:
        """Boxes and scores of nothing, scores evenly from the least similarity to 1."""
        if not self.faults.false_rate:
            return []
        rng = self._perception.rng(FALSE, *key, zlib.crc32(self._query.encode()))
        height, width = frame.depth_m.shape
        found = []
        for _ in range(rng.poisson(self.faults.false_rate)):
            sides = np.exp(rng.uniform(math.log(_LEAST_FALSE), math.log(_MOST_FALSE), 2)) * (width, height)
            left, top = rng.uniform(0, np.array([width, height]) - sides)
            box = (float(left), float(top), float(left + sides[0]), float(top + sides[1]))
            found.append((box, float(rng.uniform(self.faults.least_similarity, 1))))
        return found


def _perceived_categories(perception: OraclePerception, categories: Mapping[int, str]) -> dict[int, str]:
    """Instance id to the category of the object that perception takes it for."""
    true_texts = perception.captions
    of_text = {text: categories[number] for number, text in reversed(true_texts.items()) if number in categories}
    perceived = perception.perceived
    return {
        number: categories.get(number, "") if text == true_texts[number] else of_text.get(text, "")
        for number, text in perceived.items()
    }

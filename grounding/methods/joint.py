"""`joint`: finds the place most probably within 1 m of the thing that the query means, from all phrases and cells.

The steps, and the reason for each (no training, no language model; it sees only the map, the phrases and the query):

1. Text. The query's phrase is chosen as in `phrase`; room and article are cut off, because map cells hold things.
2. Contrast. Ridge regression removes the part of each phrase's vector that it shares with the task's other phrases and
   with ordinary texts about things in homes: a cell that resembles those equally well is no evidence. The dual softmax
   has the same effect, but this step comes before noise and neighbours are weighed.
3. Standard scores. The cosines of one phrase with all cells get mean 0 and deviation 1, because encoders and noise
   levels differ.
4. Matched filter. A thing colours its own cell and the cells around it. Each place on a sub-cell grid gets the log
   likelihood ratio of "the thing is here", with its expected footprint, against "it is not here", averaged over
   amplitudes and footprints.
5. Rooms. Phrases of the same room say where that room is: their places, widened, are a soft prior; part of it is flat.
6. Decision. Success is a distance, so the answer is the place with the most probability within 1 m of it, and the
   middle one of tied places; the next answers are the best places for the remaining probability.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid
from ..phrases.ownership_text import asked_thing
from ..types import FeatureMap, Grounding, Layers
from .baselines import NUM_CANDIDATES, QueryScoring, candidates_at
from .matching import peaks_of

REACH = 1.0
"""Distance that counts as right, metres (DESIGN.md)."""
SPACING = 1 / 3
"""Largest distance between neighbouring places, metres: 3 x 3 places in a cell of 1 m."""
FROZEN = (
    "The constants of joint were frozen on 24 invented homes (2026-11-22 16:16 UTC, first in commit a8d71bb), before "
    "the one run on the released episodes that docs/figures.md reports."
)


@dataclass(frozen=True, slots=True)
class JointOptions:
    """The constants of the steps, chosen on 24 invented homes with clutter and noise, then run once on the release."""

    ridge: float = 2.0
    """Step 2; a smaller value removes more of the shared part."""
    ordinary: float = 15.0
    """Step 2: the ordinary texts together count as this many phrases."""
    amplitudes: tuple[float, ...] = (3.0,)
    """Step 4: standard scores expected in the middle of a thing's footprint."""
    footprints: tuple[float, ...] = (0.35, 0.5, 1.0)
    """Step 4: sigma of the footprint, metres."""
    crowd: float = 0.5
    """Step 4: squared weight of other things in a cell, whose vectors share its unit length."""
    room_sigma: float = 3.0
    """Step 5: sigma of the widened places, metres."""
    room_doubt: float = 0.2
    """Step 5: share of the prior that is flat; 1 leaves the step out."""


class JointMatcher:
    """Ranks places by the probability of being within 1 m; without the query's phrase it answers as QS does."""

    name = "joint"
    uses_phrases = True
    frame = "places in and between non-empty cells"
    takes: MemoryKind = "grid"

    def __init__(self, encoder: TextEncoder, *, options: JointOptions | None = None) -> None:
        """Takes the encoder of the map and the constants."""
        self._encoder = encoder
        self._options = options or JointOptions()
        self._background: NDArray[np.float64] | None = None

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Weighs all phrases and cells at once."""
        memory = require_grid(memory, self.name, self._encoder)
        asked = asked_thing(phrases, task.queries[0], self._encoder)
        if asked is None or not len(memory.rows):
            return QueryScoring(self._encoder).ground(memory, task, phrases)
        things, chosen = asked
        vectors = self._encoder.encode_texts([item.thing for item in things])
        if self._background is None:
            ordinary = self._encoder.encode_texts(household_texts())
            self._background = background(ordinary, weight=self._options.ordinary, ridge=self._options.ridge)
        scores = standard_scores(contrasted(vectors, self._background) @ memory.rows.T)
        places = Places(memory)
        evidence = places.evidence(scores, self._options)
        total = evidence[chosen].copy()
        for index, item in enumerate(things):
            if index != chosen and item.room and item.room == things[chosen].room:
                total += places.room_prior(evidence[index], self._options)
        points, shares = places.best(total)
        layers = Layers(
            memory.rc,
            memory.grid.shape,
            final=places.per_cell(total).astype(np.float32),
            phrases=asked.texts,
            similarity=(vectors @ memory.rows.T).astype(np.float32),
            peaks=peaks_of(np.array([places.per_cell(row) for row in evidence]), memory.rc),
            chosen=chosen,
        )
        return Grounding(candidates_at(memory.grid, points, shares), layers)


def background(texts: NDArray[np.floating], *, weight: float, ridge: float) -> NDArray[np.float64]:
    """(E, E) inverse of ridge x I + weight x mean outer product of the vectors of ordinary texts (N, E)."""
    rows = np.asarray(texts, np.float64)
    spread = weight / max(len(rows), 1) * rows.T @ rows + ridge * np.eye(rows.shape[1])
    return np.asarray(np.linalg.inv(spread), np.float64)


_NOUNS = ", ".join(
    (
        "armchair, backpack, bag, basket, bathtub, bed, bench, bicycle, bin, blanket, blinds, board game, book",
        "bookshelf, bottle, bowl, box, broom, bucket, cabinet, candle, carpet, chair, chandelier, chest of drawers",
        "clock, clothes rack, coat, coffee machine, coffee table, computer, couch, cup, curtain, cushion, desk",
        "dining table, dishwasher, door, doormat, dresser, fan, faucet, fireplace, floor lamp, flower pot, guitar",
        "hair dryer, hat, headboard, jacket, kettle, keyboard, kitchen counter, ladder, lamp, laptop, laundry basket",
        "magazine, mattress, microwave, mirror, monitor, nightstand, ottoman, oven, painting, photo frame, piano",
        "picture, pillow, plant, plate, poster, printer, radiator, refrigerator, rug, sculpture, shelf, shoe rack",
        "shower curtain, side table, sink, sofa, speaker, staircase, statue, stool, stove, suitcase, table, table lamp",
        "teddy bear, telephone, television, toaster, toilet, towel, toy, trash can, tray, treadmill, tv stand",
        "umbrella, vacuum cleaner, vase, wardrobe, washing machine, window, wine rack",
    )
).split(", ")
_SIZES = ("small", "large", "tall", "round", "rectangular", "old", "modern")
_COLOURS = ("white", "black", "grey", "brown", "beige", "red", "blue", "green", "yellow", "golden", "dark", "light")
_MATERIALS = ("wooden", "metal", "glass", "leather", "fabric", "plastic", "ceramic", "stone")
_RELATIONS = ("next to", "on top of", "near", "in front of", "hanging above", "behind", "under")
"""Words of `household_texts`, written for this project and not taken from a dataset."""


def household_texts() -> tuple[str, ...]:
    """Ordinary texts of things in homes, the background of step 2: a few hundred, always the same.

    Each thing appears with its name alone, with attributes, with a relation, and with a detail.

    The steps through attributes and neighbours share no factor with the lengths of their lists, which mixes all pairs.
    """
    texts = list(_NOUNS)
    for index, noun in enumerate(_NOUNS):
        size, material = _SIZES[index % len(_SIZES)], _MATERIALS[index % len(_MATERIALS)]
        texts.append(f"{size} {_COLOURS[index % len(_COLOURS)]} {material} {noun}")
        colour, relation = _COLOURS[(5 * index + 3) % len(_COLOURS)], _RELATIONS[index % len(_RELATIONS)]
        texts.append(f"{colour} {noun} {relation} the {_NOUNS[(37 * index + 11) % len(_NOUNS)]}")
        material, colour = _MATERIALS[(3 * index + 1) % len(_MATERIALS)], _COLOURS[(7 * index + 2) % len(_COLOURS)]
        texts.append(f"{material} {noun} with a {colour} {_NOUNS[(53 * index + 29) % len(_NOUNS)]}")
    return tuple(texts)


def contrasted(vectors: NDArray[np.floating], inverse: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, E): (B + O'O)^-1 v for each vector v; O holds the other vectors, and `inverse` is B^-1 (`background`)."""
    rows = np.asarray(vectors, np.float64)
    solved = rows @ inverse
    products = solved @ rows.T
    result = solved.copy()
    for index in range(len(rows)):
        others = np.delete(np.arange(len(rows)), index)
        # Woodbury: solves a system whose size is the number of other vectors, not E
        gram = products[np.ix_(others, others)] + np.eye(len(others))
        result[index] -= np.linalg.solve(gram, products[others, index]) @ solved[others]
    return result


def standard_scores(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """(K, N) with mean 0 and deviation 1 in each row; 0 in a row whose values are all equal."""
    values = np.asarray(values, np.float64)
    centred = values - values.mean(axis=1, keepdims=True)
    deviation = values.std(axis=1, keepdims=True)
    return centred / np.where(deviation > 1e-9, deviation, np.inf)


class Places:
    """The places of a map, `sub` x `sub` in each stored cell, on a raster around the stored cells."""

    def __init__(self, memory: FeatureMap) -> None:
        """Lays the raster around the cells."""
        self._memory = memory
        self._sub = max(1, round(memory.grid.cell / SPACING))
        low = memory.rc.min(axis=0).astype(np.int64)
        self._low = low
        self._rows, self._cols = (memory.rc - low).T
        self._shape = tuple((memory.rc.max(axis=0) - low + 1).tolist())
        self._step = memory.grid.cell / self._sub
        is_stored = np.zeros(self._shape, bool)
        is_stored[self._rows, self._cols] = True
        self._is_place = np.kron(is_stored, np.ones((self._sub, self._sub))).astype(bool)

    def evidence(self, scores: NDArray[np.float64], options: JointOptions) -> NDArray[np.float64]:
        """Log likelihood ratio (K, places of the raster) of standard scores (K, N); -inf where no cell is stored."""
        pictures = np.zeros((len(scores) + 1, *self._shape))
        pictures[:-1, self._rows, self._cols] = scores
        pictures[-1, self._rows, self._cols] = 1  # the last picture marks the stored cells
        options_tried = []
        for sigma in options.footprints:
            response, energy = self._filtered(pictures, sigma, options.crowd)
            options_tried += [size * response - size**2 / 2 * energy for size in options.amplitudes]
        ratio = np.logaddexp.reduce(options_tried, axis=0) - np.log(len(options_tried))
        return np.where(self._is_place, ratio, -np.inf)

    def _filtered(
        self, pictures: NDArray[np.float64], sigma: float, crowd: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Sums over cells of footprint x score, per phrase, and of footprint squared, at every place."""
        sub, cell = self._sub, self._memory.grid.cell
        reach = int(np.ceil(2 * sigma / cell))
        offsets = np.arange(-reach, reach + 1)
        shape = (self._shape[0] * sub, self._shape[1] * sub)
        response, energy = np.empty((len(pictures) - 1, *shape)), np.empty(shape)
        inside = (np.arange(sub) + 0.5) / sub - 0.5  # position of a place in its cell, in cells
        for i, down in enumerate(inside):
            for j, right in enumerate(inside):
                square = ((offsets[:, None] - down) ** 2 + (offsets[None] - right) ** 2) * cell**2
                weight = np.exp(-square / (2 * sigma**2))
                kernel = weight / np.sqrt(weight**2 + crowd)
                response[:, i::sub, j::sub] = ndimage.correlate(pictures[:-1], kernel[None], mode="constant")
                energy[i::sub, j::sub] = ndimage.correlate(pictures[-1], kernel**2, mode="constant")
        return response, energy

    def room_prior(self, evidence: NDArray[np.float64], options: JointOptions) -> NDArray[np.float64]:
        """Log odds, against other places, that a thing of this room stands here, given the evidence."""
        spread = options.room_sigma / self._step
        near = ndimage.gaussian_filter(self._probability(evidence), spread, mode="constant")
        coverage = ndimage.gaussian_filter(self._is_place.astype(float), spread, mode="constant")
        density = np.where(self._is_place, near / np.maximum(coverage, 1e-12), 0)
        density /= density[self._is_place].mean()
        return np.log((1 - options.room_doubt) * density + options.room_doubt)

    def best(self, total: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World points (M, 3) of the best places, on their cells' floors, and the probability within REACH of each."""
        reach = int(REACH / self._step + 1e-9)
        offsets = np.arange(-reach, reach + 1) * self._step
        square = offsets[:, None] ** 2 + offsets[None] ** 2
        # nearly flat inside the reach: of places that cover equal probability, this prefers the one in the middle
        disc = np.where(square <= REACH**2 + 1e-9, 1 - 0.1 * square / REACH**2, 0)
        left = self._probability(total)
        points, shares = [], []
        for _ in range(NUM_CANDIDATES):
            mass = np.where(self._is_place, ndimage.correlate(left, disc, mode="constant"), -np.inf)
            row, col = np.unravel_index(int(np.argmax(mass >= mass.max() - 1e-9)), mass.shape)
            if points and mass[row, col] <= 0:
                break
            points.append(self._point(int(row), int(col)))
            shares.append(mass[row, col])
            rows, cols = np.ogrid[: left.shape[0], : left.shape[1]]
            left = np.where(((rows - row) ** 2 + (cols - col) ** 2) * self._step**2 <= REACH**2 + 1e-9, 0, left)
        return np.array(points), np.array(shares)

    def per_cell(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) the largest value of the places in each cell."""
        blocks = values.reshape(self._shape[0], self._sub, self._shape[1], self._sub).max(axis=(1, 3))
        return blocks[self._rows, self._cols]

    def _probability(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        weights = np.exp(logs - logs.max())
        return weights / weights.sum()

    def _point(self, row: int, col: int) -> tuple[float, float, float]:
        corner = np.asarray(self._memory.grid.origin_xz) + self._low[::-1] * self._memory.grid.cell
        x, z = corner + (np.array([col, row]) + 0.5) * self._step
        cell = self._low + np.array([row, col]) // self._sub
        return x, float(self._memory.cell_y[(self._memory.rc == cell).all(axis=1)][0]), z

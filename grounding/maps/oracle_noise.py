"""Oracle maps made worse in known ways (GROUNDING.md, section 0): clutter, noisy objects, blur, noisy cells.

A curve over one of these shows how a method fails; it does not predict success on maps built from camera views. Steps,
in this order: clutter, object noise, blur, cell noise.
"""

import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError, SceneError

from ..encoders.protocol import TextEncoder
from ..types import FeatureMap, map_from_cells
from .oracle_map import OracleHome, lower_median, objects_map, storey_objects


@dataclass(frozen=True, slots=True)
class OracleVariant:
    """Settings that make a map worse; the same values and home give the same map. All 0 = the map `objects`."""

    blur: float = 0.0
    """b, metres: an object spreads over the observed cells with a Gaussian of this sigma."""
    object_noise: float = 0.0
    """c: standard deviation of the error of an object's cosines, before its vector is made a unit vector again."""
    cell_noise: float = 0.0
    """c: the same for the cells, after the blur."""
    clutter: bool = False
    """Every observed cell without an object first gets the text of an object of another home."""
    seed: int = 0

    def __post_init__(self) -> None:
        values = (self.blur, self.object_noise, self.cell_noise)
        if not all(math.isfinite(value) and value >= 0 for value in values):
            raise AgentError(f"oracle map: {self!r}; expected blur and noise of at least 0. Correct the options.")


def other_texts(homes: Iterable[OracleHome], scene: str) -> tuple[str, ...]:
    """The texts of all objects in all homes except `scene`, for clutter; in the order of the homes."""
    return tuple(item.text for home in homes if home.scene != scene for item in home.objects)


def variant_map(
    home: OracleHome,
    encoder: TextEncoder,
    *,
    floor_id: str | None,
    variant: OracleVariant,
    clutter_texts: Sequence[str] = (),
) -> FeatureMap:
    """The map of a storey, made worse.

    Args:
        floor_id: Label of the storey; None merges all storeys.
        clutter_texts: Texts of other homes (`other_texts`); drawn from when the variant has clutter.

    Raises:
        SceneError: No object has this label, or there is no text to draw clutter from.
    """
    chosen = storey_objects(home, floor_id)
    if not (variant.blur or variant.clutter or variant.object_noise or variant.cell_noise):
        return objects_map(home, encoder, floor_id=floor_id)
    # an object has the same error on every map of its home, merged or not
    key = zlib.crc32(home.scene.encode())
    object_rng = np.random.default_rng([variant.seed, key, 0])
    cell_rng = np.random.default_rng([variant.seed, key, 1, zlib.crc32(repr(floor_id).encode())])
    vectors = encoder.encode_texts([item.text for item in home.objects])
    vectors = noisy(vectors, variant.object_noise, object_rng)[chosen]
    places = np.array([home.objects[index].position for index in chosen])[:, [0, 2]]
    cells, heights = _observed(home, floor_id, chosen)
    if variant.clutter:
        taken = {tuple(rc) for rc in home.grid.rc_from_xz(places).tolist()}
        free = np.array([rc for rc in cells.tolist() if tuple(rc) not in taken]).reshape(-1, 2)
        texts = _drawn(clutter_texts, len(free), home.scene, cell_rng)
        spots = home.grid.xz_from_rc(free) + cell_rng.uniform(-0.5, 0.5, free.shape) * home.grid.cell
        added = noisy(encoder.encode_texts(texts), variant.object_noise, cell_rng)
        vectors, places = np.concatenate([vectors, added]), np.concatenate([places, spots])
    sums = _spread(home, cells, places, blur=variant.blur) @ vectors
    filled = np.linalg.norm(sums, axis=1) > 0
    rows = noisy(sums[filled], variant.cell_noise, cell_rng)
    floors = np.array([home.objects[index].floor_y for index in chosen])
    return map_from_cells(
        rows,
        cells[filled],
        grid=home.grid,
        floor_y=lower_median(floors),
        encoder=encoder.name,
        centre_xz=home.centre_xz,
        cell_y=heights[filled],
    )


def noisy(vectors: NDArray[np.floating], c: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """unit(v + c sqrt(E) n) for the rows (N, E) as unit vectors v; n is a random unit vector.

    Before the last `unit`, cosines have errors with standard deviation c.
    """
    rows = np.asarray(vectors, np.float64)
    rows = _unit(rows)
    if not c:
        return rows
    return _unit(rows + c * math.sqrt(rows.shape[1]) * _unit(rng.standard_normal(rows.shape)))


def _unit(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(norms > 0, norms, 1)


def _observed(
    home: OracleHome, floor_id: str | None, chosen: Sequence[int]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cells (N, 2), row-major, that hold an object or a view point of the storey, and the floor's height in each."""
    objects = [home.objects[index] for index in chosen]
    stands = [place for label, place in home.stands if floor_id is None or label == floor_id]
    xz = np.array([(item.position[0], item.position[2]) for item in objects] + [(x, z) for x, _, z in stands])
    floors = np.array([item.floor_y for item in objects] + [y for _, y, _ in stands])
    cells, inverse = np.unique(home.grid.rc_from_xz(xz), axis=0, return_inverse=True)
    heights = [lower_median(floors[inverse == index]) for index in range(len(cells))]
    return cells, np.array(heights)


def _drawn(texts: Sequence[str], count: int, scene: str, rng: np.random.Generator) -> list[str]:
    if count and not texts:
        raise SceneError(
            f"{scene}: found no object of another home; expected some to draw clutter from. "
            "Give a dataset of two homes or more, or leave --clutter-texts out."
        )
    return [texts[int(index)] for index in rng.integers(len(texts), size=count)] if count else []


def _spread(
    home: OracleHome, cells: NDArray[np.int64], places: NDArray[np.float64], *, blur: float
) -> NDArray[np.float64]:
    """Weights (N, M) of objects at `places` (M, 2) in the cells (N, 2); without blur, 1 in an object's own cell."""
    if not blur:
        return (cells[:, None] == home.grid.rc_from_xz(places)[None]).all(axis=2).astype(np.float64)
    square = ((home.grid.xz_from_rc(cells)[:, None] - places[None]) ** 2).sum(axis=2)
    # rows become unit vectors later, so each may be scaled here; unscaled, far cells would round to zero
    return np.exp(-(square - square.min(axis=1, keepdims=True)) / (2 * blur**2))

"""Maps with cosines computed by hand: one axis per object, and texts and cells as weighted sums of axes."""

from collections.abc import Mapping, Sequence

import numpy as np

from grounding.types import FeatureMap, map_from_cells
from sim.types import GridSpec, Task

THINGS = ("chair", "sofa", "lamp", "rug", "bed", "other")
ORIGIN = (-2.0, 3.0)


def vector(weights: Mapping[str, float]) -> np.ndarray:
    """The unit vector with these weights on the axes of objects."""
    row = np.array([weights.get(thing, 0.0) for thing in THINGS])
    return row / np.linalg.norm(row)


class ToyEncoder:
    """Encodes a text as the sum of the axes of the objects that it names, or as "other" if it names none."""

    name = "toy"
    dim = len(THINGS)

    def encode_texts(self, texts: Sequence[str]) -> np.ndarray:
        named = [{thing: 1.0 for thing in THINGS if thing in text} or {"other": 1.0} for text in texts]
        return np.array([vector(weights) for weights in named], np.float32).reshape(len(texts), self.dim)


def toy_map(
    cells: Mapping[tuple[int, int], Mapping[str, float]],
    *,
    shape: tuple[int, int] = (8, 8),
    shift: int = 0,
    cell: float = 1.0,
    backwards: bool = False,
) -> FeatureMap:
    """A map of these cells; `shift` adds empty rows and columns before them, without moving the cells in the world."""
    places = list(cells)[::-1] if backwards else list(cells)
    return map_from_cells(
        np.array([vector(cells[rc]) for rc in places]),
        np.array(places) + shift,
        grid=GridSpec((ORIGIN[0] - shift * cell, ORIGIN[1] - shift * cell), cell, (shape[0] + shift, shape[1] + shift)),
        floor_y=0.5,
        encoder="toy",
    )


def xz(row: float, col: float) -> tuple[float, float]:
    """World x and z of the middle of a cell."""
    return (ORIGIN[0] + col + 0.5, ORIGIN[1] + row + 0.5)


def asks(query: str) -> Task:
    """A task with this query."""
    return Task("pog", "A home.", (query,))

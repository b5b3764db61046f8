"""What a builder of furniture gets and gives: an order, and parts."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .shapes import Shape, merged


class Part(NamedTuple):
    """A shape of one finish, in the piece's frame: x to its right, y up from its bottom, its front looks along +z."""

    shape: Shape
    finish: Finish


class Order(NamedTuple):
    """Which piece is wanted."""

    category: str
    size: Vec
    """Width, height, depth in metres, never smaller than the family can be built; parts.py shrinks the result."""
    finish: Finish
    """Of its main surface."""
    words: frozenset[str]
    """Lower-case words of the category and of what the caption says about the thing itself."""
    rng: np.random.Generator
    """Seeded by the piece's name, for what nobody said."""

    def says(self, *words: str) -> bool:
        """Whether any of the words is in the category or the caption."""
        return not self.words.isdisjoint(words)


Builder = Callable[[Order], list[Part]]


def made_of(finish: Finish, *shapes: Shape) -> Part:
    """One part of several shapes."""
    return Part(merged(shapes), finish)

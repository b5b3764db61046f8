"""A piece of furniture while it is being built: what is wanted of it, and the parts that it has so far."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .shapes import Shape, merged


class Part(NamedTuple):
    """A shape of one finish, in the piece's frame: x to its right, y up from its bottom, its front looks along +z."""

    shape: Shape
    finish: Finish


@dataclass
class Draft:
    """What a family's builder is given and fills."""

    size: Vec
    """Width, height, depth in metres, never smaller than the family can be built; parts.py shrinks the result."""
    finish: Finish
    """Of its main surface."""
    words: frozenset[str]
    """Lower-case words of the category and of what the caption says about the thing itself."""
    rng: np.random.Generator
    """Seeded by the piece's name, for what nobody said."""
    parts: list[Part] = field(default_factory=list)

    def says(self, *words: str) -> bool:
        """Whether any of the words is in the category or the caption."""
        return not self.words.isdisjoint(words)

    def add(self, finish: Finish, *shapes: Shape) -> None:
        """One more part, of several shapes."""
        self.parts.append(Part(merged(shapes), finish))

    def section(self, size: Vec, finish: Finish | None = None) -> "Draft":
        """An empty draft for a section of the piece, built about its own middle; `put` sets it in its place."""
        return Draft(size, finish or self.finish, self.words, self.rng)

    def put(self, section: "Draft", *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """Adds the parts of a section, moved by (x, y, z) metres."""
        self.parts += [Part(part.shape.moved(x, y, z), part.finish) for part in section.parts]


Builder = Callable[[Draft], None]

"""Looks at a home before the task, which people get in some conditions of a study; an agent may take them too."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim.types import Observation

LookKind = Literal["topdown", "glb"]
"""What is looked at: pictures of the storeys from above, or the home itself (people: its 3-D model)."""


@dataclass(frozen=True, slots=True)
class StoreyPicture:
    """A storey from above, pixel for pixel as people see it; nothing says where the robot will start."""

    rgb: NDArray[np.uint8]
    """(H, W, 3); a strip at the bottom names the storey and holds the scale."""
    metres_per_pixel: float


@dataclass(frozen=True, slots=True)
class HomeLook:
    """What an agent sees of a home before the task: pictures from above, or the views of a walk."""

    kind: LookKind
    pictures: tuple[StoreyPicture, ...] = ()
    """`topdown`: every storey, lowest first."""
    views: Callable[[], Iterator[Observation]] = lambda: iter(())
    """`glb`: renders the views of a walk on the storey of the start, in order; their frame is the start frame of the
    episode that follows, and `step` counts them."""


@runtime_checkable
class LooksFirst(Protocol):
    """An agent that can look at a home before the task; both members are optional for an `Agent`."""

    looks: frozenset[LookKind]
    """The kinds of looks that it can use."""

    def look(self, home: HomeLook) -> None:
        """Looks at the home of the next episode and forgets other homes; `reset(..., keep_memory=True)` follows."""
        ...

"""From metres on the floor plan to pixels of a drawing; north (-z) is up."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class PlanView:
    """The part of a floor plan that a drawing shows, and how large."""

    low: tuple[float, float]
    """World (x, z) of the upper left corner, metres."""
    scale: float
    """Pixels per metre."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""

    @classmethod
    def around(cls, xz: NDArray[np.float64], *, margin: float, longest: int, least: int = 0) -> "PlanView":
        """The view of all places (N, 2), at least one, with room around them.

        Args:
            xz: World x and z, metres.
            margin: Metres around them.
            longest: Pixels of the longer side.
            least: Pixels that each side has at least.
        """
        low, high = xz.min(axis=0) - margin, xz.max(axis=0) + margin
        scale = longest / float(max(high - low))
        width, height = (max(least, round(side * scale)) for side in (high - low).tolist())
        return cls((float(low[0]), float(low[1])), scale, width, height)

    def pixels(self, xz: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) right and down from the upper left corner, of world x and z (..., 2)."""
        return (np.asarray(xz, np.float64) - np.array(self.low)) * self.scale

"""Where POG bots point: at the target of their present trial, or anywhere in its home."""

from dataclasses import dataclass

import numpy as np

from sim.tasks.run_files import Vector3
from sim.types import EpisodeKey

from .homes import BotHomes

_BESIDE = 0.3
"""How far beside a place (metres)."""


@dataclass(frozen=True, slots=True)
class Aim:
    """A place to point at."""

    storey: int
    """Index of the storey on which it is, as the page counts them, from 0."""
    point: Vector3
    """World metres, on the storey's floor."""


def beside(aim: Aim) -> list[Aim]:
    """Four places round a place: where a click at the place itself meets nothing, one of these does."""
    x, y, z = aim.point
    sides = ((_BESIDE, 0.0), (0.0, _BESIDE), (-_BESIDE, 0.0), (0.0, -_BESIDE))
    return [Aim(aim.storey, (x + dx, y, z + dz)) for dx, dz in sides]


class GoalFinder:
    """Places in the home of each participant's present trial: ground truth, for bots on our own machine only."""

    def __init__(self, homes: BotHomes) -> None:
        """Opens no home yet."""
        self._homes = homes

    def goal(self, code: str) -> Aim | None:
        """The first target of the participant's present trial; None when there is none."""
        key = self._homes.due(code)
        if key is None:
            return None
        (target, *_) = self._homes.episode(key).targets
        heights = self._heights(key)
        storey = int(np.argmin([abs(height - target.floor_y) for height in heights]))
        x, _, z = target.position
        return Aim(storey, (x, heights[storey], z))

    def anywhere(self, code: str, rng: np.random.Generator) -> Aim | None:
        """A place to stand on any storey of the home of the participant's present trial; None when there is none."""
        key = self._homes.due(code)
        if key is None:
            return None
        heights = self._heights(key)
        storey = int(rng.integers(len(heights)))
        free = self._homes.scene(key.scene).navigation.top_down(heights[storey])
        cells = np.argwhere(free.free)
        x, z = free.grid.xz_from_rc(cells[int(rng.integers(len(cells)))]).tolist()
        return Aim(storey, (x, heights[storey], z))

    def _heights(self, key: EpisodeKey) -> tuple[float, ...]:
        return self._homes.scene(key.scene).navigation.storey_heights

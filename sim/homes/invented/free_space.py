"""Free space for more pieces in a room of an invented home, so that doors, windows and paths stay free."""

from collections.abc import Sequence
from typing import NamedTuple

from ..plan import Rect
from .partitions import Partition

GAP = 0.12
"""Least distance between pieces on the floor (metres)."""
FRONT = 0.7
"""Free depth in front of a piece; the robot needs 0.36 m."""
HALF_WALL = 0.06
_TALL = 0.9
"""Pieces of at least this height would cover a window (metres)."""
_DOOR_DEPTH = 1.0


class Body(NamedTuple):
    """The space that a piece of furniture takes."""

    rect: Rect
    low: float
    high: float
    """Upper end above the floor, like `low` in metres."""


class Pane(NamedTuple):
    """A window seen from above."""

    middle: tuple[float, float]
    """The window's middle (x, z)."""
    width: float


class FreeSpace:
    """One room while it is being furnished: pieces take space until it is full."""

    def __init__(self, rect: Rect, partition: Partition, *, blocked: Sequence[Rect]) -> None:
        """Starts with an empty room.

        Args:
            rect: Middle lines of its walls.
            partition: The storey's walls and gaps; those far from the room have no effect.
            blocked: Areas where nothing may stand (stairs and their ends).
        """
        self.inner = rect.grown(-HALF_WALL)
        openings = [(wall, opening) for wall in partition.walls for opening in wall.openings]
        doors = [wall.floor_beside(o, depth=_DOOR_DEPTH, margin=0.1) for wall, o in openings if o.kind == "door"]
        gaps = [_widened(gap, 0.85) for gap in partition.gaps]
        self._panes = [wall.floor_beside(o, depth=0.3, margin=0.02) for wall, o in openings if o.kind == "window"]
        self._keep_free = [*blocked, *doors, *gaps]
        self.windows = [
            Pane(wall.middle_of(o), o.width)
            for wall, o in openings
            if o.kind == "window" and rect.grown(0.01).holds(*wall.middle_of(o))
        ]
        self._bodies: list[Body] = []
        self._fronts: list[Rect] = []

    def take_floor(self, bodies: Sequence[Body], front: Rect) -> bool:
        """Whether a group fits with the free strip in front of it; if so its space is taken."""
        whole = bounds([body.rect for body in bodies])
        standing = [body for body in self._bodies if body.low < 1.5]
        if not self.inner.grown(0.001).holds_rect(whole) or not self.inner.grown(0.01).holds_rect(front):
            return False
        if any(whole.overlaps(zone) for zone in self._keep_free) or any(whole.overlaps(zone) for zone in self._fronts):
            return False
        if any(whole.grown(GAP).overlaps(body.rect) or front.overlaps(body.rect) for body in standing):
            return False
        if any(body.high > _TALL and body.rect.overlaps(pane) for body in bodies for pane in self._panes):
            return False
        if any(body.rect.overlaps(hung.rect) and body.high > hung.low for body in bodies for hung in self._bodies):
            return False
        self._bodies += bodies
        self._fronts.append(front)
        return True

    def take_wall(self, body: Body, *, beside_window: bool = False) -> bool:
        """Whether a piece can hang here above the pieces below; if so its space is taken."""
        near = body.rect.grown(0.06)
        if not self.inner.grown(0.001).holds_rect(body.rect) or any(near.overlaps(zone) for zone in self._keep_free):
            return False
        if not beside_window and any(near.overlaps(pane) for pane in self._panes):
            return False
        if any(
            near.overlaps(other.rect) and body.low < other.high + 0.05 and other.low < body.high
            for other in self._bodies
        ):
            return False
        self._bodies.append(body)
        return True

    def takes_flat(self, rect: Rect) -> bool:
        """Whether a rug fits here; people walk over it, so it takes no space from others."""
        blocked = (*self._keep_free, *(body.rect for body in self._bodies if body.low < 0.5))
        return self.inner.holds_rect(rect) and not any(rect.overlaps(zone) for zone in blocked)

    def take_flat(self, rect: Rect) -> bool:
        """As `takes_flat`; no further rug may overlap it, nor may pieces stand on it."""
        if not self.takes_flat(rect):
            return False
        self._bodies.append(Body(rect, 0.0, 0.02))
        return True


def bounds(rects: Sequence[Rect]) -> Rect:
    """The smallest rectangle around all of them."""
    x0, z0, x1, z1 = zip(*rects, strict=True)
    return Rect(min(x0), min(z0), max(x1), max(z1))


def _widened(line: Rect, depth: float) -> Rect:
    """The floor on both sides of a line without width."""
    if line.z0 == line.z1:
        return Rect(line.x0, line.z0 - depth, line.x1, line.z1 + depth)
    return Rect(line.x0 - depth, line.z0, line.x1 + depth, line.z1)

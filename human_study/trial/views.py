"""The views that a session shows; a test walks every field of them for ground truth."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.tasks.run_files import Vector3
from sim.types import Task

from .events import Event, MapKind


@dataclass(frozen=True, slots=True)
class LookView:
    """The view before the task: a map or the home, without texts."""

    what: MapKind
    storeys: tuple[float, ...]
    """Floor height of each storey that can be shown, metres, ascending."""
    storey: int
    """Index of the shown one."""
    wait_s: int
    """Whole seconds until the participant may leave it; 0 = now."""
    left_s: int | None
    """Whole seconds until it closes by itself; None = no limit."""
    has_names: bool = False
    """Whether names that are shown on demand are wanted."""


@dataclass(frozen=True, slots=True)
class PanView:
    """The view of a walking PAN participant; holds no ground truth."""

    task: Task
    rgb: NDArray[np.uint8] | None
    """(H, W, 3) the robot's picture; None when the environment does not render."""
    step: int
    """Actions taken so far."""
    is_armed: bool
    """Whether another press of STOP now ends the trial."""
    is_over: bool
    is_giving_up: bool = False
    """Whether another press of giving up now ends the trial."""
    left_s: int | None = None
    """Seconds until the time is up, in coarse steps; None = there is no limit."""
    is_blocked: bool = False
    """Whether the last step was blocked, which a sign beside the picture shows."""


@dataclass(frozen=True, slots=True)
class MarkedObject:
    """An object of a home as its outline: no name, which would lead to the public files."""

    category: str
    centre: Vector3
    """Middle of its box, world metres."""
    size: Vector3
    """Extents of its box along x, y, z, metres."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A participant's mark; world metres."""

    point: Vector3
    """The answer once it is confirmed: `hit`, or the middle of `item`."""
    hit: Vector3
    """Where the click met the home."""
    storey: int
    """Index of the storey that was shown then."""
    item: MarkedObject | None = None
    """The object to which the mark went."""


@dataclass(frozen=True, slots=True)
class PogView:
    """The view of a pointing POG participant; holds no ground truth and never says whether a point is right."""

    task: Task
    storeys: tuple[float, ...]
    """Floor height of each storey that can be shown, metres, ascending."""
    storey: int
    """Index of the shown one."""
    mark: Mark | None
    is_over: bool
    is_giving_up: bool = False
    """Whether another press of giving up now ends the trial."""
    left_s: int | None = None
    """Seconds until the time is up, in coarse steps; None = there is no limit."""
    has_names: bool = False
    """Whether names that are shown on demand are wanted."""


@dataclass(frozen=True, slots=True)
class RateView:
    """The question about confidence in the answer."""

    choices: tuple[int, ...]
    """From guessed to certain."""


TaskViewT = TypeVar("TaskViewT", PanView, PogView)


@dataclass(frozen=True, slots=True)
class SessionUpdate(Generic[TaskViewT]):
    """The result of a command."""

    events: tuple[Event, ...]
    """Store these first, all or none."""
    view: LookView | TaskViewT | RateView
    """Show this when they are stored."""

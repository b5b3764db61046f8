"""What a session shows; a test walks every field of these for ground truth."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.tasks.run_files import Vector3
from sim.types import Task

from .events import Event


@dataclass(frozen=True, slots=True)
class PanView:
    """All that a PAN participant may see; holds no ground truth."""

    task: Task
    rgb: NDArray[np.uint8] | None
    """(H, W, 3) what the robot sees; None when the environment does not render."""
    step: int
    """Actions taken so far."""
    is_armed: bool
    """Whether another press of STOP now ends the trial."""
    is_over: bool


@dataclass(frozen=True, slots=True)
class PogView:
    """All that a POG participant may see; holds no ground truth and never says whether a point is right."""

    task: Task
    storeys: tuple[float, ...]
    """Floor height of each storey that can be shown, metres, ascending."""
    storey: int
    """Index of the shown one."""
    marker: Vector3 | None
    """The marked point, world metres."""
    is_over: bool


ViewT = TypeVar("ViewT", PanView, PogView)


@dataclass(frozen=True, slots=True)
class SessionUpdate(Generic[ViewT]):
    """What a command led to."""

    events: tuple[Event, ...]
    """Store these first, all or none."""
    view: ViewT
    """Show this when they are stored."""

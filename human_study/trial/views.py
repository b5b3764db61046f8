"""The views that a session shows; a test walks every field of them for ground truth."""

from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

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


class Note(NamedTuple):
    """A message of a home sequence, as participants read it."""

    text: str
    search: int
    """Index of the search before which it was told; the intro was told before search 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchView:
    """The part of a view that belongs to home sequences: the present search, and nothing of later ones."""

    notes: tuple[Note, ...] = ()
    """The messages that can be read now, oldest first; () in an episode, and where history is hidden and nothing was
    told before this search."""
    query: str = ""
    """The object to find now."""
    search: int = 0
    """Index of the present search."""
    num_searches: int | None = None
    """Number of searches; None = the trial is an episode, and all of these fields have their defaults."""
    is_for_all: bool = False
    """Whether all right objects are to be marked before the search is ended."""


@dataclass(frozen=True, slots=True)
class PanView(SearchView):
    """The view of a walking PAN participant; holds no ground truth."""

    task: Task
    """The texts; in a home sequence those of the present search: the readable notes are the description."""
    rgb: NDArray[np.uint8] | None
    """(H, W, 3) the robot's picture; None when the environment does not render."""
    step: int
    """Actions taken so far, in a home sequence in the present search."""
    is_armed: bool
    """Whether another press of STOP now ends the trial; in a home sequence, whether it now is FOUND."""
    is_over: bool
    is_giving_up: bool = False
    """Whether another press of giving up now ends the trial, or the present search of a sequence."""
    left_s: int | None = None
    """Seconds until the time is up, in coarse steps; None = there is no limit."""
    is_blocked: bool = False
    """Whether the last step was blocked, which a sign beside the picture shows."""
    num_marks: int = 0
    """Objects marked in a search for all; FOUND at once after the last mark ends the search."""
    is_just_marked: bool = False
    """Whether the last action marked an object, so that FOUND now ends the search for all."""


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
class PogView(SearchView):
    """The view of a pointing POG participant; holds no ground truth and never says whether a point is right."""

    task: Task
    """The texts; in a home sequence those of the present search: the readable notes are the description."""
    storeys: tuple[float, ...]
    """Floor height of each storey that can be shown, metres, ascending."""
    storey: int
    """Index of the shown one."""
    mark: Mark | None
    """The newest mark."""
    is_over: bool
    is_giving_up: bool = False
    """Whether another press of giving up now ends the trial, or the present search of a sequence."""
    left_s: int | None = None
    """Seconds until the time is up, in coarse steps; None = there is no limit."""
    has_names: bool = False
    """Whether names that are shown on demand are wanted."""
    marks: tuple[Mark, ...] = ()
    """All marks, oldest first: several in a search for all, else `mark` alone."""


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

"""The terms of one trial besides the task: time limits, and the look at a home before it, with its events and view."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from sim.types import TaskKind

from ..design.study import Condition, HomeView, StudyConfig
from .events import Event, MapKind, MapOff, MapOn, Moment
from .views import LookView

LOOKING_EVERY_S = 5.0
"""An interrupted look loses at most this much of its time."""
STOP_WITHIN_S = 2.0
"""The second press of STOP counts up to this long after the first (DESIGN.md, keys)."""
GIVE_UP_WITHIN_S = 5.0
"""The second press of giving up counts up to this long after the first."""
RESUME_WITHIN_S = 600.0
"""Default of StudyConfig.resume_within_s."""
HIDDEN: Condition = "history_hidden"
"""The condition of home sequences in which only the messages of the present search can be read."""
SHOWS_HOME: tuple[Condition, ...] = ("glb", "map_first", "map_open")
"""Conditions in which participants look around in a 3-D home."""


@dataclass(frozen=True, slots=True)
class Look:
    """A look at a home before the task."""

    what: MapKind
    min_s: float = 0.0
    """Shortest look."""
    max_s: float | None = None
    """Longest look; None = it ends only when the participant begins the task."""


@dataclass(frozen=True, slots=True)
class TrialTerms:
    """The limits of one trial."""

    condition: Condition | None = None
    """The trial's condition; None in records of the first version of studies."""
    home_view: HomeView | None = None
    """Where the pictures of a 3-D home are made; None = no such home is shown."""
    look: Look | None = None
    """The look before the task; None = there is none."""
    task_max_s: float | None = None
    """Longest walk, from the first picture, or longest answer, from the texts; in a home sequence each search has this
    limit; None = no limit."""
    resume_within_s: float = RESUME_WITHIN_S
    """A longer absence ends the trial as `abandoned`."""
    asks_confidence: bool = False
    """Whether participants rate their confidence after an answer (STOP, a confirmed mark)."""

    @property
    def has_history(self) -> bool:
        """In home sequences: whether the messages of earlier searches can be read again."""
        return self.condition != HIDDEN


def terms_of(
    config: StudyConfig, condition: Condition, *, task: TaskKind | None = None, home_view: HomeView | None = None
) -> TrialTerms:
    """The terms of a study's trials in one condition.

    Args:
        config: The study.
        condition: The condition.
        task: The task; needed in studies of home sequences, whose conditions are the same for both.
        home_view: Where 3-D homes are drawn, if they are shown.
    """
    view = condition
    if config.sequences is not None:
        assert task is not None, "a study of home sequences"
        view = config.view_in(task, condition)
    is_pan = view in ("none", "topdown", "glb")
    return TrialTerms(
        condition=condition,
        home_view=home_view if view in SHOWS_HOME else None,
        look=look_of(config, view),
        task_max_s=config.pan_max_s if is_pan else config.pog.answer_max_s,
        resume_within_s=config.resume_within_s,
        asks_confidence=config.confidence,
    )


def look_of(config: StudyConfig, view: Condition) -> Look | None:
    """The look at a home before the task that belongs to a view of it; None = there is none."""
    if view == "topdown" or view == "glb":
        return Look(view, config.memory.min_s, config.memory.max_s)
    if view == "map_first":
        return Look("home", config.pog.look_min_s, config.pog.look_max_s)
    return None


class LookPhase:
    """One look; all times are on the trial's clock, which stands still during absences."""

    def __init__(self, look: Look) -> None:
        """A look that begins at 0 unless `rebuild` says otherwise."""
        self.what: MapKind = look.what
        self._look = look
        self._began_s = 0.0
        self._logged_s = 0.0

    def on(self, t_s: float) -> MapOn:
        """The event of showing the home, for the first time or again."""
        return MapOn(t_s=t_s, what=self.what, min_s=self._look.min_s, max_s=self._look.max_s)

    def off(self, reason: Literal["left", "time"], t_s: float) -> MapOff:
        """The event of the look's end."""
        return MapOff(t_s=t_s, what=self.what, reason=reason, look_s=t_s - self._began_s)

    def may_leave(self, t_s: float) -> bool:
        """Whether the shortest time is over."""
        return t_s - self._began_s >= self._look.min_s

    def is_up(self, t_s: float) -> bool:
        """Whether the longest time is over."""
        return self._look.max_s is not None and t_s - self._began_s >= self._look.max_s

    def log(self, t_s: float) -> tuple[Moment, ...]:
        """An event, now and then, that the home is still shown."""
        if t_s - self._logged_s < LOOKING_EVERY_S:
            return ()
        self._logged_s = t_s
        return (Moment(kind="looking", t_s=t_s),)

    def moments(self, t_s: float) -> list[float]:
        """Times at which the look ends by itself or the displayed seconds change."""
        limits = [self._look.min_s] if self._look.max_s is None else [self._look.min_s, self._look.max_s]
        next_second = self._began_s + math.floor(t_s - self._began_s) + 1
        return [*(self._began_s + limit for limit in limits), self._logged_s + LOOKING_EVERY_S, next_second]

    def view(self, t_s: float, *, storeys: tuple[float, ...], storey: int) -> LookView:
        """The view to show."""
        seen_s, max_s = t_s - self._began_s, self._look.max_s
        left_s = None if max_s is None else max(0, math.ceil(max_s - seen_s))
        return LookView(self.what, storeys, storey, max(0, math.ceil(self._look.min_s - seen_s)), left_s)

    def rebuild(self, events: Sequence[Event]) -> None:
        """The state after these stored events."""
        times = [event.t_s for event in events if event.kind in ("map_on", "looking") and event.t_s is not None]
        self._began_s, self._logged_s = min(times, default=0.0), max(times, default=0.0)

"""The state machine of every trial: look, task, rating; with its limits, absences and page events.

`PanSession` and `PogSession` add their task. The caller stores the events first and shows the view after that. If
storing fails, drop the session and rebuild it from the stored events. Sessions know no goal; results come from
`outcome`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Generic, Literal, Self

from sim.errors import TaskStateError
from sim.types import EndReason, EpisodeKey, Task

from .clock import TimeLimit, TrialClock
from .commands import (
    RATINGS,
    CloseMap,
    Command,
    Fail,
    GiveUp,
    LookFrom,
    Measure,
    PageChanged,
    PageCommand,
    Rate,
    Resize,
    Resume,
    ShowNames,
    ShowStorey,
    Start,
    Tick,
)
from .events import (
    MAX_SIDE,
    Abandoned,
    Cam,
    Confidence,
    Dropped,
    Error,
    Event,
    MapOff,
    Moment,
    Net,
    Open,
    Resized,
    ShownStorey,
    TimedOut,
)
from .outcome import opening, task_began_s, trial_end
from .searches import SearchTexts, search_parts
from .terms import GIVE_UP_WITHIN_S, LookPhase, TrialTerms
from .views import LookView, RateView, SessionUpdate, TaskViewT

GIVE_UP_AFTER_S = 0.5
"""The second press of giving up does not count sooner than this: a double click is one press."""
CAMERA_EVERY_S = 0.5
"""Camera poses are kept at most twice a second (HUMAN_STUDY.md, section 2)."""
RATE_WITHIN_S = 60.0
"""The question about confidence closes after this long, because the outcome waits for it."""
JUST_AFTER_S = 0.01
"""Ticks come this long after the moment at which a press counts for the last time."""
SIZE_STEP = 50
"""Pixels to which a page's size is rounded."""
Phase = Literal["look", "task", "rate", "done"]


class TrialSession(ABC, Generic[TaskViewT]):
    """One participant in one trial, from its first screen to the last question."""

    def __init__(
        self,
        *,
        key: EpisodeKey,
        task: Task,
        storeys: tuple[float, ...],
        scene_digest: str,
        terms: TrialTerms,
        searches: SearchTexts | None = None,
    ) -> None:
        """Shows nothing before `Start`.

        Args:
            task: The participant's texts, and the allowed actions; of a home sequence its first texts.
            storeys: Floor height of each storey, ascending (`NavigationMap.storey_heights`).
            terms: The look before the task, the question after it, and the limits.
            searches: The texts of a home sequence; None = an episode.
        """
        self._key, self._task, self._storeys, self._scene_digest = key, task, storeys, scene_digest
        self._terms, self._searches = terms, searches
        self._search = 0
        """Index of the present search of a sequence."""
        self._clock = TrialClock()
        self._look = LookPhase(terms.look) if terms.look is not None else None
        self._task_began_s: float | None = None
        self._limit: TimeLimit | None = None
        self._storey = 0
        self._has_names = False
        self._camera_s = -math.inf
        self._new_camera: LookFrom | None = None
        """The newest camera pose, until it is stored."""
        self._handled_s = 0.0
        self._giving_up_s = -math.inf
        self._ended: EndReason | None = None
        self._ended_s = 0.0
        self._is_rated = not terms.asks_confidence

    @property
    def end_reason(self) -> EndReason | None:
        """The reason why the task is over; None while it is running."""
        return self._ended

    @property
    def is_over(self) -> bool:
        """Whether the task takes no more commands; a question may still be open."""
        return self._ended is not None

    @property
    def is_done(self) -> bool:
        """Whether the trial is complete, so that the outcome can be stored."""
        return self.phase == "done"

    @property
    def phase(self) -> Phase:
        """The present screen."""
        if self._ended is not None:
            return "rate" if self._ended in ("stop", "click") and not self._is_rated else "done"
        return "look" if self._task_began_s is None else "task"

    def view(self, now_s: float) -> LookView | TaskViewT | RateView:
        """The view to show now."""
        t_s = self._clock.read(now_s)
        match self.phase:
            case "look":
                assert self._look is not None
                seen = self._look.view(t_s, storeys=self._storeys, storey=self._storey)
                return replace(seen, has_names=self._has_names)
            case "rate":
                return RateView(RATINGS)
            case _:
                return self._task_view(t_s)

    def wait_s(self, now_s: float) -> float | None:
        """Seconds until the next `Tick`, at which something happens or looks different; 0 = now, None = never."""
        moments = [moment for moment in self._moments(self._handled_s) if moment > self._handled_s]
        return max(0.0, min(moments) - self._clock.read(now_s)) if moments else None

    def after(self, events: Sequence[Event]) -> Self:
        """This new session after all stored events of the trial, in order; its next command is `Resume`.

        Phase, step and pose, storey and mark are as they were.

        Raises:
            StudyError: The events do not begin with `open`.
            TaskStateError: The events belong to another episode or scene.
        """
        self._rebuild(events)
        return self

    def handle(self, command: Command, now_s: float, *, busy: bool = False) -> SessionUpdate[TaskViewT]:
        """Handles one command; after the end only `Rate` has an effect.

        Args:
            now_s: Seconds on a steady clock, the same one for the whole life of this object.
            busy: Whether the picture of an earlier action is still being sent: presses are then dropped and logged.

        Raises:
            TaskStateError: The first command is not Start (Resume for a rebuilt session), or Start comes again.
        """
        if isinstance(command, Start | Resume):
            self._clock.begin(now_s, is_start=isinstance(command, Start))
        t_s = self._clock.read(now_s)
        if isinstance(command, Start):
            events = self._start(t_s)
        elif isinstance(command, Resume):
            events = self._resume(command, t_s)
        else:
            events = (*self._due(t_s), *self._on(command, t_s, busy=busy), *self._camera_events(t_s))
        self._handled_s = t_s
        return SessionUpdate(events, self.view(now_s))

    @abstractmethod
    def _open_event(self, t_s: float) -> Open:
        """The trial's first event."""

    @abstractmethod
    def _show_task(self, t_s: float, *, again: bool = False) -> tuple[Event, ...]:
        """Shows the task, for the first time or again after an absence."""

    @abstractmethod
    def _on_task(self, command: Command, t_s: float, *, busy: bool) -> tuple[Event, ...]:
        """Handles a command that only this task has."""

    @abstractmethod
    def _task_view(self, t_s: float) -> TaskViewT:
        """The task's screen."""

    def _begin_search(self, t_s: float) -> None:
        """Forgets what belongs to the search before; a press or click that comes at once was still meant for that."""
        self._giving_up_s = -math.inf
        self._clock.accept(t_s)
        self._begin_limit(t_s)

    def _opened(self) -> Open:
        """The fields that the first events of both tasks share."""
        return Open(
            task=self._task.kind,
            split=self._key.split,
            scene=self._key.scene,
            episode_id=self._key.episode_id,
            scene_digest=self._scene_digest,
            max_steps=self._task.max_steps,
            actions=self._task.actions,
            condition=self._terms.condition,
            home_view=self._terms.home_view,
        )

    def _end(self, reason: EndReason, event: Event) -> tuple[Event, ...]:
        """Ends the trial, or the present search of a sequence, after which the next one begins."""
        t_s = event.t_s or 0.0
        is_more = self._searches is not None and self._search + 1 < len(self._searches.prompts)
        if not is_more or reason in ("technical", "abandoned"):
            self._ended, self._ended_s = reason, t_s
            return (event,)
        self._search += 1
        self._begin_search(t_s)
        return (event, *self._search_shown(t_s))

    def _search_shown(self, t_s: float) -> tuple[Event, ...]:
        """The event of showing the present search; () in an episode."""
        if self._searches is None:
            return ()
        return (self._searches.begun(self._search, t_s, has_history=self._terms.has_history),)

    @property
    def _present_task(self) -> Task:
        """The texts that can be read now."""
        if self._searches is None:
            return self._task
        return self._searches.task(self._task, self._search, has_history=self._terms.has_history)

    @property
    def _search_view(self) -> dict[str, Any]:
        """The fields of a `SearchView`; {} in an episode."""
        if self._searches is None:
            return {}
        return self._searches.shown(self._search, has_history=self._terms.has_history)

    def _is_giving_up(self, t_s: float) -> bool:
        return t_s - self._giving_up_s <= GIVE_UP_WITHIN_S and not self.is_over

    def _left_s(self, t_s: float) -> int | None:
        """Remaining seconds of the task, rounded for display."""
        return self._limit.shown_s(t_s) if self._limit is not None else None

    def _moments(self, t_s: float) -> list[float]:
        """Times on the trial's clock at which something happens by itself."""
        if self._new_camera is not None and self._sees_home:
            return [self._camera_s + CAMERA_EVERY_S, *self._moments_of_phase(t_s)]
        return self._moments_of_phase(t_s)

    def _moments_of_phase(self, t_s: float) -> list[float]:
        match self.phase:
            case "look" if self._look is not None:
                return self._look.moments(t_s)
            case "task":
                limits = self._limit.moments(t_s) if self._limit is not None else []
                return [self._giving_up_s + GIVE_UP_WITHIN_S + JUST_AFTER_S, *limits]
            case "rate":
                return [self._ended_s + RATE_WITHIN_S]
            case _:
                return []

    def _start(self, t_s: float) -> tuple[Event, ...]:
        opened = self._open_event(t_s)
        return (opened, self._look.on(t_s)) if self._look is not None else (opened, *self._begin_task(t_s))

    def _begin_task(self, t_s: float) -> tuple[Event, ...]:
        self._task_began_s = t_s
        self._begin_limit(t_s)
        return (*self._search_shown(t_s), *self._show_task(t_s))

    def _begin_limit(self, t_s: float) -> None:
        """The time of the task, or of a search, begins."""
        if self._terms.task_max_s is not None:
            self._limit = TimeLimit(t_s, self._terms.task_max_s)

    def _leave_search(self, reason: EndReason, event: Event) -> tuple[Event, ...]:
        """Ends the trial or the search without an answer; shows the next search."""
        ended = self._end(reason, event)
        return ended if self.is_over else (*ended, *self._show_task(event.t_s or 0.0))

    def _leave_look(self, reason: Literal["left", "time"], t_s: float) -> tuple[Event, ...]:
        assert self._look is not None
        self._new_camera = None
        return (self._look.off(reason, t_s), *self._begin_task(t_s))

    def _resume(self, command: Resume, t_s: float) -> tuple[Event, ...]:
        self._giving_up_s = -math.inf
        if self.phase in ("rate", "done"):
            if self.phase == "done" or command.away_s <= self._terms.resume_within_s:
                return ()
            return self._rated(None, t_s)
        if command.away_s > self._terms.resume_within_s:
            return self._end("abandoned", Abandoned(t_s=t_s, away_s=command.away_s))
        taken = (Moment(kind="superseded", t_s=t_s),) if command.took_over else ()
        phase = self.phase
        due = self._due(t_s)
        if self.phase != phase or due:
            return (*taken, *due)
        if phase == "look" and self._look is not None:
            return (*taken, self._look.on(t_s))
        return (*taken, *self._search_shown(t_s), *self._show_task(t_s, again=True))

    def _due(self, t_s: float) -> tuple[Event, ...]:
        """Events that the time alone causes."""
        match self.phase:
            case "look":
                assert self._look is not None
                return self._leave_look("time", t_s) if self._look.is_up(t_s) else ()
            case "task" if self._limit is not None and self._limit.is_up(t_s):
                return self._leave_search("timeout", TimedOut(t_s=t_s, limit_s=self._limit.limit_s))
            case "rate" if t_s - self._ended_s >= RATE_WITHIN_S:
                return self._rated(None, t_s)
            case _:
                pass
        return ()

    def _on(self, command: Command, t_s: float, *, busy: bool) -> tuple[Event, ...]:
        """Handles a command in the present phase."""
        if isinstance(command, Tick):
            return self._look.log(t_s) if self.phase == "look" and self._look is not None else ()
        if self.phase == "done":
            return ()
        if self.phase == "rate":
            return self._rated(command.value, t_s) if isinstance(command, Rate) else ()
        if isinstance(command, PageCommand):
            return self._on_page(command, t_s)
        match command:
            case Fail(message=message):
                return self._end("technical", Error(t_s=t_s, message=message[:500], is_fatal=True))
            case CloseMap() if self.phase == "look" and self._look is not None:
                is_early = not self._look.may_leave(t_s)
                return (Dropped(t_s=t_s, reason="too_early"),) if is_early else self._leave_look("left", t_s)
            case GiveUp() if self.phase == "task":
                return self._give_up(t_s)
            case ShowStorey() if self._sees_home:
                return self._show_storey(command.storey, t_s)
            case ShowNames(is_shown=is_shown) if self._sees_home:
                self._has_names = is_shown
                return (Moment(kind="names_on" if is_shown else "names_off", t_s=t_s),)
            case LookFrom() if self._sees_home:
                self._new_camera = command
                return ()
            case _:
                return self._on_task(command, t_s, busy=busy)

    @property
    def _sees_home(self) -> bool:
        """Whether the present screen shows the home or its map."""
        return self.phase == "look" or (self.phase == "task" and self._task.kind == "pog")

    @property
    def _needs_webgl(self) -> bool:
        """Whether the present screen is drawn by WebGL."""
        if self.phase == "look":
            return self._look is not None and self._look.what != "topdown"
        return self._task.kind == "pog" and self.phase == "task"

    def _on_page(self, command: PageCommand, t_s: float) -> tuple[Event, ...]:
        match command:
            case Resize():
                return (Resized(t_s=t_s, width=_rounded(command.width), height=_rounded(command.height)),)
            case Measure():
                return (Net(t_s=t_s, round_trip_ms=command.round_trip_ms),)
            case PageChanged():
                event = Moment(kind=command.what, t_s=t_s, t_cli_ms=command.t_cli_ms)
                if command.what != "context_lost" or not self._needs_webgl:
                    return (event,)
                message = "The browser lost its WebGL context."
                return (event, *self._end("technical", Error(t_s=t_s, message=message, is_fatal=True)))

    def _give_up(self, t_s: float) -> tuple[Event, ...]:
        if self._clock.too_soon(t_s) or t_s - self._giving_up_s < GIVE_UP_AFTER_S:
            return (Dropped(t_s=t_s, reason="rate"),)
        if self._is_giving_up(t_s):
            return self._leave_search("giveup", Moment(kind="giveup", t_s=t_s))
        self._giving_up_s = t_s
        return (Moment(kind="giveup_armed", t_s=t_s),)

    def _show_storey(self, storey: int, t_s: float) -> tuple[Event, ...]:
        if not 0 <= storey < len(self._storeys):
            return (Dropped(t_s=t_s, reason="storey"),)
        self._storey = storey
        return (ShownStorey(t_s=t_s, storey_y=self._storeys[storey]),)

    def _camera_events(self, t_s: float) -> tuple[Event, ...]:
        """The newest camera pose as soon as it may be kept, so that the final pose of each movement is always kept."""
        look = self._new_camera
        if look is None or not self._sees_home or t_s < self._camera_s + CAMERA_EVERY_S:
            return ()
        self._camera_s, self._new_camera = t_s, None
        return (Cam(t_s=t_s, position=look.position, wxyz=look.wxyz),)

    def _rated(self, value: int | None, t_s: float) -> tuple[Event, ...]:
        self._is_rated = True
        return (Confidence(t_s=t_s, value=value),)

    def _rebuild(self, events: Sequence[Event]) -> None:
        """Takes over the state after these stored events, as `after` says."""
        opened = opening(events)
        if (opened.key, opened.scene_digest) != (self._key, self._scene_digest):
            raise TaskStateError(
                f"trial of {opened.key}: asked to resume on {self._key}, scene {self._scene_digest[:12]}; expected the "
                f"same episode and scene {opened.scene_digest[:12]}. Serve the study with the scenes it was begun with."
            )
        self._clock = TrialClock(already_s=max((event.t_s for event in events if event.t_s is not None), default=0.0))
        if self._look is not None:
            self._look.rebuild(events)
        if self._look is None or any(isinstance(event, MapOff) for event in events):
            self._task_began_s = task_began_s(events)
            parts = search_parts(events)
            self._search = max(0, len(parts) - 1)
            self._begin_limit((parts[-1].begun.t_s or 0.0) if parts else self._task_began_s)
        heights = [event.storey_y for event in events if isinstance(event, ShownStorey)]
        self._storey = self._storeys.index(heights[-1]) if heights else 0
        names = [event.kind for event in events if event.kind in ("names_on", "names_off")]
        self._has_names = names[-1:] == ["names_on"]
        end = trial_end(events)
        if end is not None:
            self._ended, self._ended_s = end[1], end[0].t_s or 0.0
        self._is_rated = self._is_rated or any(isinstance(event, Confidence) for event in events)


def _rounded(side: int) -> int:
    return min(MAX_SIDE, SIZE_STEP * round(max(0, side) / SIZE_STEP))

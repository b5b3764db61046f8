"""The two tasks of a trial as state machines, walking (PAN) and pointing (POG): a command in, events and a view out."""

import hashlib
import math
from collections.abc import Mapping, Sequence

import numpy as np

from sim.tasks.pan import PanEnv
from sim.types import Action, EndReason, EpisodeKey, Observation, Pose, Task

from .commands import Click, Command, Confirm, Move, PressStop, Resume, Unmark
from .events import Act, Clicked, Dropped, DropReason, Event, Key, Moment, Open, Shown, ShownStorey, Unmarked
from .outcome import last_marked, left_searches, walked_steps
from .searches import SearchTexts, search_parts
from .terms import STOP_WITHIN_S, TrialTerms
from .trial_session import JUST_AFTER_S, TrialSession
from .views import Mark, MarkedObject, PanView, PogView, SessionUpdate

_NO_TERMS = TrialTerms()


class PanSession(TrialSession[PanView]):
    """One participant walking in one PAN trial."""

    def __init__(
        self,
        env: PanEnv,
        *,
        key: EpisodeKey,
        task: Task,
        scene_digest: str,
        storeys: tuple[float, ...] = (),
        terms: TrialTerms = _NO_TERMS,
        looks_later: bool = False,
        searches: SearchTexts | None = None,
    ) -> None:
        """Takes over the environment; nothing is rendered or shown before `Start`.

        Args:
            env: The environment of the episode or sequence; the session owns it from now on. Its `max_steps` must be
                the task's.
            storeys: As for TrialSession; used only where `terms` has a look.
            looks_later: Whether a step's events come without its picture, so that they can be stored while it is
                rendered; `look` gives the picture after that.
            searches: The texts of a home sequence; the environment has the same prompts.
        """
        assert env.max_steps == task.max_steps, (env.max_steps, task.max_steps)
        super().__init__(key=key, task=task, storeys=storeys, scene_digest=scene_digest, terms=terms, searches=searches)
        self._env, self._looks_later = env, looks_later
        self._armed_s = -math.inf
        self._observation: Observation | None = None
        self._was_blocked = False
        """Whether the last step was blocked; forgotten after an absence, and when a search begins."""

    @property
    def observation(self) -> Observation | None:
        """The robot's observation now, for a watching researcher; None before `Start`. Participants get the view."""
        return self._observation

    @property
    def pose(self) -> Pose:
        """The robot's present pose."""
        return self._env.pose

    @property
    def last_action(self) -> Action | None:
        """The robot's last step; None before the first."""
        return self._env.steps[-1].action if self._env.steps else None

    @property
    def needs_look(self) -> bool:
        """Whether the last step's picture is missing (`looks_later`): call `look` when the step is stored."""
        return self._observation is None and bool(self._env.steps)

    def look(self, now_s: float) -> SessionUpdate[PanView]:
        """The picture of the last step, and the event of handing it out; after the end there is neither."""
        self._observation = self._env.observe()
        events = self._show_task(self._clock.read(now_s)) if self.phase == "task" else ()
        return SessionUpdate(events, self.view(now_s))

    def handle(self, command: Command, now_s: float, *, busy: bool = False) -> SessionUpdate[PanView]:
        """Like `TrialSession.handle`; an absence also disarms STOP and removes the sign of a blocked step."""
        if isinstance(command, Resume):
            self._armed_s, self._was_blocked = -math.inf, False
        return super().handle(command, now_s, busy=busy)

    def _open_event(self, t_s: float) -> Open:
        self._observation = self._env.reset()
        pose = self._env.pose
        return self._opened().model_copy(update={"t_s": t_s, "position": pose.position, "yaw": pose.yaw})

    def _show_task(self, t_s: float, *, again: bool = False) -> tuple[Event, ...]:
        rgb = self._observation.rgb if self._observation is not None else None
        digest = None if rgb is None else hashlib.sha256(np.ascontiguousarray(rgb).data).hexdigest()
        return (Shown(t_s=t_s, step=len(self._env.steps), frame_hash=digest, blocked=self._was_blocked),)

    def _task_view(self, t_s: float) -> PanView:
        begin = (0, *self._env.search_ends)[self._search]
        of_search = [step.action for step in self._env.steps[begin:]]
        is_for_all = self._searches is not None and self._searches.prompts[self._search].is_for_all
        return PanView(
            task=self._present_task,
            rgb=self._observation.rgb if self._observation is not None else None,
            step=len(of_search),
            is_armed=t_s - self._armed_s <= STOP_WITHIN_S and not self.is_over,
            is_over=self.is_over,
            is_giving_up=self._is_giving_up(t_s),
            left_s=self._left_s(t_s),
            is_blocked=self._was_blocked and self._observation is not None and not self.is_over,
            num_marks=of_search.count(Action.FOUND) if is_for_all else 0,
            is_just_marked=is_for_all and of_search[-1:] == [Action.FOUND] and not self.is_over,
            **self._search_view,
        )

    def _begin_search(self, t_s: float) -> None:
        super()._begin_search(t_s)
        self._armed_s, self._was_blocked = -math.inf, False

    def _end(self, reason: EndReason, event: Event) -> tuple[Event, ...]:
        if self._searches is not None and reason in ("giveup", "timeout"):
            self._env.end_search(reason)
        return super()._end(reason, event)

    def _moments(self, t_s: float) -> list[float]:
        moments = super()._moments(t_s)
        return [*moments, self._armed_s + STOP_WITHIN_S + JUST_AFTER_S] if self.phase == "task" else moments

    def _on_task(self, command: Command, t_s: float, *, busy: bool) -> tuple[Event, ...]:
        if not isinstance(command, Move | PressStop):
            return (Dropped(t_s=t_s, reason="phase"),)
        answer = Action.STOP if self._searches is None else Action.FOUND
        action = command.action if isinstance(command, Move) else answer
        key = Key(t_s=t_s, t_cli_ms=command.t_cli_ms, code=command.code[:32], action=action, repeat=command.repeat)
        reason = self._drop_reason(action, t_s, repeat=command.repeat, busy=busy)
        if reason is not None:
            return (key, Dropped(t_s=t_s, reason=reason))
        self._clock.accept(t_s)
        if action is answer and t_s - self._armed_s > STOP_WITHIN_S:
            self._armed_s = t_s
            return (key, Moment(kind="stop_armed", t_s=t_s))
        self._armed_s = -math.inf
        acted = self._act(action, t_s)
        if action is Action.STOP:
            return (key, *acted, Moment(kind="stop", t_s=t_s))
        return (key, *acted, *(() if self.is_over or self._looks_later else self._show_task(t_s)))

    def _drop_reason(self, action: Action, t_s: float, *, repeat: bool, busy: bool) -> DropReason | None:
        if self.phase != "task":
            return "phase"
        if repeat:
            return "repeat"
        if busy:
            return "busy"
        if self._clock.too_soon(t_s):
            return "rate"
        return None if action in self._task.actions else "action"

    def _act(self, action: Action, t_s: float) -> tuple[Event, ...]:
        began_s, num_ended = self._task_began_s or 0.0, len(self._env.search_ends)
        self._env.move(action, t_s=t_s - began_s)
        self._observation = None if self._looks_later else self._env.observe()
        step = self._env.steps[-1]
        self._was_blocked = step.collided
        act = Act(t_s=t_s, action=action, position=step.position, yaw=step.yaw, tilt=step.tilt, collided=step.collided)
        reasons = self._env.search_reasons
        return self._end(reasons[-1], act) if len(reasons) > num_ended else (act,)

    def _rebuild(self, events: Sequence[Event]) -> None:
        super()._rebuild(events)
        self._observation = self._env.restore(walked_steps(events), left=left_searches(events))


class PogSession(TrialSession[PogView]):
    """One participant pointing in one POG trial; shows the lowest storey first."""

    def __init__(
        self,
        *,
        key: EpisodeKey,
        task: Task,
        storeys: tuple[float, ...],
        scene_digest: str,
        terms: TrialTerms = _NO_TERMS,
        objects: Mapping[str, MarkedObject] | None = None,
        searches: SearchTexts | None = None,
    ) -> None:
        """Shows nothing before `Start`; the other arguments are those of TrialSession.

        Args:
            objects: The home's objects by name; None = clicks do not tell which object they met, and marks stay where
                people click.
        """
        super().__init__(key=key, task=task, storeys=storeys, scene_digest=scene_digest, terms=terms, searches=searches)
        self._objects = objects
        self._marked: list[Clicked] = []
        """The clicks that set the present marks."""

    def _open_event(self, t_s: float) -> Open:
        opened = {"t_s": t_s, "knows_objects": self._objects is not None}
        if self._searches is not None:
            opened |= {"position": self._searches.start.position, "yaw": self._searches.start.yaw}
        return self._opened().model_copy(update=opened)

    def _show_task(self, t_s: float, *, again: bool = False) -> tuple[Event, ...]:
        if not again:
            return ()
        return (ShownStorey(t_s=t_s, storey_y=self._storeys[self._storey]),)

    def _task_view(self, t_s: float) -> PogView:
        marks = tuple(mark for mark in map(self._mark, self._marked) if mark is not None)
        return PogView(
            task=self._present_task,
            storeys=self._storeys,
            storey=self._storey,
            mark=marks[-1] if marks else None,
            is_over=self.is_over,
            is_giving_up=self._is_giving_up(t_s),
            left_s=self._left_s(t_s),
            has_names=self._has_names,
            marks=marks,
            **self._search_view,
        )

    def _begin_search(self, t_s: float) -> None:
        super()._begin_search(t_s)
        self._marked = []

    @property
    def _is_for_all(self) -> bool:
        return self._searches is not None and self._searches.prompts[self._search].is_for_all

    def _mark(self, marked: Clicked) -> Mark | None:
        if marked.hit is None or marked.mark is None:
            return None
        item = (self._objects or {}).get(marked.object_name or "") if marked.snapped is not None else None
        return Mark(marked.mark, marked.hit, self._storeys.index(marked.ray.storey_y), item)

    def _on_task(self, command: Command, t_s: float, *, busy: bool) -> tuple[Event, ...]:
        if self.phase != "task":
            return (Dropped(t_s=t_s, reason="phase"),)
        match command:
            case Click():
                return self._click(command, t_s)
            case Unmark(index=index) if self._is_for_all and 0 <= index < len(self._marked):
                del self._marked[index]
                return (Unmarked(t_s=t_s, index=index),)
            case Confirm() | Unmark() if not self._marked:
                return (Dropped(t_s=t_s, reason="nothing_marked"),)
            case Confirm():
                ended = self._end("click", Moment(kind="confirm", t_s=t_s))
                return ended if self.is_over else (*ended, *self._show_task(t_s))
            case _:
                return (Dropped(t_s=t_s, reason="phase"),)

    def _click(self, command: Click, t_s: float) -> tuple[Event, ...]:
        if self._clock.too_soon(t_s):
            return (Dropped(t_s=t_s, reason="rate"),)
        self._clock.accept(t_s)
        clicked = Clicked(
            t_s=t_s,
            t_cli_ms=command.t_cli_ms,
            ray=command.ray,
            hit=command.hit,
            pixel=command.pixel,
            object_name=command.object_name if self._objects is not None else None,
            snapped=command.snapped if self._objects is not None else None,
        )
        if clicked.hit is not None:
            self._marked = [*self._marked, clicked] if self._is_for_all else [clicked]
        return (clicked,)

    def _rebuild(self, events: Sequence[Event]) -> None:
        super()._rebuild(events)
        marked, parts = last_marked(events), search_parts(events)
        self._marked = [marked] if marked is not None and not parts else list(parts[-1].marks) if parts else []

"""What one participant does in one trial, as two state machines: a command and the time in, events and a view out.

The caller stores the events first and shows the view after that. If storing fails, drop the session and rebuild it from
the stored events (`pan_session_from_events`, `pog_session_from_events`): same step, same pose. Sessions know no goal;
results come from `outcome`.
"""

import hashlib
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.errors import TaskStateError
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Vector3
from sim.types import Action, EndReason, EpisodeKey, Observation, Task

from .clock import TrialClock
from .commands import (
    Click,
    Confirm,
    Fail,
    GiveUp,
    LookFrom,
    Move,
    PanCommand,
    PogCommand,
    PressStop,
    Resume,
    ShowStorey,
    Start,
)
from .events import (
    Abandoned,
    Act,
    Cam,
    Clicked,
    Confirmed,
    Dropped,
    DropReason,
    Error,
    Event,
    GaveUp,
    Key,
    Open,
    Shown,
    ShownStorey,
    Stop,
    StopArmed,
)
from .outcome import end_reason, last_marked, opening
from .views import PanView, PogView, SessionUpdate

STOP_WITHIN_S = 2.0
"""The second press of STOP counts this long after the first (DESIGN.md, keys)."""
CAMERA_EVERY_S = 0.5
"""Camera poses are kept at most twice a second (HUMAN_STUDY.md, section 2)."""
RESUME_WITHIN_S = 600.0
"""Default of StudyConfig.resume_within_s."""


class PanSession:
    """One participant walking in one PAN trial."""

    def __init__(
        self,
        env: PanEnv,
        *,
        key: EpisodeKey,
        task: Task,
        scene_digest: str,
        resume_within_s: float = RESUME_WITHIN_S,
    ) -> None:
        """Takes over the environment; nothing is rendered or shown before `Start`.

        Args:
            env: The episode's environment; the session owns it from now on. Its `max_steps` must be the task's.
            key: The episode.
            task: What the participant is told, and the allowed actions.
            scene_digest: Of the scene that `env` walks in.
            resume_within_s: A longer absence ends the trial as `abandoned`.
        """
        assert env.max_steps == task.max_steps, (env.max_steps, task.max_steps)
        self._env, self._key, self._task, self._scene_digest = env, key, task, scene_digest
        self._resume_within_s = resume_within_s
        self._clock = TrialClock()
        self._armed_s = -math.inf
        self._ended: EndReason | None = None
        self._observation: Observation | None = None

    @property
    def end_reason(self) -> EndReason | None:
        """Why the trial is over; None while it is running."""
        return self._ended or self._env.end_reason

    @property
    def is_over(self) -> bool:
        """Whether the trial takes no more commands."""
        return self.end_reason is not None

    @property
    def observation(self) -> Observation | None:
        """What the robot senses now, for a researcher who watches; None before `Start`. Participants get the view."""
        return self._observation

    @property
    def _rgb(self) -> NDArray[np.uint8] | None:
        return self._observation.rgb if self._observation is not None else None

    def view(self, now_s: float) -> PanView:
        """What to show now; `is_armed` falls back by itself after STOP_WITHIN_S."""
        is_armed = self._clock.read(now_s) - self._armed_s <= STOP_WITHIN_S and not self.is_over
        return PanView(self._task, self._rgb, len(self._env.steps), is_armed, self.is_over)

    def handle(self, command: PanCommand, now_s: float, *, busy: bool = False) -> SessionUpdate[PanView]:
        """Take one command; after the end none has an effect.

        Args:
            command: What the participant did.
            now_s: Seconds on a steady clock, the same one for the whole life of this object.
            busy: The picture of an earlier action is still under way: presses are dropped and logged.

        Raises:
            TaskStateError: The first command is not Start (Resume for a rebuilt session), or Start comes again.
        """
        if isinstance(command, Start | Resume):
            self._clock.begin(now_s, is_start=isinstance(command, Start))
        t_s = self._clock.read(now_s)
        events = () if self.is_over else self._events(command, t_s, busy)
        return SessionUpdate(events, self.view(now_s))

    def _events(self, command: PanCommand, t_s: float, busy: bool) -> tuple[Event, ...]:
        match command:
            case Start():
                self._observation = self._env.reset()
                return (self._open(t_s), *self._shown(t_s))
            case Resume(away_s=away_s):
                if away_s > self._resume_within_s:
                    self._ended = "abandoned"
                    return (Abandoned(t_s=t_s, away_s=away_s),)
                return self._shown(t_s)
            case Move() | PressStop():
                return self._press(command, t_s, busy)
            case GiveUp():
                self._ended = "giveup"
                return (GaveUp(t_s=t_s),)
            case Fail(message=message):
                self._ended = "technical"
                return (Error(t_s=t_s, message=message[:500], is_fatal=True),)

    def _press(self, command: Move | PressStop, t_s: float, busy: bool) -> tuple[Event, ...]:
        action = command.action if isinstance(command, Move) else Action.STOP
        key = Key(t_s=t_s, t_cli_ms=command.t_cli_ms, code=command.code[:32], action=action, repeat=command.repeat)
        reason = self._drop_reason(action, t_s, repeat=command.repeat, busy=busy)
        if reason is not None:
            return (key, Dropped(t_s=t_s, reason=reason))
        self._clock.accept(t_s)
        if action is not Action.STOP:
            self._armed_s = -math.inf
            return (key, self._act(action, t_s), *self._shown(t_s))
        if t_s - self._armed_s <= STOP_WITHIN_S:
            return (key, self._act(action, t_s), Stop(t_s=t_s))
        self._armed_s = t_s
        return (key, StopArmed(t_s=t_s))

    def _drop_reason(self, action: Action, t_s: float, *, repeat: bool, busy: bool) -> DropReason | None:
        if repeat:
            return "repeat"
        if busy:
            return "busy"
        if self._clock.too_soon(t_s):
            return "rate"
        return None if action in self._task.actions else "action"

    def _act(self, action: Action, t_s: float) -> Act:
        self._observation = self._env.step(action, t_s=t_s)
        step = self._env.steps[-1]
        return Act(t_s=t_s, action=action, position=step.position, yaw=step.yaw, tilt=step.tilt, collided=step.collided)

    def _open(self, t_s: float) -> Open:
        pose = self._env.pose
        return _open_event(self._key, self._task, self._scene_digest).model_copy(
            update={"t_s": t_s, "position": pose.position, "yaw": pose.yaw}
        )

    def _shown(self, t_s: float) -> tuple[Shown, ...]:
        """The picture's event; none after the last step, when nothing new is shown."""
        if self.is_over:
            return ()
        digest = None if self._rgb is None else hashlib.sha256(np.ascontiguousarray(self._rgb).data).hexdigest()
        return (Shown(t_s=t_s, step=len(self._env.steps), frame_hash=digest),)

    def _rebuild(self, events: Sequence[Event]) -> None:
        self._observation = self._env.restore([event.step for event in events if isinstance(event, Act)])
        self._clock = TrialClock(already_s=_last_time(events))
        self._ended = end_reason(events)


class PogSession:
    """One participant pointing in one POG trial."""

    def __init__(
        self,
        *,
        key: EpisodeKey,
        task: Task,
        storeys: tuple[float, ...],
        scene_digest: str,
        resume_within_s: float = RESUME_WITHIN_S,
    ) -> None:
        """Shows the lowest storey; nothing is shown before `Start`.

        Args:
            key: The episode.
            task: What the participant is told.
            storeys: Floor height of each storey, ascending (`NavigationMap.storey_heights`).
            scene_digest: Of the scene that is shown.
            resume_within_s: A longer absence ends the trial as `abandoned`.
        """
        self._key, self._task, self._storeys, self._scene_digest = key, task, storeys, scene_digest
        self._resume_within_s = resume_within_s
        self._clock = TrialClock()
        self._storey = 0
        self._marker: Vector3 | None = None
        self._camera_s = -math.inf
        self._ended: EndReason | None = None

    @property
    def end_reason(self) -> EndReason | None:
        """Why the trial is over; None while it is running."""
        return self._ended

    @property
    def is_over(self) -> bool:
        """Whether the trial takes no more commands."""
        return self._ended is not None

    def view(self) -> PogView:
        """What to show now."""
        return PogView(self._task, self._storeys, self._storey, self._marker, self.is_over)

    def handle(self, command: PogCommand, now_s: float) -> SessionUpdate[PogView]:
        """Take one command; after the end none has an effect.

        Args:
            command: What the participant did.
            now_s: Seconds on a steady clock, the same one for the whole life of this object.

        Raises:
            TaskStateError: The first command is not Start (Resume for a rebuilt session), or Start comes again.
        """
        if isinstance(command, Start | Resume):
            self._clock.begin(now_s, is_start=isinstance(command, Start))
        t_s = self._clock.read(now_s)
        events = () if self.is_over else self._events(command, t_s)
        return SessionUpdate(events, self.view())

    def _events(self, command: PogCommand, t_s: float) -> tuple[Event, ...]:
        match command:
            case Start():
                return (_open_event(self._key, self._task, self._scene_digest).model_copy(update={"t_s": t_s}),)
            case Resume(away_s=away_s):
                if away_s > self._resume_within_s:
                    return self._end("abandoned", Abandoned(t_s=t_s, away_s=away_s))
                return self._show(self._storey, t_s)
            case ShowStorey(storey=storey):
                return self._show(storey, t_s)
            case LookFrom():
                return self._look(command, t_s)
            case Click():
                return self._click(command, t_s)
            case Confirm():
                if self._marker is None:
                    return (Dropped(t_s=t_s, reason="nothing_marked"),)
                return self._end("click", Confirmed(t_s=t_s))
            case GiveUp():
                return self._end("giveup", GaveUp(t_s=t_s))
            case Fail(message=message):
                return self._end("technical", Error(t_s=t_s, message=message[:500], is_fatal=True))

    def _end(self, reason: EndReason, event: Event) -> tuple[Event, ...]:
        self._ended = reason
        return (event,)

    def _show(self, storey: int, t_s: float) -> tuple[Event, ...]:
        if not 0 <= storey < len(self._storeys):
            return (Dropped(t_s=t_s, reason="storey"),)
        self._storey = storey
        return (ShownStorey(t_s=t_s, storey_y=self._storeys[storey]),)

    def _look(self, command: LookFrom, t_s: float) -> tuple[Event, ...]:
        if t_s - self._camera_s < CAMERA_EVERY_S:
            return ()
        self._camera_s = t_s
        return (Cam(t_s=t_s, position=command.position, wxyz=command.wxyz),)

    def _click(self, command: Click, t_s: float) -> tuple[Event, ...]:
        event = Clicked(t_s=t_s, t_cli_ms=command.t_cli_ms, ray=command.ray, hit=command.hit)
        if self._clock.too_soon(t_s):
            return (Dropped(t_s=t_s, reason="rate"),)
        self._clock.accept(t_s)
        self._marker = command.hit if command.hit is not None else self._marker
        return (event,)

    def _rebuild(self, events: Sequence[Event]) -> None:
        heights = [event.storey_y for event in events if isinstance(event, ShownStorey)]
        self._storey = self._storeys.index(heights[-1]) if heights else 0
        marked = last_marked(events)
        self._marker = marked.hit if marked is not None else None
        self._clock = TrialClock(already_s=_last_time(events))
        self._ended = end_reason(events)


def pan_session_from_events(
    events: Sequence[Event],
    env: PanEnv,
    *,
    key: EpisodeKey,
    task: Task,
    scene_digest: str,
    resume_within_s: float = RESUME_WITHIN_S,
) -> PanSession:
    """The session after these stored events: same step, same pose. Its next command is `Resume`.

    Args: as PanSession's; `events` are all of the trial, in order.

    Raises:
        StudyError: The events do not begin with `open`.
        TaskStateError: They are of another episode or scene.
    """
    _require_same_trial(opening(events), key, scene_digest)
    session = PanSession(env, key=key, task=task, scene_digest=scene_digest, resume_within_s=resume_within_s)
    session._rebuild(events)
    return session


def pog_session_from_events(
    events: Sequence[Event],
    *,
    key: EpisodeKey,
    task: Task,
    storeys: tuple[float, ...],
    scene_digest: str,
    resume_within_s: float = RESUME_WITHIN_S,
) -> PogSession:
    """The session after these stored events: same storey, same mark. Its next command is `Resume`.

    Args: as PogSession's; `events` are all of the trial, in order.

    Raises:
        StudyError: The events do not begin with `open`.
        TaskStateError: They are of another episode or scene.
    """
    _require_same_trial(opening(events), key, scene_digest)
    session = PogSession(
        key=key, task=task, storeys=storeys, scene_digest=scene_digest, resume_within_s=resume_within_s
    )
    session._rebuild(events)
    return session


def _open_event(key: EpisodeKey, task: Task, scene_digest: str) -> Open:
    return Open(
        task=task.kind,
        split=key.split,
        scene=key.scene,
        episode_id=key.episode_id,
        scene_digest=scene_digest,
        max_steps=task.max_steps,
        actions=task.actions,
    )


def _last_time(events: Sequence[Event]) -> float:
    return max((event.t_s for event in events if event.t_s is not None), default=0.0)


def _require_same_trial(opened: Open, key: EpisodeKey, scene_digest: str) -> None:
    if (opened.key, opened.scene_digest) != (key, scene_digest):
        raise TaskStateError(
            f"trial of {opened.key}: asked to resume on {key}, scene {scene_digest[:12]}; expected the same episode "
            f"and scene {opened.scene_digest[:12]}. Serve the study with the scenes it was begun with."
        )

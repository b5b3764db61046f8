"""All that can happen in a trial, as a closed list of typed events: sessions make them, the store keeps them for good.

A view, an outcome and a resumed session are all rebuilt from these alone. No event holds ground truth.
"""

import json
from typing import Annotated, Literal, get_args

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from sim.errors import StudyError, line_from_validation_error
from sim.tasks.run_files import ClickRay, Step, Vector3
from sim.types import Action, EpisodeKey, Pose, Split, TaskKind

Finite = Annotated[float, AllowInfNan(False)]
DropReason = Literal["repeat", "busy", "rate", "action", "storey", "nothing_marked"]


class _Event(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    t_s: Finite | None = None
    """Seconds since the trial's start on the session's clock; time away is not counted. None: the store made it."""
    t_cli_ms: Finite | None = None
    """The browser's own `performance.now`, where it told one."""


class Open(_Event):
    """First event of each trial: what the participant is asked to do, and where."""

    kind: Literal["open"] = "open"
    task: TaskKind
    split: Split
    scene: str
    episode_id: str
    scene_digest: str
    max_steps: int
    actions: tuple[Action, ...]
    position: Vector3 | None = None
    """PAN: where the robot starts, world metres."""
    yaw: Finite | None = None
    """PAN: radians."""

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)

    @property
    def start(self) -> Pose | None:
        """Start pose; None in POG."""
        return None if self.position is None or self.yaw is None else Pose(self.position, self.yaw)


class Shown(_Event):
    """The picture that was handed out for display."""

    kind: Literal["shown"] = "shown"
    step: int
    frame_hash: str | None
    """sha256 of the (H, W, 3) bytes; None when the environment does not render."""


class Key(_Event):
    """A key or button was pressed, whether or not it had an effect."""

    kind: Literal["key"] = "key"
    code: str = Field(max_length=32)
    """`KeyboardEvent.code`, or the button's name."""
    action: Action
    repeat: bool = False
    """Sent again by a held key."""


class Dropped(_Event):
    """The command before this event had no effect."""

    kind: Literal["dropped"] = "dropped"
    reason: DropReason


class Act(_Event):
    """The robot took a step; the pose is the one after it."""

    kind: Literal["act"] = "act"
    action: Action
    position: Vector3
    yaw: Finite
    tilt: Finite = 0.0
    collided: bool = False

    @property
    def step(self) -> Step:
        """The same as a line of a run file."""
        return Step(
            action=self.action,
            position=self.position,
            yaw=self.yaw,
            tilt=self.tilt,
            collided=self.collided,
            t_s=self.t_s or 0.0,
        )


class StopArmed(_Event):
    """First press of STOP."""

    kind: Literal["stop_armed"] = "stop_armed"


class Stop(_Event):
    """Second press of STOP in time: the trial is over."""

    kind: Literal["stop"] = "stop"


class Cam(_Event):
    """Where a POG participant looks from; at most two a second."""

    kind: Literal["cam"] = "cam"
    position: Vector3
    wxyz: tuple[Finite, Finite, Finite, Finite]


class ShownStorey(_Event):
    """A POG participant chose the storey to see."""

    kind: Literal["storey"] = "storey"
    storey_y: Finite


class Clicked(_Event):
    """A POG participant pointed at the scene."""

    kind: Literal["click"] = "click"
    ray: ClickRay
    hit: Vector3 | None
    """Where the server's ray met the shown storey, world metres; None = it met nothing."""
    provisional: bool = True
    """Whether it can still be changed before `confirm`."""


class Confirmed(_Event):
    """The marked point is the answer: the trial is over."""

    kind: Literal["confirm"] = "confirm"


class GaveUp(_Event):
    """The participant gave up: the trial is over."""

    kind: Literal["giveup"] = "giveup"


class Reconnect(_Event):
    """The trial was opened again, in another tab or after a break; older epochs cannot write any more."""

    kind: Literal["reconnect"] = "reconnect"
    epoch: int
    away_s: Finite
    """Seconds since the event before."""


class Abandoned(_Event):
    """The participant came back too late: the trial is over."""

    kind: Literal["abandoned"] = "abandoned"
    away_s: Finite


class Error(_Event):
    """Something on our side failed."""

    kind: Literal["error"] = "error"
    message: str = Field(max_length=500)
    is_fatal: bool
    """Whether it ended the trial (outcome `technical`)."""


Event = (
    Open
    | Shown
    | Key
    | Dropped
    | Act
    | StopArmed
    | Stop
    | Cam
    | ShownStorey
    | Clicked
    | Confirmed
    | GaveUp
    | Reconnect
    | Abandoned
    | Error
)
EVENT_KINDS: tuple[str, ...] = tuple(model.model_fields["kind"].default for model in get_args(Event))
"""Every kind, in the order above."""
_ADAPTER: TypeAdapter[Event] = TypeAdapter(Annotated[Event, Field(discriminator="kind")])


def event_to_json(event: Event) -> str:
    """The event as one line of JSON, the same bytes each time."""
    return event.model_dump_json()


def event_from_json(text: str | bytes, *, where: str = "event") -> Event:
    """The event of one JSON object.

    Args:
        where: What the message names as the place of a bad event.

    Raises:
        StudyError: It is not JSON, of no known kind, or a field is missing, unknown or out of range.
    """
    try:
        return _ADAPTER.validate_json(text, strict=True)
    except ValidationError as error:
        if error.errors()[0]["type"] in ("union_tag_invalid", "union_tag_not_found"):
            found = json.loads(text).get("kind")
            raise StudyError(
                f"{where}: kind is {found!r}; expected one of {', '.join(EVENT_KINDS)}. "
                "Use the version of personal-viz that wrote it."
            ) from None
        advice = "Use the version of personal-viz that wrote it."
        raise StudyError(line_from_validation_error(where, error, advice=advice)) from None

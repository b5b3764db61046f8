"""All events of a trial, as a closed list of types: sessions make them, the store keeps them.

A view, an outcome and a resumed session are all rebuilt from the events alone. No event holds ground truth.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from sim.errors import StudyError, line_from_validation_error
from sim.tasks.run_files import ClickRay, Step, Vector3
from sim.types import Action, EpisodeKey, GridSpec, Pose, Split, TaskKind

from ..design.study import Condition, HomeView

Finite = Annotated[float, AllowInfNan(False)]
DropReason = Literal["repeat", "busy", "rate", "action", "storey", "nothing_marked", "phase", "too_early"]
"""`phase`: not in this part of the trial; `rate`: too soon after another press, or after a search began; `too_early`:
the map must be looked at for longer."""
MapKind = Literal["topdown", "glb", "home"]
"""The look before a trial's task: pictures from above, or the 3-D home before walking (`glb`) or pointing."""
PageChange = Literal["focus", "blur", "hidden", "visible", "context_lost"]
"""The page got or lost the keyboard (`focus`, `blur`), left or came back on screen (`hidden`, `visible`: another tab, a
minimised window), or can no longer show 3-D scenes, because the browser lost its WebGL context."""
ABOVE_MAP = 10.0
"""Height over the floor from which a place on a map is looked at, metres: over all of a cut storey."""
MAX_SIDE = 100_000
"""Largest side of a page that is stored, pixels; larger sides are stored as this number."""


class TrialEvent(BaseModel):
    """The fields of all events."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    t_s: Finite | None = None
    """Seconds since the trial's start on the session's clock, without absences. None: the store made the event."""
    t_cli_ms: Finite | None = None
    """The browser's own `performance.now`, where it sent one."""


class Open(TrialEvent):
    """First event of each trial: the task and its home."""

    kind: Literal["open"] = "open"
    task: TaskKind
    split: Split
    scene: str
    episode_id: str
    scene_digest: str
    max_steps: int
    actions: tuple[Action, ...]
    condition: Condition | None = None
    """The view of the home besides the task, or, in a home sequence, whether earlier messages can be read again; None
    in records of the first version: `none`, or `map_open`."""
    home_view: HomeView | None = None
    """Where the pictures of a 3-D home were made; None = none was shown, or, in older records, in the browser."""
    position: Vector3 | None = None
    """World metres; None in POG on an episode. Start of the robot (PAN), or of the home sequence (both tasks)."""
    yaw: Finite | None = None
    """Yaw at this start, radians."""
    knows_objects: bool = False
    """POG: whether clicks tell the object that they met; older records never do."""

    @property
    def key(self) -> EpisodeKey:
        """The episode or home sequence."""
        return EpisodeKey(self.split, self.scene, self.episode_id)

    @property
    def start(self) -> Pose | None:
        """Start pose; None in POG on an episode."""
        return None if self.position is None or self.yaw is None else Pose(self.position, self.yaw)


class Moment(TrialEvent):
    """Something that its kind says completely."""

    kind: (
        Literal["stop_armed", "stop", "confirm", "giveup_armed", "giveup", "looking", "superseded"]
        | Literal["names_on", "names_off"]
        | PageChange
    )
    """In a home sequence, the search is over where this says that the trial is.
    `stop_armed`, `stop`: first press of STOP, and the second one in time: the trial is over. `confirm`: the marked
    point is the answer: the trial is over. `giveup_armed`, `giveup`: first press of giving up, and the second one: the
    trial is over. `looking`: the map is still shown; repeated now and then, so that an interrupted look keeps its time.
    `names_on`, `names_off`: names in the home were asked for, and taken away.
    `superseded`: the participant took the trial over from another tab that was still open."""


class Shown(TrialEvent):
    """The picture that was handed out for display."""

    kind: Literal["shown"] = "shown"
    step: int
    frame_hash: str | None
    """sha256 of the (H, W, 3) bytes; None when the environment does not render."""
    blocked: bool = False
    """Whether a sign showed that the last step was blocked; older programs had neither the sign nor this field."""


class Key(TrialEvent):
    """A key or button was pressed, whether or not it had an effect."""

    kind: Literal["key"] = "key"
    code: str = Field(max_length=32)
    """`KeyboardEvent.code`, or the button's name."""
    action: Action
    repeat: bool = False
    """Whether a held key sent it again."""


class Dropped(TrialEvent):
    """The command before this event had no effect."""

    kind: Literal["dropped"] = "dropped"
    reason: DropReason


class Act(TrialEvent):
    """The robot took a step; the pose is the one after it."""

    kind: Literal["act"] = "act"
    action: Action
    position: Vector3
    yaw: Finite
    tilt: Finite = 0.0
    collided: bool = False

    @property
    def step(self) -> Step:
        """The step as a line of a run file."""
        return Step(
            action=self.action,
            position=self.position,
            yaw=self.yaw,
            tilt=self.tilt,
            collided=self.collided,
            t_s=self.t_s or 0.0,
        )


class Cam(TrialEvent):
    """Camera of a participant who looks at the 3-D home; at most two a second."""

    kind: Literal["cam"] = "cam"
    position: Vector3
    wxyz: tuple[Finite, Finite, Finite, Finite]


class ShownStorey(TrialEvent):
    """A participant who sees the home chose another storey."""

    kind: Literal["storey"] = "storey"
    storey_y: Finite


class MapPixel(BaseModel):
    """A place on a storey's picture from above, with the values that turn it into a place in the world."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    uv: tuple[Finite, Finite]
    """(columns, rows) from the picture's top left corner, with fractions; (0.5, 0.5) is the first pixel's centre."""
    origin_xz: tuple[Finite, Finite]
    """World (x, z) of the top left corner, metres."""
    pixel_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Side of a pixel, metres."""
    shape: tuple[int, int]
    """(rows, columns) of the picture."""

    @property
    def grid(self) -> GridSpec:
        """The picture's pixels in the world."""
        return GridSpec(self.origin_xz, self.pixel_m, self.shape)

    def point(self, floor_y: float) -> Vector3:
        """The place in the world, on a floor at this height."""
        x, z = self.grid.xz_from_uv(np.array(self.uv)).tolist()
        return (x, floor_y, z)


class Clicked(TrialEvent):
    """A POG participant pointed at the scene, or at its picture from above."""

    kind: Literal["click"] = "click"
    ray: ClickRay
    hit: Vector3 | None
    """Point where the server's ray met the shown storey, world metres; None = it met nothing."""
    pixel: MapPixel | None = None
    """Place on the picture from above; None for clicks on the 3-D home."""
    object_name: str | None = None
    """Name in the scene of the object that is seen there; None = it is no object, or the trial does not tell."""
    snapped: Vector3 | None = None
    """Middle of that object, where the mark went (`pog.pointing: snap`), world metres; None = the mark is at `hit`."""
    provisional: bool = True
    """Whether the mark can still be changed before `confirm`."""

    @property
    def mark(self) -> Vector3 | None:
        """The point that is the answer once it is confirmed; None = the click met nothing."""
        return self.snapped if self.snapped is not None else self.hit

    @property
    def object_ray(self) -> tuple[Vector3, Vector3]:
        """Origin and direction of the ray that meets the object: the click's own, or straight down on the map."""
        return object_ray(self.ray, self.hit, self.pixel)


class SearchBegun(TrialEvent):
    """A search of a home sequence is shown, for the first time or again after an absence."""

    kind: Literal["search"] = "search"
    search: int = Field(ge=0)
    """Its index."""
    num_searches: int = Field(ge=1)
    is_for_all: bool
    notes: tuple[int, ...]
    """Indices of the messages that can be read from now until the next such event; 0 = the intro."""


class Unmarked(TrialEvent):
    """A POG participant took a mark away in a search for all."""

    kind: Literal["unmark"] = "unmark"
    index: int = Field(ge=0)
    """Place among the marks of the search, in order of their clicks."""


class TimedOut(TrialEvent):
    """Walking or answering took as long as the study allows: the trial, or the search of a home sequence, is over."""

    kind: Literal["timeout"] = "timeout"
    limit_s: Finite


class MapOn(TrialEvent):
    """The map or the home is shown before the task; again after each absence."""

    kind: Literal["map_on"] = "map_on"
    what: MapKind
    min_s: Finite
    """Shortest look."""
    max_s: Finite | None
    """Longest look, after which it closes by itself; None = no limit."""


class MapOff(TrialEvent):
    """The task begins: the robot's first picture, or the texts."""

    kind: Literal["map_off"] = "map_off"
    what: MapKind
    reason: Literal["left", "time"]
    """`left`: closed by the participant; `time`: after the longest look."""
    look_s: Finite
    """Seconds for which it was shown, without absences."""


class Confidence(TrialEvent):
    """The participant's confidence in the answer, given after the end."""

    kind: Literal["confidence"] = "confidence"
    value: Annotated[int, Field(ge=1, le=5)] | None
    """1 = guessed, 5 = certain; None = no answer in time."""


class Reconnect(TrialEvent):
    """The trial was opened again, in another tab or after a break; older epochs cannot write any more."""

    kind: Literal["reconnect"] = "reconnect"
    epoch: int
    away_s: Finite
    """Seconds since the last event."""


class Resized(TrialEvent):
    """The window changed its size; rounded, so that it identifies nobody."""

    kind: Literal["resize"] = "resize"
    width: Annotated[int, Field(ge=0, le=MAX_SIDE)]
    height: Annotated[int, Field(ge=0, le=MAX_SIDE)]


class Net(TrialEvent):
    """Duration of a round trip to the browser."""

    kind: Literal["net"] = "net"
    round_trip_ms: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Abandoned(TrialEvent):
    """The participant came back too late, or never (then the store writes it, without a time). The trial is over."""

    kind: Literal["abandoned"] = "abandoned"
    away_s: Finite


class Error(TrialEvent):
    """Something on our side failed."""

    kind: Literal["error"] = "error"
    message: str = Field(max_length=500)
    is_fatal: bool
    """Whether it ended the trial (outcome `technical`)."""


Event = (
    Open
    | Moment
    | Shown
    | Key
    | Dropped
    | Act
    | Cam
    | ShownStorey
    | Clicked
    | SearchBegun
    | Unmarked
    | TimedOut
    | MapOn
    | MapOff
    | Confidence
    | Reconnect
    | Resized
    | Net
    | Abandoned
    | Error
)
_ADAPTER: TypeAdapter[Event] = TypeAdapter(Annotated[Event, Field(discriminator="kind")])


def object_ray(ray: ClickRay, hit: Vector3 | None, pixel: MapPixel | None) -> tuple[Vector3, Vector3]:
    """Origin and direction of the ray by which a click meets an object.

    A click on the picture from above means what lies under its pixel, however the browser's camera stood.
    """
    if pixel is None or hit is None:
        return ray.origin, ray.direction
    x, y, z = hit
    return (x, y + ABOVE_MAP, z), (0.0, -1.0, 0.0)


def event_to_json(event: Event) -> str:
    """The event as one line of JSON, the same bytes each time."""
    return event.model_dump_json()


def event_from_json(text: str | bytes, *, where: str = "event") -> Event:
    """The event of one JSON object; `where` names its place in messages.

    Raises:
        StudyError: The text is not JSON, its kind is unknown, or a field is missing, unknown or out of range.
    """
    try:
        return _ADAPTER.validate_json(text, strict=True)
    except ValidationError as error:
        advice = "Use the version of personal-viz that wrote it."
        raise StudyError(line_from_validation_error(where, error, advice=advice)) from None

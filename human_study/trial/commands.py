"""The commands of a participant in a trial; `session` takes one at a time."""

from dataclasses import dataclass

from sim.tasks.run_files import ClickRay, Vector3
from sim.types import Action

from .events import MapPixel, PageChange


@dataclass(frozen=True, slots=True)
class Start:
    """Show the trial for the first time."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Show a rebuilt trial again, or end it as `abandoned` after too long."""

    away_s: float = 0.0
    """Seconds since the trial's last event (`Trial.away_s`)."""
    took_over: bool = False
    """Whether another tab still showed the trial."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed; `wait_s` of a session says when one is due."""


@dataclass(frozen=True, slots=True)
class CloseMap:
    """Begin the task: leave the map or the home that is shown before it."""


@dataclass(frozen=True, slots=True)
class Move:
    """Press a key or button of any action but STOP."""

    action: Action
    code: str
    """`KeyboardEvent.code` or the button's name."""
    repeat: bool = False
    t_cli_ms: float | None = None

    def __post_init__(self) -> None:
        """STOP needs two presses: PressStop."""
        assert self.action is not Action.STOP


@dataclass(frozen=True, slots=True)
class PressStop:
    """Press Enter or the STOP button; the second press within STOP_WITHIN_S ends the trial.

    In a home sequence it is FOUND: it ends the search, or marks an object in a search for all, and again ends that.
    """

    code: str = "Enter"
    repeat: bool = False
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class GiveUp:
    """End the trial, or the present search of a home sequence, without an answer.

    Only a second press within GIVE_UP_WITHIN_S ends it.
    """


@dataclass(frozen=True, slots=True)
class Fail:
    """End the trial because our side failed (outcome `technical`)."""

    message: str


@dataclass(frozen=True, slots=True)
class ShowStorey:
    """See another storey."""

    storey: int
    """Index into `PogView.storeys`."""


@dataclass(frozen=True, slots=True)
class ShowNames:
    """Show the names in the home that are shown on demand, or take them away."""

    is_shown: bool


@dataclass(frozen=True, slots=True)
class LookFrom:
    """The camera in the 3-D home moved."""

    position: Vector3
    wxyz: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Click:
    """Point at the shown storey."""

    ray: ClickRay
    hit: Vector3 | None
    """Point where the caller's ray met the shown storey; None = nothing was hit."""
    pixel: MapPixel | None = None
    """Place on the picture from above, whose `point` is the hit; None for the 3-D home."""
    object_name: str | None = None
    """Name in the scene of the object that is seen there; None = it is no object, or objects are not known."""
    snapped: Vector3 | None = None
    """Middle of that object, where the mark goes and which is the answer; None = the mark is at the hit."""
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Unmark:
    """Take a mark away; in searches of a home sequence for all, whose clicks add marks."""

    index: int
    """Index into `PogView.marks`."""


@dataclass(frozen=True, slots=True)
class Confirm:
    """Make the marked point, or all marked points of a search for all, the answer."""


@dataclass(frozen=True, slots=True)
class Rate:
    """Say how sure the answer is."""

    value: int
    """1 = guessed, 5 = certain."""

    def __post_init__(self) -> None:
        """Refuses values other than 1 to 5."""
        assert self.value in RATINGS


@dataclass(frozen=True, slots=True)
class PageChanged:
    """The browser reports a change of the page around the task."""

    what: PageChange
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Resize:
    """The page has this size in pixels; kept rounded."""

    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Measure:
    """A round trip to the browser took this long."""

    round_trip_ms: float


RATINGS = (1, 2, 3, 4, 5)
PageCommand = PageChanged | Resize | Measure
TrialCommand = Start | Resume | Tick | CloseMap | ShowStorey | ShowNames | LookFrom | GiveUp | Fail | Rate | PageCommand
"""Commands that every trial takes."""
PanCommand = TrialCommand | Move | PressStop
PogCommand = TrialCommand | Click | Unmark | Confirm
Command = PanCommand | PogCommand

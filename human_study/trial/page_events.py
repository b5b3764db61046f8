"""Events of the page around the task: keyboard, screen, window, connection, WebGL."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field

Finite = Annotated[float, AllowInfNan(False)]
SIZE_STEP = 50
"""Pixels to which a page's size is rounded."""
MAX_SIDE = 100_000
"""Largest side of a page that is stored, pixels; larger sides are stored as this number."""


class TrialEvent(BaseModel):
    """The fields of all events."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    t_s: Finite | None = None
    """Seconds since the trial's start on the session's clock, without absences. None: the store made the event."""
    t_cli_ms: Finite | None = None
    """The browser's own `performance.now`, where it sent one."""


class Focused(TrialEvent):
    """The page got the keyboard."""

    kind: Literal["focus"] = "focus"


class Blurred(TrialEvent):
    """The page lost the keyboard."""

    kind: Literal["blur"] = "blur"


class Hidden(TrialEvent):
    """The page is no longer on screen: another tab, a minimised window."""

    kind: Literal["hidden"] = "hidden"


class Visible(TrialEvent):
    """The page is on screen again."""

    kind: Literal["visible"] = "visible"


class Resized(TrialEvent):
    """The window changed its size."""

    kind: Literal["resize"] = "resize"
    width: Annotated[int, Field(ge=0, le=MAX_SIDE)]
    height: Annotated[int, Field(ge=0, le=MAX_SIDE)]
    """Height of the page in pixels; like the width it is rounded, so that it identifies nobody."""


class Net(TrialEvent):
    """Duration of a round trip to the browser."""

    kind: Literal["net"] = "net"
    round_trip_ms: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class ContextLost(TrialEvent):
    """The browser lost its WebGL context and can no longer show 3-D scenes."""

    kind: Literal["context_lost"] = "context_lost"


@dataclass(frozen=True, slots=True)
class PageChanged:
    """Command: the browser reports a change of the page itself."""

    what: Literal["focus", "blur", "hidden", "visible", "context_lost"]
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Resize:
    """Command: the page's size in pixels; kept rounded."""

    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Measure:
    """Command: a round trip to the browser took this long."""

    round_trip_ms: float


PageCommand = PageChanged | Resize | Measure
PageEvent = Focused | Blurred | Hidden | Visible | Resized | Net | ContextLost
_MODELS: dict[str, type[Focused | Blurred | Hidden | Visible | ContextLost]] = {
    "focus": Focused,
    "blur": Blurred,
    "hidden": Hidden,
    "visible": Visible,
    "context_lost": ContextLost,
}


def page_event(command: PageCommand, t_s: float) -> PageEvent:
    """The event of a command about the page."""
    match command:
        case Resize(width=width, height=height):
            return Resized(t_s=t_s, width=_rounded(width), height=_rounded(height))
        case Measure(round_trip_ms=round_trip_ms):
            return Net(t_s=t_s, round_trip_ms=round_trip_ms)
        case PageChanged(what=what, t_cli_ms=t_cli_ms):
            return _MODELS[what](t_s=t_s, t_cli_ms=t_cli_ms)


def _rounded(side: int) -> int:
    return min(MAX_SIDE, SIZE_STEP * round(max(0, side) / SIZE_STEP))

"""What a participant can do in a trial; `session` takes these one at a time."""

from dataclasses import dataclass

from sim.tasks.run_files import ClickRay, Vector3
from sim.types import Action


@dataclass(frozen=True, slots=True)
class Start:
    """Show the trial for the first time."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Show a rebuilt trial again, or end it as `abandoned` after too long."""

    away_s: float = 0.0
    """Seconds since the trial's last event (`Trial.away_s`)."""


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
    """Press Enter or the STOP button; the second press within STOP_WITHIN_S ends the trial."""

    code: str = "Enter"
    repeat: bool = False
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class GiveUp:
    """End the trial without an answer."""


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
class LookFrom:
    """The POG camera moved."""

    position: Vector3
    wxyz: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Click:
    """Point at the shown storey."""

    ray: ClickRay
    hit: Vector3 | None
    """Where the caller's ray met the shown storey; None = nothing was hit."""
    t_cli_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Confirm:
    """Make the marked point the answer."""


PanCommand = Start | Resume | Move | PressStop | GiveUp | Fail
PogCommand = Start | Resume | ShowStorey | LookFrom | Click | Confirm | GiveUp | Fail

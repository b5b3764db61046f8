"""What bots note of what they do: keys, clicks, answers and their times; `bots_count` looks for it in the records."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

from sim.tasks.run_files import Vector3
from sim.types import TaskKind

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]
KINDS: tuple[BotKind, ...] = ("shortest", "random", "slow", "impatient", "disconnecting")
_NEAR = 0.03
"""A mark is where it is expected if it is no further away (metres)."""
_MOVED = 0.1
"""How far one press of an arrow moves the mark (`pog_app.NUDGE_M`)."""


@dataclass(slots=True)
class Press:
    """One key that was sent."""

    t_cli_ms: float
    """The bot's clock, different for each of its keys; stored with the key."""
    sent_s: float
    """`time.perf_counter()`."""
    counted_s: float | None = None
    """When the step counter said that it is stored."""
    shown_s: float | None = None
    """When its picture came."""
    was_cut_off: bool = False
    """Whether the bot hung up before it heard of an answer."""


@dataclass(slots=True)
class Pointed:
    """One click, or one press that moves the mark."""

    sent_s: float
    """`time.perf_counter()`."""
    xz: tuple[float, float]
    """Where the mark is expected; of a move, where it was before. World metres."""
    ray: tuple[Vector3, Vector3] | None = None
    """Origin and direction, as sent: different for each click. None = a move of the mark."""
    shown_s: float | None = None
    """When the mark was there; it is shown when it is stored."""
    is_awaited: bool = True
    """Whether the bot waits for it."""
    was_cut_off: bool = False
    """As in `Press`; also of what was on its way when the time of a trial was up."""

    def is_marked_by(self, mark: Vector3) -> bool:
        """Whether a mark at this place (world metres) is what the click or move led to."""
        distance = math.hypot(mark[0] - self.xz[0], mark[2] - self.xz[1])
        return abs(distance - (0.0 if self.ray is not None else _MOVED)) < _NEAR


@dataclass(slots=True)
class Confirmed:
    """One answer: the mark was confirmed, by one press or by several."""

    sent_s: float
    shown_s: float | None = None
    """When the page went on, which it does when the answer is stored."""
    was_cut_off: bool = False
    """As in `Press`."""


@dataclass(slots=True)
class BotLog:
    """What one bot did."""

    code: str
    """The participant."""
    kind: BotKind
    task: TaskKind = "pan"
    presses: list[Press] = field(default_factory=list)
    """Keys of a PAN bot."""
    ends: list[int] = field(default_factory=list)
    """How many keys it had sent when each of its connections ended."""
    points: list[Pointed] = field(default_factory=list)
    """Clicks and moves of the mark of a POG bot."""
    answers: list[Confirmed] = field(default_factory=list)
    """Of a POG bot."""
    num_frames: int = 0
    """Pictures of the robot's camera."""
    num_connections: int = 0
    num_unanswered: int = 0
    """Keys, clicks and answers whose effect was awaited for ANSWER_S in vain; keys that were pressed before an earlier
    one's picture are not."""
    problem: str = ""
    """Why it ended early; empty when it did not."""
    is_finished: bool = False
    """Whether it has no trial left."""
    is_resting: bool = False
    """Whether the study asked it to come back later."""
    completion_code: str | None = None
    """What the last page told it."""


@dataclass(frozen=True, slots=True)
class BotCount:
    """Where that is which one bot sent; fields as in `bots_count.KeyCount`."""

    sent: int
    stored: int
    dropped: Counter[str]
    lost: tuple[str, ...]
    """What was lost, one text for each."""
    cut_off: int
    duplicated: int
    unknown: int
    answers: int = 0
    """Trials with a confirmed mark."""

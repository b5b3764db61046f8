"""What bots note of what they do, and where that is in the study's records: what was lost, what is there twice.

Keys carry the browser's clock (`t_cli_ms`), which bots make different for each key, and clicks their rays: so each is
looked for by itself. Moves of the mark and answers are only counted.
"""

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Clicked, Dropped, Event, Key
from sim.tasks.run_files import Vector3
from sim.types import TaskKind

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]
KINDS: tuple[BotKind, ...] = ("shortest", "random", "slow", "impatient", "disconnecting")
_OF_CLICKS = ("rate", "phase")
"""Reasons for which a click, a move or an answer is stored as dropped; that event does not say which one it was."""
_DOWN = (0.0, -1.0, 0.0)
_NEAR = 0.03
"""A mark is where it is expected if it is no further away (metres)."""
_MOVED = 0.1
"""How far one press of an arrow moves the mark (`NUDGE_M` of study_app/screens/pog.py, which is heavy to import)."""


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
    num_acked: int = 0
    """Number of keys that the study has told a PAN bot are on disk."""
    step_counted: int = 0
    """Last value of the step counter that a PAN bot saw."""
    resumed: list[tuple[int, int]] = field(default_factory=list)
    """(step of the first picture, index in `presses` of the next key) after each return of a PAN bot."""
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
    """Where the keys, clicks, moves of the mark and answers of bots are."""

    sent: int = 0
    """Keys, clicks and moves of the mark."""
    stored: int = 0
    """Different ones that are in the database; keys also where they were dropped with a reason."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Stored as without effect, by reason: `busy`, `rate` and so on."""
    lost: tuple[str, ...] = ()
    """Sent and not stored, without those cut off: participant, number of the key or click, of how many."""
    cut_off: int = 0
    """Not stored, because the bot hung up while they were on their way; nobody was told that they counted."""
    untimed: int = 0
    """Keys that are stored without the page's own time, because its message came too long before them."""
    duplicated: int = 0
    """Stored more than once."""
    unknown: int = 0
    """Stored, but sent by no bot."""
    answers: int = 0
    """Trials with a confirmed mark."""

    def __add__(self, other: "BotCount") -> "BotCount":
        """Of both."""
        return BotCount(*(getattr(self, name) + getattr(other, name) for name in BotCount.__slots__))


def count_bots(folder: Path, logs: Sequence[BotLog]) -> BotCount:
    """Looks for all that bots have sent.

    Args:
        folder: Of the study; its hash chains are checked first.
        logs: What the bots did, all who took part.

    Raises:
        StudyError: The database is damaged.
    """
    with read_study(folder) as reader:
        reader.check()
        return sum((_points(reader, log) if log.task == "pog" else _keys(reader, log) for log in logs), BotCount())


def events_of(reader: StudyReader, code: str) -> list[Event]:
    """All that a participant did, in order."""
    trials = [status.trial_id for status in reader.trials(code) if status.trial_id is not None]
    return [line.event for trial in trials for line in reader.events(trial)]


def _keys(reader: StudyReader, log: BotLog) -> BotCount:
    """Looks for each key of a PAN bot.

    Keys of one connection are stored in the order in which they were pressed: one is lost if a later one of its
    connection is stored, or if the bot had heard of its effect.
    """
    events = events_of(reader, log.code)
    found = Counter(event.t_cli_ms for event in events if isinstance(event, Key))
    untimed = found.pop(None, 0)
    marks = {press.t_cli_ms for press in log.presses}
    gone: list[int] = []
    num_missing = 0
    for begin, end in itertools.pairwise([0, *log.ends, len(log.presses)]):
        missing = [place for place in range(begin, end) if log.presses[place].t_cli_ms not in found]
        last = max((place for place in range(begin, end) if log.presses[place].t_cli_ms in found), default=-1)
        num_missing += len(missing)
        gone += [place for place in missing if place < last or not log.presses[place].was_cut_off]
    lost = gone[untimed:]  # which of them are those without a time is not known
    who, num_keys = f"{log.code} ({log.kind})", len(log.presses)
    return BotCount(
        sent=num_keys,
        stored=len(found.keys() & marks) + untimed,
        dropped=Counter(event.reason for event in events if isinstance(event, Dropped)),
        lost=tuple(f"{who}: key {place + 1} of {num_keys}" for place in lost),
        cut_off=num_missing - len(gone) - max(0, untimed - len(gone)),
        untimed=untimed,
        duplicated=sum(found[mark] - 1 for mark in marks if mark in found),
        unknown=sum(count for mark, count in found.items() if mark not in marks),
    )


def _points(reader: StudyReader, log: BotLog) -> BotCount:
    """Looks for each click of a POG bot by itself, and for as many moves and answers as it sent."""
    events = events_of(reader, log.code)
    clicks = [event for event in events if isinstance(event, Clicked)]
    rays = Counter((event.ray.origin, event.ray.direction) for event in clicks if not _is_move(event))
    dropped = Counter(event.reason for event in events if isinstance(event, Dropped))
    confirmed = Counter(
        status.trial_id
        for status in reader.trials(log.code)
        if status.trial_id is not None
        for line in reader.events(status.trial_id)
        if line.event.kind == "confirm"
    )
    sent = {pointed.ray: pointed for pointed in log.points if pointed.ray is not None}
    missing = [pointed for ray, pointed in sent.items() if ray not in rays]
    num_moves = sum(map(_is_move, clicks))
    moves = _Missing.of([pointed.was_cut_off for pointed in log.points if pointed.ray is None], num_moves)
    answers = _Missing.of([answer.was_cut_off for answer in log.answers], len(confirmed))
    who, num_points = f"{log.code} ({log.kind})", len(log.points)
    lost = [f"{who}: click {log.points.index(one) + 1} of {num_points}" for one in missing if not one.was_cut_off]
    lost += [f"{who}: a move of the mark"] * moves.lost
    lost = lost[sum(dropped[reason] for reason in _OF_CLICKS) :]
    return BotCount(
        sent=num_points,
        stored=len(rays.keys() & sent.keys()) + min(num_moves, num_points - len(sent)),
        dropped=dropped,
        lost=(*lost, *[f"{who}: an answer of {len(log.answers)}"] * answers.lost),
        cut_off=sum(pointed.was_cut_off for pointed in missing) + moves.cut_off + answers.cut_off,
        duplicated=sum(count - 1 for ray, count in rays.items() if ray in sent) + confirmed.total() - len(confirmed),
        unknown=sum(count for ray, count in rays.items() if ray not in sent) + moves.unknown + answers.unknown,
        answers=len(confirmed),
    )


@dataclass(frozen=True, slots=True)
class _Missing:
    """What is missing of things that are only counted: those cut off may be stored or not."""

    lost: int
    cut_off: int
    unknown: int

    @classmethod
    def of(cls, were_cut_off: list[bool], stored: int) -> "_Missing":
        num, num_cut_off = len(were_cut_off), sum(were_cut_off)
        return cls(
            lost=max(0, num - num_cut_off - stored),
            cut_off=min(num_cut_off, max(0, num - stored)),
            unknown=max(0, stored - num),
        )


def _is_move(event: Clicked) -> bool:
    """Whether the ray is the server's own, which looks straight down through the moved mark."""
    return event.ray.direction == _DOWN and event.ray.camera_position == event.ray.origin

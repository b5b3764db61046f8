"""The logs of bots, and their comparison with the study's records: what was lost, and what is there twice.

Each key has its own browser time (`t_cli_ms`) and each click its own ray, so each is searched for by itself. Moves of
the mark and answers are only counted.
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
"""Reasons for which a click, a move or an answer is stored as dropped; the event does not say which one it was."""
_DOWN = (0.0, -1.0, 0.0)
_NEAR = 0.03
"""Largest distance of a mark from its expected place, metres."""
_MOVED = 0.1
"""Metres by which an arrow moves the mark (`NUDGE_M` of study_app/screens/pog.py, which is heavy to import)."""


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
    """Whether the bot hung up before an answer came."""


@dataclass(slots=True)
class Pointed:
    """One click, or one press that moves the mark."""

    sent_s: float
    """`time.perf_counter()`."""
    xz: tuple[float, float]
    """Expected place of the mark, or for a move its place before; world metres."""
    ray: tuple[Vector3, Vector3] | None = None
    """Origin and direction as sent, different for each click; None = a move of the mark."""
    shown_s: float | None = None
    """When the mark was there, which is shown once it is stored."""
    is_awaited: bool = True
    """Whether the bot waits for it."""
    was_cut_off: bool = False
    """As in `Press`, or whether the time of the trial ended first."""

    def is_marked_by(self, mark: Vector3) -> bool:
        """Whether a mark at this place (world metres) can come from the click or move."""
        distance = math.hypot(mark[0] - self.xz[0], mark[2] - self.xz[1])
        return abs(distance - (0.0 if self.ray is not None else _MOVED)) < _NEAR


@dataclass(slots=True)
class Confirmed:
    """One answer: the mark was confirmed, by one press or several."""

    sent_s: float
    shown_s: float | None = None
    """When the page went on, which it does once the answer is stored."""
    was_cut_off: bool = False
    """As in `Press`."""


@dataclass(slots=True)
class BotLog:
    """Everything that one bot did."""

    code: str
    """The participant."""
    kind: BotKind
    task: TaskKind = "pan"
    presses: list[Press] = field(default_factory=list)
    """Keys of a PAN bot."""
    ends: list[int] = field(default_factory=list)
    """Number of keys that it had sent when each of its connections ended."""
    points: list[Pointed] = field(default_factory=list)
    """Clicks and moves of the mark of a POG bot."""
    answers: list[Confirmed] = field(default_factory=list)
    """Answers of a POG bot."""
    num_acked: int = 0
    """Number of keys that the study has told a PAN bot are on disk."""
    step_counted: int = 0
    """Last value of the step counter that a PAN bot saw."""
    resumed: list[tuple[int, int]] = field(default_factory=list)
    """(step of the first picture, index in `presses` of the next key) after each return of a PAN bot."""
    num_frames: int = 0
    """Pictures of the robot's camera received."""
    num_connections: int = 0
    num_unanswered: int = 0
    """Keys, clicks and answers whose effect did not come within ANSWER_S, without keys that were pressed before an
    earlier one's picture."""
    problem: str = ""
    """Why it ended early; empty if it did not."""
    is_finished: bool = False
    """Whether it has no trial left."""
    is_resting: bool = False
    """Whether the study asked it to come back later."""
    completion_code: str | None = None
    """The code on the last page."""


@dataclass(frozen=True, slots=True)
class BotCount:
    """Counts of the keys, clicks, moves of the mark and answers of bots in the records."""

    sent: int = 0
    """Keys, clicks and moves of the mark."""
    stored: int = 0
    """Different ones in the database; keys count even if they were dropped with a reason."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Stored as without effect, by reason: `busy`, `rate`, ..."""
    lost: tuple[str, ...] = ()
    """Sent and not stored, without those cut off, such as `p02 (random): key 3 of 5`."""
    cut_off: int = 0
    """Not stored, because the bot hung up while they were on their way; they were never acknowledged."""
    untimed: int = 0
    """Keys stored without the page's own time, because its message came too long before them."""
    duplicated: int = 0
    """Stored more than once."""
    unknown: int = 0
    """Stored, but sent by no bot."""
    answers: int = 0
    """Trials with a confirmed mark."""

    def __add__(self, other: "BotCount") -> "BotCount":
        """The sums of both."""
        return BotCount(*(getattr(self, name) + getattr(other, name) for name in BotCount.__slots__))


def count_bots(folder: Path, logs: Sequence[BotLog]) -> BotCount:
    """Compares everything that bots have sent with the records.

    Args:
        folder: Folder of the study; its hash chains are checked first.
        logs: The logs of all bots.

    Raises:
        StudyError: The database is damaged.
    """
    with read_study(folder) as reader:
        reader.check()
        return sum((_points(reader, log) if log.task == "pog" else _keys(reader, log) for log in logs), BotCount())


def events_of(reader: StudyReader, code: str) -> list[Event]:
    """All events of a participant, in order."""
    trials = [status.trial_id for status in reader.trials(code) if status.trial_id is not None]
    return [line.event for trial in trials for line in reader.events(trial)]


def _keys(reader: StudyReader, log: BotLog) -> BotCount:
    """Searches for each key of a PAN bot.

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
    lost = gone[untimed:]  # nobody knows which of them were stored without a time
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
    """Searches for each click of a POG bot, and counts its moves and answers."""
    events = events_of(reader, log.code)
    clicks = [event for event in events if isinstance(event, Clicked)]
    rays = Counter((event.ray.origin, event.ray.direction) for event in clicks if not _is_move(event))
    dropped = Counter(event.reason for event in events if isinstance(event, Dropped))
    opened = [status.trial_id for status in reader.trials(log.code) if status.trial_id is not None]
    confirmed = [sum(line.event.kind == "confirm" for line in reader.events(trial)) for trial in opened]
    num_answers, num_moves = sum(count > 0 for count in confirmed), sum(map(_is_move, clicks))
    sent = {point.ray: point for point in log.points if point.ray is not None}
    missing = [point for ray, point in sent.items() if ray not in rays]
    who, num_points = f"{log.code} ({log.kind})", len(log.points)
    lost = [f"{who}: click {log.points.index(one) + 1} of {num_points}" for one in missing if not one.was_cut_off]
    moves_cut_off = [point.was_cut_off for point in log.points if point.ray is None]
    moves = _only_counted(moves_cut_off, num_moves, f"{who}: a move of the mark")
    answers_cut_off = [answer.was_cut_off for answer in log.answers]
    answers = _only_counted(answers_cut_off, num_answers, f"{who}: an answer of {len(log.answers)}")
    return BotCount(
        sent=num_points,
        stored=len(rays.keys() & sent.keys()) + min(num_moves, num_points - len(sent)),
        dropped=dropped,
        lost=(*(*lost, *moves.lost)[sum(dropped[reason] for reason in _OF_CLICKS) :], *answers.lost),
        cut_off=sum(point.was_cut_off for point in missing) + moves.cut_off + answers.cut_off,
        duplicated=sum(count - 1 for ray, count in rays.items() if ray in sent) + sum(confirmed) - num_answers,
        unknown=sum(count for ray, count in rays.items() if ray not in sent) + moves.unknown + answers.unknown,
        answers=num_answers,
    )


def _only_counted(were_cut_off: Sequence[bool], num_stored: int, words: str) -> BotCount:
    """The count of actions that cannot be told apart: those cut off may be stored or not."""
    num, num_cut_off = len(were_cut_off), sum(were_cut_off)
    return BotCount(
        lost=(words,) * max(0, num - num_cut_off - num_stored),
        cut_off=min(num_cut_off, max(0, num - num_stored)),
        unknown=max(0, num_stored - num),
    )


def _is_move(event: Clicked) -> bool:
    """Whether the ray is the server's own, which looks straight down through the moved mark."""
    return event.ray.direction == _DOWN and event.ray.camera_position == event.ray.origin

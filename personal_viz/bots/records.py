"""The logs of bots, and their comparison with the study's records: what was lost or stored twice.

Each key has its own browser time (`t_cli_ms`) and each click its own ray, so each is searched for by itself. Moves of
the mark and answers are only counted.
"""

import itertools
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Act, Clicked, Dropped, Event, Key
from sim.tasks.run_files import Vector3
from sim.types import TaskKind

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]
KINDS: tuple[BotKind, ...] = ("shortest", "random", "slow", "impatient", "disconnecting")
Ray = tuple[Vector3, Vector3]
"""Origin in world metres, direction of length 1."""
_OF_CLICKS = ("rate", "phase")
"""Reasons for which a click, a move or an answer is stored as dropped; the event does not say which one it was."""
_DOWN = (0.0, -1.0, 0.0)
_NEAR = 0.03
"""Largest distance of a mark from its expected place, metres."""
_MOVED = 0.1
"""Metres by which an arrow moves the mark (`NUDGE_M` of study_app/screens/pog.py, which is heavy to import)."""


@dataclass(slots=True, eq=False)
class Sent:
    """One action of a bot: a key, a click, a move of the mark or an answer."""

    sent_s: float
    """`time.perf_counter()`."""
    is_awaited: bool = field(default=True, kw_only=True)
    """Whether the bot waits for its effect."""
    shown_s: float | None = field(default=None, kw_only=True)
    """When the page showed its effect: the next picture, the mark, or after an answer the next page."""
    was_cut_off: bool = field(default=False, kw_only=True)
    """Whether the connection, or the time of the trial, ended before that."""

    @property
    def shown_ms(self) -> float | None:
        """Milliseconds from sending it until then."""
        return None if self.shown_s is None else 1e3 * (self.shown_s - self.sent_s)


@dataclass(slots=True, eq=False)
class Press(Sent):
    """One key."""

    mark: float
    """The bot's clock (`t_cli_ms`), different for each of its keys; stored with the key."""
    step: int = 0
    """Number of steps of the trial once it is stored."""
    counted_s: float | None = None
    """When the step counter said that it is stored."""

    @property
    def counted_ms(self) -> float | None:
        """Milliseconds from sending it until then."""
        return None if self.counted_s is None else 1e3 * (self.counted_s - self.sent_s)


@dataclass(slots=True, eq=False)
class Pointed(Sent):
    """One click, or one press that moves the mark; the mark is shown once it is stored."""

    xz: tuple[float, float]
    """Expected place of the mark, or for a move its place before; world metres."""
    mark: Ray | None = None
    """The ray as sent, different for each click; None = a move of the mark."""

    def is_marked_by(self, mark: Vector3) -> bool:
        """Whether a mark at this place (world metres) can come from the click or move."""
        distance = math.hypot(mark[0] - self.xz[0], mark[2] - self.xz[1])
        return abs(distance - (0.0 if self.mark is not None else _MOVED)) < _NEAR


@dataclass(slots=True)
class BotLog:
    """Everything that one bot did."""

    code: str
    """The participant."""
    kind: BotKind
    task: TaskKind = "pan"
    presses: list[Press] = field(default_factory=list)
    """Keys of a PAN bot."""
    points: list[Pointed] = field(default_factory=list)
    """Clicks and moves of the mark of a POG bot."""
    answers: list[Sent] = field(default_factory=list)
    """Answers of a POG bot; each mark was confirmed by one press or several."""
    ends: list[int] = field(default_factory=list)
    """Number of keys, clicks and moves that it had sent when each of its connections ended."""
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
    """Awaited actions whose effect did not come within ANSWER_S."""
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
    """Sent and not stored, without those cut off, such as `p02 (random): key 3 of 5`; also `missing_steps`."""
    cut_off: int = 0
    """Not stored, because the bot hung up while they were on their way; they were never acknowledged."""
    untimed: int = 0
    """Keys stored without the page's own time, because its message came too long before them."""
    duplicated: int = 0
    """Stored more than once."""
    unknown: int = 0
    """Stored, but sent by no bot."""
    answers: int = 0
    """Trials, or searches of home sequences, with a confirmed mark."""

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
    lost = missing_steps(folder, logs)
    with read_study(folder) as reader:
        return sum((_count(reader, log) for log in logs), BotCount(lost=lost))


def missing_steps(folder: Path, logs: Sequence[BotLog]) -> tuple[str, ...]:
    """Steps that a bot's page has counted but that are not stored now; all hash chains are checked.

    A page's counter says "Step 7" when seven steps are on disk.

    Raises:
        StudyError: The database is damaged.
    """
    counted = [log.step_counted for log in logs]  # must be read before the records
    missing = []
    with read_study(folder) as reader:
        reader.check()
        for log, step in zip(logs, counted, strict=True):
            trials = trial_events(reader, log.code)[-2:]  # the page may still show the trial before the last
            stored = max((sum(isinstance(event, Act) for event in events) for events in trials), default=0)
            if stored < step:
                missing.append(f"{log.code}: step {step} was counted, {stored} are stored")
    return tuple(missing)


def trial_events(reader: StudyReader, code: str) -> list[list[Event]]:
    """The events of each trial that a participant has opened, in order."""
    opened = [status.trial_id for status in reader.trials(code) if status.trial_id is not None]
    return [[line.event for line in reader.events(trial)] for trial in opened]


def _count(reader: StudyReader, log: BotLog) -> BotCount:
    """Searches for each key or click of a bot, and counts its moves and answers."""
    trials = trial_events(reader, log.code)
    events = list(itertools.chain.from_iterable(trials))
    clicks = [event for event in events if isinstance(event, Clicked)]
    found = Counter[float | Ray | None](event.t_cli_ms for event in events if isinstance(event, Key))
    found.update((event.ray.origin, event.ray.direction) for event in clicks if not _is_move(event))
    dropped = Counter(event.reason for event in events if isinstance(event, Dropped))
    untimed = found.pop(None, 0)
    nameless = sum(dropped[reason] for reason in _OF_CLICKS) if log.task == "pog" else untimed
    sent = [*log.presses, *log.points]
    marks = {one.mark for one in sent if one.mark is not None}
    missing, gone = _missing(sent, found.keys(), log.ends)
    who, word = f"{log.code} ({log.kind})", "click" if log.task == "pog" else "key"
    moves = [point for point in log.points if point.mark is None]
    moved = _only_counted(moves, sum(map(_is_move, clicks)), f"{who}: a move of the mark")
    confirmed = [sum(event.kind == "confirm" for event in trial) for trial in trials]
    searches = [max(1, sum(event.kind == "search" for event in trial)) for trial in trials]
    num_answers = sum(map(min, confirmed, searches))
    answered = _only_counted(log.answers, num_answers, f"{who}: an answer of {len(log.answers)}")
    lost = (*(f"{who}: {word} {place + 1} of {len(sent)}" for place in gone), *moved.lost)
    return BotCount(
        sent=len(sent),
        stored=len(found.keys() & marks) + untimed + moved.stored,
        dropped=dropped,
        lost=(*lost[nameless:], *answered.lost),  # nobody knows which of them were stored without a name
        cut_off=max(0, len(missing) - max(len(gone), nameless)) + moved.cut_off + answered.cut_off,
        untimed=untimed,
        duplicated=sum(found[mark] - 1 for mark in marks if mark in found) + sum(confirmed) - num_answers,
        unknown=sum(count for mark, count in found.items() if mark not in marks) + moved.unknown + answered.unknown,
        answers=num_answers,
    )


def _missing(
    sent: Sequence[Press | Pointed], found: Collection[float | Ray | None], ends: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Places in `sent` of keys and clicks that are not stored, and of those among them that must have been lost.

    Actions of one connection are stored in the order in which they were sent: one is lost if a later one of its
    connection is stored, or if it was not cut off.
    """
    missing, gone = list[int](), list[int]()
    for begin, end in itertools.pairwise([0, *ends, len(sent)]):
        last = max((place for place in range(begin, end) if sent[place].mark in found), default=-1)
        absent = [k for k in range(begin, end) if sent[k].mark is not None and sent[k].mark not in found]
        missing += absent
        gone += [place for place in absent if place < last or not sent[place].was_cut_off]
    return missing, gone


def _only_counted(sent: Sequence[Sent], num_stored: int, words: str) -> BotCount:
    """The count of actions that cannot be told apart: those cut off may be stored or not."""
    num, num_cut_off = len(sent), sum(one.was_cut_off for one in sent)
    return BotCount(
        stored=min(num, num_stored),
        lost=(words,) * max(0, num - num_cut_off - num_stored),
        cut_off=min(num_cut_off, max(0, num - num_stored)),
        unknown=max(0, num_stored - num),
    )


def _is_move(event: Clicked) -> bool:
    """Whether the ray is the server's own, which looks straight down through the moved mark."""
    return event.ray.direction == _DOWN and event.ray.camera_position == event.ray.origin

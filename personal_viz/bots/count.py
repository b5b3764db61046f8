"""Compares what bots sent with what the study's database holds: what was lost, what is there twice.

Keys carry the browser's clock (`t_cli_ms`), which bots make different for each key: so each is looked for by itself.
Clicks and answers of POG bots are counted by `bots_count_pog`; all that is said of keys here holds for them, too.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Dropped, Key

from .count_pog import count_points
from .log import BotCount, BotLog


class KeyCount(BaseModel):
    """Where that is which bots sent."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    sent: int
    """Keys, clicks and moves of the mark."""
    stored: int
    """Different ones that are in the database; keys also where they were dropped with a reason."""
    dropped: dict[str, int]
    """Stored as without effect, by reason: `busy`, `rate` and so on."""
    lost: int
    """Sent and not stored, without those cut off; answers too."""
    cut_off: int
    """Not stored, because the bot hung up while they were on their way; nobody was told that they counted."""
    duplicated: int
    """Stored more than once."""
    unknown: int
    """Stored, but sent by no bot."""
    lost_keys: tuple[str, ...]
    """Which were lost: participant, number of the key or click, of how many."""
    events: int
    """All events in the database; its hash chains have been checked."""
    clicks: int = 0
    """Of `sent`: clicks and moves of the mark."""
    answers: int = 0
    """Marks that were confirmed, in the database."""


def count_keys(folder: Path, logs: Sequence[BotLog]) -> KeyCount:
    """Looks for each key and click of each bot.

    Args:
        folder: Of the study; checked whole first.
        logs: What the bots did, all who took part.

    Raises:
        StudyError: The database is damaged.
    """
    with read_study(folder) as reader:
        num_events = reader.check()
        found = [count_points(reader, log) if log.task == "pog" else count_presses(reader, log) for log in logs]
    dropped = sum((count.dropped for count in found), Counter[str]())
    return KeyCount(
        sent=sum(count.sent for count in found),
        stored=sum(count.stored for count in found),
        dropped=dict(sorted(dropped.items())),
        lost=sum(len(count.lost) for count in found),
        cut_off=sum(count.cut_off for count in found),
        duplicated=sum(count.duplicated for count in found),
        unknown=sum(count.unknown for count in found),
        lost_keys=tuple(text for count in found for text in count.lost),
        events=num_events,
        clicks=sum(len(log.points) for log in logs),
        answers=sum(count.answers for count in found),
    )


def count_presses(reader: StudyReader, log: BotLog) -> BotCount:
    """Looks for each key of a PAN bot."""
    found: Counter[float | None] = Counter()
    dropped: Counter[str] = Counter()
    for status in reader.trials(log.code):
        events = [one.event for one in reader.events(status.trial_id)] if status.trial_id is not None else []
        found.update(event.t_cli_ms for event in events if isinstance(event, Key))
        dropped.update(event.reason for event in events if isinstance(event, Dropped))
    sent = {press.t_cli_ms: press for press in log.presses}
    missing = [press for mark, press in sent.items() if mark not in found]
    before_stored = _before_stored(log, {mark for mark in found if mark is not None})
    gone = [
        number
        for number, press in enumerate(log.presses, start=1)
        if press.t_cli_ms not in found and (number <= before_stored[number - 1] or not press.was_cut_off)
    ]
    return BotCount(
        sent=len(log.presses),
        stored=len(found.keys() & sent.keys()),
        dropped=dropped,
        lost=tuple(f"{log.code} ({log.kind}): key {number} of {len(log.presses)}" for number in gone),
        cut_off=len(missing) - len(gone),
        duplicated=sum(count - 1 for mark, count in found.items() if mark in sent),
        unknown=sum(count for mark, count in found.items() if mark not in sent),
    )


def _before_stored(log: BotLog, found: set[float]) -> list[int]:
    """For each key the number of the last stored one of its connection: keys of one are stored in their order."""
    numbers: list[int] = []
    for begin, end in itertools.pairwise([0, *log.ends, len(log.presses)]):
        stored = [place + 1 for place in range(begin, end) if log.presses[place].t_cli_ms in found]
        numbers += [stored[-1] if stored else 0] * (end - begin)
    return numbers

"""Compares what bots sent with what the study's database holds: which keys were lost, which are there twice.

Keys carry the browser's clock (`t_cli_ms`), which bots make different for each key: so each is looked for by itself.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.events import Dropped, Key
from human_study.records import read_study

from .bots import BotLog


class KeyCount(BaseModel):
    """Where the keys are that bots sent."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    sent: int
    stored: int
    """Different keys of bots that are in the database, accepted or dropped with a reason."""
    dropped: dict[str, int]
    """Stored keys without effect, by reason: `busy`, `rate` and so on."""
    lost: int
    """Keys that were sent and are not stored, without those cut off."""
    cut_off: int
    """Not stored, because the bot hung up while they were on their way; nobody was told that they counted."""
    duplicated: int
    """Keys that are stored more than once."""
    unknown: int
    """Stored keys that no bot sent."""
    lost_keys: tuple[str, ...]
    """Which keys were lost: participant, number of the key, number of keys."""
    events: int
    """All events in the database; its hash chains have been checked."""


def count_keys(folder: Path, logs: Sequence[BotLog]) -> KeyCount:
    """Looks for each key of each bot.

    Args:
        folder: Of the study; checked whole first.
        logs: What the bots did, all who took part.

    Raises:
        StudyError: The database is damaged.
    """
    cut_off = duplicated = unknown = stored = 0
    dropped: Counter[str] = Counter()
    lost_keys: list[str] = []
    with read_study(folder) as reader:
        num_events = reader.check()
        for log in logs:
            found: Counter[float | None] = Counter()
            for status in reader.trials(log.code):
                events = reader.events(status.trial_id) if status.trial_id is not None else ()
                kinds = [one.event for one in events]
                found.update(event.t_cli_ms for event in kinds if isinstance(event, Key))
                dropped.update(event.reason for event in kinds if isinstance(event, Dropped))
            sent = {press.t_cli_ms: press for press in log.presses}
            stored += len(found.keys() & sent.keys())
            duplicated += sum(count - 1 for mark, count in found.items() if mark in sent)
            unknown += sum(count for mark, count in found.items() if mark not in sent)
            missing = [press for mark, press in sent.items() if mark not in found]
            cut_off += sum(press.was_cut_off for press in missing)
            gone = [log.presses.index(press) + 1 for press in missing if not press.was_cut_off]
            lost_keys += [f"{log.code} ({log.kind}): key {number} of {len(log.presses)}" for number in gone]
    return KeyCount(
        sent=sum(len(log.presses) for log in logs),
        stored=stored,
        dropped=dict(sorted(dropped.items())),
        lost=len(lost_keys),
        cut_off=cut_off,
        duplicated=duplicated,
        unknown=unknown,
        lost_keys=tuple(lost_keys),
        events=num_events,
    )

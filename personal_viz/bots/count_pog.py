"""Compares what POG bots sent with the database: clicks by their rays, moves and answers by their number."""

from collections import Counter
from dataclasses import dataclass

from human_study.store.records import StudyReader
from human_study.trial.events import Clicked, Confirmed, Dropped, Event

from .log import BotCount, BotLog

_OF_CLICKS = ("rate", "phase")
"""Reasons for which a click, a move or an answer is stored as dropped; that event does not say which one it was."""
_DOWN = (0.0, -1.0, 0.0)


def count_points(reader: StudyReader, log: BotLog) -> BotCount:
    """Looks for each click of a bot by itself, and for as many moves and answers as it sent.

    Args:
        reader: Of the study.
        log: Of a POG bot.
    """
    rays: Counter[tuple] = Counter()
    moves, answers, more_answers = 0, 0, 0
    dropped: Counter[str] = Counter()
    for status in reader.trials(log.code):
        events = [one.event for one in reader.events(status.trial_id)] if status.trial_id is not None else []
        rays.update((event.ray.origin, event.ray.direction) for event in _clicks(events) if not _is_move(event))
        moves += sum(_is_move(event) for event in _clicks(events))
        dropped.update(event.reason for event in events if isinstance(event, Dropped))
        confirmed = sum(isinstance(event, Confirmed) for event in events)
        answers += min(1, confirmed)
        more_answers += max(0, confirmed - 1)
    sent = {pointed.ray: pointed for pointed in log.points if pointed.ray is not None}
    sent_moves = [pointed for pointed in log.points if pointed.ray is None]
    missing = [pointed for ray, pointed in sent.items() if ray not in rays]
    missing_moves = _missing([pointed.was_cut_off for pointed in sent_moves], moves)
    missing_answers = _missing([answer.was_cut_off for answer in log.answers], answers)
    gone = [log.points.index(pointed) + 1 for pointed in missing if not pointed.was_cut_off]
    who, num_points = f"{log.code} ({log.kind})", len(log.points)
    lost = [f"{who}: click {number} of {num_points}" for number in gone]
    lost += [f"{who}: a move of the mark"] * missing_moves.lost
    lost = lost[sum(dropped[reason] for reason in _OF_CLICKS) :]
    return BotCount(
        sent=num_points,
        stored=len(rays.keys() & sent.keys()) + min(moves, len(sent_moves)),
        dropped=dropped,
        lost=(*lost, *[f"{who}: an answer of {len(log.answers)}"] * missing_answers.lost),
        cut_off=sum(pointed.was_cut_off for pointed in missing) + missing_moves.cut_off + missing_answers.cut_off,
        duplicated=sum(count - 1 for ray, count in rays.items() if ray in sent) + more_answers,
        unknown=sum(count for ray, count in rays.items() if ray not in sent)
        + missing_moves.unknown
        + missing_answers.unknown,
        answers=answers,
    )


@dataclass(frozen=True, slots=True)
class _Missing:
    lost: int
    cut_off: int
    unknown: int


def _missing(were_cut_off: list[bool], stored: int) -> _Missing:
    """What is missing of things that are only counted: those cut off may be stored or not."""
    num_cut_off = sum(were_cut_off)
    num_whole = len(were_cut_off) - num_cut_off
    return _Missing(
        lost=max(0, num_whole - stored),
        cut_off=min(num_cut_off, max(0, len(were_cut_off) - stored)),
        unknown=max(0, stored - len(were_cut_off)),
    )


def _clicks(events: list[Event]) -> list[Clicked]:
    return [event for event in events if isinstance(event, Clicked)]


def _is_move(event: Clicked) -> bool:
    """Whether the ray is the server's own, which looks straight down through the moved mark."""
    return event.ray.direction == _DOWN and event.ray.camera_position == event.ray.origin

"""Stages of a participant in the study: an append-only list, from which every page is derived."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

Stage = Literal[
    "arrived",
    "device_ok",
    "device_failed",
    "consented",
    "declined",
    "instructed",
    "quiz_passed",
    "quiz_failed",
    "keys_changed",
    "sitting_started",
    "break_started",
    "break_ended",
    "finished",
    "withdrawn",
    "screened_out",
    "dropped_out",
    "returned",
    "full",
]
WayOut = Literal["declined", "withdrawn", "screened_out", "full"]
"""Stages after which a participant does nothing more."""
OUT: tuple[WayOut, ...] = get_args(WayOut)


@dataclass(frozen=True, slots=True)
class StageEntry:
    """A stage that a participant reached."""

    stage: Stage
    detail: dict[str, Any]
    """Answers of the quiz, the coarse profile of the device and similar facts."""
    at_ns: int
    """Server's wall clock."""


def has_reached(entries: Sequence[StageEntry], stage: Stage) -> bool:
    """Whether the stage is among the entries."""
    return any(entry.stage == stage for entry in entries)


def way_out(entries: Sequence[StageEntry]) -> WayOut | None:
    """The stage by which the participant left for good; None if there is none."""
    return next((entry.stage for entry in entries if entry.stage in OUT), None)


def has_dropped_out(entries: Sequence[StageEntry]) -> bool:
    """Whether the participant's trials were given to others and the participant has not returned since."""
    moves = [entry.stage for entry in entries if entry.stage in ("dropped_out", "returned")]
    return bool(moves) and moves[-1] == "dropped_out"


def last_detail(entries: Sequence[StageEntry], stage: Stage) -> dict:
    """The details stored with the newest entry of a stage; {} where there is none."""
    return next((entry.detail for entry in reversed(entries) if entry.stage == stage), {})

"""The searches of home sequences as rows of plain figures, one row for each search of each finished attempt."""

from collections.abc import Sequence
from typing import Annotated

from sim.episodes.sequences import SubtaskKind
from sim.sequences.figures import search_dtg, search_spl
from sim.sequences.runs import SearchEnd, SearchReason, SequenceEnd
from sim.types import SuccessRule

from ..trial.events import Event
from ..trial.outcome import Outcome
from ..trial.searches import SearchPart, search_parts
from .data_dictionary import Unit
from .trial_table import AttemptName, Metres, Seconds

SEARCHES = "searches"
"""Name of the table."""
MEANING = (
    "One row per search of an attempt at a home sequence that ended with a result. In `trials`, `success` of a "
    "sequence says whether all its searches succeeded, and `episode_id` names the sequence."
)


class SearchRow(AttemptName):
    """One search of one attempt."""

    search: int
    """Place of the search in its sequence, from 0."""
    kind: SubtaskKind
    """`fresh`: nobody asked before, and the intro decides the answer; `revisit`: asked before; `changed`: a later
    message decides the answer; `stale`: the owner gave an object of the category away and has another one."""
    is_for_all: bool
    """Whether all right objects were to be marked."""
    message: int
    """Index of the message that decides the answer; 0 = the intro."""
    notes: tuple[str, ...]
    """Indices of the messages that could be read during the search."""
    is_told: bool
    """Whether the message that decides the answer was among these."""
    reason: SearchReason
    """The end of the search."""
    success: bool | None
    """Under the success rule of the study file; empty where it is undefined. Of a search for all, under every rule,
    whether `recall` and `precision` are 1, however it ended."""
    spl: Annotated[float, Unit("share")] | None
    """Success weighted by path length from where the search began, 0 to 1; PAN only."""
    dtg: Metres | None
    """Walking distance left to where the rule counts FOUND; PAN only, of searches that ended with FOUND."""
    planar_distance: Metres | None
    """From the last position or the answer to the nearest right object's middle, on the floor plan."""
    n_steps: Annotated[int, Unit("steps")] | None
    """Actions, FOUND included; PAN only."""
    path_m: Metres | None
    """Length of the robot's way; PAN only."""
    t_s: Seconds | None
    """From the beginning of the search to its end, without time away."""
    is_at_old: bool | None
    """Whether the answer was at the object that was right before and at no right one; empty where there is none."""
    recall: Annotated[float, Unit("share")] | None
    """Share of the right objects that were marked; of searches for all. In PAN each FOUND is a mark and counts however
    the search ended; in POG marks count only if they were confirmed."""
    precision: Annotated[float, Unit("share")] | None
    """Share of the marks, counted as for `recall`, that are at a right object not marked before; 0 without marks. Of
    searches for all."""


def search_rows(
    name: AttemptName, events: Sequence[Event], outcome: Outcome | None, *, rule: SuccessRule
) -> list[SearchRow]:
    """The rows of one attempt; [] without a scored sequence.

    Args:
        name: The attempt.
        events: All its events.
        outcome: Its stored or recomputed outcome.
        rule: Success rule of the study file.
    """
    if not isinstance(outcome, SequenceEnd):
        return []
    parts = search_parts(events)
    return [_row(name, part, end, rule) for part, end in zip(parts, outcome.searches, strict=True)]


def _row(name: AttemptName, part: SearchPart, end: SearchEnd, rule: SuccessRule) -> SearchRow:
    began_s, ended_s, walk = part.begun.t_s, part.end and part.end.t_s, end.measures
    planar = end.answer.planar_distance if end.answer is not None else walk and walk.centre_distance
    return SearchRow(
        **name.place,
        search=part.begun.search,
        kind=end.kind,
        is_for_all=part.begun.is_for_all,
        message=end.message,
        notes=tuple(map(str, part.begun.notes)),
        is_told=end.message in part.begun.notes,
        reason=end.reason,
        success=end.succeeds(rule),
        spl=None if walk is None else search_spl(end, rule),
        dtg=search_dtg(end, rule),
        planar_distance=planar,
        n_steps=None if walk is None else walk.num_steps,
        path_m=None if walk is None else walk.path_m,
        t_s=None if began_s is None or ended_s is None else ended_s - began_s,
        is_at_old=end.is_at_old,
        recall=end.all and end.all.recall,
        precision=end.all and end.all.precision,
    )

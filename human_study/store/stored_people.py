"""Reads where people are from the database, without decrypting anything and without results of trials.

Only `technical` and `abandoned` leave the database as reasons for a trial's end; all other reasons read as `done`.
"""

import json
from collections import defaultdict

from sim.types import EpisodeKey

from ..journey import AssignedTrial, Person
from .record_types import StageEntry
from .records import StudyReader

_END = "CASE WHEN end_reason IS NULL OR end_reason IN ('technical', 'abandoned') THEN end_reason ELSE 'done' END"


def stored_person(reader: StudyReader, code: str) -> Person:
    """One participant.

    Raises:
        StudyError: There is no such participant.
    """
    reader.participant(code)
    return stored_people(reader, code)[0]


def stored_people(reader: StudyReader, code: str | None = None) -> list[Person]:
    """All participants, p01 first, or only the given one."""
    only, values = ("", ()) if code is None else (" WHERE code = ?", (code,))
    stages: dict[str, list[StageEntry]] = defaultdict(list)
    for owner, stage, detail, at_ns in reader.rows(
        f"SELECT code, stage, detail, at_ns FROM stage{only} ORDER BY seq", *values
    ):
        stages[owner].append(StageEntry(stage, json.loads(detail), at_ns))
    trials = _trials(reader, only, values)
    people = reader.rows(
        "SELECT code, task, EXISTS(SELECT 1 FROM claim WHERE claim.code = participant.code)"
        f" FROM participant{only} ORDER BY length(code), code",
        *values,
    )
    return [
        Person(
            code=owner,
            task=task,
            is_claimed=bool(is_claimed or stages[owner] or any(trial.is_begun for trial in trials[owner])),
            stages=tuple(stages[owner]),
            trials=tuple(trials[owner]),
        )
        for owner, task, is_claimed in people
    ]


def _trials(reader: StudyReader, only: str, values: tuple[str, ...]) -> dict[str, list[AssignedTrial]]:
    rows = reader.rows(
        "SELECT code, order_no, phase, task, condition, split, scene, episode_id, rep, release.at_ns IS NOT NULL,"
        " trial_id IS NOT NULL, EXISTS(SELECT 1 FROM sitting WHERE sitting.trial_id = trial.trial_id),"
        f" {_END}, outcome.at_ns FROM assignment"
        " LEFT JOIN trial ON trial.assignment_id = assignment.assignment_id AND attempt = (SELECT max(attempt)"
        " FROM trial AS other WHERE other.assignment_id = assignment.assignment_id)"
        " LEFT JOIN outcome USING(trial_id) LEFT JOIN release ON release.assignment_id = assignment.assignment_id"
        f"{only} ORDER BY order_no",
        *values,
    )
    found = defaultdict(list)
    for code, order_no, phase, task, condition, split, scene, episode_id, rep, *rest in rows:
        is_released, is_begun, is_open, end, ended_ns = rest
        key = EpisodeKey(split, scene, episode_id)
        flags = bool(is_released), bool(is_begun), bool(is_open)
        found[code].append(AssignedTrial(order_no, phase, task, condition, key, rep, *flags, end, ended_ns))
    return found

"""Reads the progress of people from the database, without decrypting anything and without results of trials.

Of the reasons for a trial's end only `technical` and `abandoned` leave the database; all others read `done`.
"""

import json
from collections import defaultdict
from dataclasses import dataclass

from sim.types import EpisodeKey

from ..journey import AssignedTrial, Person
from .records import StudyReader
from .stages import StageEntry

_END = "CASE WHEN end_reason IS NULL OR end_reason IN ('technical', 'abandoned') THEN end_reason ELSE 'done' END"


@dataclass(frozen=True, slots=True)
class PersonRow:
    """The stored facts about one participant, with those for the operator."""

    person: Person
    num_reconnects: int
    num_technical: int
    num_abandoned: int
    last_ns: int | None
    """Time of the participant's newest record, by the server's wall clock; None = there is none."""


def stored_person(reader: StudyReader, code: str) -> Person:
    """One participant.

    Raises:
        StudyError: There is no such participant.
    """
    reader.participant(code)
    return _people(reader, code)[0]


def person_rows(reader: StudyReader) -> list[PersonRow]:
    """All participants, p01 first."""
    ends = _ends(reader)
    reconnects = dict(
        reader.rows(
            "SELECT code, count(*) - count(DISTINCT trial_id) FROM sitting JOIN trial USING(trial_id)"
            " JOIN assignment USING(assignment_id) GROUP BY code"
        )
    )
    latest = dict(reader.rows(_LATEST))
    return [
        PersonRow(
            person,
            num_reconnects=reconnects.get(person.code, 0),
            num_technical=ends.get((person.code, "technical"), 0),
            num_abandoned=ends.get((person.code, "abandoned"), 0),
            last_ns=latest.get(person.code),
        )
        for person in _people(reader)
    ]


# The newest event is read only for running trials: an outcome is newer than the events before it.
_LATEST = """
SELECT code, max(at_ns) FROM (
    SELECT code, at_ns FROM stage
    UNION ALL SELECT code, at_ns FROM consent
    UNION ALL SELECT code, at_ns FROM claim
    UNION ALL SELECT code, max(
        opened_ns,
        coalesce(outcome.at_ns, 0),
        coalesce((SELECT max(sitting.opened_ns) FROM sitting WHERE sitting.trial_id = trial.trial_id), 0),
        CASE WHEN outcome.at_ns IS NULL THEN coalesce((
            SELECT t_srv_ns FROM event WHERE event.trial_id = trial.trial_id ORDER BY seq DESC LIMIT 1
        ), 0) ELSE 0 END
    ) FROM trial JOIN assignment USING(assignment_id) LEFT JOIN outcome USING(trial_id)
) GROUP BY code
"""


def _people(reader: StudyReader, code: str | None = None) -> list[Person]:
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


def _ends(reader: StudyReader) -> dict[tuple[str, str], int]:
    """Number of each participant's attempts that failed for technical reasons or were abandoned."""
    rows = reader.rows(
        "SELECT code, end_reason, count(*) FROM outcome JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        " WHERE end_reason IN ('technical', 'abandoned') GROUP BY code, end_reason"
    )
    return {(code, reason): count for code, reason, count in rows}

"""What the database says about how far people are, without decrypting anything and without how a trial ended.

Of the reasons for a trial's end only `technical` and `abandoned` leave the database; all others read `done`.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Literal

from sim.types import EpisodeKey, TaskKind

from ..design.plan import Phase
from ..design.study import Condition
from .records import StudyReader
from .stages import StageEntry

End = Literal["done", "technical", "abandoned"]
_END = "CASE WHEN end_reason IS NULL OR end_reason IN ('technical', 'abandoned') THEN end_reason ELSE 'done' END"


@dataclass(frozen=True, slots=True)
class AssignedTrial:
    """An assigned trial and its newest attempt."""

    order_no: int
    phase: Phase
    task: TaskKind
    condition: Condition
    key: EpisodeKey
    rep: int
    is_released: bool
    is_begun: bool
    end: End | None
    """None while the newest attempt has not ended."""
    ended_ns: int | None

    @property
    def is_due(self) -> bool:
        """Whether the participant has still to do, or finish, it."""
        return self.end is None and not self.is_released

    @property
    def is_done(self) -> bool:
        """Whether it ended with something to count and was kept."""
        return self.end == "done" and not self.is_released

    @property
    def slot(self) -> tuple[TaskKind, Condition, EpisodeKey, int]:
        """What one person after the other may hold."""
        return self.task, self.condition, self.key, self.rep


@dataclass(frozen=True, slots=True)
class PersonRow:
    """What is stored about one participant."""

    code: str
    task: TaskKind
    is_claimed: bool
    """Whether somebody came with this link, or took it from an open one."""
    stages: tuple[StageEntry, ...]
    trials: tuple[AssignedTrial, ...]
    """In the participant's order."""
    num_reconnects: int
    num_technical: int
    num_abandoned: int
    last_ns: int | None
    """The newest thing that is stored of the participant, by the server's wall clock; None = nothing."""


def person_rows(reader: StudyReader) -> list[PersonRow]:
    """All participants, p01 first."""
    stages = defaultdict(list)
    for stage, participant in _stages(reader):
        stages[participant].append(stage)
    trials = _trials(reader)
    ends = _ends(reader)
    reconnects = dict(
        reader.rows(
            "SELECT code, count(*) - count(DISTINCT trial_id) FROM sitting JOIN trial USING(trial_id)"
            " JOIN assignment USING(assignment_id) GROUP BY code"
        )
    )
    latest = dict(reader.rows(_LATEST))
    people = reader.rows("SELECT code, task FROM participant ORDER BY length(code), code")
    return [
        PersonRow(
            code=code,
            task=task,
            is_claimed=code in latest,
            stages=tuple(stages[code]),
            trials=tuple(trials[code]),
            num_reconnects=reconnects.get(code, 0),
            num_technical=ends.get((code, "technical"), 0),
            num_abandoned=ends.get((code, "abandoned"), 0),
            last_ns=latest.get(code),
        )
        for code, task in people
    ]


# The newest event is looked up in trials that run: an outcome is newer than the events before it.
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


def _stages(reader: StudyReader) -> list[tuple[StageEntry, str]]:
    """All stages in order, each with its participant; of their details only what says that a sitting ended."""
    rows = reader.rows(
        "SELECT code, stage, json_extract(detail, '$.done'), json_extract(detail, '$.sitting'), at_ns FROM stage"
        " ORDER BY seq"
    )
    return [
        (StageEntry(stage, {"done": done, "sitting": bool(ends)}, at_ns), code)
        for code, stage, done, ends, at_ns in rows
    ]


def _trials(reader: StudyReader) -> dict[str, list[AssignedTrial]]:
    rows = reader.rows(
        "SELECT code, order_no, phase, task, condition, split, scene, episode_id, rep, release.at_ns IS NOT NULL,"
        f" EXISTS(SELECT 1 FROM sitting WHERE sitting.trial_id = trial.trial_id), {_END}, outcome.at_ns FROM assignment"
        " LEFT JOIN trial ON trial.assignment_id = assignment.assignment_id AND attempt = (SELECT max(attempt)"
        " FROM trial AS other WHERE other.assignment_id = assignment.assignment_id)"
        " LEFT JOIN outcome USING(trial_id) LEFT JOIN release ON release.assignment_id = assignment.assignment_id"
        " ORDER BY order_no"
    )
    found = defaultdict(list)
    for code, order_no, phase, task, condition, split, scene, episode_id, rep, *rest in rows:
        is_released, is_begun, end, ended_ns = rest
        key = EpisodeKey(split, scene, episode_id)
        found[code].append(
            AssignedTrial(order_no, phase, task, condition, key, rep, bool(is_released), bool(is_begun), end, ended_ns)
        )
    return found


def _ends(reader: StudyReader) -> dict[tuple[str, str], int]:
    """How many attempts of each participant failed for technical reasons or were abandoned."""
    rows = reader.rows(
        "SELECT code, end_reason, count(*) FROM outcome JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        " WHERE end_reason IN ('technical', 'abandoned') GROUP BY code, end_reason"
    )
    return {(code, reason): count for code, reason, count in rows}

"""What people are called in exports: p01, p02, ... in an order that does not depend on their codes in the study."""

import hashlib
import json
from collections.abc import Sequence

from ..store.record_types import ParticipantRecord, TrialStatus
from ..store.records import StudyReader


def exported_codes(reader: StudyReader) -> dict[str, str]:
    """New code of each participant by code in the study, deleted ones included so that numbers stay.

    The order is that of hashes of the study and of what was planned for each person; people with the same plan (spare
    ones) follow the time of their arrival. So an export a week later numbers the same people the same way, and giving
    the people of a study other codes does not change its tables.
    """
    codes = reader.codes()
    order = sorted(codes, key=lambda code: _rank(reader.study_version, reader.participant(code), reader.trials(code)))
    width = max(2, len(str(len(codes))))
    return {code: f"p{number:0{width}d}" for number, code in enumerate(order, start=1)}


def is_gone(record: ParticipantRecord, *, is_deleted_on_withdrawal: bool) -> bool:
    """Whether nothing of a participant may be read any more, also just before the key is deleted."""
    return record.is_shredded or (record.is_withdrawn and is_deleted_on_withdrawal)


def _rank(study_version: str, record: ParticipantRecord, trials: Sequence[TrialStatus]) -> tuple[str, float, int, str]:
    """What people are sorted by; the study's own code only where nothing else tells two apart."""
    planned = {
        trial.order_no: [trial.order_no, trial.phase, trial.task, trial.condition, *trial.key, trial.rep]
        for trial in trials
        if trial.made_by == "plan"
    }
    text = json.dumps([study_version, record.task, record.arm, list(planned.values())])
    arrived = record.stages[0].at_ns if record.stages else float("inf")
    return hashlib.sha256(text.encode()).hexdigest(), arrived, len(record.code), record.code

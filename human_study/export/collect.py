"""A study's records as rows and runs under exported codes: an export writes them, a report reads them from here.

People are called p01, p02, ... in an order that does not depend on their codes in the study.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from sim.tasks.run_files import Answer, EpisodeRun, Run

from ..store.record_types import ParticipantRecord, StoredEvent, StoredTrial
from ..store.records import StudyReader
from .rows import ExclusionRow, ParticipantRow, VerificationRow, exclusion_rows, participant_row, verification_rows
from .runs import created_utc, result_of, trial_run_info
from .trial_table import RowContext, TrialRow, row_context, trial_row


@dataclass(slots=True)
class Collected:
    """All records of people whose records were not deleted, by exported code."""

    trials: list[TrialRow] = field(default_factory=list)
    events: list[tuple[TrialRow, Sequence[StoredEvent]]] = field(default_factory=list)
    """Events of each attempt."""
    participants: list[ParticipantRow] = field(default_factory=list)
    exclusions: list[ExclusionRow] = field(default_factory=list)
    verifications: list[VerificationRow] = field(default_factory=list)
    runs: dict[str, Run] = field(default_factory=dict)
    """Runs of counted trials with a result, by run id; each run holds its trials in order."""
    num_deleted: int = 0
    """People who withdrew and whose records were deleted."""


def collect(reader: StudyReader) -> Collected:
    """All records that may leave the study's folder.

    Raises:
        StudyError: A record cannot be read.
    """
    context, codes = row_context(reader), exported_codes(reader)
    is_deleted = context.config.privacy.on_withdraw == "delete"
    found = Collected()
    kept: dict[str, str] = {}
    names: dict[str, TrialRow] = {}
    for code, exported in sorted(codes.items(), key=lambda item: item[1]):
        record = reader.participant(code)
        if is_gone(record, is_deleted_on_withdrawal=is_deleted):
            found.num_deleted += 1
            continue
        kept[code] = exported
        trials = reader.trials(code)
        found.participants.append(participant_row(record, trials, code=exported))
        for status in trials:
            row = _add_trial(found, reader, context, status, exported)
            if status.trial_id is not None:
                names[status.trial_id] = row
    found.exclusions += exclusion_rows(context.config, reader.exclusions(), names, kept)
    found.verifications += verification_rows(reader.verifications(), names)
    return found


def exported_codes(reader: StudyReader) -> dict[str, str]:
    """New code of each participant by code in the study; deleted participants are included, so that numbers stay.

    People are sorted by hashes of the study and of their plans; people with the same plan (spare people) are sorted by
    their time of arrival. So an export a week later gives the same people the same numbers, and other codes in the
    study do not change its tables.
    """
    codes = reader.codes()
    order = sorted(codes, key=lambda code: _rank(reader.study_version, reader.participant(code), reader.trials(code)))
    width = max(2, len(str(len(codes))))
    return {code: f"p{number:0{width}d}" for number, code in enumerate(order, start=1)}


def is_gone(record: ParticipantRecord, *, is_deleted_on_withdrawal: bool) -> bool:
    """Whether a participant's records may no longer be read; true also just before the key is deleted."""
    return record.is_shredded or (record.is_withdrawn and is_deleted_on_withdrawal)


def _add_trial(found: Collected, reader: StudyReader, context: RowContext, status: StoredTrial, code: str) -> TrialRow:
    """Adds one attempt to `found`: its row, its events, and its result if it counts; returns the row."""
    stored: Sequence[StoredEvent] = reader.events(status.trial_id) if status.trial_id is not None else ()
    head = reader.head_hash(status.trial_id) if status.trial_id is not None else None
    events = [item.event for item in stored]
    row = trial_row(context, status, events, head_hash=head, code=code)
    found.trials.append(row)
    found.events.append((row, stored))
    if row.left_out is None and status.outcome is not None:
        info = trial_run_info(
            context.config,
            context.plan.scene(status.key.scene),
            code,
            status.task,
            condition=status.condition,
            created_utc=created_utc(reader.created_ns),
            app_version=reader.app_version,
            study_version=reader.study_version,
            mixes_kinds=len({home.kind for home in context.plan.scenes}) > 1,
            is_pilot=reader.is_pilot,
        )
        run = found.runs.get(info.run_id, Run(info=info))
        found.runs[info.run_id] = _with(run, result_of(events, status.outcome, code=code))
    return row


def _with(run: Run, result: EpisodeRun | Answer) -> Run:
    if isinstance(result, EpisodeRun):
        return run.model_copy(update={"episodes": (*run.episodes, result)})
    return run.model_copy(update={"answers": (*run.answers, result)})


def _rank(study_version: str, record: ParticipantRecord, trials: Sequence[StoredTrial]) -> tuple[str, float, int, str]:
    """Sort key of a person; the study's own code counts only where nothing else tells two people apart."""
    planned = {
        trial.order_no: [trial.order_no, trial.phase, trial.task, trial.condition, *trial.key, trial.rep]
        for trial in trials
        if trial.made_by == "plan"
    }
    text = json.dumps([study_version, record.task, record.arm, list(planned.values())])
    arrived = record.stages[0].at_ns if record.stages else float("inf")
    return hashlib.sha256(text.encode()).hexdigest(), arrived, len(record.code), record.code

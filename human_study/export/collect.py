"""A study's records as rows and runs under exported codes: an export writes them, a report reads them from here."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from sim.tasks.run_files import Answer, EpisodeRun, Run

from ..store.record_types import StoredEvent, TrialStatus
from ..store.records import StudyReader
from .codes import exported_codes, is_gone
from .rows import ExclusionRow, ParticipantRow, VerificationRow, exclusion_rows, participant_row, verification_rows
from .runs import created_utc, result_of, trial_run_info
from .trial_table import RowContext, TrialRow, row_context, trial_row


@dataclass(slots=True)
class Collected:
    """All records of the people who did not have theirs deleted, by exported code."""

    trials: list[TrialRow] = field(default_factory=list)
    events: list[tuple[TrialRow, Sequence[StoredEvent]]] = field(default_factory=list)
    """Of each attempt."""
    participants: list[ParticipantRow] = field(default_factory=list)
    exclusions: list[ExclusionRow] = field(default_factory=list)
    verifications: list[VerificationRow] = field(default_factory=list)
    runs: dict[str, Run] = field(default_factory=dict)
    """Counted trials with a result, by run id; within a run in the order of the trials."""
    num_deleted: int = 0
    """People who withdrew and whose records were deleted."""


def collect(reader: StudyReader) -> Collected:
    """Everything that may be known of the study outside its folder.

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


def _add_trial(found: Collected, reader: StudyReader, context: RowContext, status: TrialStatus, code: str) -> TrialRow:
    """One attempt: its row, its events, and its result where it counts."""
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

"""A study's records as rows and runs under exported codes: an export writes them, a report reads them from here.

People are called p01, p02, ... in an order that does not depend on their codes in the study.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from pydantic import BaseModel

from sim.homes.kind import scene_label
from sim.sequences.runs import SequenceRun
from sim.tasks.run_files import Answer, EpisodeRun, Run, RunInfo

from ..design.plan import StudyPlan
from ..design.study import StudyConfig
from ..journey import Person, StageEntry, way_out
from ..store.exclusions import rules_before_data
from ..store.records import StoredEvent, StoredTrial, StudyReader
from ..trial.events import Event, event_to_json
from .rows import CommentRow, EventRow, ExclusionRow, ParticipantRow, StageRow, VerificationRow
from .runs import created_utc, result_of, trial_run_info
from .search_table import SearchRow, search_rows
from .survey import SurveyRow, survey_rows
from .trial_table import AttemptName, TrialRow, is_long_hidden, trial_figures

SIZE_STEP = 100
"""Pixels to which window sizes are rounded."""
_EVENT_COLUMNS = frozenset({"kind", "t_s", "t_cli_ms"})
"""Fields of an event that are columns of their own."""


@dataclass(slots=True)
class Collected:
    """All records of people whose records were not deleted, by exported code."""

    trials: list[TrialRow] = field(default_factory=list)
    events: list[tuple[TrialRow, Sequence[StoredEvent]]] = field(default_factory=list)
    """Events of each attempt."""
    participants: list[ParticipantRow] = field(default_factory=list)
    exclusions: list[ExclusionRow] = field(default_factory=list)
    verifications: list[VerificationRow] = field(default_factory=list)
    comments: list[CommentRow] = field(default_factory=list)
    """Comments by people who wrote one."""
    survey: list[SurveyRow] = field(default_factory=list)
    runs: dict[str, Run] = field(default_factory=dict)
    """Runs of counted trials with a result, by run id; each run holds its trials in order."""
    sequences: dict[str, tuple[RunInfo, list[SequenceRun]]] = field(default_factory=dict)
    """The same of home sequences, with those that rules exclude, which the report counts from here."""
    searches: list[SearchRow] = field(default_factory=list)
    """The searches of home sequences."""
    num_deleted: int = 0
    """People who withdrew and whose records were deleted."""


def collect(reader: StudyReader) -> Collected:
    """All records that may leave the study's folder.

    Raises:
        StudyError: A record cannot be read.
    """
    config, plan = reader.config, reader.plan
    run_facts = _run_facts(reader, plan)
    verified = {entry.trial_id: entry.status for entry in reader.verifications()}
    excluded: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    for entry in reader.exclusions():
        if not entry.is_undone:
            excluded[entry.target_kind, entry.target].append(entry.rule_id)
    found = Collected()
    kept: dict[str, str] = {}
    names: dict[str, TrialRow] = {}
    for code, exported in sorted(exported_codes(reader).items(), key=lambda item: item[1]):
        person = reader.participant(code)
        if reader.is_shredded(code) or (person.is_withdrawn and config.privacy.on_withdraw == "delete"):
            found.num_deleted += 1
            continue
        kept[code] = exported
        trials = reader.trials(code)
        found.participants.append(_participant_row(person, trials, code=exported))
        for trial in trials:
            trial_id, home = (
                trial.trial_id or "",
                plan.scene(trial.key.scene),
            )  # "" = never opened
            stored = reader.events(trial_id)
            events = [entry.event for entry in stored]
            told = {
                "participant": exported,
                "scene_kind": home.kind,
                "verification": verified.get(trial_id),
                "excluded": tuple(dict.fromkeys([*excluded["participant", code], *excluded["trial", trial_id]])),
                "head_hash": reader.head_hash(trial_id),
            }
            row = names[trial_id] = _trial_row(trial, events, config, told)
            found.trials.append(row)
            found.events.append((row, stored))
            found.searches += search_rows(row, events, trial.outcome, rule=config.success)
            if row.left_out is None and trial.outcome is not None:
                info = trial_run_info(config, home, exported, trial.task, condition=trial.condition, **run_facts)
                _add(result_of(events, trial.outcome, code=exported), info, found)
    found.exclusions += _exclusion_rows(config, reader, names, kept)
    comments = reader.answers("comment")
    found.comments += [CommentRow(participant=kept[code], comment=comments[code]) for code in kept if code in comments]
    found.verifications += _verification_rows(reader, names)
    found.survey += survey_rows(reader, kept)
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


def event_rows(name: AttemptName, events: Sequence[StoredEvent]) -> list[EventRow]:
    """One attempt's events with times from its start."""
    first_of_epoch: dict[int, float] = {}
    rows = []
    for stored in events:
        fields = json.loads(event_to_json(stored.event))
        t_cli_ms = fields["t_cli_ms"]
        if t_cli_ms is not None:
            t_cli_ms -= first_of_epoch.setdefault(stored.epoch, t_cli_ms)
        rows.append(
            EventRow(
                **name.place,
                seq=stored.seq,
                epoch=stored.epoch,
                kind=stored.event.kind,
                t_s=fields["t_s"],
                t_cli_ms=t_cli_ms,
                t_srv_s=(stored.t_srv_ns - events[0].t_srv_ns) / 1e9,
                payload={key: _rounded(key, value) for key, value in fields.items() if key not in _EVENT_COLUMNS},
            )
        )
    return rows


def _run_facts(reader: StudyReader, plan: StudyPlan) -> dict[str, Any]:
    """The arguments of `trial_run_info` that all runs of a study share."""
    return {
        "created_utc": created_utc(reader.created_ns),
        "app_version": reader.app_version,
        "study_version": reader.study_version,
        "mixes_kinds": len({home.kind for home in plan.scenes}) > 1,
        "is_pilot": reader.is_pilot,
    }


def _add(result: EpisodeRun | Answer | SequenceRun, info: RunInfo, found: Collected) -> None:
    """Adds a result to its run."""
    if isinstance(result, SequenceRun):
        found.sequences.setdefault(info.run_id, (info, []))[1].append(result)
        return
    runs = found.runs
    run = runs.get(info.run_id, Run(info=info))
    if isinstance(result, EpisodeRun):
        runs[info.run_id] = run.model_copy(update={"episodes": (*run.episodes, result)})
    else:
        runs[info.run_id] = run.model_copy(update={"answers": (*run.answers, result)})


def _trial_row(trial: StoredTrial, events: Sequence[Event], config: StudyConfig, told: Mapping[str, Any]) -> TrialRow:
    """The row of one attempt; `told` holds the fields that are in other records."""
    figures = trial_figures(events, trial.outcome, rule=config.success)
    return TrialRow.model_validate(
        {
            **dict(figures),
            **_shared(trial, TrialRow),
            "split": trial.key.split,
            "scene": trial.key.scene,
            "episode_id": trial.key.episode_id,
            "scene_label": scene_label(told["scene_kind"]),
            "is_long_hidden": is_long_hidden(figures.t_hidden_s, config),
            **told,
        }
    )


def _participant_row(person: Person, trials: Sequence[StoredTrial], *, code: str) -> ParticipantRow:
    """One person's row under a new code."""
    main = [trial for trial in trials if trial.phase == "main"]
    stages, consent = person.stages, person.consent
    return ParticipantRow(
        participant=code,
        task=person.task,
        arm=person.arm,
        conditions=tuple(sorted({trial.condition for trial in main})),
        has_come=person.has_come,
        has_consented=consent.given if consent else None,
        consent_text=consent.text_hash if consent else None,
        is_withdrawn=person.is_withdrawn,
        last_stage=stages[-1].stage if stages else None,
        left_by=way_out(stages),
        num_assigned=len({trial.order_no for trial in main}),
        num_ended=len({trial.order_no for trial in main if trial.has_ended}),
        time_in_study_s=(stages[-1].at_ns - stages[0].at_ns) / 1e9 if stages else None,
        stages=tuple(_stage_row(entry, stages[0].at_ns) for entry in stages),
    )


def _stage_row(entry: StageEntry, start_ns: int) -> StageRow:
    flat = {name: inner for value in entry.detail.values() if isinstance(value, dict) for name, inner in value.items()}
    flat |= {name: value for name, value in entry.detail.items() if not isinstance(value, dict)}
    counted = {key: len(value) if isinstance(value, list) else value for key, value in flat.items()}
    detail = {key: _rounded(key, value) for key, value in counted.items() if isinstance(value, bool | int | float)}
    return StageRow(stage=entry.stage, t_s=(entry.at_ns - start_ns) / 1e9, detail=detail)


def _exclusion_rows(
    config: StudyConfig, reader: StudyReader, names: Mapping[str, AttemptName], codes: Mapping[str, str]
) -> list[ExclusionRow]:
    """Rows of all exclusions of exported attempts (`names`, by trial id) and people (`codes`)."""
    planned = rules_before_data(config)
    rows = []
    for entry in reader.exclusions():
        name = names.get(entry.target) if entry.target_kind == "trial" else None
        code = name.participant if name is not None else codes.get(entry.target)
        if code is not None:
            place = name.place if name is not None else {"participant": code, "order_no": None, "attempt": None}
            is_planned = entry.rule_id in planned
            rows.append(ExclusionRow(**_shared(entry, ExclusionRow), **place, is_planned=is_planned))
    return sorted(rows, key=lambda row: (row.participant, row.order_no or 0, row.attempt or 0))


def _verification_rows(reader: StudyReader, names: Mapping[str, AttemptName]) -> list[VerificationRow]:
    """Rows of the verifications of exported attempts, by attempt and then by time."""
    numbers: dict[str, int] = {}
    rows = []
    for entry in reader.verifications():
        run_no = numbers.setdefault(entry.run_id, len(numbers) + 1)
        if entry.trial_id in names:
            place = names[entry.trial_id].place
            rows.append(VerificationRow(**_shared(entry, VerificationRow), **place, run_no=run_no))
    return sorted(rows, key=lambda row: (row.participant, row.order_no, row.attempt, row.run_no))


def _shared(record: Any, model: type[BaseModel]) -> dict[str, Any]:
    """The fields of a stored record that its exported row has under the same name."""
    return {known.name: getattr(record, known.name) for known in fields(record) if known.name in model.model_fields}


def _rounded(key: str, value: Any) -> Any:
    """The value, rounded if it is the size of a window."""
    is_size = key in ("width", "height") and isinstance(value, int | float)
    return SIZE_STEP * round(value / SIZE_STEP) if is_size else value


def _rank(study_version: str, person: Person, trials: Sequence[StoredTrial]) -> tuple[str, float, int, str]:
    """Sort key of a person; the study's own code counts only where nothing else tells two people apart."""
    planned = {
        trial.order_no: [trial.order_no, trial.phase, trial.task, trial.condition, *trial.key, trial.rep]
        for trial in trials
        if trial.made_by == "plan"
    }
    text = json.dumps([study_version, person.task, person.arm, list(planned.values())])
    arrived = person.stages[0].at_ns if person.stages else float("inf")
    return hashlib.sha256(text.encode()).hexdigest(), arrived, len(person.code), person.code

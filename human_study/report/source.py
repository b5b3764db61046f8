"""Reads the input of a report: run folders, exports of a study, or study folders, whose records are read directly."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.errors import StudyError
from sim.tasks.run_files import Run
from sim.tasks.run_folders import read_runs, with_controls

from ..design.plan import AGENT_RUNS
from ..design.study import STUDY_FILE, StudyConfig, load_study
from ..export.collect import collect
from ..export.formats import Row, rows_from_jsonl
from ..export.manifest import MANIFEST_FILE, read_manifest
from ..export.rows import ExclusionRow, ParticipantRow
from ..export.survey import SurveyRow
from ..export.trial_table import TrialRow
from ..store.records import DATABASE_FILE, StudyDates, read_study

TRIALS_FILE = "trials.jsonl"
_PARTICIPANTS_FILE, _EXCLUSIONS_FILE = "participants.jsonl", "exclusions.jsonl"


@dataclass(frozen=True, slots=True)
class StudyRecords:
    """The records that a study or its export holds beside the runs; empty where there are only runs."""

    config: StudyConfig | None = None
    rows: tuple[TrialRow, ...] = ()
    people: tuple[ParticipantRow, ...] = ()
    exclusions: tuple[ExclusionRow, ...] = ()
    survey: tuple[SurveyRow, ...] = ()
    dates: StudyDates | None = None
    """None where they are not known: exports hold no dates."""
    num_deleted: int = 0
    """People who withdrew and whose records were deleted."""
    is_pilot: bool = False
    plan_changes: tuple[str, ...] = ()
    """Wishes of the study file that the plan could not fulfil, each with the reason."""
    homes_version: int | None = None
    """`HOMES_VERSION` with which the study was planned."""


@dataclass(frozen=True, slots=True)
class ReportSource:
    """Runs of people and agents, and the records of the people's study if there are any."""

    runs: tuple[Run, ...]
    records: StudyRecords = StudyRecords()


def read_source(folders: Sequence[Path]) -> ReportSource:
    """Everything in run folders, folders of run folders, and at most one study folder or export.

    Raises:
        StudyError: There are records of more than one study, or records are damaged.
        RunFileError: A folder holds no run, or a run is damaged.
    """
    studies = [folder for folder in folders if (folder / DATABASE_FILE).is_file()]
    exports = [folder for folder in folders if folder not in studies and (folder / TRIALS_FILE).is_file()]
    if len(studies) + len(exports) > 1:
        names = ", ".join(str(folder) for folder in folders)
        raise StudyError(
            f"report: found records of {len(studies) + len(exports)} studies or exports in {names}; expected one, "
            "because a trial counts once. Give one study folder or one of its exports, and run folders of agents."
        )
    others = [folder for folder in folders if folder not in (*studies, *exports)]
    others += [found for study in studies if (found := own_agents(study, others)) is not None]
    if not studies and not exports:
        return ReportSource(tuple(read_runs(with_controls(others))))
    people, records = _of_study(studies[0]) if studies else _of_export(exports[0])
    if not people and not others:
        raise _no_trial(folders[0])
    return ReportSource((*people, *(read_runs(with_controls(others)) if others else ())), records)


def own_agents(study: Path, given: Sequence[Path]) -> Path | None:
    """The study's folder of runs of agents; None where it holds none, or where runs in it are named."""
    folder = study / AGENT_RUNS
    is_named = any(folder.resolve() in (each.resolve(), *each.resolve().parents) for each in given)
    return None if is_named or not any(folder.glob("*/run.json")) else folder


def people_of_study(folder: Path) -> list[Run]:
    """The runs of a study's people, under the codes that an export would give them.

    Raises:
        StudyError: Records are damaged, or hold no counted trial with a result.
    """
    people, _ = _of_study(folder)
    if not people:
        raise _no_trial(folder)
    return people


def _no_trial(folder: Path) -> StudyError:
    return StudyError(
        f"{folder}: holds no counted trial with a result; expected at least one. Wait for participants to "
        "finish some; personal-viz study status shows how far they are."
    )


def _of_study(folder: Path) -> tuple[list[Run], StudyRecords]:
    """People's runs and the study's records, with the names that an export would give them."""
    with read_study(folder) as reader:
        reader.check()
        found = collect(reader)
        records = StudyRecords(
            config=reader.config,
            rows=tuple(found.trials),
            people=tuple(found.participants),
            exclusions=tuple(found.exclusions),
            survey=tuple(found.survey),
            dates=reader.dates(),
            num_deleted=found.num_deleted,
            is_pilot=reader.is_pilot,
            plan_changes=reader.plan.changes,
            homes_version=reader.plan.homes_version,
        )
    return [run for _, run in sorted(found.runs.items())], records


def _of_export(folder: Path) -> tuple[list[Run], StudyRecords]:
    has_runs = any(folder.glob("*/run.json"))
    return read_runs([folder]) if has_runs else [], read_records(folder)


def read_records(folder: Path) -> StudyRecords:
    """The tables of an export folder.

    Raises:
        StudyError: A file is missing or damaged.
    """
    manifest = read_manifest(folder) if (folder / MANIFEST_FILE).is_file() else None
    if not (folder / STUDY_FILE).is_file():
        raise StudyError(f"{folder}: holds {TRIALS_FILE} but no {STUDY_FILE}; expected both. Export the study again.")
    return StudyRecords(
        config=load_study(folder),
        rows=_lines(folder / TRIALS_FILE, TrialRow),
        people=_lines(folder / _PARTICIPANTS_FILE, ParticipantRow),
        exclusions=_lines(folder / _EXCLUSIONS_FILE, ExclusionRow),
        survey=read_survey(folder),
        num_deleted=manifest.num_deleted if manifest else 0,
        is_pilot=manifest.is_pilot if manifest else False,
        plan_changes=manifest.plan_changes if manifest else (),
        homes_version=manifest.homes_version if manifest else None,
    )


def read_survey(folder: Path) -> tuple[SurveyRow, ...]:
    """The answers to the survey in an export folder; () where there was none, or its file was kept apart."""
    return _lines(folder / "survey.jsonl", SurveyRow)


def _lines(path: Path, model: type[Row]) -> tuple[Row, ...]:
    """The rows of a table; () where the export has no such table."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return rows_from_jsonl(text, model, path=path, advice="Export the study again.")

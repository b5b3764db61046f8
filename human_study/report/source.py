"""Reads the input of a report: run folders, exports of a study, or study folders, whose records are read directly.

Runs of agents that cannot stand beside the people are left out, each with its reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sim.errors import RunFileError, StudyError
from sim.sequences.rows import RunOfSequences
from sim.sequences.runs import read_sequence_runs
from sim.tasks.metrics import metric_rows, require_comparable
from sim.tasks.run_files import Run, read_run_info
from sim.tasks.run_folders import control_of, read_runs, run_folders

from ..design.plan import AGENT_RUNS
from ..design.study import STUDY_FILE, StudyConfig, load_study
from ..export.collect import collect
from ..export.formats import Row, rows_from_jsonl
from ..export.manifest import MANIFEST_FILE, read_manifest
from ..export.rows import ExclusionRow, ParticipantRow
from ..export.search_table import SEARCHES, SearchRow
from ..export.survey import SurveyRow
from ..export.trial_table import TrialRow
from ..store.records import DATABASE_FILE, StudyDates, read_study
from .trials import LeftOutRun

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
    """None where they are not known, as in exports of earlier versions."""
    num_deleted: int = 0
    """People who withdrew and whose records were deleted."""
    is_pilot: bool = False
    plan_changes: tuple[str, ...] = ()
    """Wishes of the study file that the plan could not fulfil, each with the reason."""
    homes_version: int | None = None
    """`HOMES_VERSION` with which the study was planned."""
    sequences: tuple[RunOfSequences, ...] = ()
    """Runs of home sequences, in a study of them."""
    searches: tuple[SearchRow, ...] = ()
    """Their searches."""


@dataclass(frozen=True, slots=True)
class ReportSource:
    """Runs of people and agents, and the records of the people's study if there are any."""

    runs: tuple[Run, ...]
    """In the order of their ids."""
    records: StudyRecords = StudyRecords()
    left_out: tuple[LeftOutRun, ...] = ()
    """Runs of agents that cannot stand beside the people, or cannot be read."""


def source_of(runs: Sequence[Run], records: StudyRecords | None = None) -> ReportSource:
    """The runs of people, and those of agents that can stand beside them; the others with the reason.

    Raises:
        StudyError: There is no run of people, or their runs are of two studies.
        RunFileError: People's runs are on different episode files, or in scans and other homes.
    """
    ordered = sorted(runs, key=lambda run: run.info.run_id)
    people = [run for run in ordered if run.info.who_kind == "human"]
    if not people:
        raise StudyError(
            f"found {len(runs)} runs of agents and none of people; expected at least one of people. "
            "Write them with personal-viz study export."
        )
    versions = {str(run.info.config.get("study_version", "")): run.info.run_id for run in people}
    if len(versions) > 1:
        names = ", ".join(f"{version[:12] or 'none'} ({run_id})" for version, run_id in sorted(versions.items()))
        raise StudyError(
            f"runs of people: found study versions {names}; expected one, because people's codes are those of one "
            "study. Make a report of each."
        )
    require_comparable(run.info for run in people)
    reasons = {id(run): _why_not_beside(run, people) for run in ordered if run.info.who_kind != "human"}
    kept = tuple(run for run in ordered if not reasons.get(id(run)))
    left_out = tuple(LeftOutRun(run=run.info.run_id, reason=why) for run in ordered if (why := reasons.get(id(run))))
    return ReportSource(kept, records or StudyRecords(), left_out)


def _why_not_beside(run: Run, people: Sequence[Run]) -> str:
    """Why a run of an agent cannot stand in a report on these people; empty if it can."""
    info, theirs = run.info, people[0].info
    version, study = str(info.config.get("study_version", "")), str(theirs.config.get("study_version", ""))
    if version and version != study:
        return f"ran on study version {version[:12]}, people on {study[:12] or 'none'}"
    if info.dataset_digest != theirs.dataset_digest:
        return f"is on other episode files ({info.dataset_digest[:12]}) than people ({theirs.dataset_digest[:12]})"
    kinds = {one.info.scene_kind for one in people}
    if info.scene_kind not in {*kinds, "oracle-map"}:
        return f"was made in homes of kind {info.scene_kind}, people were in {', '.join(sorted(kinds))}"
    done = {"PAN": {item.key for one in people for item in one.episodes}}
    done["POG"] = {item.key for one in people for item in one.answers}
    own = {"PAN": {item.key for item in run.episodes}, "POG": {item.key for item in run.answers}}
    tasks, asked = ([task for task, keys in of.items() if keys] for of in (own, done))
    if not set(tasks) & set(asked):
        return f"{' and '.join(tasks) or 'empty'} run in a {' and '.join(asked)} report"
    if not any(own[task] & done[task] for task in asked):
        return f"did none of the {sum(map(len, done.values()))} episodes that people did"
    has_labels = {one.info.labels for one in people if one.episodes}
    if run.episodes and has_labels and info.labels not in has_labels:
        words = ("had", "did not") if info.labels else ("lacked", "had them")
        return f"its pictures {words[0]} the categories written on objects, people's {words[1]}"
    try:
        metric_rows([run])
    except RunFileError as error:
        return str(error).removeprefix(f"{info.run_id}: ").partition("; ")[0]
    return ""


def read_source(folders: Sequence[Path]) -> ReportSource:
    """Everything in run folders, folders of run folders, and at most one study folder or export.

    A run of an agent that cannot be read is left out, as one that cannot stand beside the people.

    Raises:
        StudyError: There are records of more than one study, records are damaged, or there is no run of people.
        RunFileError: A folder holds no run, or a run of people is damaged.
    """
    folder, others = records_folder(folders)
    people, records = [], None
    if folder is not None:
        people, records = runs_and_records(folder)
        if not people and not others:
            raise no_trial(folder)
    runs, unread = _each_read(others, agents_only=records is not None)
    source = source_of([*people, *runs], records)
    left_out = sorted((*source.left_out, *unread), key=lambda left: left.run)
    return replace(source, left_out=tuple(left_out))


def records_folder(folders: Sequence[Path]) -> tuple[Path | None, list[Path]]:
    """The study folder or export among these folders, if there is one, and all folders of other runs.

    Raises:
        StudyError: There are records of more than one study, or a study in which nobody has taken part yet.
    """
    studies = [folder for folder in folders if (folder / DATABASE_FILE).is_file()]
    exports = [folder for folder in folders if folder not in studies and (folder / TRIALS_FILE).is_file()]
    for folder in folders:
        if folder not in (*studies, *exports) and (folder / STUDY_FILE).is_file():
            raise no_trial(folder)
    if len(studies) + len(exports) > 1:
        names = ", ".join(str(folder) for folder in folders)
        raise StudyError(
            f"report: found records of {len(studies) + len(exports)} studies or exports in {names}; expected one, "
            "because a trial counts once. Give one study folder or one of its exports, and run folders of agents."
        )
    others = [folder for folder in folders if folder not in (*studies, *exports)]
    others += [found for study in studies if (found := own_agents(study, others)) is not None]
    return next(iter((*studies, *exports)), None), others


def runs_and_records(folder: Path) -> tuple[list[Run], StudyRecords]:
    """People's runs and the records in a study folder or an export.

    Raises:
        StudyError: Records are damaged.
    """
    return _of_study(folder) if (folder / DATABASE_FILE).is_file() else _of_export(folder)


def _each_read(folders: Sequence[Path], *, agents_only: bool) -> tuple[list[Run], list[LeftOutRun]]:
    """The runs in these folders, with the controls beside them, and those of agents that cannot be read.

    Args:
        agents_only: Whether people's runs come from elsewhere, so that a folder whose run.json is damaged holds none.

    Raises:
        RunFileError: A named folder holds no run, or a run of people is damaged.
    """
    waiting = run_folders(folders) if folders or not agents_only else []
    runs, left_out = [], []
    for folder in waiting:  # grows by the controls
        try:
            control = control_of(folder, among=waiting)
            runs += read_runs([folder])
            waiting += [control] if control is not None else []
        except RunFileError as error:
            if not (folder / "run.json").is_file():
                raise
            if not agents_only and read_run_info(folder).who_kind == "human":
                raise
            reason = str(error).removeprefix(str(folder)).lstrip(": /").partition("; ")[0]
            left_out.append(LeftOutRun(run=folder.name, reason=reason))
    return runs, left_out


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
        raise no_trial(folder)
    return people


def no_trial(folder: Path) -> StudyError:
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
            config=reader.reported_config(),
            rows=tuple(found.trials),
            people=tuple(found.participants),
            exclusions=tuple(found.exclusions),
            survey=tuple(found.survey),
            dates=reader.dates(),
            num_deleted=found.num_deleted,
            is_pilot=reader.is_pilot,
            plan_changes=reader.plan.changes,
            homes_version=reader.plan.homes_version,
            sequences=tuple((info, tuple(runs)) for _, (info, runs) in sorted(found.sequences.items())),
            searches=tuple(found.searches),
        )
    return [run for _, run in sorted(found.runs.items())], records


def _of_export(folder: Path) -> tuple[list[Run], StudyRecords]:
    records, has_runs = read_records(folder), any(folder.glob("*/run.json"))
    if records.config is not None and records.config.sequences is not None:
        found = [(read_run_info(path.parent), read_sequence_runs(path.parent)) for path in folder.glob("*/run.json")]
        found.sort(key=lambda run: run[0].run_id)
        return [], replace(records, sequences=tuple(found))
    return read_runs([folder]) if has_runs else [], records


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
        dates=manifest.dates if manifest else None,
        num_deleted=manifest.num_deleted if manifest else 0,
        is_pilot=manifest.is_pilot if manifest else False,
        plan_changes=manifest.plan_changes if manifest else (),
        homes_version=manifest.homes_version if manifest else None,
        searches=_lines(folder / f"{SEARCHES}.jsonl", SearchRow),
    )


def read_survey(folder: Path) -> tuple[SurveyRow, ...]:
    """The answers to the survey in an export folder; () where there was none, or its file was kept apart."""
    return _lines(folder / "survey.jsonl", SurveyRow)


def _lines(path: Path, model: type[Row]) -> tuple[Row, ...]:
    """The rows of a table; () where the export has no such table."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return rows_from_jsonl(text, model, path=path, advice="Export the study again.")

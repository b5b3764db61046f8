"""Reads an export back and checks it: files are unchanged, and every outcome follows from the exported events."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError, TaskStateError
from sim.sequences.runs import SequenceRun, read_sequence_runs
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, read_run
from sim.types import EpisodeKey

from ..design.plan import StudyScene
from ..design.study import StudyConfig, load_study
from ..trial.events import Event, Open
from ..trial.outcome import Outcome, has_begun
from .formats import Row, rows_from_jsonl
from .manifest import Manifest, read_manifest, require_unchanged
from .rows import EventRow
from .runs import run_condition
from .search_table import SEARCHES, SearchRow, search_rows
from .trial_table import TrialFigures, TrialRow, is_long_hidden, trial_figures
from .verify import TrialHome, first_difference, recompute, run_as_known

OpenHome = Callable[[StudyScene], TrialHome]
"""Opens one of the manifest's homes; those of `practice_scenes` are in the export's folder `practice`."""
_Counted = tuple[str, str, EpisodeKey]
"""(participant, condition in run files, episode)."""


class ImportReport(BaseModel):
    """The result of reading an export back."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    folder: str
    num_files: int
    """Number of files; all are as they were written."""
    num_attempts: int
    """Number of attempts that ended."""
    num_agreeing: int
    """Attempts whose events give the same figures again, and that have the same result in the run folders."""
    num_unsupported: int
    """Attempts that were done in a different version of a home than the given one."""
    problems: tuple[str, ...]
    """One sentence for each attempt or run that does not agree."""

    @property
    def agrees(self) -> bool:
        """Whether everything was recomputed and is the same."""
        return self.num_agreeing == self.num_attempts and not self.problems


def import_check(folder: Path, open_home: OpenHome) -> ImportReport:
    """Compares an export with the results that its own events give.

    Args:
        folder: The folder that `export_study` wrote.
        open_home: Opens the homes of the trials; each is opened once.

    Raises:
        StudyError: A file is missing, was changed, or holds invalid rows.
        DatasetError, SceneError: A home or an episode cannot be read.
    """
    manifest = read_manifest(folder)
    contents = require_unchanged(folder, manifest)
    config = load_study(folder)
    rows = [row for row in _rows(contents, folder, manifest, "trials", TrialRow) if row.end_reason is not None]
    events = _events(_rows(contents, folder, manifest, "events", EventRow))
    searches = defaultdict[str, list[SearchRow]](list)
    for line in _rows(contents, folder, manifest, SEARCHES, SearchRow) if config.sequences is not None else ():
        searches[line.attempt_name].append(line)
    counted = _counted(folder, manifest)
    problems: list[str] = []
    num_agreeing = num_unsupported = 0
    for row, home in _with_homes(rows, manifest, open_home):
        found = events.get(row.attempt_name, [])
        in_runs = (
            counted.pop((row.participant, run_condition(row.condition), row.key), None)
            if row.left_out is None
            else None
        )
        first = found[0] if found else None
        if isinstance(first, Open) and first.scene_digest != home.scene_digest:
            num_unsupported += 1
            continue
        problem = _difference(row, found, home, config, in_runs, searches[row.attempt_name])
        problems += [f"{row.attempt_name}: {problem}"] if problem else []
        num_agreeing += problem is None
    problems += [f"run of {who} ({name}) {key}: is of no row in trials.jsonl" for who, name, key in counted]
    return ImportReport(
        folder=str(folder),
        num_files=len(manifest.files),
        num_attempts=len(rows),
        num_agreeing=num_agreeing,
        num_unsupported=num_unsupported,
        problems=tuple(problems),
    )


def _difference(
    row: TrialRow,
    events: Sequence[Event],
    home: TrialHome,
    config: StudyConfig,
    in_runs: EpisodeRun | Answer | SequenceRun | None,
    searches: Sequence[SearchRow],
) -> str | None:
    """The first disagreement about one attempt, None if all agrees.

    `in_runs` is its result in the run folders, `searches` are the rows of its searches.
    """
    if row.left_out is None and in_runs is None:
        return "is in no run folder, though nothing leaves it out"
    # only the record knows whether a failure of ours ended the trial
    stored: Outcome = EpisodeEnd(reason=row.end_reason or "technical")
    if row.end_reason == "technical" and not has_begun(events):  # it failed before anything was shown
        return _other_figures(row, events, stored, config)
    try:
        result = recompute(
            events, stored, home.trial(row.key), home=home, participant=row.participant, condition=row.condition
        )
    except (StudyError, TaskStateError) as problem:
        return str(problem)
    outcome = result.end if isinstance(result, EpisodeRun | SequenceRun) else result
    difference = _other_figures(row, events, outcome, config)
    if difference is None:
        lines = [line.model_dump(mode="json") for line in search_rows(row, events, outcome, rule=config.success)]
        difference = first_difference([line.model_dump(mode="json") for line in searches], lines, "searches")
    if isinstance(result, EpisodeRun) and isinstance(in_runs, EpisodeRun):
        result = run_as_known(result, in_runs)
    if difference is None and in_runs is not None:
        difference = first_difference(in_runs.model_dump(mode="json"), result.model_dump(mode="json"), "run")
    return difference


def _other_figures(row: TrialRow, events: Sequence[Event], outcome: Outcome, config: StudyConfig) -> str | None:
    """The first figure of a row that the events do not give; None when they agree."""
    figures = trial_figures(events, outcome, rule=config.success)
    found = figures.model_dump(mode="json") | {"is_long_hidden": is_long_hidden(figures.t_hidden_s, config)}
    stored = row.model_dump(mode="json", include={*TrialFigures.model_fields, "is_long_hidden"})
    return first_difference(stored, {name: found[name] for name in stored}, "row")


def _with_homes(
    rows: Sequence[TrialRow], manifest: Manifest, open_home: OpenHome
) -> Iterable[tuple[TrialRow, TrialHome]]:
    """Yields the rows, grouped by home, each with its open home; one home is open at a time."""
    scenes = {scene.name: scene for scene in (*manifest.scenes, *manifest.practice_scenes)}
    by_scene: defaultdict[str, list[TrialRow]] = defaultdict(list)
    for row in rows:
        by_scene[row.scene].append(row)
    for name, found in by_scene.items():
        if name not in scenes:
            raise StudyError(f"trials.jsonl: scene is {name!r}; expected one of {sorted(scenes)}. Export again.")
        home = open_home(scenes[name])
        yield from ((row, home) for row in found)


def _counted(folder: Path, manifest: Manifest) -> dict[_Counted, EpisodeRun | Answer | SequenceRun]:
    """Every result in the run folders, by participant, condition and episode or sequence."""
    found: dict[_Counted, EpisodeRun | Answer | SequenceRun] = {}
    for name in manifest.files:
        if name.endswith("/run.json"):
            run, sequences = read_run((folder / name).parent), read_sequence_runs((folder / name).parent)
            for item in (*run.episodes, *run.answers, *sequences):
                who = item.participant if isinstance(item, Answer) else item.start.participant
                found[who or "", run.info.condition, item.key] = item
    return found


def _events(rows: Iterable[EventRow]) -> dict[str, list[Event]]:
    """Events by attempt, in order."""
    found: defaultdict[str, list[Event]] = defaultdict(list)
    for row in rows:
        found[row.attempt_name].append(row.event)
        if row.seq != len(found[row.attempt_name]):
            raise StudyError(
                f"events.jsonl: {row.attempt_name} has seq {row.seq} as its event {len(found[row.attempt_name])}; "
                "expected 1, 2, 3 and so on. Export the study again."
            )
    return found


def _rows(
    contents: dict[str, bytes], folder: Path, manifest: Manifest, table: str, model: type[Row]
) -> tuple[Row, ...]:
    """The rows of a table, from its JSON lines."""
    name = f"{table}.jsonl"
    if name not in contents:
        raise StudyError(f"{folder / name}: is not in the manifest; expected the table. Export the study again.")
    advice = "Use the version of personal-viz that wrote it."
    rows = rows_from_jsonl(contents[name].decode(), model, path=folder / name, advice=advice)
    if len(rows) != manifest.files[name].num_rows:
        raise StudyError(
            f"{folder / name}: has {len(rows)} rows; expected {manifest.files[name].num_rows}. Export the study again."
        )
    return rows

"""Reads a study of home sequences for its report, and the runs of agents that can stand beside its people."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.errors import RunFileError
from sim.sequences.rows import RunOfSequences
from sim.sequences.runs import SequenceRun, read_sequence_runs
from sim.tasks.run_files import RunInfo, read_run_info
from sim.tasks.run_folders import run_folders
from sim.types import MAX_STEPS

from ..design.study import STUDY_FILE, load_study
from ..report.source import StudyRecords, no_trial, records_folder, runs_and_records
from ..report.trials import LeftOutRun
from ..store.records import DATABASE_FILE, read_study


@dataclass(frozen=True, slots=True)
class SequenceSource:
    """People's records and runs, and the runs of agents that can stand beside them, cut to the people's sequences."""

    records: StudyRecords
    people: tuple[RunOfSequences, ...]
    agents: tuple[RunOfSequences, ...]
    """A run on oracle maps, which are of no home, once for each kind of people's homes, and named by it."""
    left_out: tuple[LeftOutRun, ...]


def read_sequences(folders: Sequence[Path]) -> SequenceSource | None:
    """The study of home sequences among these folders, with runs of agents; None where there is none.

    Raises:
        StudyError: There are records of more than one study, they are damaged, or hold no counted trial with a result.
        RunFileError: A named folder holds no run.
    """
    folder, others = records_folder(folders)
    if folder is None or not _is_of_sequences(folder):
        return None
    _, records = runs_and_records(folder)
    people = records.sequences
    if not people:
        raise no_trial(folder)
    agents: list[RunOfSequences] = []
    left_out = []
    for one in run_folders(others) if others else []:
        try:
            info, runs = read_run_info(one), read_sequence_runs(one)
        except RunFileError as error:
            left_out.append(LeftOutRun(run=one.name, reason=str(error).removeprefix(f"{one}: ").partition("; ")[0]))
            continue
        same, why = _beside(info, runs, people)
        agents += same
        left_out += [] if same else [LeftOutRun(run=info.run_id, reason=why)]
    agents.sort(key=lambda run: run[0].run_id)
    return SequenceSource(records, people, tuple(agents), tuple(sorted(left_out, key=lambda left: left.run)))


def _is_of_sequences(folder: Path) -> bool:
    if (folder / DATABASE_FILE).is_file():
        with read_study(folder) as reader:
            return reader.config.sequences is not None
    return (folder / STUDY_FILE).is_file() and load_study(folder).sequences is not None


def _beside(
    info: RunInfo, runs: Sequence[SequenceRun], people: Sequence[RunOfSequences]
) -> tuple[list[RunOfSequences], str]:
    """A run's sequences that people did too, by kind of their homes; without one, the reason."""
    if info.who_kind == "human":
        return [], "is of people; those of the study come from its records"
    if not runs:
        return [], "holds no home sequence"
    kinds = sorted({one.scene_kind for one, _ in people})
    is_of_maps, walks = info.scene_kind == "oracle-map", any(run.start.task == "pan" for run in runs)
    theirs = next((one for one, _ in people if one.scene_kind == info.scene_kind), people[0][0])
    asked, had = info.config, theirs.config
    own_clutter = asked.get("clutter", asked.get("home_clutter", 0))
    for differs, what, own, wanted in (
        (True, "is on other sequences", asked.get("sequences"), had["sequences"]),
        (True, "is on other episode files", info.dataset_digest, theirs.dataset_digest),
        (True, "read other paraphrases of the queries", asked.get("query_index", 0), had.get("query_index", 0)),
        (walks, "had other steps for a search", asked.get("max_steps", MAX_STEPS), had.get("max_steps", MAX_STEPS)),
        (not is_of_maps, "was in homes with other clutter", own_clutter, had.get("clutter", 0)),
    ):
        if differs and own != wanted:
            return [], f"{what} ({str(own)[:12]}) than people ({str(wanted)[:12]})"
    done = {(run.start.task, one.scene_kind, run.key) for one, walked in people for run in walked}
    found: list[RunOfSequences] = []
    for kind in kinds if is_of_maps else (info.scene_kind,):
        same = tuple(run for run in runs if (run.start.task, kind, run.key) in done)
        found += [(info.model_copy(update={"scene_kind": kind}), same)] if same else []
    had_labels = {one.labels for one, walked in people for run in walked if run.start.task == "pan"}
    if found and walks and info.labels not in had_labels:
        return [], f"its pictures {'had' if info.labels else 'lacked'} the categories on objects, unlike people's"
    others = _versions(found) - _versions(people)
    if others:
        home, digest = min(others)
        return [], f"was in another version of home {home} ({digest[:12]}) than people"
    where = " or ".join(kinds) if is_of_maps else info.scene_kind
    return found, f"did none of the {len(done)} sequences that people did in homes of kind {where}"


def _versions(runs: Iterable[RunOfSequences]) -> set[tuple[str, str]]:
    """(home, digest) of the homes in which walks were measured."""
    return {
        (run.key.scene, search.measures.scene_digest)
        for _, found in runs
        for run in found
        for search in run.end.searches
        if search.measures is not None
    }

"""Rows of tables about runs of home sequences: one per agent, condition and kind of homes."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from sim.errors import RunFileError
from sim.homes.kind import scene_label
from sim.tasks.run_files import RunInfo, read_run_info
from sim.types import EpisodeKey, SuccessRule, TaskKind

from .figures import MemoryGain, SequenceFigures, SrDifference, memory_gain, sequence_figures, sr_difference
from .runs import SEQUENCES_FILE, SequenceRun, read_sequence_runs

MEMORY = "memory"
"""Part of the condition of runs in which agents kept their memory."""


RunOfSequences = tuple[RunInfo, tuple[SequenceRun, ...]]
"""A run: who did it and how, and its sequences."""
_Pooled = dict[tuple[str, str, str, TaskKind], list[RunOfSequences]]
"""Runs by who, condition, kind of homes and task."""


class BesideFirst(BaseModel):
    """A row's SR less that of the first row of its task and kind of homes, on the sequences that both have."""

    model_config = ConfigDict(frozen=True)
    who: str
    condition: str
    """The first row's."""
    sr: SrDifference


class SequenceRow(BaseModel):
    """The figures of an agent in one condition and kind of homes, over all splits."""

    model_config = ConfigDict(frozen=True)
    who: str
    task: TaskKind
    condition: str
    scene_kind: str
    edition: str
    scene_label: str
    rule: SuccessRule
    made_for: tuple[SuccessRule, ...]
    sequence_measures: SequenceFigures
    goat_measures: SequenceFigures | None
    """The same runs by GOAT-Bench's rule: FOUND less than 0.25 m of walking from a view point; PAN only."""
    memory_gain: MemoryGain | None = None
    """Of a row with memory, beside the same agent's row without."""
    beside_first: BesideFirst | None = None
    """None for the first row, and for one that shares no sequence with it."""


def holds_sequence_runs(folder: Path) -> bool:
    """Whether a run folder holds runs of sequences, not of episodes."""
    return (folder / SEQUENCES_FILE).is_file()


def sequence_rows(folders: Sequence[Path], *, rule: SuccessRule = "paper") -> list[SequenceRow]:
    """The rows of some run folders; several runs of one agent and condition are pooled, such as those of seeds.

    Raises:
        RunFileError: A folder is damaged, a sequence stands twice in one run or seed, or runs are on different sets or
            homes.
    """
    return rows_of_runs([(read_run_info(folder), read_sequence_runs(folder)) for folder in folders], rule=rule)


def rows_of_runs(read: Sequence[RunOfSequences], *, rule: SuccessRule = "paper") -> list[SequenceRow]:
    """The same of runs that were read already, or of people's."""
    _require_one_set([info for info, _ in read])
    pooled: _Pooled = defaultdict(list)
    for info, runs in read:
        tasks: set[TaskKind] = {run.start.task for run in runs}
        for task in sorted(tasks):
            of_task = tuple(run for run in runs if run.start.task == task)
            pooled[info.who, info.condition, info.scene_kind, task].append((info, of_task))
    rows = [_row(found, rule) for found in pooled.values()]
    more = [{"memory_gain": _gain(row, pooled, rule), "beside_first": _beside(row, rows, pooled, rule)} for row in rows]
    return [row.model_copy(update=found) for row, found in zip(rows, more, strict=True)]


def _row(found: Sequence[RunOfSequences], rule: SuccessRule) -> SequenceRow:
    info = found[0][0]
    seen: dict[tuple[EpisodeKey, int | str], str] = {}
    for one, runs in found:
        for run in runs:
            trial = (run.key, one.run_id if one.seed is None or one.who_kind == "human" else one.seed)
            if trial in seen:
                raise RunFileError(
                    f"{one.run_id}: found {run.key} a second time (first in {seen[trial]}); expected each sequence "
                    "once. Give each run once; runs of one agent need different seeds."
                )
            seen[trial] = one.run_id
    whole = [run for _, runs in found for run in runs]
    task = whole[0].start.task
    return SequenceRow(
        who=info.who,
        task=task,
        condition=info.condition,
        scene_kind=info.scene_kind,
        edition=info.edition,
        scene_label=scene_label(info.scene_kind),
        rule=rule,
        made_for=tuple(sorted({one.made_for for one, _ in found if one.made_for is not None})),
        sequence_measures=sequence_figures(whole, rule=rule),
        goat_measures=sequence_figures(whole, rule="goat") if task == "pan" else None,
    )


def _beside(row: SequenceRow, rows: Sequence[SequenceRow], pooled: _Pooled, rule: SuccessRule) -> BesideFirst | None:
    """The row's difference from the first one of its task and kind of homes."""
    first = next(one for one in rows if (one.task, one.scene_kind) == (row.task, row.scene_kind))
    if row is first:
        return None
    runs, others = (
        [run for _, found in pooled[one.who, one.condition, one.scene_kind, one.task] for run in found]
        for one in (row, first)
    )
    sr = sr_difference(runs, others, rule=rule)
    return None if sr is None else BesideFirst(who=first.who, condition=first.condition, sr=sr)


def _gain(
    row: SequenceRow,
    pooled: _Pooled,
    rule: SuccessRule,
) -> MemoryGain | None:
    """The gain of a row with memory over the same agent's row without; runs are paired by their seeds."""
    parts = row.condition.split(", ")
    without = ", ".join(part for part in parts if part != MEMORY) or "none"
    others = pooled.get((row.who, without, row.scene_kind, row.task))
    if MEMORY not in parts or others is None:
        return None
    forgetting = {(info.seed, run.key): run for info, runs in others for run in runs}
    pairs = [
        (run, forgetting[info.seed, run.key])
        for info, runs in pooled[row.who, row.condition, row.scene_kind, row.task]
        for run in runs
        if (info.seed, run.key) in forgetting
    ]
    return memory_gain(pairs, rule=rule)


def _require_one_set(infos: Sequence[RunInfo]) -> None:
    """Raises RunFileError where runs are on different sets of sequences, or had different homes or pictures."""
    sets = {(str(info.config.get("sequences")), info.dataset_digest, info.labels): info.run_id for info in infos}
    if len(sets) > 1:
        found = ", ".join(
            f"{name[:12]}{' with labels' * labels} ({sets[name, homes, labels]})"
            for name, homes, labels in sorted(sets)
        )
        raise RunFileError(
            f"runs: found sequences {found}; expected runs on one set, in the homes of one edition, all with labels in "
            "the pictures or none. Give them separately."
        )

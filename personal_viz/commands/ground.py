"""Verb `ground`: a grounder over POG episodes into a run folder, and the paper's POG table of it."""

import json as json_module
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import ValidationError
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from grounding.encoders import make_encoder
from grounding.evaluate import GroundJob, GroundSettings, evaluate, select_jobs
from grounding.grounders import Grounder, make_grounder
from grounding.phrases import DatasetPhrases
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError, RunFileError, line_from_validation_error
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import Answer, RunInfo, RunWriter, read_run
from sim.types import SPLITS, Split

_TOTAL_IS = "all episodes together"
"""The Total column weighs every episode alike; the plain mean of the splits is given beside it."""


@dataclass(frozen=True, slots=True)
class _Count:
    """Successes among answers."""

    n: int
    top1: int
    top3: int

    @property
    def sr(self) -> float | None:
        """Percent; None without episodes."""
        return round(100 * self.top1 / self.n, 2) if self.n else None

    @property
    def sr3(self) -> float | None:
        """Percent with any of the first three answers right; None without episodes."""
        return round(100 * self.top3 / self.n, 2) if self.n else None


def ground(
    *,
    dataset: Path,
    method: Literal["random", "center", "qs", "rpg"],
    map: Literal["oracle"],
    encoder: Literal["hashed"],
    out: Path,
    run_id: str | None,
    scene: tuple[str, ...] | None,
    split: tuple[Split, ...] | None,
    limit: int | None,
    seed: int,
    jobs: int,
    json: bool,
    all_storeys: bool = False,
) -> int:
    """Grounds episodes into `out/<run_id>`; a second call goes on where the first stopped. Prints the figures.

    Raises:
        PersonalVizError: Bad options, dataset or folder.
    """
    _require_positive("--limit", limit)
    _require_positive("--jobs", jobs)
    episodes = PersonalDataset(dataset)
    settings = GroundSettings(method, map=map, encoder=encoder, seed=seed, all_storeys=all_storeys)
    work = select_jobs(episodes, settings, splits=split or SPLITS, scenes=scene, limit=limit)
    if not work:
        raise PersonalVizError(f"{dataset}: the chosen splits and scenes hold no episode; expected one. Choose others.")
    grounder = make_grounder(method, make_encoder(encoder), seed=seed)
    storey = "all-storeys" if all_storeys else "storey-given"
    run_id = run_id or f"ground-{method}-{map}-{encoder}-{storey}-seed{seed}"
    folder = out / run_id
    writer = RunWriter(folder, _info(run_id, episodes, settings, grounder))
    _evaluate_with_progress(work, writer, processes=jobs)
    chosen = {key for job in work for key in job.keys}
    answers = [answer for answer in read_run(folder).answers if answer.key in chosen]
    counts = {split: _count([answer for answer in answers if answer.split == split]) for split in SPLITS}
    counts["total"] = _count(answers)
    if json:
        print(json_module.dumps(_document(settings, grounder, counts, folder), indent=2))
    else:
        _print_table(settings, grounder, counts, folder)
    return 0


def _require_positive(option: str, value: int | None) -> None:
    if value is not None and value < 1:
        raise PersonalVizError(f"{option} is {value}; expected a whole number from 1. Leave it out for the default.")


def _phrase_source(grounder: Grounder) -> str:
    """The phrase source's name, printed with every figure; "none" for a grounder that ignores phrases."""
    return DatasetPhrases.name if grounder.uses_phrases else "none"


def _info(run_id: str, dataset: PersonalDataset, settings: GroundSettings, grounder: Grounder) -> RunInfo:
    phrases = _phrase_source(grounder)
    storey = "all storeys" if settings.all_storeys else "storey given"
    try:
        return make_run_info(
            run_id,
            who=settings.method,
            who_kind="agent",
            condition=f"{settings.map} map, {settings.encoder} encoder, phrases {phrases}, {storey}",
            scene_kind="oracle-map",
            dataset_digest=dataset.digest(),
            seed=settings.seed,
            config={
                "map": settings.map,
                "encoder": settings.encoder,
                "phrases": phrases,
                "all_storeys": settings.all_storeys,
                "frame": grounder.frame,
            },
        )
    except ValidationError as error:
        advice = "Give another --run-id."
        raise RunFileError(line_from_validation_error(f"--run-id {run_id!r}", error, advice=advice)) from None


def _evaluate_with_progress(work: Sequence[GroundJob], writer: RunWriter, *, processes: int) -> None:
    total = sum(len(job.keys) for job in work)
    left = sum(key not in writer.done for job in work for key in job.keys)
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task(work[0].settings.method, total=total, completed=total - left)
        evaluate(work, writer, processes=processes, on_scene=lambda count: progress.update(bar, advance=count))


def _count(answers: Sequence[Answer]) -> _Count:
    measures = [answer.measures for answer in answers if answer.measures is not None]
    return _Count(len(measures), sum(item.success for item in measures), sum(item.top3_success for item in measures))


def _mean_of_splits(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(sum(known) / len(known), 2) if known else None


def _document(settings: GroundSettings, grounder: Grounder, counts: dict[str, _Count], folder: Path) -> dict:
    return {
        "method": settings.method,
        "encoder": settings.encoder,
        "phrases": _phrase_source(grounder),
        "map": settings.map,
        "storey_given": not settings.all_storeys,
        "frame": grounder.frame,
        "seed": settings.seed,
        "n": counts["total"].n,
        "n_per_split": {split: counts[split].n for split in SPLITS},
        "sr": {name: count.sr for name, count in counts.items()},
        "top3": {name: count.sr3 for name, count in counts.items()},
        "total_is": _TOTAL_IS,
        "mean_of_splits": {
            "sr": _mean_of_splits([counts[split].sr for split in SPLITS]),
            "top3": _mean_of_splits([counts[split].sr3 for split in SPLITS]),
        },
        "run": str(folder),
    }


def _print_table(settings: GroundSettings, grounder: Grounder, counts: dict[str, _Count], folder: Path) -> None:
    storey = "all storeys merged" if settings.all_storeys else "storey given"
    table = Table(
        title=f"POG, {settings.map} map ({storey}), {settings.encoder} encoder, phrases {_phrase_source(grounder)}",
        caption=f"Percent within 1 m of the target. {settings.method} chooses among: {grounder.frame}. "
        f"Total = {_TOTAL_IS}; mean of the splits: SR {_mean_of_splits([counts[split].sr for split in SPLITS])}, "
        f"top-3 {_mean_of_splits([counts[split].sr3 for split in SPLITS])}.",
    )
    table.add_column("Method")
    table.add_column("")
    for name in counts:
        table.add_column(name.capitalize(), justify="right")
    table.add_row(settings.method, "SR", *(_cell(count.sr, count.top1, count.n) for count in counts.values()))
    table.add_row("", "top-3", *(_cell(count.sr3, count.top3, count.n) for count in counts.values()))
    Console(file=sys.stdout).print(table)
    print(f"Written to {folder}; see it with: personal-viz metrics {folder}")


def _cell(percent: float | None, successes: int, n: int) -> str:
    return "-" if percent is None else f"{percent:.1f} ({successes}/{n})"

"""Verb `ground`: a grounder over POG episodes into a run folder, and the paper's POG table of it."""

import json as json_module
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from grounding.encoders import make_encoder
from grounding.evaluate import GroundJob, GroundSettings, evaluate, select_jobs
from grounding.grounders import Grounder, make_grounder
from grounding.phrases import DatasetPhrases
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.tasks.metrics import MetricRow, metric_rows
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import RunInfo, read_run
from sim.tasks.run_writer import RunWriter
from sim.types import SPLITS, Split

from .options import check_options

_TOTAL_IS = "plain mean of the splits"
"""As in the paper's Total column and in `personal-viz metrics`; `pooled` weighs every episode alike."""


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
    check_options(run_id=run_id, limit=limit, jobs=jobs, seed=seed)
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
    run = read_run(folder)
    chosen = {key for job in work for key in job.keys}
    answers = tuple(answer for answer in run.answers if answer.key in chosen)
    rows = {row.split: row for row in metric_rows([run.model_copy(update={"answers": answers})])}
    if json:
        print(json_module.dumps(_document(settings, grounder, rows, folder), indent=2))
    else:
        _print_table(settings, grounder, rows, folder)
    return 0


def _phrase_source(grounder: Grounder) -> str:
    """The phrase source's name, printed with every figure; "none" for a grounder that ignores phrases."""
    return DatasetPhrases.name if grounder.uses_phrases else "none"


def _info(run_id: str, dataset: PersonalDataset, settings: GroundSettings, grounder: Grounder) -> RunInfo:
    phrases = _phrase_source(grounder)
    storey = "all storeys" if settings.all_storeys else "storey given"
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


def _evaluate_with_progress(work: Sequence[GroundJob], writer: RunWriter, *, processes: int) -> None:
    total = sum(len(job.keys) for job in work)
    left = sum(key not in writer.done for job in work for key in job.keys)
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task(work[0].settings.method, total=total, completed=total - left)
        evaluate(work, writer, processes=processes, on_episode=lambda: progress.update(bar, advance=1))


def _document(settings: GroundSettings, grounder: Grounder, rows: dict[str, MetricRow], folder: Path) -> dict:
    names = (*SPLITS, "total")
    splits = [rows[split] for split in SPLITS if split in rows]
    return {
        "method": settings.method,
        "encoder": settings.encoder,
        "phrases": _phrase_source(grounder),
        "map": settings.map,
        "storey_given": not settings.all_storeys,
        "frame": grounder.frame,
        "seed": settings.seed,
        "n": rows["total"].n,
        "n_per_split": {split: rows[split].n if split in rows else 0 for split in SPLITS},
        "sr": {name: _rounded(rows[name].sr) if name in rows else None for name in names},
        "top3": {name: _rounded(rows[name].top3) if name in rows else None for name in names},
        "total_is": _TOTAL_IS,
        "pooled": {
            "sr": _pooled([(row.sr, row.n) for row in splits]),
            "top3": _pooled([(row.top3, row.n) for row in splits]),
        },
        "run": str(folder),
    }


def _pooled(figures: Sequence[tuple[float | None, int]]) -> float | None:
    """Percent over all episodes together, of each split's percent and number of episodes."""
    known = [(percent, n) for percent, n in figures if percent is not None]
    return _rounded(sum(percent * n for percent, n in known) / sum(n for _, n in known)) if known else None


def _rounded(percent: float | None) -> float | None:
    return None if percent is None else round(percent, 2)


def _print_table(settings: GroundSettings, grounder: Grounder, rows: dict[str, MetricRow], folder: Path) -> None:
    storey = "all storeys merged" if settings.all_storeys else "storey given"
    table = Table(
        title=f"POG, {settings.map} map ({storey}), {settings.encoder} encoder, phrases {_phrase_source(grounder)}",
        caption=f"Percent within 1 m of the target. {settings.method} chooses among: {grounder.frame}. "
        f"Total = {_TOTAL_IS}.",
    )
    table.add_column("Method")
    table.add_column("")
    names = [name for name in (*SPLITS, "total") if name in rows]
    for name in names:
        table.add_column(name.capitalize(), justify="right")
    table.add_row(settings.method, "SR", *(_cell(rows[name].sr) for name in names))
    table.add_row("", "k/n", *(f"{rows[name].k}/{rows[name].n}" for name in names))
    table.add_row("", "top-3", *(_cell(rows[name].top3) for name in names))
    Console(file=sys.stdout).print(table)
    print(f"Written to {folder}; see it with: personal-viz metrics {folder}")


def _cell(percent: float | None) -> str:
    return "-" if percent is None else f"{percent:.1f}"

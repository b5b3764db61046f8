"""Verbs `validate` and `stats`: what is wrong in a folder of episodes, and the paper's tables rebuilt from it."""

import json as json_module
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from personal_viz.printed import Console
from sim.episodes.dataset import PersonalDataset
from sim.episodes.statistics import (
    NETWORK_FIELDS,
    CaptionMetrics,
    CaptionStatistics,
    NetworkMetrics,
    NetworkStatistics,
    caption_statistics,
    network_statistics,
)
from sim.episodes.validate import CheckResult, Measure, ValidationReport, validate_dataset
from sim.types import SPLITS, Split

_COLOURS = {"error": "red", "defect": "yellow", "note": "dim", "ok": "green"}
_PIPE_WIDTH = 150
_NUM_EXAMPLES = 4


def validate(*, dataset: Path, json: bool) -> int:
    """Prints every check of DATA_FORMAT.md section 8; 1 when something is unusable, else 0."""
    report = validate_dataset(dataset)
    if json:
        print(json_module.dumps(_json_of_report(report), indent=1))
    else:
        _print_report(report)
    return 1 if report.num_errors else 0


def stats(*, dataset: Path, json: bool) -> int:
    """Prints the paper's tables of ownership and captions, rebuilt from the files, beside the paper's figures."""
    episodes = PersonalDataset(dataset)
    network, captions = network_statistics(episodes), caption_statistics(episodes)
    if json:
        print(json_module.dumps({"network": asdict(network), "captions": asdict(captions)}, indent=1))
        return 0
    console = _console()
    console.print(_network_table(network))
    console.print(_caption_table(captions))
    if captions.faulty:
        print(f"Captions with an annotator's note: {', '.join(captions.faulty)}")
    return 0


def _console() -> Console:
    """Writes to stdout; wide enough for the tables where there is no terminal to ask."""
    return Console(file=sys.stdout, width=None if sys.stdout.isatty() else _PIPE_WIDTH)


def _json_of_report(report: ValidationReport) -> dict[str, Any]:
    checks = [
        {
            "row": check.row,
            "slug": check.measure.slug,
            "level": check.level,
            "count": check.measure.count,
            "per_split": check.measure.per_split,
            "episodes": check.measure.names,
            "unit": check.measure.unit,
            "population": check.measure.population,
            "title": check.title,
            "also": [{k: v for k, v in asdict(measure).items() if k != "names"} for measure in check.also],
        }
        for check in report.checks
    ]
    return {
        "episodes": sum(report.num_episodes.values()),
        "per_split": report.num_episodes,
        "errors": report.num_errors,
        "checks": checks,
        "problems": report.problems,
    }


def _print_report(report: ValidationReport) -> None:
    counts = ", ".join(f"{split} {report.num_episodes[split]}" for split in SPLITS)
    print(f"{report.root}: {sum(report.num_episodes.values())} episodes ({counts})")
    table = Table(title="Checks of DATA_FORMAT.md, section 8")
    table.add_column("row", justify="right")
    table.add_column("level")
    for head in ("found", *SPLITS):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("check", overflow="fold")
    for check in report.checks:
        _add_check(table, check)
    _console().print(table)
    for check in report.checks:
        if check.level != "note" and check.measure.names:
            print(f"row {check.row}, {check.level}, {check.measure.slug}: {_examples(check.measure)}")
    for line in report.problems:
        print(line)
    found = {level: sum(c.level == level and c.measure.count > 0 for c in report.checks) for level in _COLOURS}
    print(
        f"{report.num_errors} errors (a file or episode cannot be used), {found['defect']} kinds of defects "
        f"(wrong, can be worked round), {found['note']} kinds of notes (normal for the format). "
        "Every episode concerned: --json."
    )


def _add_check(table: Table, check: CheckResult) -> None:
    level = check.level if check.measure.count else "ok"
    text = f"{check.measure.slug} [dim]({check.measure.unit}: {escape(check.title)})[/]"
    table.add_row(str(check.row), f"[{_COLOURS[level]}]{level}[/]", *_cells(check.measure), text)
    for measure in check.also:
        table.add_row("", "", *_cells(measure), f"  {measure.slug} ({measure.unit})", style="dim")


def _cells(measure: Measure) -> tuple[str, ...]:
    return (f"{measure.count:,}", *(_share(measure, split) for split in SPLITS))


def _share(measure: Measure, split: Split) -> str:
    """The split's count, with its percentage for units of which a split holds thousands."""
    count = f"{measure.per_split[split]:,}"
    if measure.population is None or "points" not in measure.unit or not measure.population[split]:
        return count
    return f"{count} ({measure.per_split[split] / measure.population[split]:.1%})"


def _examples(measure: Measure) -> str:
    more = f" and {len(measure.names) - _NUM_EXAMPLES:,} more" if len(measure.names) > _NUM_EXAMPLES else ""
    return ", ".join(measure.names[:_NUM_EXAMPLES]) + more


def _network_table(statistics: NetworkStatistics) -> Table:
    """One line per metric; per column the paper's figure, then per episode, then per distinct summary."""
    table = Table(title='Table "network-metrics": paper | files, per episode | files, per distinct summary')
    table.add_column("metric")
    columns = [column.column for column in statistics.per_episode]
    for column in columns:
        table.add_column(column.capitalize(), justify="right")
    sources = [_by_column(source) for source in (statistics.paper, statistics.per_episode, statistics.per_summary)]
    for field in NETWORK_FIELDS:
        cells = (" | ".join(_figure(getattr(source[column], field)) for source in sources) for column in columns)
        table.add_row(field.replace("_", " "), *cells)
    return table


def _by_column(columns: Sequence[NetworkMetrics]) -> Mapping[str, NetworkMetrics]:
    return {column.column: column for column in columns}


def _caption_table(statistics: CaptionStatistics) -> Table:
    table = Table(title='Table "goat_comparison": first caption of each distinct target')
    table.add_column("captions of")
    for head in ("captions", "tokens", "words / caption", "range", "vocabulary", "type-token ratio", "entropy, bits"):
        table.add_column(head, justify="right")
    for metrics in (*statistics.paper, statistics.all_targets, statistics.stripped, *statistics.per_split):
        table.add_row(*_caption_cells(metrics))
    return table


def _caption_cells(metrics: CaptionMetrics) -> tuple[str, ...]:
    return (
        metrics.source,
        "-" if metrics.captions is None else f"{metrics.captions:,}",
        "-" if metrics.tokens is None else f"{metrics.tokens:,}",
        f"{metrics.words_mean:.2f} ± {metrics.words_sd:.2f}",
        "-" if metrics.words_range is None else f"{metrics.words_range[0]}-{metrics.words_range[1]}",
        f"{metrics.vocabulary:,}",
        f"{metrics.type_token_ratio:.4f}",
        f"{metrics.entropy_bits:.2f}",
    )


def _figure(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.2f}"

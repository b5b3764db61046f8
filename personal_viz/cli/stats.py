"""Verb `stats`: the paper's tables of ownership and captions, rebuilt from the files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from .options import Dataset, Json
from .output import print_json, table_console

if TYPE_CHECKING:
    from rich.table import Table

    from sim.episodes.statistics import CaptionMetrics, CaptionStatistics, NetworkMetrics, NetworkStatistics


@dataclass
class Stats:
    """Rebuild the paper's two statistics tables from the files."""

    dataset: Dataset
    json: Json = False

    def run(self) -> int:
        from sim.episodes.dataset import PersonalDataset
        from sim.episodes.statistics import caption_statistics, network_statistics

        episodes = PersonalDataset(self.dataset)
        network, captions = network_statistics(episodes), caption_statistics(episodes)
        if self.json:
            print_json({"network": asdict(network), "captions": asdict(captions)})
            return 0
        console = table_console(folds=True)
        console.print(_network_table(network))
        console.print(_caption_table(captions))
        if captions.faulty:
            print(f"Captions with an annotator's note: {', '.join(captions.faulty)}")
        return 0


def _network_table(statistics: NetworkStatistics) -> Table:
    """A table with one line per metric; a cell holds the paper's figure, ours per episode and per distinct summary."""
    from rich.table import Table

    from sim.episodes.statistics import NETWORK_FIELDS

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
    from rich.table import Table

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

"""Verb `stats`: the paper's tables of ownership and captions, rebuilt from the files."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from sim.episodes.dataset import PersonalDataset
from sim.episodes.editions import edition_of
from sim.episodes.statistics import (
    NETWORK_FIELDS,
    CaptionMetrics,
    NetworkStatistics,
    caption_statistics,
    goat_metrics,
    network_statistics,
)

from .options import Dataset, Json
from .output import print_json, print_table


@dataclass
class Stats:
    """Rebuild the paper's two statistics tables from the files."""

    dataset: Dataset
    goat: Annotated[Path | None, arg(help="Folder of GOAT-Bench's episodes, for its column of the captions.")] = None
    json: Json = False

    def run(self) -> int:
        episodes = PersonalDataset(self.dataset)
        edition = edition_of(episodes.digest())
        goat = None if self.goat is None else goat_metrics(self.goat)
        network, captions = network_statistics(episodes), caption_statistics(episodes)
        if self.json:
            more = {} if goat is None else {"goat": asdict(goat)}
            print_json({"edition": edition, "network": asdict(network), "captions": asdict(captions), **more})
            return 0
        print(f"Episodes of edition {edition}.")
        _print_network(network)
        heads = ("captions of", "captions", "tokens", "words / caption", "range", "vocabulary", "type-token ratio")
        measured = (captions.all_targets, captions.stripped, *captions.per_split)
        shown = (*captions.paper, *(() if goat is None else (goat,)), *measured)
        title = 'Table "goat_comparison": first caption of each distinct target'
        print_table(title, (*heads, "entropy, bits"), map(_caption_cells, shown), folds=True)
        if captions.faulty:
            print(f"Captions with an annotator's note: {', '.join(captions.faulty)}")
        return 0


def _print_network(statistics: NetworkStatistics) -> None:
    """Prints a line per metric; a cell holds the paper's figure, ours per episode and per distinct summary."""
    sources = [
        {column.column: column for column in source}
        for source in (statistics.paper, statistics.per_episode, statistics.per_summary)
    ]
    columns = list(sources[1])
    rows = [
        (
            field.replace("_", " "),
            *(" | ".join(_figure(getattr(source[column], field)) for source in sources) for column in columns),
        )
        for field in NETWORK_FIELDS
    ]
    title = 'Table "network-metrics": paper | files, per episode | files, per distinct summary'
    print_table(title, ("metric", *map(str.capitalize, columns)), rows, folds=True)


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

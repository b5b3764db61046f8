"""Verb `stats`: the paper's tables of ownership and captions, rebuilt from the files; or the figures of a set of home
sequences."""

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from sim.episodes.dataset import PersonalDataset
from sim.episodes.editions import edition_of
from sim.episodes.sequence_files import SequenceSet, holds_sequences
from sim.episodes.statistics import (
    NETWORK_FIELDS,
    CaptionMetrics,
    NetworkStatistics,
    caption_statistics,
    goat_metrics,
    network_statistics,
)
from sim.types import SPLITS
from sim.words.english import how_many

from .options import Dataset, Json
from .output import print_json, print_table

_SEQUENCE_TABLES = {
    "sequences": "Home sequences of each split",
    "lengths": "Sequences by length",
    "messages": "Messages by kind",
    "kinds": "Searches by kind",
    "modes": "Searches by mode",
}


@dataclass
class Stats:
    """Rebuild the paper's two statistics tables from the files, or count what a set of home sequences holds."""

    dataset: Dataset
    goat: Annotated[Path | None, arg(help="Folder of GOAT-Bench's episodes, for its column of the captions.")] = None
    json: Json = False

    def run(self) -> int:
        if holds_sequences(self.dataset):
            figures = _sequence_figures(SequenceSet(self.dataset))
            print_json(figures) if self.json else _print_sequences(figures)
            return 0
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


def _sequence_figures(found: SequenceSet) -> dict[str, dict[str, dict[str, int]]]:
    """Counts of each split and of all: sequences, their lengths, messages and searches by kind, searches by mode."""
    counts: dict[str, dict[str, Counter[str]]] = {name: {} for name in _SEQUENCE_TABLES}
    for sequence in found.sequences():
        record = sequence.record
        told = {
            "sequences": ["sequences"],
            "lengths": [how_many(len(record.subtasks), "search", "searches")],
            "messages": [message.kind for message in record.messages],
            "kinds": [subtask.kind for subtask in record.subtasks],
            "modes": [subtask.mode for subtask in record.subtasks],
        }
        for name, entries in told.items():
            for column in (record.split, "all"):
                counts[name].setdefault(column, Counter()).update(entries)
    return {
        name: {column: dict(sorted(columns[column].items())) for column in (*SPLITS, "all") if column in columns}
        for name, columns in counts.items()
    }


def _print_sequences(figures: dict[str, dict[str, dict[str, int]]]) -> None:
    for name, title in _SEQUENCE_TABLES.items():
        columns = figures[name]
        entries = sorted(columns.get("all", {}), key=lambda entry: (len(entry), entry))
        rows = [(entry, *(f"{columns[column].get(entry, 0):,}" for column in columns)) for entry in entries]
        print_table(title, ("", *columns), rows)


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

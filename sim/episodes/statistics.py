"""The paper's dataset tables rebuilt from files: "network-metrics" (ownership) and "goat_comparison" (captions)."""

import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from sim.errors import DatasetError, short
from sim.files import bounded_json
from sim.types import SPLITS, Split
from sim.words.english import how_many

from .checks_text import is_annotator_note
from .dataset import PersonalDataset
from .ownership import anonymous_summary, ownership_graph
from .schema import Episode

_WORD = re.compile(r"[a-z0-9']+")
_GOAT_BYTES, _GOAT_VALUES = 2 << 30, 200_000_000
"""Most bytes and values of a content file of GOAT-Bench, whose goals list many view points."""


@dataclass(frozen=True, slots=True)
class NetworkMetrics:
    """One column of the table "network-metrics"; means over episodes or over distinct summaries."""

    column: Split | Literal["total"]
    people: float
    """People per graph."""
    objects: float
    """Objects per graph."""
    shared_objects: float
    """Objects with several owners per graph."""
    categories: int
    """Distinct categories that episodes ask for."""
    summary_words: float
    """Words of the summary, split at spaces."""
    edges: float
    """Ownership edges per graph."""
    degree_per_person: float
    """Mean of the graphs' objects per person."""
    degree_per_object: float
    """Mean of the graphs' owners per object."""
    density: float
    """Mean of the graphs' densities."""
    overlap_ratio: float
    """Mean of the graphs' shares of shared objects."""
    episodes: int
    """Episodes, or distinct summaries."""
    geodesic: float
    """Mean stored geodesic distance, metres."""
    euclidean: float
    """Mean stored planar distance, metres."""


NETWORK_FIELDS = (
    "people", "objects", "shared_objects", "categories", "summary_words", "edges", "degree_per_person",
    "degree_per_object", "density", "overlap_ratio", "episodes", "geodesic", "euclidean",
)  # fmt: skip
"""The rows of the table, in the paper's order."""
_MEANS = tuple(field for field in NETWORK_FIELDS if field not in ("categories", "episodes"))
PAPER_NETWORK = (
    NetworkMetrics("easy", 4.52, 4.52, 0, 51, 67, 4.52, 1.00, 1.00, 0.23, 0, 600, 3.12, 3.40),
    NetworkMetrics("medium", 4.42, 6.09, 0, 83, 117, 6.09, 1.43, 1.00, 0.24, 0, 700, 5.23, 4.80),
    NetworkMetrics("hard", 6.27, 6.42, 4.55, 119, 148, 16.42, 2.61, 2.62, 0.42, 0.73, 720, 7.56, 7.09),
    NetworkMetrics("total", 5.07, 5.68, 1.52, 119, 110, 9.01, 1.68, 1.54, 0.30, 0.24, 2020, 5.30, 5.10),
)
"""Table "network-metrics" of the paper (arXiv 2509.19843)."""


@dataclass(frozen=True, slots=True)
class NetworkStatistics:
    """Table "network-metrics", rebuilt."""

    per_episode: tuple[NetworkMetrics, ...]
    """One column per split that has episodes, and "total": the unweighted mean of the splits, as in the paper."""
    per_summary: tuple[NetworkMetrics, ...]
    """The same with one graph per distinct story (names removed) instead of one per episode."""
    paper: tuple[NetworkMetrics, ...] = PAPER_NETWORK


@dataclass(frozen=True, slots=True)
class CaptionMetrics:
    """One column of the table "goat_comparison"."""

    source: str
    """Source of the captions."""
    words_mean: float
    words_sd: float
    """Population standard deviation of the words per caption."""
    vocabulary: int
    """Distinct tokens."""
    type_token_ratio: float
    """Vocabulary over tokens; falls with the number of tokens, so compare only at equal counts."""
    entropy_bits: float
    """Shannon entropy of the token frequencies."""
    captions: int | None = None
    """Number of captions; None where the paper does not say."""
    tokens: int | None = None
    """Number of tokens; None where the paper does not say."""
    words_range: tuple[int, int] | None = None
    """Words of the shortest and of the longest caption."""


PAPER_CAPTIONS = (
    CaptionMetrics("GOAT (paper)", 20.65, 13.10, 1344, 0.051, 6.92),
    CaptionMetrics("PersONAL (paper)", 16.28, 6.06, 1564, 0.069, 7.35),
)
"""Table "goat_comparison" of the paper; the release holds no caption of GOAT-Bench (`goat_metrics` reads its files)."""


@dataclass(frozen=True, slots=True)
class CaptionStatistics:
    """Table "goat_comparison", rebuilt from the first caption of each distinct target object."""

    all_targets: CaptionMetrics
    """Tokens = lower case, split at spaces, as upstream."""
    stripped: CaptionMetrics
    """Tokens = runs of letters, digits and apostrophes."""
    per_split: tuple[CaptionMetrics, ...]
    """Targets of one split each, in order of SPLITS; splits without episodes are left out."""
    faulty: tuple[str, ...]
    """`scene/object_name` of targets whose caption holds an annotator's note."""
    paper: tuple[CaptionMetrics, ...] = PAPER_CAPTIONS


def network_statistics(dataset: PersonalDataset) -> NetworkStatistics:
    """Rebuilds the table "network-metrics".

    Raises:
        DatasetError: A file is damaged, or an ownership sentence cannot be parsed.
    """
    episodes = tuple(dataset.episodes())
    return NetworkStatistics(_network_columns(episodes), _network_columns(_one_per_summary(episodes)))


def caption_statistics(dataset: PersonalDataset) -> CaptionStatistics:
    """Rebuilds the table "goat_comparison".

    Raises:
        DatasetError: A file is damaged.
    """
    episodes = tuple(dataset.episodes())
    captions = _first_captions(episodes)
    per_split = ((split, _first_captions(e for e in episodes if e.key.split == split)) for split in SPLITS)
    return CaptionStatistics(
        caption_metrics("all targets", [_tokens(text) for text in captions.values()]),
        caption_metrics("without punctuation", [_WORD.findall(text.lower()) for text in captions.values()]),
        tuple(caption_metrics(split, [_tokens(t) for t in texts.values()]) for split, texts in per_split if texts),
        tuple(sorted(f"{scene}/{name}" for (scene, name), text in captions.items() if is_annotator_note(text))),
    )


def goat_metrics(folder: Path) -> CaptionMetrics:
    """The column of GOAT-Bench in the table "goat_comparison", from all content files below a folder.

    Counts `lang_desc` of each distinct object that has one, also those of more than 55 words, for which GOAT-Bench's
    loader makes no task (github.com/Ram81/goat-bench).

    Raises:
        DatasetError: There is no content file, a file is damaged, or none holds a description.
    """
    captions: dict[tuple[str, str], str] = {}
    paths = sorted(path for path in folder.rglob("*.json*") if path.parent.name == "content")
    for path in paths:
        try:
            goals = json.loads(bounded_json(path, most=_GOAT_BYTES, most_values=_GOAT_VALUES))["goals"]
            found = [goal for of_category in goals.values() for goal in of_category]
            texts = {str(goal["object_id"]): goal["lang_desc"] for goal in found if goal.get("lang_desc")}
        except (OSError, EOFError, zlib.error, ValueError, RecursionError) as error:
            raise DatasetError(f"{path}: {error}; expected JSON. Download the file again.") from None
        except (LookupError, TypeError, AttributeError) as error:
            problem = f"{type(error).__name__} {short(str(error), most=80)}"
            raise DatasetError(
                f"{path}: found {problem}; expected the goals of GOAT-Bench by category. Give the folder of its splits."
            ) from None
        captions |= {(path.name.partition(".")[0], name): str(text) for name, text in texts.items()}
    if not captions:
        raise DatasetError(
            f"{folder}: found no description in {how_many(len(paths), 'content file')}; expected GOAT-Bench's "
            "<split>/content/<Scene>.json.gz with lang_desc. Give the folder of its splits."
        )
    return caption_metrics("GOAT-Bench", [_tokens(text) for text in captions.values()])


def caption_metrics(source: str, token_lists: Sequence[Sequence[str]]) -> CaptionMetrics:
    """Size, vocabulary and entropy of some captions, one list of tokens each; zeros for no tokens."""
    counts = Counter(token for tokens in token_lists for token in tokens)
    num_tokens = counts.total()
    if not num_tokens:
        return CaptionMetrics(source, 0.0, 0.0, 0, 0.0, 0.0, len(token_lists), 0, (0, 0))
    lengths = [len(tokens) for tokens in token_lists]
    entropy = -math.fsum(count / num_tokens * math.log2(count / num_tokens) for count in counts.values())
    return CaptionMetrics(
        source,
        words_mean=float(np.mean(lengths)),
        words_sd=float(np.std(lengths)),
        vocabulary=len(counts),
        type_token_ratio=len(counts) / num_tokens,
        entropy_bits=entropy,
        captions=len(lengths),
        tokens=num_tokens,
        words_range=(min(lengths), max(lengths)),
    )


def _network_columns(episodes: Sequence[Episode]) -> tuple[NetworkMetrics, ...]:
    of_split = ([episode for episode in episodes if episode.key.split == split] for split in SPLITS)
    columns = tuple(_network_column(chosen) for chosen in of_split if chosen)
    return (*columns, _total_column(columns, episodes)) if columns else ()


def _network_column(episodes: Sequence[Episode]) -> NetworkMetrics:
    """The column of one split, from its episodes."""
    graphs = [ownership_graph(episode) for episode in episodes]
    records = [episode.record for episode in episodes]
    return NetworkMetrics(
        episodes[0].key.split,
        people=_mean(len(graph.people) for graph in graphs),
        objects=_mean(len(graph.objects) for graph in graphs),
        shared_objects=_mean(len(graph.shared) for graph in graphs),
        categories=len({record.object_category for record in records}),
        summary_words=_mean(len(record.summary.split()) for record in records),
        edges=_mean(len(graph.edges) for graph in graphs),
        degree_per_person=_mean(graph.degree_per_person for graph in graphs),
        degree_per_object=_mean(graph.degree_per_object for graph in graphs),
        density=_mean(graph.density for graph in graphs),
        overlap_ratio=_mean(graph.overlap_ratio for graph in graphs),
        episodes=len(episodes),
        geodesic=_mean(record.info.geodesic_distance for record in records),
        euclidean=_mean(record.info.euclidean_distance for record in records),
    )


def _total_column(columns: Sequence[NetworkMetrics], episodes: Sequence[Episode]) -> NetworkMetrics:
    """Unweighted mean of the splits' means; categories are the union and episodes the sum."""
    means = {field: _mean(getattr(column, field) for column in columns) for field in _MEANS}
    num_categories = len({episode.record.object_category for episode in episodes})
    return NetworkMetrics("total", categories=num_categories, episodes=len(episodes), **means)


def _one_per_summary(episodes: Iterable[Episode]) -> list[Episode]:
    """The first episode of each story; a story has one split, one scene, and one summary apart from the names."""
    first: dict[tuple[str, str, str], Episode] = {}
    for episode in episodes:
        first.setdefault((episode.key.split, episode.key.scene, anonymous_summary(episode.record)[0]), episode)
    return list(first.values())


def _first_captions(episodes: Iterable[Episode]) -> dict[tuple[str, str], str]:
    """The first caption of each target by (scene, object_name); the first episode with the target counts."""
    captions: dict[tuple[str, str], str] = {}
    for episode in episodes:
        for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
            if texts:
                captions.setdefault((episode.key.scene, name), texts[0])
    return captions


def _tokens(text: str) -> list[str]:
    return text.lower().split()


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))

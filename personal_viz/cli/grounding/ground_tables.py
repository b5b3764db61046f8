"""Output of the verb `ground`: one JSON document per run, or the paper's POG table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grounding.chat.budget import ChatUsage
from grounding.encoders.by_name import encoder_called
from grounding.evaluation.settings import GroundSettings
from grounding.methods.chat_grounders import CHAT_METHODS, STANDS_IN
from grounding.report.sources import PAPER_IS, PAPER_POG, pog_notes
from sim.tasks.metrics import MetricRow
from sim.tasks.run_files import RunInfo
from sim.types import SPLITS

from ..chat_cost import chat_document, chat_line
from ..output import print_table

_TOTAL_IS = "plain mean of the splits"
"""As in the paper's Total column and in `personal-viz metrics`; `pooled` gives every episode the same weight."""


@dataclass(frozen=True, slots=True)
class GroundResult:
    """One run and its figures."""

    settings: GroundSettings
    info: RunInfo
    rows: Mapping[str, MetricRow]
    """By split, and `total`."""
    folder: Path
    fell_back: int
    """Number of answers for which the chat model gave nothing to use."""
    chat: ChatUsage | None = None
    """The run's use of a chat model, over all calls; None for runs without one."""
    price: tuple[float, float] | None = None
    """Money for a million tokens of prompts and of answers."""


def ground_document(result: GroundResult) -> dict[str, object]:
    """The figures of a run in rounded percent; splits without episodes are None."""
    settings, info, rows = result.settings, result.info, result.rows
    names = (*SPLITS, "total")
    splits = [rows[split] for split in SPLITS if split in rows]
    return {
        "method": info.who,
        "encoder": encoder_called(settings.map_encoder),
        "phrases": info.config["phrases"],
        "fell_back": result.fell_back if _asks(result) else None,
        "chat": chat_document(result.chat, result.price) if result.chat is not None and _asks(result) else None,
        "map": settings.map,
        "edition": info.edition,
        "scene_kind": info.scene_kind,
        "scene_label": info.scene_label,
        "condition": info.condition,
        "storey_given": not settings.all_storeys,
        "notes": list(pog_notes([info])),
        "frame": info.config["frame"],
        "seed": settings.seed,
        "config": dict(info.config),
        "n": rows["total"].n,
        "n_per_split": {split: rows[split].n if split in rows else 0 for split in SPLITS},
        "sr": {name: _rounded(rows[name].sr) if name in rows else None for name in names},
        "top3": {name: _rounded(rows[name].top3) if name in rows else None for name in names},
        "total_is": _TOTAL_IS,
        "pooled": {
            "sr": _pooled([(row.sr, row.n) for row in splits]),
            "top3": _pooled([(row.top3, row.n) for row in splits]),
        },
        "run": str(result.folder),
    }


def print_ground_table(results: Sequence[GroundResult]) -> None:
    """The paper's POG table with one method; a group of rows for each source of phrases.

    Args:
        results: Results with the same settings except for the phrases; at least one.
    """
    info, settings = results[0].info, results[0].settings
    sources = [str(result.info.config["phrases"]) for result in results]
    names = [name for name in (*SPLITS, "total") if any(name in result.rows for result in results)]
    lines = []
    for result, source in zip(results, sources, strict=True):
        shown = [result.rows[name] for name in names]
        label = settings.method if source == "none" else f"{settings.method} (phrases {source})"
        lines.append((label, "SR", *(_cell(row.sr) for row in shown)))
        lines.append(("", "k/n", *(f"{row.k}/{row.n}" for row in shown)))
        lines.append(("", "top-3", *(_cell(row.top3) for row in shown)))
    if info.scene_kind == "oracle-map" and settings.method in PAPER_POG:
        printed = dict[str, float](zip((*SPLITS, "total"), PAPER_POG[settings.method], strict=True))
        lines.append((PAPER_IS, "SR", *(f"{printed[name]:.1f}" for name in names)))
    homes = "no home" if info.scene_kind == "oracle-map" else f"{info.scene_kind} homes"
    title = f"POG, {info.condition.replace(f', phrases {sources[0]}', '')} ({homes}; edition {info.edition})"
    print_table(title, ("Method", "figure", *map(str.capitalize, names)), lines, texts=("figure",))
    print(
        f"Percent within 1 m of the target. {settings.method} chooses among: {info.config['frame']}. "
        f"Total = {_TOTAL_IS}."
    )
    for note in [*([f"{info.scene_label}."] if info.scene_label else []), *pog_notes([each.info for each in results])]:
        print(note)
    for result in results:
        if result.fell_back:
            instead = (
                "rules read those phrases"
                if result.info.config["phrases"] == "llm"
                else f"{STANDS_IN[settings.method]} gave those"
            )
            print(
                f"The chat model gave nothing to use for {result.fell_back} of {result.rows['total'].n} answers: "
                f"{instead}."
            )
        if result.chat is not None and _asks(result):
            print(chat_line(result.chat, result.price))
    folders = " ".join(str(result.folder) for result in results)
    print(f"Written to {folders}; see it with: personal-viz metrics {folders}")


def _asks(result: GroundResult) -> bool:
    """Whether the answers depend on a chat model."""
    return result.info.config["phrases"] == "llm" or result.settings.method in CHAT_METHODS


def _pooled(figures: Sequence[tuple[float | None, int]]) -> float | None:
    """Percent over all episodes together, from each split's percent and number of episodes."""
    known = [(percent, n) for percent, n in figures if percent is not None]
    return _rounded(sum(percent * n for percent, n in known) / sum(n for _, n in known)) if known else None


def _rounded(percent: float | None) -> float | None:
    return None if percent is None else round(percent, 2)


def _cell(percent: float | None) -> str:
    return "-" if percent is None else f"{percent:.1f}"

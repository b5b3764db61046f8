"""The grounding benchmark's figures as rows and as Markdown, with their targets."""

from collections.abc import Iterator

from .grounding import LEAST, MOST, GroundingFigures

_CASES = ("b1", "b64", "all_episodes")
_HEADS = ("figure", "found", "target", "met")


def figure_rows(figures: GroundingFigures) -> list[tuple[str, ...]]:
    """Heads, then each figure with its target, where it has one; "literal_ms" and so on below each case."""
    rows = []
    for name, value in _values(figures):
        if name in MOST:
            target, met = f"<= {MOST[name]:g}", value <= MOST[name]
        elif name in LEAST:
            target, met = f">= {LEAST[name]:g}", value >= LEAST[name]
        else:
            target, met = "", None
        rows.append((name, f"{value:.2f}", target, "" if met is None else "yes" if met else "no"))
    return [_HEADS, *rows]


def missed(figures: GroundingFigures) -> list[str]:
    """Names of the figures that miss their targets."""
    return [row[0] for row in figure_rows(figures) if row[3] == "no"]


def markdown(figures: GroundingFigures) -> str:
    """The table, and what was measured."""
    heads, *rows = ("| " + " | ".join(row) + " |" for row in figure_rows(figures))
    every, used = figures.all_episodes, figures.settings
    text = (
        f"Algorithm 1 on the CPU, one thread, texts encoded before; elapsed medians. b1 and b64: random maps of "
        f"{used.size} x {used.size} x {used.dim}, {used.cells} cells filled, {used.phrases} phrases (b64 has "
        f"{figures.b64.episodes} episodes on as many maps). all_episodes: {every.episodes} {figures.inputs} episodes "
        f"on {every.maps} maps with {every.cells:.0f} filled cells and {every.phrases:.1f} phrases each, owners' names "
        f"left out. Bound: the product of texts and full grids alone. cold_s: a fresh process over "
        f"{figures.cold_episodes} episodes with rpg, cold_phrase_s: with phrase. query_ms: one "
        f"description and query to an answer."
    )
    return "\n".join(["# Grounding", "", text, "", heads, "|---|---|---|---|", *rows, ""])


def _values(figures: GroundingFigures) -> Iterator[tuple[str, float]]:
    for case in _CASES:
        for name, value in getattr(figures, case):
            if isinstance(value, float):
                yield f"{case}.{name}", value
    for name in ("cold_s", "cold_phrase_s", "query_ms"):
        for encoder, value in getattr(figures, name).items():
            yield f"{name}.{encoder}", value

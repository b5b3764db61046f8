"""Writes the comparison of agents into the documentation: tables between two marks of a page, and a picture of curves.

python -m personal_viz.bench.search.page docs/figures/search.json docs/agents.md docs/pictures/search.png
"""

import io
import re
import sys
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grounding.report.statistics import Range
from human_study.export.text_tables import markdown_table
from sim.errors import RunFileError
from sim.homes.kind import scene_label

from .figures import GroupFigures, SearchDocument, SearchRow

_PLACE = re.compile(r"(<!-- search -->\n).*?(<!-- end -->)", re.DOTALL)
_HEADS = (
    "agent",
    "faults",
    "SR %",
    "95 % by home",
    "SPL %",
    "SR at a view point %",
    "steps",
    "SR beside geometry (95 % by home)",
)
_LEVELS = {"": "sees nothing", "oracle:clean": "none", "oracle:mild": "mild", "oracle:strong": "strong"}
_LOOKS = {
    "onemap": ("#1f5fa8", "o"),
    "vlfm": ("#b5472f", "s"),
    "vlfm-geometry": ("#3d9a5f", "^"),
    "nearest-frontier": ("#8a6db1", "D"),
    "random-frontier": ("#555555", "x"),
}
"""Colour and marker of each agent."""


def rewritten(page: str, document: SearchDocument) -> str:
    """The page (Markdown) with the document's tables between its marks.

    Raises:
        RunFileError: It has no marks.
    """
    if _PLACE.search(page) is None:
        raise RunFileError("found no line <!-- search -->; expected it above <!-- end -->. Add both lines.")
    parts = [_section(group) for group in document.groups]
    origin = f"Run {document.created_utc[:10]}, homes version {document.homes_version}."
    return _PLACE.sub(lambda found: f"{found[1]}\n{origin}\n\n" + "\n\n".join(parts) + f"\n\n{found[2]}", page)


def curves_png(document: SearchDocument) -> bytes:
    """A PNG picture: success over the faults of perception, one panel per kind of homes, intervals by home."""
    figure = Figure(figsize=(10.5, 4.8), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(document.groups), sharey=True, squeeze=False)[0]
    for axes, group in zip(panels, document.groups, strict=True):
        _draw(axes, group)
    panels[0].set_ylabel("success (rule paper), %")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(_LOOKS), fontsize=9, frameon=False)
    figure.suptitle(
        "Oracle perception in homes without a scan: it ranks methods and says nothing about HM3D", fontsize=11
    )
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def _section(group: GroupFigures) -> str:
    title = f"{scene_label(group.homes)}: {len(group.episodes)} episodes of {group.num_homes} homes."
    return f"{title}\n\n{markdown_table(_HEADS, map(_cells, group.rows), num_text=2)}"


def _cells(row: SearchRow) -> list[str]:
    beside = "" if row.beside_geometry is None else f"{row.beside_geometry:+.1f}"
    if row.beside_geometry_by_home is not None:
        beside += f" ({_interval(row.beside_geometry_by_home)})"
    return [
        row.agent,
        _LEVELS[row.level],
        f"{row.sr:.1f}",
        _interval(row.sr_by_home),
        f"{row.spl:.1f}",
        f"{row.sr_at_view_point:.1f}",
        f"{row.num_steps:.0f}",
        beside,
    ]


def _interval(found: Range | None) -> str:
    return "" if found is None else f"{found.low:.1f} to {found.high:.1f}"


def _draw(axes: Axes, group: GroupFigures) -> None:
    """Draws one panel; agents stand a little apart so that their intervals can be told from each other."""
    levels = [level for level in _LEVELS if level]
    for place, (agent, (colour, marker)) in enumerate(_LOOKS.items()):
        rows = [row for row in group.rows if row.agent == agent]
        if len(rows) == 1:  # sees nothing, so faults change nothing
            axes.axhline(rows[0].sr, color=colour, linestyle=":", label=agent)
            continue
        at = [levels.index(row.level) + 0.06 * (place - 1.5) for row in rows]
        below = [row.sr - row.sr_by_home.low if row.sr_by_home else 0 for row in rows]
        above = [row.sr_by_home.high - row.sr if row.sr_by_home else 0 for row in rows]
        axes.errorbar(at, [row.sr for row in rows], [below, above], color=colour, marker=marker, capsize=3, label=agent)
    axes.set_xticks(range(len(levels)), [_LEVELS[level] for level in levels])
    axes.set_xlabel("faults of perception")
    axes.set_ylim(0, 100)
    axes.set_title(f"{group.homes} homes, {len(group.episodes)} episodes", fontsize=10)
    axes.grid(alpha=0.3)


def main() -> None:
    """Reads JSON, rewrites PAGE and PICTURE."""
    source, page, picture = (Path(argument) for argument in sys.argv[1:])
    document = SearchDocument.model_validate_json(source.read_text())
    try:
        text = rewritten(page.read_text(), document)
    except RunFileError as error:
        raise SystemExit(f"{page}: {error}") from None
    page.write_text(text)
    picture.write_bytes(curves_png(document))
    print(f"Written to {page} and {picture}")


if __name__ == "__main__":
    main()

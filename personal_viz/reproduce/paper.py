"""The figures that the paper prints, for lines beside ours."""

from collections.abc import Sequence
from typing import NamedTuple

from grounding.report.sources import PAPER_POG
from sim.tasks.metrics import MetricRow
from sim.types import SPLITS

Figures = tuple[float, ...]
"""One figure for easy, medium, hard and total."""


class PanFigures(NamedTuple):
    """A line of the paper's PAN table."""

    sr: Figures
    spl: Figures
    dtg: Figures


PAPER_PAN: dict[str, PanFigures] = {
    "Human": PanFigures((70.21, 65.22, 60.13, 63.54), (49.20, 40.05, 35.31, 41.34), (1.26, 1.40, 1.32, 1.48)),
    "Human w. env. memory": PanFigures((89.0, 86.0, 82.0, 86.0), (58.12, 55.0, 53.2, 52.18), (0.84, 1.10, 0.98, 1.03)),
    "Random": PanFigures((0.01, 0.05, 0.01, 0.0), (0.0, 0.0, 0.0, 0.0), (6.02, 6.98, 0.0, 8.20)),
    "VLFM": PanFigures((12.5, 10.49, 7.82, 9.88), (6.0, 4.0, 1.0, 6.0), (5.21, 5.18, 5.03, 5.03)),
    "OneMap": PanFigures((38.17, 28.61, 20.0, 28.93), (29.0, 21.0, 16.0, 22.0), (3.04, 3.75, 4.68, 3.82)),
}
"""PAN results as printed, percent and metres.

The totals of Human and VLFM are no mean of their splits, and Random's DTG on hard is printed as 0.
"""
_POG_NAMES = {
    "random": "Random (x,y)",
    "center": "Center (x,y)",
    "qs": "Query-Score (QS)",
    "rpg": "Region-Gated (RPG)",
    "human": "Human",
}
"""The paper's names of the lines of `PAPER_POG`."""


def paper_cells(row: MetricRow, *, columns: Sequence[str]) -> tuple[str, list[tuple[str, ...]]] | None:
    """The paper's name of a row's method, and for each column (a split, or `total`) the cells under our heads.

    None where the paper has no such method.
    """
    places = [(*SPLITS, "total").index(name) for name in columns]
    if row.task == "pog":
        if row.who not in _POG_NAMES:
            return None
        return _POG_NAMES[row.who], [(f"{PAPER_POG[row.who][place]:.1f}", "", "") for place in places]
    name = _pan_name(row)
    if name is None:
        return None
    sr, spl, dtg = PAPER_PAN[name]
    return name, [(f"{sr[place]:.1f}", "", f"{spl[place]:.1f}", f"{dtg[place]:.2f}") for place in places]


def _pan_name(row: MetricRow) -> str | None:
    if row.who == "human":
        return "Human" if row.condition == "none" else "Human w. env. memory"
    known = {"random-frontier": "Random", "vlfm": "VLFM", "onemap": "OneMap"}
    return known.get(row.who.lower())

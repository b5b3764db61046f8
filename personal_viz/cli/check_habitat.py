"""Verb `check-habitat`: figures of agreement with a real Habitat's answers, beside their targets."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.markup import escape
from rich.table import Table
from rich.text import Text
from tyro.conf import arg

from personal_viz.bench.habitat.agreement import TARGETS, Agreement, Figures, agreement, targets_met

from .options import Json
from .output import say, table_console, table_of

MIN_WIDTH = 110
"""Columns that the table needs; narrower terminals wrap it, but files and pipes do not."""
_LABELS = {
    "geodesic_within_1e-4": "distances within 1e-4 m",
    "reachability": "same reachability",
    "steps_within_1mm": "forwards within 1 mm (no sliding, habitat-sim <= 0.3.3)",
    "snap": "snapped points within 1e-4 m",
    "navigable": "is_navigable",
    "grid_mean_rel_error": "own grid: mean error of distances",
    "grid_reachability": "own grid: same reachability",
    "grid_area_rel_error": "own grid: largest error of the area",
    "depth_median_mm": "depth: median error",
    "depth_within_1mm": "depth: pixels within 1 mm",
    "measures_max_abs_error": "measures: largest error",
}
_NOT_IN_PERCENT = ("depth_median_mm", "measures_max_abs_error")


@dataclass
class CheckHabitat:
    """Compare navigation, pictures and measures with the answers of a real Habitat, stored in a folder."""

    golden: Annotated[Path, arg(help="Folder as docs/simulator.md describes; write one on your own scans.")]
    json: Json = False

    def run(self) -> int:
        found = agreement(self.golden, on_house=lambda name: say(f"comparing {name}"))
        if self.json:
            print(found.model_dump_json(by_alias=True, indent=2))
            return 0
        console = table_console(MIN_WIDTH)
        console.print(_table(found))
        for line in _notes(found):
            console.print(line)
        return 0


def _table(found: Agreement) -> Table:
    met = targets_met(found)
    rows = []
    for key, target in TARGETS.items():
        sign = ">=" if target.at_least else "<="
        colour = {True: "green", False: "red", None: "dim"}[met[key]]
        all_houses, *each = [_cell(figures, key) for figures in (found, *found.houses)]
        rows.append((_LABELS[key], f"{sign} {_shown(key, target.limit)}", Text(all_houses, colour), *each))
    houses = [house.house for house in found.houses]
    return table_of(("", "target", "all", *houses), rows, title=f"Agreement with Habitat on {', '.join(houses)}")


def _notes(found: Agreement) -> list[str]:
    rows, further = found.rows, found.further
    notes = [
        f"Rows: {rows.geodesic:,} distances, {rows.steps:,} forwards ({rows.sensitive:,} more left out as sensitive), "
        f"{rows.snap:,} points, {rows.grid:,} distances on the grid, {rows.depth_pixels:,} pixels, "
        f"{rows.episodes:,} trajectories.",
        "Exact: "
        + ", ".join(
            f"{name} {_percent(value)}"
            for name, value in (
                ("success", further.success_exact),
                ("steps", further.num_steps_exact),
                ("collisions", further.collisions_exact),
                ("inf and nan", further.nonfinite_exact),
            )
        )
        + ".",
        f"With sliding: forwards within 1 mm {_percent(further.slide_steps_within_1mm)}. Pairs off the navmesh, where "
        f"Detour counts heights: mean error of the grid {_percent(further.grid_off_mesh_mean_rel_error)}, same "
        f"reachability {_percent(further.grid_off_mesh_reachability)} ({rows.grid_off_mesh:,} pairs).",
    ]
    if found.missing:
        notes.append(f"Not in the folder, so not compared: {escape(', '.join(found.missing))}.")
    if found.made_with:
        notes.append(f"Answers made with {escape('; '.join(found.made_with))}; compared with {found.compared_with}.")
    return notes


def _cell(figures: Figures, key: str) -> str:
    value = figures.model_dump(by_alias=True)[key]
    return "-" if value is None else _shown(key, value)


def _shown(key: str, value: float) -> str:
    if key not in _NOT_IN_PERCENT:
        return _percent(value)
    return f"{value:.3f} mm" if key == "depth_median_mm" else f"{value:.1e}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2%}"

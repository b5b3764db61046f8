"""The page of `check-scans`: one table of all scans, and the worst cases drawn from above.

`ScanCheck`s -> Markdown and SVG -> one HTML file.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from human_study.report.page import filled, html_page
from sim.homes.kind import scene_labels
from sim.plan_view.storey import storey_map, storeys_of
from sim.plan_view.svg import drawn_svg, free_path
from sim.plan_view.view import PlanView
from sim.walk.navigation_map import NavigationMap

from .measures import SAME_PLACE, MapName, ScanCheck, ScanFigures, WorstCentre, WorstWalk

_FOLDER = Path(__file__).parent
_CASE = _FOLDER / "case.svg.j2"
_PIXELS, _LEAST_PIXELS = 360, 140
"""Longer side of a drawing, and least length of a side."""

Drawings = dict[str, str]
"""SVG by file name."""
HEADS = (
    *("scene", "use", "up", "10^3\ntriangles", "objects", "ids\nfound", "centres\n< 0.5 m", "seen"),
    *("map", "m2", "starts", "within\n25 cm", "view\npoints", "paths", "median\nratio", "within\n1 %", "within\n5 %"),
    *("open\ns", "check\ns", "GB"),
)
TEXT_HEADS = ("use", "up", "map")
"""Heads of columns of text."""


def drawings_of(checked: ScanCheck) -> dict[str, str]:
    """The worst cases of one scan as SVG, by caption."""
    if checked.navigation is None:
        return {}
    found = {_walk_caption(walk): _walk_svg(walk, checked.navigation) for walk in checked.walks}
    return found | {_centre_caption(one): _centre_svg(one, checked.navigation) for one in checked.centres}


def page_of(figures: dict[str, ScanFigures], drawings: dict[str, dict[str, str]]) -> str:
    """The HTML page of all scans.

    Args:
        figures: Of each scene.
        drawings: `drawings_of` each scene, for those that have any.
    """
    pictures: Drawings = {}
    cases: list[tuple[str, list[tuple[str, str]]]] = []
    for name, drawn in drawings.items():
        named = [(caption, f"{name}-{number}.svg") for number, caption in enumerate(drawn)]
        pictures |= {file: drawn[caption] for caption, file in named}
        cases.append((name, named))
    text = filled(
        "report.md.j2",
        folder=_FOLDER,
        heads_of=[head.replace("\n", " ") for head in HEADS],
        lines=table_lines(figures),
        figures=figures,
        cases=cases,
        impossible=sum(one.impossible or 0 for one in figures.values()),
        labels=scene_labels(one.kind for one in figures.values()),
    )
    return html_page(text, pictures, beside_px=_PIXELS)


def table_lines(figures: dict[str, ScanFigures]) -> list[list[str]]:
    """Cells of a line for each map of each scene, the one that is used first, or of one line without a map."""
    lines = []
    for name, one in figures.items():
        kinds = sorted(one.maps, key=lambda kind: kind != one.used)
        costs = [_number(one.load_s), _number(one.check_s), _number(one.peak_mb and one.peak_mb / 1e3)]
        lines.append([name, "no" if one.problem else "yes", *_own_cells(one), *_map_cells(one, kinds[:1]), *costs])
        if kinds[1:]:
            lines.append(["", "", *[""] * len(_own_cells(one)), *_map_cells(one, kinds[1:]), *[""] * len(costs)])
    return lines


def _own_cells(one: ScanFigures) -> list[str]:
    shares = (one.goals_found, one.centres_near, one.goals_seen)
    sizes = [_number(one.triangles and one.triangles / 1e3, 0), _number(one.objects, 0)]
    return [one.up or "-", *sizes, *map(_percent, shares)]


def _map_cells(one: ScanFigures, kinds: Sequence[MapName]) -> list[str]:
    if not kinds:
        return ["-"] * 9
    of_map = one.maps[kinds[0]]
    places = map(_percent, (of_map.starts, of_map.starts_near, of_map.view_points, of_map.paths))
    lengths = [_number(of_map.ratio_median, 3), _percent(of_map.within_1), _percent(of_map.within_5)]
    return [kinds[0], _number(of_map.area_m2, 0), *places, *lengths]


def _number(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{share:.1%}"


def _walk_caption(walk: WorstWalk) -> str:
    ours = "no path" if math.isinf(walk.ours) else f"ours {walk.ours:.2f} m"
    return f"{walk.key}: {ours}, recorded {walk.recorded:.2f} m"


def _centre_caption(one: WorstCentre) -> str:
    return f"{one.name}: {one.apart:.2f} m from its recorded centre (more than {SAME_PLACE} m)"


def _walk_svg(walk: WorstWalk, navigation: NavigationMap) -> str:
    return _case_svg(_walk_caption(walk), walk.path, navigation, is_path=not math.isinf(walk.ours))


def _centre_svg(one: WorstCentre, navigation: NavigationMap) -> str:
    return _case_svg(_centre_caption(one), np.array([one.found, one.recorded]), navigation, is_path=False)


def _case_svg(title: str, line: NDArray[np.float64], navigation: NavigationMap, *, is_path: bool) -> str:
    """The storey of a line's end from above, with the line (K, 3): solid for a path, dashed for two places apart."""
    storey = storey_map(navigation, int(storeys_of(line[-1:, 1], navigation)[0]))
    rows, cols = np.nonzero(storey.free)
    around = storey.grid.xz_from_rc(np.stack([rows, cols], axis=1)) if len(rows) else line[:, [0, 2]]
    view = PlanView.around(np.concatenate([around, line[:, [0, 2]]]), margin=0.5, longest=_PIXELS, least=_LEAST_PIXELS)
    points = view.pixels(line[:, [0, 2]]).tolist()
    return drawn_svg(
        _CASE, title=title, view=view, free=free_path(view, storey.free, storey.grid), points=points, is_path=is_path
    )


def problems_of(figures: dict[str, ScanFigures]) -> Sequence[str]:
    """One line for each scan that cannot be used."""
    return [f"{name}: {one.problem}" for name, one in figures.items() if one.problem]

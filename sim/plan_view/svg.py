"""A storey from above as SVG: the free floor as one path, and Jinja2 templates that share the macros of plan.svg.j2."""

from pathlib import Path

import jinja2
import numpy as np
from numpy.typing import NDArray

from sim.page_style import light_token
from sim.types import GridSpec

from .view import PlanView

_OVERLAP = 0.3
"""Pixels by which a row of cells reaches into the next, so that no gap shows between them."""


def drawn_svg(template: Path, **values: object) -> str:
    """The SVG that a template makes of these values, without empty lines.

    Args:
        template: The file; it can import `plan.svg.j2`, its texts are escaped, and `token(name)` is a value of
            `tokens.css`.
        values: The template's variables.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["token"] = light_token
    environment.filters["px"] = "{:.1f}".format
    drawn = environment.get_template(template.name).render(**values)
    return "\n".join([line for line in drawn.splitlines() if line.strip()]) + "\n"


def free_path(view: PlanView, free: NDArray[np.bool_], grid: GridSpec) -> str:
    """Path data of free cells (rows, cols): a rectangle for each run of cells in a row."""
    edges = np.diff(np.pad(free.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    firsts, lasts = np.argwhere(edges == 1), np.argwhere(edges == -1)
    corners = view.pixels(grid.xz_from_rc(firsts) - grid.cell / 2)
    widths = (lasts - firsts)[:, 1] * (grid.cell * view.scale)
    height = grid.cell * view.scale + _OVERLAP
    return "".join(
        f"M{left:.1f} {top:.1f}h{width:.1f}v{height:.1f}h{-width:.1f}z"
        for (left, top), width in zip(corners.tolist(), widths.tolist(), strict=True)
    )

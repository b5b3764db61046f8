"""From what a browser sends to a click of the session: rays and moves of the mark, on the home and on its map."""

import math

from human_study.trial.commands import Click
from human_study.trial.views import PogView
from sim.tasks.run_files import ClickRay, Vector3

from ..home.home import Home
from ..home.map_view import map_click
from .pog import Nudge

_ABOVE_MAP = 10.0
"""Height over the floor from which a moved mark is looked at on a map (metres)."""
_UNDER_CUT = 0.01
"""A moved mark on the home is looked at from this far under the cut (metres)."""
_WXYZ_DOWN = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""A camera (OpenCV axes) that looks straight down: right = +x, down = +z."""


def click_of(pointed: ClickRay | Nudge, view: PogView, home: Home, *, is_map: bool) -> Click:
    """The click on the shown storey.

    Args:
        pointed: A ray, which was sent with the storey that the browser showed then, or a move of the mark.
        view: What is shown now.
        home: Of the trial.
        is_map: Whether its map is pointed at, not the home.
    """
    ray = pointed if isinstance(pointed, ClickRay) else _straight_down(pointed, view, home, is_map=is_map)
    storey = view.storeys.index(ray.storey_y)
    if is_map:
        return map_click(home.copies.maps[storey], ray)
    return Click(ray, home.pog_scene.hit(storey, ray.origin, ray.direction))


def _straight_down(nudge: Nudge, view: PogView, home: Home, *, is_map: bool) -> ClickRay:
    """The ray from above through the moved mark, or through the middle of a storey that has no mark."""
    floor_y = view.storeys[view.storey]
    cut = home.copies.cuts[view.storey]
    x, z = home.copies.middle(view.storey)
    is_on_storey = view.marker is not None and cut.bottom_y <= view.marker[1] <= cut.top_y
    if view.marker is not None and is_on_storey:
        x, z = view.marker[0] + nudge.x_m, view.marker[2] + nudge.z_m
    origin: Vector3 = (x, floor_y + _ABOVE_MAP if is_map else cut.top_y - _UNDER_CUT, z)
    return ClickRay(
        origin=origin,
        direction=(0.0, -1.0, 0.0),
        camera_position=origin,
        camera_wxyz=_WXYZ_DOWN,
        storey_y=floor_y,
    )

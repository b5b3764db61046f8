"""A storey drawn from above with numbered things, for a model that looks at pictures. North (-z) is up."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim.plan_view.view import PlanView
from sim.tasks.observers import FREE, OCCUPIED

from ..maps.home_map import ObjectInstance, OccupancyGrid

LONGEST = 1024
"""Pixels of the longer side."""
_MARGIN = 0.5
"""Metres around the things."""
_UNKNOWN_COLOUR, _FREE_COLOUR, _WALL_COLOUR = (225, 225, 225), (255, 255, 255), (90, 90, 90)
_COLOURS = ((214, 120, 60), (70, 130, 190), (110, 160, 70), (170, 100, 170), (190, 150, 40), (60, 160, 160))
"""Colours of the things in turn, so that neighbours differ; they mean nothing."""
_INK = (0, 0, 0)
_FONT = 17
_RINGS = 8
"""Places tried for a number that would cover another one: rings around its thing."""
_Box = tuple[float, float, float, float]


def numbered_map(
    things: Sequence[tuple[int, ObjectInstance]], floor: OccupancyGrid | None
) -> tuple[NDArray[np.uint8], PlanView]:
    """The picture (H, W, 3), and the view that says where places are on it.

    Args:
        things: At least one; each with its number, all of one storey.
        floor: What the robot knows of the floor; None = nothing is drawn below the things.
    """
    view = PlanView.around(_shown_xz([item for _, item in things], floor), margin=_MARGIN, longest=LONGEST, least=64)
    picture = Image.fromarray(floor_picture(view, floor))
    draw = ImageDraw.Draw(picture)
    for number, item in things:
        colour = _COLOURS[number % len(_COLOURS)]
        half = max(1.5, 0.03 * view.scale)  # points are about 5 cm apart
        for u, v in view.pixels(item.points[:, [0, 2]]).tolist():
            draw.rectangle((u - half, v - half, u + half, v + half), fill=colour)
    draw_numbers(draw, [(str(number), *_pixel(view, item)) for number, item in things])
    draw_scale(draw, view)
    return np.asarray(picture), view


def _shown_xz(things: Sequence[ObjectInstance], floor: OccupancyGrid | None) -> NDArray[np.float64]:
    """(N, 2) all places that the picture must hold."""
    places = [item.points[:, [0, 2]].astype(np.float64) for item in things]
    if floor is not None and (floor.cells == FREE).any():
        places.append(floor.grid.xz_from_rc(np.argwhere(floor.cells == FREE)))
    return np.concatenate(places)


def floor_picture(view: PlanView, floor: OccupancyGrid | None) -> NDArray[np.uint8]:
    """(H, W, 3) the floor without things."""
    ground = np.full((view.height, view.width, 3), _UNKNOWN_COLOUR, np.uint8)
    if floor is None:
        return ground
    v, u = np.indices(ground.shape[:2]) + 0.5
    xz = np.stack([u, v], axis=-1) / view.scale + np.array(view.low)
    rc = floor.grid.rc_from_xz(xz.reshape(-1, 2))
    is_inside = floor.grid.contains(rc)
    cells = np.zeros(len(rc), np.uint8)
    cells[is_inside] = floor.cells[tuple(rc[is_inside].T)]
    cells = cells.reshape(ground.shape[:2])
    ground[cells == FREE] = _FREE_COLOUR
    ground[cells == OCCUPIED] = _WALL_COLOUR
    return ground


def _pixel(view: PlanView, item: ObjectInstance) -> tuple[float, float]:
    x, _, z = item.centre
    u, v = view.pixels((x, z)).tolist()
    return u, v


def draw_numbers(draw: ImageDraw.ImageDraw, numbers: Sequence[tuple[str, float, float]]) -> None:
    """Writes each number on its thing, or beside it with a line to it where another number stands there."""
    font = ImageFont.load_default(size=_FONT)
    taken: list[_Box] = []
    placed: list[tuple[str, _Box]] = []
    for word, u, v in numbers:
        left, top, right, bottom = draw.textbbox((u, v), word, font=font, anchor="mm")
        box = _free_box((left - 3, top - 3, right + 3, bottom + 3), taken)
        taken.append(box)
        placed.append((word, box))
        middle = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
        draw.line((u, v, *middle), fill=_INK, width=1)
    for word, box in placed:  # numbers cover all lines
        draw.rectangle(box, fill=(255, 255, 210), outline=_INK)
        draw.text(((box[0] + box[2]) / 2, (box[1] + box[3]) / 2), word, font=font, anchor="mm", fill=_INK)


def _free_box(box: _Box, taken: Sequence[_Box]) -> _Box:
    """The box at the nearest tried place where it covers no other; where it was if there is none."""
    width, height = box[2] - box[0] + 1, box[3] - box[1] + 1
    for ring in range(_RINGS):
        for du, dv in ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1)) if ring else ((0, 0),):
            right, down = du * ring * width, dv * ring * height
            moved = (box[0] + right, box[1] + down, box[2] + right, box[3] + down)
            if not any(moved[0] < b[2] and b[0] < moved[2] and moved[1] < b[3] and b[1] < moved[3] for b in taken):
                return moved
    return box


def draw_scale(draw: ImageDraw.ImageDraw, view: PlanView) -> None:
    """A bar of one metre in the lower left corner."""
    low = view.height - 10
    draw.line((10, low, 10 + view.scale, low), fill=_INK, width=3)
    draw.text((14 + view.scale, low), "1 m", font=ImageFont.load_default(size=_FONT), anchor="lm", fill=_INK)

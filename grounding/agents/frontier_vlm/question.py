"""The question to a chat model about frontiers and things, and its answer.

`Choices`, pictures -> words, a numbered map, crops -> the model -> JSON -> one of the choices. The question holds the
task's description and query and what the robot has seen: no goal, caption or phrase of the dataset.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from pydantic import BaseModel, ConfigDict, model_validator

from grounding.chat.answers import read_answer
from grounding.chat.protocol import NoAnswer, Part
from grounding.maps.home_map import OccupancyGrid
from grounding.methods.map_picture import draw_numbers, draw_scale, floor_picture
from sim.frames import forward_from_yaw
from sim.plan_view.view import PlanView
from sim.tasks.observers import FREE

from ..frontiers import Frontier
from .choices import Choices
from .things import Thing

PROMPT = """You guide a robot that looks for one object in a home where several people live. The description says who
owns what; the query names the object. The robot can look into unexplored space at a frontier, or walk to a thing that
its detector found (a snapshot). A snapshot may show another object of the same kind, or nothing of the kind.
On the map, seen from above, white is free floor, dark grey are walls and obstacles, light grey is unknown. The red
arrow is the robot, blue areas F1, F2 ... are frontiers, orange circles S1, S2 ... are snapshots.
Choose a snapshot only if it shows the object of the query: the robot then walks there and stops, and the search is
over. Otherwise choose the frontier behind which the object is most probably found with a short way.
Answer with one JSON object and nothing else: {"frontier": number} or {"snapshot": number}."""
_LONGEST = 512
"""Pixels of the map's longer side."""
_MARGIN = 0.5
"""Metres around what the map shows."""
_FRONTIER_COLOUR, _THING_COLOUR, _ROBOT_COLOUR = (70, 130, 220), (230, 130, 30), (210, 30, 30)
_LEAST_CROP = 64
"""Smaller pictures are enlarged: some servers refuse pictures of a few pixels."""


class Chosen(BaseModel):
    """The answer: one of the two."""

    model_config = ConfigDict(frozen=True)
    frontier: int | None = None
    snapshot: int | None = None

    @model_validator(mode="after")
    def _one(self) -> "Chosen":
        if (self.frontier is None) == (self.snapshot is None):
            raise ValueError("expected either frontier or snapshot")
        return self


def question(choices: Choices, crops: Sequence[NDArray[np.uint8] | None]) -> list[Part]:
    """The task, the map, then each frontier and thing with its picture.

    Args:
        choices: Numbered from 1 in their order.
        crops: The view towards each frontier; None = no picture shows it.
    """
    parts: list[Part] = [
        f"Description: {choices.task.description}\n\nQuery: {choices.task.queries[0]}\n\nMap of what is known so far:",
        map_picture(choices),
    ]
    for number, (frontier, crop) in enumerate(zip(choices.frontiers, crops, strict=True), start=1):
        words = f"Frontier F{number}, {math.dist(choices.robot[:2], choices.place_of(frontier)):.1f} m away"
        parts += [f"{words}; no picture shows it."] if crop is None else [f"{words}:", _enlarged(crop)]
    for number, thing in enumerate(choices.things, start=1):
        away = math.dist(choices.robot[:2], thing.xz)
        seen = "1 picture" if thing.num_views == 1 else f"{thing.num_views} pictures"
        parts += [
            f"Snapshot S{number}, {away:.1f} m away, detected in {seen}, score {thing.score:.2f}:",
            _enlarged(thing.crop),
        ]
    return parts


def choice_of(answer: str, choices: Choices) -> Frontier | Thing:
    """The choice that the model's words name.

    Raises:
        NoAnswer: They hold no such JSON, or a number that no choice has.
    """
    chosen = read_answer(answer, Chosen)
    kind, number, among = (
        ("frontier", chosen.frontier, choices.frontiers)
        if chosen.frontier is not None
        else ("snapshot", chosen.snapshot, choices.things)
    )
    assert number is not None
    if not 1 <= number <= len(among):
        raise NoAnswer(f"the answer names {kind} {number}, and there are {len(among)}")
    return among[number - 1]


def map_picture(choices: Choices) -> NDArray[np.uint8]:
    """(H, W, 3) the floor as the robot knows it with the numbers of all choices; -z is up."""
    floor = OccupancyGrid(choices.ground.cells, choices.ground.grid)
    x, z, yaw = choices.robot
    places = [np.array([[x, z]]), floor.grid.xz_from_rc(np.argwhere(floor.cells == FREE)).reshape(-1, 2)]
    places += [np.array([thing.xz]) for thing in choices.things]
    view = PlanView.around(np.concatenate(places), margin=_MARGIN, longest=_LONGEST, least=_LEAST_CROP)
    picture = Image.fromarray(floor_picture(view, floor))
    draw = ImageDraw.Draw(picture)
    half = max(1.5, view.scale * floor.grid.cell / 2)
    for frontier in choices.frontiers:
        for u, v in view.pixels(floor.grid.xz_from_rc(frontier.cells_rc).reshape(-1, 2)).tolist():
            draw.rectangle((u - half, v - half, u + half, v + half), fill=_FRONTIER_COLOUR)
    for thing in choices.things:
        u, v = view.pixels(thing.xz).tolist()
        draw.ellipse((u - 6, v - 6, u + 6, v + 6), fill=_THING_COLOUR)
    labels = [(f"F{number}", choices.place_of(each)) for number, each in enumerate(choices.frontiers, start=1)]
    labels += [(f"S{number}", each.xz) for number, each in enumerate(choices.things, start=1)]
    draw_numbers(draw, [(label, *_pixel(view, xz)) for label, xz in labels])
    _draw_robot(draw, view, (x, z), yaw)
    draw_scale(draw, view)
    return np.asarray(picture)


def _draw_robot(draw: ImageDraw.ImageDraw, view: PlanView, xz: tuple[float, float], yaw: float) -> None:
    """A triangle of about 14 pixels that points where the robot looks."""
    right, down = forward_from_yaw(yaw)[[0, 2]].tolist()
    u, v = _pixel(view, xz)
    tip, left, other = (
        (u + 12 * right, v + 12 * down),
        (u - 6 * right + 7 * down, v - 6 * down - 7 * right),
        (u - 6 * right - 7 * down, v - 6 * down + 7 * right),
    )
    draw.polygon([tip, left, other], fill=_ROBOT_COLOUR)


def _pixel(view: PlanView, xz: tuple[float, float]) -> tuple[float, float]:
    u, v = view.pixels(xz).tolist()
    return u, v


def _enlarged(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture, or a larger one if a side is shorter than _LEAST_CROP."""
    height, width = picture.shape[:2]
    times = math.ceil(_LEAST_CROP / min(height, width))
    return picture if times == 1 else picture.repeat(times, axis=0).repeat(times, axis=1)

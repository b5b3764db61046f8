"""A bot's camera and mouse over a home or its map: the messages that viser's client sends for them.

The camera goes over a place and looks straight down; a click sends the ray from there through the place.
"""

import math

import numpy as np

from sim.tasks.run_files import Vector3

from ..study_app.first_camera import CAMERA
from .wire import BotConnection

ABOVE = 8.0
"""Height of the camera over the place (metres)."""
ASIDE = 0.05
"""The place is so far from the picture's middle at most, so that no two clicks have the same ray (metres)."""
_WXYZ_DOWN = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""A camera (OpenCV axes) that looks straight down: right = +x, down = +z."""
Ray = tuple[Vector3, Vector3]
"""Origin in world metres, direction of length 1."""


def ray_to(point: Vector3, rng: np.random.Generator) -> Ray:
    """The ray of a click at a place, seen from above."""
    x, y, z = point
    dx, dz = (float(value) for value in rng.uniform(-ASIDE, ASIDE, 2))
    length = math.hypot(dx, ABOVE, dz)
    return (x + dx, y + ABOVE, z + dz), (-dx / length, -ABOVE / length, -dz / length)


async def look_down(connection: BotConnection, eye: Vector3) -> None:
    """Moves the camera there."""
    x, y, z = eye
    looks = {"position": eye, "look_at": (x, y - 1, z), "wxyz": _WXYZ_DOWN, "up_direction": (0.0, 0.0, -1.0)}
    await connection.send(CAMERA | looks)


async def click(connection: BotConnection, ray: Ray) -> None:
    """Clicks into the scene."""
    origin, direction = ray
    await connection.send(
        {
            "type": "ScenePointerMessage",
            "event_type": "click",
            "ray_origin": origin,
            "ray_direction": direction,
            "screen_pos": [screen_pos(direction)],
            "modifier": None,
        }
    )


def screen_pos(direction: Vector3) -> tuple[float, float]:
    """Where on the screen the ray of a camera that looks straight down goes through: right and down, from 0 to 1."""
    half = math.tan(CAMERA["fov"] / 2)
    aspect = CAMERA["image_width"] / CAMERA["image_height"]
    x, y, z = direction
    return 0.5 - x / y / (2 * half * aspect), 0.5 - z / y / (2 * half)

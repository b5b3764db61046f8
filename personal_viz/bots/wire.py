"""A bot's connection with viser's page: it sends over the websocket what viser's client would send.

Its camera goes over a place and looks straight down; a click sends the ray from there through the place.
"""

import json
import math
from urllib.parse import parse_qs, urlsplit

import msgspec
import numpy as np
import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from human_study.texts.catalogue import Catalogue
from sim.errors import StudyError
from sim.tasks.run_files import Vector3

from ..study_app.gateway.filter import CAMERA
from .forms import ENTER_S, Session
from .page import BotPage
from .records import Ray

ABOVE = 8.0
"""Height of the camera over the place (metres)."""
ASIDE = 0.05
"""Largest distance of the place from the picture's middle, so that no two clicks have the same ray (metres)."""
_WXYZ_DOWN = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""A camera (OpenCV axes) that looks straight down: right = +x, down = +z."""


class BotConnection:
    """One open connection and the page that came over it."""

    def __init__(self, socket: ClientConnection, words: Catalogue) -> None:
        """Nothing received yet."""
        self._socket = socket
        self.page = BotPage(words)
        self.is_open = True

    async def receive(self) -> bool:
        """Waits for viser's next message; False if the connection has ended."""
        try:
            data = await self._socket.recv()
        except ConnectionClosed:
            self.is_open = False
            return False
        if isinstance(data, bytes):
            self.page.apply(data)
        return True

    async def trigger(self, uuid: str) -> None:
        """Presses the key of a command."""
        await self.send({"type": "CommandTriggerMessage", "uuid": uuid})

    async def set_value(self, uuid: str, value: object) -> None:
        """Presses a button (True), or fills a box."""
        await self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    async def tell(self, said: dict[str, object]) -> bool:
        """Sends one message of the page's script; False while the page cannot take it."""
        box, seat = self.page.letter_box, self.page.seat
        if box is None or seat is None:
            return False
        await self.set_value(box.uuid, json.dumps({"seat": seat, "said": [said]}))
        return True

    async def look_down(self, eye: Vector3) -> None:
        """Moves the camera there."""
        x, y, z = eye
        looks = {"position": eye, "look_at": (x, y - 1, z), "wxyz": _WXYZ_DOWN, "up_direction": (0.0, 0.0, -1.0)}
        await self.send(CAMERA | looks)

    async def click(self, ray: Ray) -> None:
        """Clicks into the scene."""
        origin, direction = ray
        await self.send(
            {
                "type": "ScenePointerMessage",
                "event_type": "click",
                "ray_origin": origin,
                "ray_direction": direction,
                "screen_pos": [screen_pos(direction)],
                "modifier": None,
            }
        )

    async def send(self, message: dict[str, object]) -> None:
        """Sends a message as a browser does; does nothing if the connection has ended."""
        try:
            await self._socket.send(msgspec.msgpack.encode(message))
        except ConnectionClosed:
            self.is_open = False

    async def close(self) -> None:
        """Closes the connection as a closed tab does."""
        self.is_open = False
        await self._socket.close()

    def abort(self) -> None:
        """Drops the connection as a lost network does, without a closing message."""
        self.is_open = False
        self._socket.transport.abort()


def ray_to(point: Vector3, rng: np.random.Generator) -> Ray:
    """The ray of a click at a place, from above."""
    x, y, z = point
    dx, dz = (float(value) for value in rng.uniform(-ASIDE, ASIDE, 2))
    length = math.hypot(dx, ABOVE, dz)
    return (x + dx, y + ABOVE, z + dz), (-dx / length, -ABOVE / length, -dz / length)


def screen_pos(direction: Vector3) -> tuple[float, float]:
    """Screen position (right, down; 0 to 1) of a ray of a camera that looks straight down."""
    half = math.tan(CAMERA["fov"] / 2)
    aspect = CAMERA["image_width"] / CAMERA["image_height"]
    x, y, z = direction
    return 0.5 - x / y / (2 * half * aspect), 0.5 - z / y / (2 * half)


async def connect_viser(session: Session, words: Catalogue) -> BotConnection:
    """Opens viser's page of a session of a study in this language.

    Raises:
        StudyError: The websocket does not open.
    """
    (address,) = parse_qs(urlsplit(session.view).query)["websocket"]
    try:
        socket = await connect(
            address,
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            additional_headers={"Cookie": session.cookie, "Origin": session.origin},
            max_size=None,
            compression=None,
            open_timeout=ENTER_S,
            ping_interval=None,
        )
    except (OSError, WebSocketException) as error:
        raise StudyError(
            f"{session.origin}: the websocket did not open ({error or type(error).__name__}); expected viser's page. "
            "Check that the study is being served."
        ) from None
    connection = BotConnection(socket, words)
    await connection.send(CAMERA)
    return connection

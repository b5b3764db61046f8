"""Times the pictures of a home that the server draws: one participant orbits a scan of many triangles.

Through gateway and worker, without a browser, whose own drawing would need the same cores.
"""

import asyncio
import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import viser.transforms
from pydantic import BaseModel, ConfigDict

from human_study.design.study import StudyPog, load_study
from human_study.texts.catalogue import ENGLISH, catalogue_of
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.tasks.run_files import Vector3

from ...bots.forms import answer_pages, open_session, right_answers
from ...bots.server import Server
from ...bots.site import HOME, Site, make_pilot
from ...bots.wire import BotConnection, connect_viser
from ...study_app.gateway.filter import CAMERA, CAMERA_RATE
from ..harness import Progress, Values
from ..sim.copies import browser_figures
from .big_home import write_scan

_SIDES = {"image_width": 640, "image_height": 480}
_PATIENCE_S = 120.0
_RESTING_S = 0.5
"""After so long without a move the last picture of a camera has come."""


class PogViewSettings(BaseModel):
    """Size of the home, and how long it is looked at."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    faces: int = 1_000_000
    """Number of triangles of the home on disk."""
    seconds: float = 10.0
    """Seconds of orbiting."""
    moves: int = 40
    """Single moves of which each picture is timed."""
    clicks: int = 20_000
    seed: int = 29

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return (
            f"one participant orbits a home of {self.faces} triangles at 640 x 480, drawn by the server, with "
            f"{CAMERA_RATE[0]:g} camera messages a second."
        )


def measure_pog_view(settings: PogViewSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Serves a study whose homes the server draws, and looks at one.

    Returns:
        `faces` of the scan; `fps`, pictures a second while the camera orbits; `p50_ms` and `p95_ms` from a camera's
        message to the picture; `click_mm_p99`, distance between a ray's hit on the home, which is stored, and on the
        copy that a browser would draw, for the same ray.

    Raises:
        SceneError: The home cannot be made.
        StudyError: The study cannot be served.
    """
    progress(f"making a home of {settings.faces} triangles")
    data, scans = folder / "dataset", folder / "scans"
    shutil.copytree(dataset, data)
    scans.mkdir()
    shutil.copy(data / "scenes" / f"{HOME}.stage_config.json", scans)
    num_faces = write_scan(scans / f"{HOME}.glb", data, HOME, num_faces=settings.faces, seed=settings.seed)
    make_pilot(
        folder / "study",
        data,
        participants=1,
        scenes_dir=scans,
        seed=settings.seed,
        task=("pog",),
        pog=StudyPog(conditions=("map_open",)),
        pog_view="server",
    )
    scene = open_scene(PersonalDataset(data), HOME, scenes_dir=scans)
    low, high = scene.mesh.vertices.min(axis=0), scene.mesh.vertices.max(axis=0)
    x, _, z = ((low + high) / 2).tolist()
    floor_y = scene.navigation.storey_heights[0]
    with Server(folder / "study", data, scenes_dir=scans) as server:
        progress("orbiting")
        fps, delays = asyncio.run(_looked(server.start(), settings, (x, floor_y, z)))
    progress("clicking")
    clicked = browser_figures(scene, floor_y, num_clicks=settings.clicks, seed=settings.seed)
    return {
        "faces": num_faces,
        "fps": fps,
        "p50_ms": float(np.quantile(delays, 0.5)),
        "p95_ms": float(np.quantile(delays, 0.95)),
        "click_mm_p99": clicked["click_p99_mm"],
    }


async def _looked(site: Site, settings: PogViewSettings, target: Vector3) -> tuple[float, list[float]]:
    """Pictures a second while orbiting, and milliseconds to the picture of each single move."""
    session = open_session(site.everybody[0].link)
    answer_pages(session, right_answers(load_study(site.folder), "pog"))
    connection = await connect_viser(session, catalogue_of(ENGLISH))
    page = connection.page
    await _until(connection, lambda: page.is_pointing and page.num_surfaces > 0)
    began_s, before = time.perf_counter(), page.num_surfaces
    turning = asyncio.create_task(_orbit(connection, target, settings.seconds))
    await _until(connection, turning.done)
    fps = (page.num_surfaces - before) / (time.perf_counter() - began_s)
    delays = []
    for move in range(settings.moves):
        await _rest(connection)
        sent_s, shown = time.perf_counter(), page.num_surfaces
        await connection.send(_camera(target, 0.7 * move))
        await _until(connection, lambda shown=shown: page.num_surfaces > shown)
        delays.append((time.perf_counter() - sent_s) * 1e3)
    await connection.close()
    return fps, delays


async def _orbit(connection: BotConnection, target: Vector3, seconds: float) -> None:
    """Moves the camera around the target, as often as the gateway lets through."""
    began_s, number = time.perf_counter(), 0
    while time.perf_counter() - began_s < seconds:
        await connection.send(_camera(target, 0.05 * number))
        number += 1
        await asyncio.sleep(max(0.0, began_s + number / CAMERA_RATE[0] - time.perf_counter()))


async def _until(connection: BotConnection, wanted: Callable[[], bool]) -> None:
    """Receives until a condition holds."""
    async with asyncio.timeout(_PATIENCE_S):
        while not wanted():
            await _received(connection, 0.05)


async def _rest(connection: BotConnection) -> None:
    """Receives until nothing comes any more."""
    while await _received(connection, _RESTING_S):
        pass


async def _received(connection: BotConnection, within_s: float) -> bool:
    try:
        async with asyncio.timeout(within_s):
            return await connection.receive()
    except TimeoutError:
        return False


def _camera(target: Vector3, angle: float) -> dict[str, object]:
    """The message of a camera that looks down at a place from 8 m aside and 9 m above; `angle` in radians."""
    eye = np.add(target, (8 * math.cos(angle), 9.0, 8 * math.sin(angle)))
    ahead = np.array(target) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    wxyz = viser.transforms.SO3.from_matrix(R).wxyz
    return CAMERA | _SIDES | {"position": eye.tolist(), "look_at": list(target), "wxyz": wxyz.tolist()}

"""The map of a home that `ask` names: explored and mapped once, as `ground --map explore` does, and kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grounding.agents.explored_storeys import storey_explorations
from grounding.encoders.by_name import encoder_slug, sees
from grounding.encoders.protocol import ModelOptions
from grounding.evaluation.home_maps import VIEWS_EVERY, MapFolders, map_home, require_perceived
from grounding.evaluation.known_home import KnownHome
from grounding.evaluation.settings import GroundSettings
from grounding.maps.files import read_map_header
from sim.frames import T_world_camera
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene
from sim.types import Camera, Frame


@dataclass(frozen=True, slots=True)
class WalkedView:
    """A view of an exploration, rendered when it is needed; a `PosedView`."""

    scene: Scene
    T_map_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the world, which is the map's frame."""
    camera: Camera

    def load(self) -> Frame:
        """The rendered picture."""
        return raycaster_of(self.scene).render(self.T_map_camera, self.camera)


@dataclass(frozen=True, slots=True)
class AskedHome:
    """A home with its map."""

    scene: Scene
    file: Path
    """The map file."""
    views: Sequence[WalkedView]


def asked_home(
    home: KnownHome, settings: GroundSettings, *, folder: Path, model: ModelOptions, say_so: Callable[[str], None]
) -> AskedHome:
    """A home and its map.

    Args:
        home: The home, with what oracle perception knows of it.
        settings: Say how the home is mapped.
        folder: Keeps explorations, and a folder of maps per encoder, layout and objects.
        model: Of a real encoder.
        say_so: Gets a line before a map is made.

    Raises:
        SceneError: The home cannot be explored, or oracle perception knows no object of it.
        RunFileError: A file cannot be read or written.
        AgentError: The encoder is unknown or cannot be loaded.
    """
    require_perceived(home, settings)
    scene = home.scene
    known = "" if sees(settings.map_encoder) else f"-{home.objects_digest}"
    maps = folder / f"{settings.layout}-{encoder_slug(settings.map_encoder)}{known}"
    folders = MapFolders(maps, folder / "explorations")
    file = folders.map_file(scene.name)
    if not file.exists() or read_map_header(file).source.digest != scene.digest:
        say_so(f"exploring and mapping {scene.name}; the map is kept in {folders.maps}")
        map_home(home, settings, folders, model=model, say=lambda line: None)
    walks = storey_explorations(scene, home.storeys, folder=folders.explorations, seed=settings.seed)
    camera = Camera()
    poses = [pose for walk in walks for pose in walk.poses[::VIEWS_EVERY]]
    return AskedHome(scene, file, [WalkedView(scene, T_world_camera(pose, camera), camera) for pose in poses])

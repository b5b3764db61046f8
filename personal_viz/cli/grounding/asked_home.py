"""The map of a home that `ask` names: explored and mapped once, as `ground --map explore` does, and kept."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grounding.agents.explored_storeys import storey_explorations
from grounding.encoders.by_name import encoder_slug
from grounding.encoders.protocol import ModelOptions
from grounding.evaluation.home_maps import VIEWS_EVERY, MapFolders, make_home_map
from grounding.evaluation.settings import GroundSettings
from grounding.maps.files import read_map_header
from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene
from sim.types import Camera, Frame

from ..output import say


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
    dataset: PersonalDataset,
    name: str,
    settings: GroundSettings,
    *,
    folder: Path,
    scenes_dir: Path | None,
    model: ModelOptions,
) -> AskedHome:
    """The home of this name and its map.

    Args:
        settings: Say how the home is mapped.
        folder: Keeps explorations, and a folder of maps per encoder and layout.

    Raises:
        DatasetError: The scene is unknown.
        SceneError: The home cannot be opened.
        RunFileError: A file cannot be read or written.
        AgentError: The encoder is unknown or cannot be loaded.
    """
    dataset.require_scene(name)
    scene = open_scene(dataset, name, scenes_dir=scenes_dir)
    maps = folder / f"{settings.layout}-{encoder_slug(settings.map_encoder)}"
    folders = MapFolders(maps, folder / "explorations", scenes_dir)
    file = folders.map_file(name)
    if not file.exists() or read_map_header(file).source.digest != scene.digest:
        say(f"exploring and mapping {name}; the map is kept in {folders.maps}")
        make_home_map(dataset, name, settings, folders, model=model, say=lambda line: None)
    walks = storey_explorations(dataset, scene, folder=folders.explorations, seed=settings.seed)
    camera = Camera()
    poses = [pose for walk in walks for pose in walk.poses[::VIEWS_EVERY]]
    return AskedHome(scene, file, [WalkedView(scene, T_world_camera(pose, camera), camera) for pose in poses])

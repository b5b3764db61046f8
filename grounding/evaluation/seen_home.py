"""What a robot knows of an explored home beside its map: the floors, and key frames of its walks.

Explorations and map file (home_maps.py) -> floors and pictures for the grounders that show them to a model.
"""

from collections.abc import Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING

from sim.episodes.dataset import PersonalDataset
from sim.types import Camera, Frame

from ..agents.key_frames import key_views
from ..maps.files import load_memory
from ..maps.home_map import HomeMemory, Memory, OccupancyGrid
from ..methods.chat_grounders import MOST_FRAMES
from .home_maps import VIEWS_EVERY, MapFolders
from .settings import GroundSettings

if TYPE_CHECKING:
    from sim.mesh import Scene

    from ..agents.exploration import Exploration

_SMALL = Camera(width=160, height=120)
"""The camera whose views are counted; it shows the same as the robot's."""


class SeenHome:
    """The home of one scene; it was explored and mapped before. Read when it is first needed."""

    def __init__(self, dataset: PersonalDataset, scene: str, settings: GroundSettings, folders: MapFolders) -> None:
        """Reads nothing yet."""
        self._dataset, self._scene, self._settings, self._folders = dataset, scene, settings, folders
        self._frames_at = cache(self._rendered)

    def floors(self, memory: Memory) -> Sequence[tuple[float, OccupancyGrid]]:
        """Height and floor of the storeys of a memory, lowest first."""
        storeys = self._home.storeys if self._settings.all_storeys else (self._home.storey_near(memory.floor_y),)
        return [(storey.floor_y, storey.occupancy) for storey in storeys]

    def key_frames(self, memory: Memory) -> Sequence[Frame]:
        """The views that show most of the memory's storeys, in the order of the walks; the same for the same storeys.

        Raises:
            SceneError: The home cannot be opened.
            RunFileError: An exploration is damaged.
        """
        return self._frames_at(None if self._settings.all_storeys else memory.floor_y)

    @cached_property
    def _home(self) -> HomeMemory:
        return load_memory(self._folders.map_file(self._scene))

    @cached_property
    def _walks(self) -> tuple["Scene", list["Exploration"]]:
        """The opened home, and its explorations."""
        from sim.homes.open_home import open_scene

        from ..agents.explored_storeys import storey_explorations, storeys_of_starts

        scene = open_scene(
            self._dataset, self._scene, scenes_dir=self._folders.scenes_dir, clutter=self._settings.home_clutter
        )
        storeys = storeys_of_starts(self._dataset, scene)
        walks = storey_explorations(scene, storeys, folder=self._folders.explorations, seed=self._settings.seed)
        return scene, walks

    def _rendered(self, floor_y: float | None) -> list[Frame]:
        """The key frames of the walk on the storey at this height, or of all walks."""
        from sim.homes.renderers import raycaster_of

        from ..agents.explore import frames_of

        scene, walks = self._walks
        if floor_y is not None:
            walks = [min(walks, key=lambda walk: abs(walk.storey_y - floor_y))]
        small = [view for walk in walks for view in frames_of(scene, walk, camera=_SMALL, every=VIEWS_EVERY)]
        raycaster = raycaster_of(scene)
        return [raycaster.render(small[index].T_world_camera, Camera()) for index in key_views(small, most=MOST_FRAMES)]

"""All that every browser of one `personal-viz browse` shares: episodes, runs, texts of scenes, open homes.

Homes are opened one after the other in a thread of their own; the last few are kept.
"""

import threading
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from personal_viz.study_app.home.scene_view import StoreyCopies
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene, SceneObject
from sim.render.renderer import Renderer
from sim.tasks.run_files import read_run
from sim.types import Camera, ClutterLevel, Pose
from sim.walk.storeys import storey_of

from .catalogue import Catalogue
from .object_links import SceneTexts
from .shown import RunIndex

KEPT = 4
"""Homes that stay in memory; a scan takes some hundred megabytes."""


@dataclass(frozen=True)
class OpenHome:
    """A home that is ready to be shown."""

    scene: Scene
    copies: StoreyCopies
    renderer: Renderer
    _rendering: threading.Lock = field(default_factory=threading.Lock)

    @property
    def objects(self) -> dict[str, SceneObject]:
        """Objects by name; none where a scan has no semantics."""
        return {item.name: item for item in self.scene.objects}

    def storey(self, floor_y: float) -> int:
        """Index of the storey on which something at this height stands."""
        return storey_of(floor_y, [(height, height) for height in self.copies.storeys])

    def picture(self, pose: Pose, camera: Camera):
        """(H, W, 3) colours that a robot sees there; one picture at a time."""
        with self._rendering:
            return self.renderer.render(T_world_camera(pose, camera), camera).rgb


class Homes:
    """Opens homes on demand and keeps the last ones that were asked for."""

    def __init__(self, open_home: Callable[[str], OpenHome], *, kept: int = KEPT) -> None:
        """Opens nothing yet.

        Args:
            open_home: Opens a scene by its name; called in our thread, it may take long or raise.
            kept: How many stay.
        """
        self._open, self._kept = open_home, kept
        self._lock = threading.Lock()
        self._futures: OrderedDict[str, Future[OpenHome]] = OrderedDict()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="homes")

    def ask(self, scene: str) -> Future[OpenHome]:
        """The home, soon; a failed one is tried again when it is asked for again."""
        with self._lock:
            future = self._futures.pop(scene, None)
            if future is None or future.cancelled() or (future.done() and future.exception() is not None):
                future = self._pool.submit(self._open, scene)
            self._futures[scene] = future
            while len(self._futures) > self._kept:
                _, oldest = self._futures.popitem(last=False)
                oldest.cancel()  # nobody waits for it any more; an open one is only forgotten
            return future

    def close(self) -> None:
        """Opens no more; what is under way ends with the program."""
        self._pool.shutdown(wait=False, cancel_futures=True)


@dataclass(frozen=True)
class Library:
    """What is looked through; only read."""

    catalogue: Catalogue
    runs: RunIndex
    texts: dict[str, SceneTexts]
    """By scene."""
    homes: Homes


def open_library(
    dataset: Path,
    *,
    runs: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    scenes: tuple[str, ...] = (),
    clutter: ClutterLevel = 0,
) -> Library:
    """Reads all episodes and runs; homes are opened when somebody looks at them.

    Args:
        dataset: Folder of the episodes.
        runs: Run folders to show beside the episodes.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        scenes: Which scenes are listed; none named = all.
        clutter: Level for homes without a scan.

    Raises:
        DatasetError: An episode file is damaged, a scene is unknown, or there is no episode.
        RunFileError: A run folder is damaged.
    """
    found = PersonalDataset(dataset)
    index = RunIndex([read_run(folder) for folder in runs])
    episodes = tuple(found.episodes(scenes=scenes or None))
    if not episodes:
        raise DatasetError(f"{dataset}: found files without episodes; expected at least one. Give another --dataset.")
    by_scene: dict[str, list[Episode]] = defaultdict(list)
    for episode in episodes:
        by_scene[episode.key.scene].append(episode)
    texts = {scene: SceneTexts.from_episodes(found.goals(scene), there) for scene, there in by_scene.items()}

    def open_home(name: str) -> OpenHome:
        scene = open_scene(found, name, scenes_dir=scenes_dir, clutter=clutter)
        return OpenHome(scene, StoreyCopies(scene), renderer_of(scene))

    catalogue = Catalogue(episodes, num_runs=[index.count(episode.key) for episode in episodes])
    return Library(catalogue, index, texts, Homes(open_home))

"""The homes that the browser shows: opened one after the other in a thread of their own, the last few kept."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

from personal_viz.study_app.home.scene_view import StoreyCopies
from sim.frames import T_world_camera
from sim.mesh import Scene, SceneObject
from sim.render.renderer import Renderer
from sim.types import Camera, Pose
from sim.walk.storeys import storey_of

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

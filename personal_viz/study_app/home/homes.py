"""The homes that a worker holds in memory: opened when a trial needs them, kept for later trials, closed for others.

Opening a scan takes seconds, so the next trial's home is opened on a thread of its own while the participant still
reads or walks. Nothing here runs on viser's event loop.
"""

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from human_study.design.study import StudyConfig
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.tasks.pan import PanEnv
from sim.tasks.pog import PogScene
from sim.types import EpisodeKey

from ..watch import Watches
from .frames import Frames
from .scene_view import StoreyCopies

KEPT_HOMES = 3
"""Number of unused homes that stay open; a scan with its browser copies takes some hundred megabytes."""


@dataclass(frozen=True, slots=True)
class Home:
    """The parts of an open home that all its participants share."""

    scene: Scene
    renderer: Frames
    pog_scene: PogScene
    copies: StoreyCopies
    episodes: dict[EpisodeKey, Episode]
    storeys: list[tuple[float, float]]
    """(lowest, highest) floor of each storey, from the episodes."""
    watches: Watches
    """Observers of the trials, for a researcher who watches."""

    def close(self) -> None:
        """Ends the observers; called when nobody is in the home any more."""
        self.watches.close()


def pan_env(episode: Episode, scene: Scene, renderer: Renderer, config: StudyConfig) -> PanEnv:
    """The environment in which a PAN participant walks."""
    camera, steps = config.robot_camera, config.steps
    return PanEnv(episode.start, scene.navigation, renderer=renderer, camera=camera, max_steps=steps)


class Closeable(Protocol):
    """A thing that a library holds."""

    def close(self) -> None:
        """Frees the thing; called once, when nobody uses it any more."""
        ...


HomeT = TypeVar("HomeT", bound=Closeable)


@dataclass(slots=True)
class _Entry(Generic[HomeT]):
    """A home that is wanted, being opened, or open."""

    home: Future[HomeT] = field(default_factory=Future)
    is_begun: bool = False
    """Whether a thread opens it or has opened it."""
    num_users: int = 0

    @property
    def is_open(self) -> bool:
        return self.home.done() and self.home.exception() is None


class HomeLibrary(Generic[HomeT]):
    """Opens each home once for all who use it; thread safe."""

    def __init__(self, open_home: Callable[[str], HomeT], *, kept: int = KEPT_HOMES) -> None:
        """Opens nothing yet.

        Args:
            open_home: Opens the home of a scene; called in the thread that needs the home first, or in the warming one.
            kept: Number of unused homes that stay open; the ones unused for longest are closed first.
        """
        assert kept >= 0, kept
        self._open_home, self._kept = open_home, kept
        self._entries: OrderedDict[str, _Entry[HomeT]] = OrderedDict()
        self._lock = threading.Lock()
        self._warmer = ThreadPoolExecutor(1, thread_name_prefix="warm-home")
        self._is_closed = False

    @contextlib.contextmanager
    def use(self, scene: str) -> Iterator[HomeT]:
        """The home of a scene for a block, in which it is not closed; waits while it is being opened.

        Raises:
            PersonalVizError: The home cannot be opened. Asking again tries again.
        """
        with self._lock:
            entry = self._entries.setdefault(scene, _Entry())
            entry.num_users += 1
        try:
            self._open_once(scene, entry)
            yield entry.home.result()
        finally:
            with self._lock:
                entry.num_users -= 1
                if self._entries.get(scene) is entry:
                    self._entries.move_to_end(scene)
            self._close_unused()

    def warm(self, scene: str) -> None:
        """Opens a home in the background; returns at once. A failure is raised when the home is used."""
        with self._lock:
            if scene in self._entries or self._is_closed:
                return
            entry = self._entries.setdefault(scene, _Entry())
            self._warmer.submit(self._warm, scene, entry)

    def open_scenes(self) -> tuple[str, ...]:
        """Scenes that are open now, the one unused for longest first."""
        with self._lock:
            return tuple(scene for scene, entry in self._entries.items() if entry.is_open)

    def close(self) -> None:
        """Closes every unused home at once and every other home when it is left; nothing is warmed any more."""
        with self._lock:
            self._is_closed = True
            self._kept = 0
        self._warmer.shutdown(wait=True, cancel_futures=True)
        self._close_unused()

    def _warm(self, scene: str, entry: _Entry[HomeT]) -> None:
        if not self._is_closed:
            self._open_once(scene, entry)
            self._close_unused(but=scene)

    def _open_once(self, scene: str, entry: _Entry[HomeT]) -> None:
        """Opens the home unless another thread does; a failure is raised for all who wait, and then forgotten."""
        with self._lock:
            if entry.is_begun:
                return
            entry.is_begun = True
        try:
            entry.home.set_result(self._open_home(scene))
        except BaseException as error:  # raised where the home is used
            with self._lock:
                if self._entries.get(scene) is entry:
                    del self._entries[scene]
            entry.home.set_exception(error)

    def _close_unused(self, *, but: str | None = None) -> None:
        """Closes unused homes over `kept`, except `but`, which was just opened for somebody who is about to come."""
        with self._lock:
            unused = [
                scene
                for scene, entry in self._entries.items()
                if entry.is_open and not entry.num_users and scene != but
            ]
            closed = [self._entries.pop(scene) for scene in unused[: max(0, len(unused) - self._kept)]]
        for entry in closed:
            entry.home.result().close()

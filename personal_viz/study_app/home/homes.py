"""The homes that a process holds in memory: opened when somebody needs them, kept for later, closed for others.

Opening a scan takes seconds, so a home is opened on a thread of its own while its visitor still reads or walks. Nothing
here runs on viser's event loop.
"""

import contextlib
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import viser

from human_study.design.study import HomeView, StudyConfig, StudyPog
from human_study.trial.views import MarkedObject
from sim.episodes.schema import Episode, Goal
from sim.episodes.sequence_files import HomeSequence
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.sequences.searches import prompts_of
from sim.tasks.pan import PanEnv
from sim.tasks.pog import PogScene
from sim.types import Action, EpisodeKey

from ..watch import Watches
from .frames import Frames, RenderThreads
from .names import Name, names_of_objects
from .pictures import PictureView
from .surfaces import HomeSurface, SceneView, StoreyCopies

_PLAIN = StudyPog()
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
    """The home's episodes; none where sequences are done in their place."""
    storeys: list[tuple[float, float]]
    """(lowest, highest) floor of each storey, from the episodes."""
    storey_labels: tuple[int, ...]
    """Number of each storey that can be shown, from `sim.homes.storey_names.storey_labels`."""
    watches: Watches
    """Observers of the trials, for a researcher who watches."""
    threads: RenderThreads
    """Draw pictures of the home for participants who look around in it."""
    sequences: Mapping[EpisodeKey, HomeSequence] = field(default_factory=dict)
    """The home's sequences, in a study of them."""
    view: HomeView = "browser"
    """Where those pictures are made."""
    rooms: tuple[tuple[Name, ...], ...] = ()
    """Names of the rooms of each storey; () = they are not shown."""

    def shown_in(self, client: viser.ClientHandle, shown: StudyPog = _PLAIN) -> HomeSurface:
        """The home in one browser, with the names that `pog` of the study file shows; PAN's look has the default."""
        objects = shown.object_names
        if objects == "auto":
            objects = "off" if self.scene.kind == "scan" else "on"

        def names_of(index: int, is_asked: bool) -> list[Name]:
            wanted = {"on", "demand"} if is_asked else {"on"}
            rooms = self.rooms[index] if self.rooms and shown.room_names in wanted else ()
            return [*rooms, *(names_of_objects(self.copies.objects(index)) if objects in wanted else ())]

        if self.view == "browser":
            return SceneView(client, self.copies, names_of)
        return PictureView(client, self.copies, names_of, pog_scene=self.pog_scene, threads=self.threads)

    def objects_for(self, targets: Iterable[Goal]) -> dict[str, MarkedObject] | None:
        """The objects at which one can point, by name; None where these targets are not among them."""
        found = {
            item.name: MarkedObject(item.category, item.centre, item.size)
            for item in self.scene.objects
            if item.instance_id
        }
        return found if all(target.object_name in found for target in targets) else None

    def try_out(self, config: StudyConfig) -> None:
        """Walks and points once: loops that no run has compiled yet on this machine are compiled before people wait.

        Raises:
            PersonalVizError: Nobody could walk here.
        """
        first = next(iter((*self.episodes.values(), *self.sequences.values())))
        env = pan_env(first, self.scene, self.renderer, config)
        env.reset()
        env.step(Action.FORWARD)
        self.pog_scene.hit(0, env.pose.position, (0.0, -1.0, 0.0))

    def close(self) -> None:
        """Ends the observers; called when nobody is in the home any more."""
        self.watches.close()


def pan_env(trial: Episode | HomeSequence, scene: Scene, renderer: Renderer, config: StudyConfig) -> PanEnv:
    """The environment in which a PAN participant walks."""
    return PanEnv(
        trial.start,
        scene.navigation,
        renderer=renderer,
        camera=config.robot_camera,
        max_steps=config.steps,
        prompts=() if isinstance(trial, Episode) else prompts_of(trial, query_index=config.query_index),
    )


class Closeable(Protocol):
    """A thing that a library holds."""

    def close(self) -> None:
        """Frees the thing; called once, when nobody uses it any more."""
        ...


HomeT = TypeVar("HomeT", bound=Closeable)


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
        self._homes: OrderedDict[str, Future[HomeT]] = OrderedDict()
        """Homes that are wanted, being opened, or open."""
        self._num_users: Counter[str] = Counter()
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
            home, _ = self._wanted(scene)
            self._num_users[scene] += 1
        try:
            self._open_once(scene, home)
            yield home.result()
        finally:
            with self._lock:
                self._num_users[scene] -= 1
                if self._homes.get(scene) is home:
                    self._homes.move_to_end(scene)
            self._close_unused()

    def warm(self, scene: str) -> "Future[HomeT]":
        """Opens a home in the background; returns it at once.

        The future may be cancelled while it waits. A failure is raised where the home is used, and asking again tries
        again.
        """
        with self._lock:
            home, is_new = self._wanted(scene)
            if self._is_closed:
                home.cancel()
            elif is_new:
                self._warmer.submit(self._warm, scene, home)
            return home

    def close(self) -> None:
        """Closes every unused home at once and every other home when it is left; nothing is warmed any more."""
        with self._lock:
            self._is_closed = True
            self._kept = 0
        self._warmer.shutdown(wait=True, cancel_futures=True)
        self._close_unused()

    def _wanted(self, scene: str) -> "tuple[Future[HomeT], bool]":
        """The home of a scene, and whether nobody has asked for it yet. Needs the lock."""
        home = self._homes.get(scene)
        if home is not None and not home.cancelled():
            self._homes.move_to_end(scene)
            return home, False
        home = self._homes[scene] = Future()
        return home, True

    def _warm(self, scene: str, home: "Future[HomeT]") -> None:
        if not self._is_closed:
            self._open_once(scene, home)
            self._close_unused(but=scene)

    def _open_once(self, scene: str, home: "Future[HomeT]") -> None:
        """Opens the home unless another thread does; a failure is raised for all who wait, and then forgotten."""
        with self._lock:
            if home.running() or home.done():
                return
            home.set_running_or_notify_cancel()
        try:
            home.set_result(self._open_home(scene))
        except BaseException as error:  # raised where the home is used
            with self._lock:
                if self._homes.get(scene) is home:
                    del self._homes[scene]
            home.set_exception(error)

    def _close_unused(self, *, but: str | None = None) -> None:
        """Closes unused homes over `kept`, except `but`, which was just opened for somebody who is about to come."""
        with self._lock:
            unused = [
                scene
                for scene, home in self._homes.items()
                if home.done() and not home.cancelled() and not self._num_users[scene] and scene != but
            ]
            closed = [self._homes.pop(scene) for scene in unused[: max(0, len(unused) - self._kept)]]
        for home in closed:
            home.result().close()

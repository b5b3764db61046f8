"""`TrialPlay` without a browser: a page with a script, screens that keep what they are shown, a store in memory."""

import contextlib
import dataclasses
import queue
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from human_study.design.study import Condition
from human_study.store.store import SupersededError, Trial, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.texts.catalogue import catalogue_of
from human_study.trial.events import Event, event_from_json, event_to_json
from human_study.trial.views import LookView, Mark, PanView, PogView, RateView
from personal_viz.study_app.home import homes as homes_module
from personal_viz.study_app.home.frames import Frames, RenderThreads
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.home.surfaces import SceneView
from personal_viz.study_app.screens import play as play_module
from personal_viz.study_app.screens.cards import Card
from personal_viz.study_app.screens.page import GoneError, Item, WithdrawnError
from personal_viz.study_app.screens.play import TrialPlay
from personal_viz.study_app.watch import Watches
from sim.copies.cut import StoreyCut
from sim.episodes.schema import Episode
from sim.mesh import SceneObject
from sim.render.renderer import Hits
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Vector3
from sim.types import Camera, EpisodeKey, Frame, TaskKind

from ..human_study.small_world import PoseColours, SquareRoom, episode, study
from ..human_study.trials import ray_down

PASS = object()
"""In a script: the participant does nothing until time alone changes something."""
EVERY_S = 1.0
"""Time between two commands of a script, seconds."""
RAY = ray_down(0.0, 3.0, 0.0)
HIT = (-1.5, 0.0, 0.0)
LAMP = SceneObject(7, episode().targets[0].object_name, "lamp", (-2.0, 0.5, 0.0), (1.2, 1.0, 0.4))
"""The target, which every ray meets."""
View = LookView | PanView | PogView | RateView


class Clock:
    """`time.monotonic` that a script moves on."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def monotonic(self) -> float:
        return self.now_s


class MemoryLink:
    """The store of one trial."""

    def __init__(
        self, task: TaskKind, condition: Condition | None = None, *, code: str = "p02", key: EpisodeKey | None = None
    ) -> None:
        chosen = condition or ("none" if task == "pan" else "map_open")
        self.trial = Trial("t1", code, 1, "main", task, chosen, key or episode().key, 1, 0, 0.0)
        self.stored: list[Event] = []
        self.outcome: Any = None
        self.calls: list[str] = []
        self.changed = threading.Condition()

    def open_trial(self) -> Trial:
        """Opens the trial as the store does; older epochs cannot write afterwards."""
        self.trial = dataclasses.replace(self.trial, epoch=self.trial.epoch + 1)
        return self.trial

    def events(self, trial_id: str = "t1") -> list[Event]:
        """The stored events as they are read from disk."""
        return [event_from_json(line) for line in self.lines()]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> None:
        assert events
        with self.changed:
            if epoch != self.trial.epoch:
                raise SupersededError("another tab has the trial")
            if self.outcome is not None:
                raise TrialEndedError("it is over")
            self.stored += events
            self.calls.append("store " + " ".join(event.kind for event in events))
            self.changed.notify_all()

    def finish_trial(self, trial_id: str, outcome: Any) -> None:
        with self.changed:
            assert self.outcome is None
            self.outcome = outcome
            self.calls.append("finish")
            self.changed.notify_all()

    def lines(self) -> list[str]:
        """The stored events as they are on disk."""
        return [event_to_json(event) for event in self.stored]

    def wait_for(self, kind: str, *, count: int = 1) -> list[Event]:
        """All events, once there are `count` of this kind."""
        with self.changed:
            assert self.changed.wait_for(lambda: sum(e.kind == kind for e in self.stored) >= count, timeout=60)
        return self.events()

    def wait_for_outcome(self) -> Any:
        """The trial's outcome, once it is stored."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.outcome is not None, timeout=60)
        return self.outcome


class ScriptedPage:
    """Stands for a `Page`: hands out a script, then the browser is gone."""

    client = None
    words = catalogue_of("en")

    def __init__(self, script: Sequence[Any], clock: Clock, screens: list[str]) -> None:
        self._script, self._clock, self._screens = list(script), clock, screens
        self.waits: list[float | None] = []
        self.num_screens = 0

    def new_screen(self, *, hears: tuple[type, ...] = ()) -> Any:
        self.num_screens += 1
        return None

    def done_with(self, item: Item) -> None:
        """As the page's."""

    def card(self, card: Card, chosen: Any) -> None:
        self._screens.append(card.title)

    def wait(self, *, timeout_s: float | None = None) -> Item:
        self.waits.append(timeout_s)
        if not self._script:
            raise GoneError
        content = self._script.pop(0)
        if content is PASS:
            assert timeout_s is not None, "the session waits for ever"
            self._clock.now_s += timeout_s
            raise queue.Empty
        self._clock.now_s += EVERY_S
        if isinstance(content, Exception):
            raise content
        return Item(content, self.num_screens)


class RenderedHere:
    """Stands for `Frames`: renders when asked, never ahead."""

    def __init__(self) -> None:
        self._renderer = PoseColours()
        self.ahead: dict[str, int] = {}
        """Number of pictures wished for, by participant."""
        self.begun: list[Any] = []

    def render(self, T_world_camera: Any, camera: Camera) -> Frame:
        return self._renderer.render(T_world_camera, camera)

    def cast(self, origins: Any, directions: Any) -> Hits:
        return self._renderer.cast(origins, directions)

    def jpeg(self, rgb: Any) -> bytes:
        return b""

    def begin(self, pose: Any, camera: Camera) -> None:
        self.begun.append(pose)

    def look_ahead(self, who: str, poses: Sequence[Any], camera: Camera) -> None:
        self.ahead[who] = len(poses)


class Pointed:
    """A PogScene in which every ray meets the same point."""

    def hit(self, storey: int, origin: object, direction: object) -> Vector3:
        return HIT

    def object_at(self, storey: int, origin: object, direction: object) -> SceneObject:
        return LAMP

    def middle_of(self, storey: int, item: SceneObject) -> Vector3:
        return item.centre


@dataclasses.dataclass
class FakeScene:
    """The parts of a scene that trials need."""

    label = "a room (invented)"
    kind = "invented"
    digest = "d" * 64
    navigation = SquareRoom()
    objects: tuple[SceneObject, ...] = (LAMP,)


@dataclasses.dataclass
class Played:
    """A trial as it was played."""

    link: MemoryLink
    page: ScriptedPage
    watches: Watches
    shown: list[View]
    """Every view, on any screen."""
    screens: list[str]
    """Names of the screens and titles of the cards, in order."""
    raised: Exception | None
    """The error that ended it before its outcome was stored and shown."""


def make_env(episode: Episode) -> PanEnv:
    """The environment in which a participant walks."""
    return PanEnv(episode.start, SquareRoom(), renderer=PoseColours(), camera=study().robot_camera, max_steps=500)


@pytest.fixture
def fake_screens(monkeypatch: pytest.MonkeyPatch) -> tuple[list[View], list[str]]:
    """Replaces all screens; returns (the views that they show, their names as they open)."""
    shown: list[View] = []
    screens: list[str] = []

    def screen_named(name: str) -> Any:
        class Screen:
            def __init__(self, page: Any, view: View, send: Any, **options: Any) -> None:
                screens.append(name)
                shown.append(view)

            def show(self, view: View) -> None:
                shown.append(view)

        return Screen

    for name in ("LookScreen", "PanScreen", "PogScreen"):
        monkeypatch.setattr(play_module, name, screen_named(name))
    for module, name in ((homes_module, "SceneView"), (play_module, "MapView")):
        monkeypatch.setattr(module, name, lambda client, *_, name=name: screens.append(name))
    return shown, screens


class TwoStoreys(SquareRoom):
    """The room, and another above it."""

    storey_heights = (0.0, 3.0)


class TwoStoreyScene(FakeScene):
    """The room's scene with both storeys."""

    navigation = TwoStoreys()


class EmptySurface(SceneView):
    """Shows nothing."""

    def show_storey(self, index: int) -> None: ...

    def show_marks(self, marks: Sequence[tuple[Mark, str]]) -> None: ...


def meshless_home(*, category: str = "lamp") -> Home:
    """A home with two storeys for real screens: pictures of one colour, and a place for a mark on a thing."""
    return fake_home(
        Watches(None, make_env=make_env),
        scene=TwoStoreyScene(objects=(dataclasses.replace(LAMP, category=category),)),
        renderer=Frames(PoseColours(), RenderThreads(1)),
        episodes={episode(name).key: episode(name) for name in ("0", "1", "2")},
        storeys=[(0.0, 0.0), (3.0, 3.0)],
        storey_labels=(0, 1),
    )


def fake_home(watches: Watches, **changes: Any) -> Home:
    """The square room with one episode; pictures tell poses apart, and every ray meets the same point."""
    fields = {
        "scene": FakeScene(),
        "renderer": RenderedHere(),
        "pog_scene": Pointed(),
        "copies": _Copies(),
        "episodes": {episode().key: episode()},
        "storeys": [(0.0, 0.0)],
        "storey_labels": (0,),
        "watches": watches,
        "threads": RenderThreads(1),
    }
    return Home(**(fields | changes))


@contextlib.contextmanager
def _clock(clock: Clock) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(play_module, "time", clock)
        yield


def played(
    fakes: tuple[list[View], list[str]],
    link: MemoryLink,
    *script: Any,
    observers: Any = None,
    away_s: float = 0.0,
    took_over: bool = False,
    home_options: dict[str, Any] | None = None,
    **choices: object,
) -> Played:
    """Plays the link's trial with this script until it is over, or the script is.

    Args:
        fakes: From the fixture `fake_screens`.
        link: The store.
        script: Commands, rays, PASS, and errors that the page raises.
        observers: Observers of the trial.
        away_s: How long the participant was away.
        took_over: Whether the trial is taken over from another tab.
        home_options: Fields of the home.
        choices: Fields of the study file.
    """
    clock = Clock()
    watches = Watches(observers, make_env=make_env)
    home = fake_home(watches, **(home_options or {}))
    del fakes[0][:], fakes[1][:]
    page = ScriptedPage(script, clock, fakes[1])
    raised: Exception | None = None
    with _clock(clock):
        play = TrialPlay(page, link, home, study(**choices), link.open_trial(), name="Trial 1 of 1")
        try:
            play.play(away_s=away_s, took_over=took_over)
        except (GoneError, SupersededError, TrialEndedError, StoreFullError, WithdrawnError) as error:
            raised = error
        finally:
            play.leave()
    return Played(link, page, watches, list(fakes[0]), list(fakes[1]), raised)


class _Copies:
    """Stands for `StoreyCopies`."""

    maps = ()
    cuts = (StoreyCut(-0.1, 2.0), StoreyCut(2.9, 5.0))

    def middle(self, index: int) -> tuple[float, float]:
        """World (x, z)."""
        return 0.0, 0.0

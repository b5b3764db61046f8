"""One trial after the other in a real browser without gateway and store: viser, page, session and screens are real."""

import contextlib
import threading
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import viser

from human_study.design.plan import StudyScene
from human_study.design.study import Condition, StudyConfig
from human_study.store.store import SupersededError, Trial
from human_study.trial.events import Event, event_from_json, event_to_json
from human_study.trial.outcome import Outcome
from personal_viz.study_app.home.frames import RenderThreads
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.page_script import PageMessages
from personal_viz.study_app.screens.cards import Card, Choice, paragraphs
from personal_viz.study_app.screens.page import GoneError, Page
from personal_viz.study_app.screens.play import TrialPlay
from personal_viz.study_app.server import open_home
from personal_viz.study_app.store_link import StoreLink
from sim.episodes.dataset import PersonalDataset
from sim.types import EpisodeKey, TaskKind

from ..human_study.small_world import study
from .invented import invented_dataset

SEED = 4
"""Of an invented home with two storeys."""


class MemoryLink:
    """The store's side of one trial, kept as text in memory."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.outcome: Outcome | None = None
        self.epoch = 0
        self.changed = threading.Condition()

    def events(self, trial_id: str) -> list[Event]:
        """All so far."""
        return [event_from_json(line) for line in self.lines]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> None:
        """Keeps them, unless a newer tab has the trial."""
        with self.changed:
            if epoch != self.epoch:
                raise SupersededError("another tab has the trial")
            self.lines += [event_to_json(event) for event in events]
            self.changed.notify_all()

    def finish_trial(self, trial_id: str, outcome: Outcome) -> None:
        """Keeps the outcome."""
        with self.changed:
            assert self.outcome is None
            self.outcome = outcome
            self.changed.notify_all()

    def wait_for(self, kind: str, *, count: int = 1) -> list[Event]:
        """All events, once there are so many of this kind."""
        with self.changed:
            assert self.changed.wait_for(lambda: sum(e.kind == kind for e in self.events("")) >= count, timeout=60)
        return self.events("")

    def wait_for_outcome(self) -> Outcome:
        """The trial's outcome, once it is stored."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.outcome is not None, timeout=60)
        assert self.outcome is not None
        return self.outcome


@dataclass
class Stage:
    """A server whose visitors all play the same trial."""

    url: str
    link: MemoryLink
    home: Home
    key: EpisodeKey
    config: StudyConfig
    pages: list[Page] = field(default_factory=list)


def invented_home(folder: Path, config: StudyConfig) -> Home:
    """A home with two storeys, as a worker opens it."""
    scene = StudyScene(name=f"Invented{SEED}", kind="invented")
    invented_dataset(folder, name=scene.name, seed=SEED)
    return open_home(config, scene, PersonalDataset(folder), None, threads=RenderThreads(1))


@contextlib.contextmanager
def staged(
    home: Home, task: TaskKind, condition: Condition, *, again: bool = False, **choices: object
) -> Iterator[Stage]:
    """The stage until the end of the block.

    Args:
        home: In which the trial takes place.
        task: Of the trial.
        condition: Of the trial.
        again: Whether two notices and the same trial follow, with a new link, and so on.
        choices: The study's.
    """
    config, key = study(**choices), min(home.episodes)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.scene.set_up_direction("+y")
    stage = Stage(f"http://127.0.0.1:{server.get_port()}", MemoryLink(), home, key, config)

    def run(client: viser.ClientHandle) -> None:
        page = Page(client)
        stage.pages.append(page)
        actions = ("forward", "left", "right", "stop") if task == "pan" else ()
        PageMessages(client, page.heard, actions=actions).begin({})
        page.tools(has_keys=task == "pan", on_leave="Your answers are deleted.")
        try:
            while True:
                stage.link.epoch += 1
                trial = Trial("t1", "p01", 1, "main", task, condition, key, 1, stage.link.epoch, 0.0)
                play = TrialPlay(page, cast(StoreLink, stage.link), home, config, trial, name="Trial 1 of 1")
                play.play(away_s=1.0, took_over=stage.link.epoch > 1)
                if not again:
                    break
                page.choose(Card("Saved", paragraphs("The trial is over."), (Choice("more", "Once more"),)))
                page.choose(Card("Ready", paragraphs("The trial begins."), (Choice("begin", "Begin"),)))
                stage.link = MemoryLink()
            page.card(Card("Saved", paragraphs("The trial is over.")))
        except (GoneError, SupersededError):
            pass
        except Exception:  # a test must see why
            traceback.print_exc()

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        threading.Thread(target=run, args=(client,), daemon=True).start()

    @server.on_client_disconnect
    async def _(client: viser.ClientHandle) -> None:
        for page in stage.pages:
            if page.client.client_id == client.client_id:
                page.end(GoneError())

    try:
        yield stage
    finally:
        server.stop()

"""One trial after the other in a real browser without gateway and store: viser, page, session and screens are real."""

import contextlib
import socket
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import viser

from human_study.design.plan import StudyScene
from human_study.design.study import Condition, StudyConfig
from human_study.store.store import StudyStore, SupersededError
from human_study.texts.catalogue import catalogue_of
from personal_viz.study_app.home.frames import RenderThreads
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.page_script import PageMessages
from personal_viz.study_app.screens.cards import Card, Choice, paragraphs
from personal_viz.study_app.screens.page import GoneError, Page
from personal_viz.study_app.screens.play import TrialPlay
from personal_viz.study_app.server import open_home
from personal_viz.study_app.store_link import StoreLink, StoreService
from sim.episodes.dataset import PersonalDataset
from sim.types import EpisodeKey, TaskKind

from ..human_study.small_world import study
from .fake_play import MemoryLink
from .invented import invented_dataset

SEED = 4
"""Seed of an invented home with two storeys."""


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
def store_line(
    store: StudyStore, *, code_of_ticket: Callable[[str], str | None] = lambda _: None
) -> Iterator[StoreLink]:
    """A worker's line to a store of this process, until the end of the block."""
    ours, theirs = socket.socketpair()
    service = StoreService(
        ours, store, code_of_ticket=code_of_ticket, client_profile=lambda _: None, on_end=lambda: None
    )
    with contextlib.closing(service):
        yield StoreLink(theirs)


@contextlib.contextmanager
def staged(
    home: Home, task: TaskKind, condition: Condition, *, again: bool = False, **choices: object
) -> Iterator[Stage]:
    """The stage until the end of the block.

    Args:
        home: Home of the trial.
        task: Task of the trial.
        condition: Condition of the trial.
        again: Whether two notices and the same trial with a new link follow, again and again.
        choices: Fields of the study file.
    """
    config = study(**choices)
    key = min(home.episodes if config.sequences is None else home.sequences)

    def new_link() -> MemoryLink:
        return MemoryLink(task, condition, code="p01", key=key)

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.scene.set_up_direction("+y")
    stage = Stage(f"http://127.0.0.1:{server.get_port()}", new_link(), home, key, config)

    def run(client: viser.ClientHandle) -> None:
        page = Page(client, catalogue_of(config.language))
        stage.pages.append(page)
        actions = ("forward", "left", "right", "stop" if config.sequences is None else "found") if task == "pan" else ()
        PageMessages(client, page.heard, actions=actions).begin({})
        page.tools(has_keys=task == "pan", on_leave="Your answers are deleted.")
        try:
            while True:
                trial, link = stage.link.open_trial(), cast(StoreLink, stage.link)
                play = TrialPlay(page, link, home, config, trial, name="Trial 1 of 1")
                play.play(away_s=1.0, took_over=trial.epoch > 1)
                if not again:
                    break
                page.choose(Card("Saved", paragraphs("The trial is over."), (Choice("more", "Once more"),)))
                page.choose(Card("Ready", paragraphs("The trial begins."), (Choice("begin", "Begin"),)))
                stage.link = new_link()
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
    except Exception:
        print("Stored:", [(event.kind, round(event.t_s, 2)) for event in stage.link.events()])
        raise
    finally:
        server.stop()

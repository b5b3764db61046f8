"""A page that is loaded again while its home is opening: the newest connection has the trial, whatever comes first."""

import contextlib
import random
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import viser

from human_study.store.records import StoredTrial
from human_study.store.store import StudyStore, SupersededError
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.home.homes import Home, HomeLibrary
from personal_viz.study_app.screens.seat import Study
from personal_viz.study_app.server import serve
from personal_viz.study_app.worker_door import SECRET_HEADER, WorkerDoor
from tests.human_study.stores import filled, trials_of

from .fake_play import meshless_home
from .gateways import wait_until
from .stage import store_line
from .wire import WireClient, line_to

CODE = "p02"
"""The participant who walks."""
NUM_RELOADS = 100


@dataclass
class SlowHomes:
    """Opens the home of the study when the test lets it."""

    may_open: threading.Event = field(default_factory=threading.Event)
    is_opening: threading.Event = field(default_factory=threading.Event)

    def open(self, _: str) -> Home:
        """Waits for `may_open`."""
        self.is_opening.set()
        assert self.may_open.wait(60)
        return meshless_home()


@dataclass
class Worker:
    """A worker in this process, with its store."""

    store: StudyStore
    homes: SlowHomes
    server: viser.ViserServer
    door: WorkerDoor
    numbers: int = 0
    """Connections so far."""

    @contextlib.contextmanager
    def connected(self) -> Iterator[WireClient]:
        """A new connection of the participant, as the gateway makes it."""
        self.numbers += 1
        with self.connected_as(self.numbers) as client:
            yield client

    @contextlib.contextmanager
    def connected_as(self, number: int) -> Iterator[WireClient]:
        """A connection with this number."""
        url, secret = f"ws://127.0.0.1:{self.door.port}/?connection={number}&ticket={CODE}", self.door.secret
        with line_to(url, additional_headers={SECRET_HEADER: secret}, close_timeout=0.1) as connection:
            client = WireClient(connection)
            client.send(CAMERA)
            yield client

    def trial(self) -> StoredTrial:
        """The participant's first."""
        return trials_of(self.store, CODE)[0]


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[StudyStore]:
    """The store of a small study with its people; the one who walks has read the instructions."""
    with filled(folder) as store:
        store.enter_stage(CODE, "arrived")
        store.enter_stage(CODE, "instructed")
        yield store


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    """Serves a study in the square room; every visitor is the participant that the ticket names."""
    homes = SlowHomes()
    with opened(tmp_path) as store, store_line(store, code_of_ticket=lambda ticket: ticket) as link:
        library = HomeLibrary(homes.open, kept=0)
        server, door = serve(Study(store.config, store.plan, library, time.monotonic()), link)
        try:
            yield Worker(store, homes, server, door)
        finally:
            homes.may_open.set()
            server.stop()
            for seat in seats():
                seat.join(30)
            library.close()


def seats() -> list[threading.Thread]:
    """Threads of participants."""
    return [thread for thread in threading.enumerate() if thread.name == f"seat-{CODE}"]


def walks(client: WireClient, *, step: int) -> None:
    """Turns left once more from the picture of a step: only the connection that has the trial can."""
    client.see_step(step)
    client.press("Turn left (A or Left)")
    client.see_step(step + 1)
    assert not any("no longer used" in str(message) for message in client.messages)


@pytest.mark.slow
def test_a_hundred_reloads_at_random_moments_leave_the_trial_to_the_last_page(worker: Worker) -> None:
    rng = random.Random(7)
    with worker.connected():
        assert worker.homes.is_opening.wait(30)
    num_reloads, step = 0, 0
    while num_reloads < NUM_RELOADS:
        num_now = min(rng.randint(1, 12), NUM_RELOADS - num_reloads)
        opens_before = rng.randint(0, num_now)
        for number in range(num_now):
            if number == opens_before:
                worker.homes.may_open.set()
            with worker.connected() as client:
                if rng.random() < 0.7:
                    client.receive_until(lambda message: "personalPage.begin" in str(message))
                if rng.random() < 0.3:
                    worker.homes.is_opening.wait(30)
            num_reloads += 1
        with worker.connected() as client:
            worker.homes.may_open.set()
            walks(client, step=step)
            for seat in seats()[:-1]:  # the others get what they wait for, and end
                seat.join(30)
            step += 1
            walks(client, step=step)
            step += 1
        worker.homes.may_open.clear()
        worker.homes.is_opening.clear()
    assert worker.trial().trial_id is not None


def test_a_page_that_was_left_while_its_home_was_opening_begins_no_trial(worker: Worker) -> None:
    with worker.connected():
        assert worker.homes.is_opening.wait(30)
    wait_until(lambda: not worker.server.get_clients())
    worker.homes.may_open.set()
    for seat in seats():
        seat.join(30)
    assert worker.trial().trial_id is None


def test_the_newest_connection_is_the_one_that_came_last_not_the_one_that_was_admitted_last(worker: Worker) -> None:
    worker.homes.may_open.set()
    with worker.connected_as(2) as newest:
        newest.see_step(0)
        with worker.connected_as(1) as late:
            late.receive_until(lambda message: "no longer used" in str(message))
            walks(newest, step=0)


def test_the_store_refuses_an_older_connection_that_opens_a_trial_later(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        store.open_trial(CODE, 1, connection=4)
        with pytest.raises(SupersededError, match="asked from connection 3; expected 4, the newest tab's"):
            store.open_trial(CODE, 1, connection=3)
        assert store.open_trial(CODE, 1, connection=4).epoch == 2
        assert store.open_trial(CODE, 1, connection=9).epoch == 3
        assert store.open_trial("p01", 1, connection=1).epoch == 1

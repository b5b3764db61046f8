"""Workers are started together, watched, started again, shared out evenly, and all end with the block."""

import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, cast

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from human_study.store.store import StudyStore
from personal_viz.study_app.gateway import workers
from personal_viz.study_app.gateway.admission import Tickets
from personal_viz.study_app.gateway.app import Gateway
from personal_viz.study_app.gateway.heartbeat import Heartbeat
from personal_viz.study_app.gateway.http import listen, served_in_thread, uvicorn_server
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.gateway.workers import WorkerPool
from sim.errors import StudyError

from .gateways import NO_PAGES, PRESS, admission_for, enter, few_people, pack, wait_until

pytestmark = pytest.mark.slow

PATIENCE_S = 60


def pool_of(
    folder: Path, kind: str, num_workers: int, told: list[str], tickets: Tickets | None = None, **choices: Any
) -> WorkerPool:
    """Fake workers that behave like this; their pids are file names in the folder."""
    return WorkerPool(
        cast(StudyStore, None),
        lambda fd: [sys.executable, "-m", "tests.personal_viz.fake_worker", str(fd), str(folder), kind],
        num_workers=num_workers,
        tickets=tickets or Tickets(),
        tell=told.append,
        **choices,
    )


def pids(folder: Path) -> list[int]:
    """Process ids of all workers that were ever started."""
    return [int(path.stem) for path in folder.glob("*.pid")]


def is_running(pid: int) -> bool:
    """Whether the process runs."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[WorkerPool, Path]]:
    """Two good workers with the folder of their pids, for tests that leave them alone; both end with the block."""
    folder = tmp_path_factory.mktemp("two")
    with pool_of(folder, "good", 2, []) as pool:
        assert len(pids(folder)) == 2
        assert all(is_running(pid) for pid in pids(folder))
        yield pool, folder
    assert not any(is_running(pid) for pid in pids(folder))


def test_people_are_shared_out_evenly_and_stay_where_they_are(two: tuple[WorkerPool, Path]) -> None:
    pool, _ = two
    with ExitStack() as stack:
        doors = {code: stack.enter_context(pool.seat(code)) for code in ("p01", "p02", "p03", "p04")}
        assert Counter(doors.values()) == {worker.door: 2 for worker in pool.workers}
        again = {code: stack.enter_context(pool.seat(code)) for code in doors}
        assert again == doors
        assert pool.num_people() == 4
        first = doors["p01"]
        with pool.seat("p05") as fifth:
            assert fifth is not None
        with pool.seat("p06") as sixth:
            assert sixth == fifth, "the least loaded again"
        assert first in {worker.door for worker in pool.workers}
    assert pool.num_people() == 0


def test_a_person_who_comes_back_gets_the_same_worker_if_it_is_as_free(two: tuple[WorkerPool, Path]) -> None:
    pool, _ = two
    with pool.seat("p11"), pool.seat("p12") as second:
        pass
    with pool.seat("p12") as again:
        assert again == second


def test_ctrl_c_does_not_reach_workers_and_they_share_the_cores_with_the_gateway(two: tuple[WorkerPool, Path]) -> None:
    for pid in pids(two[1]):
        assert os.getpgid(pid) not in (os.getpgid(0), 0)
        assert os.getsid(pid) == os.getsid(0)


def test_a_worker_that_does_not_listen_is_killed(tmp_path: Path) -> None:
    with pool_of(tmp_path, "deaf", 1, [], end_s=0.5):
        assert is_running(pids(tmp_path)[0])
    assert not is_running(pids(tmp_path)[0])


def test_a_worker_that_cannot_start_says_why_and_the_others_end(tmp_path: Path) -> None:
    with (
        pytest.raises(StudyError, match="scene X: cannot be read; expected a mesh"),
        pool_of(tmp_path, "broken", 2, []),
    ):
        pytest.fail("served nevertheless")
    assert not any(is_running(pid) for pid in pids(tmp_path))


@pytest.mark.parametrize(
    ("kind", "heartbeat"), [("fragile", None), ("slow", Heartbeat(every_s=0.01, patience_s=0.3))], ids=["dies", "hangs"]
)
def test_a_worker_that_always_dies_or_hangs_is_given_up_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, heartbeat: Heartbeat | None
) -> None:
    monkeypatch.setattr(workers, "MOST_FAILURES", 2)
    monkeypatch.setattr(workers, "PAUSES_S", (0.0, 0.0))
    told: list[str] = []
    with pool_of(tmp_path, kind, 1, told, heartbeat=heartbeat) as pool:
        assert pool.ended.wait(PATIENCE_S)
        with pool.seat("p01") as door:
            assert door is None
    assert told[-1] == "viser worker 1 ended 2 times in a row; it is not started again."
    assert len(pids(tmp_path)) == 2


@contextmanager
def served(folder: Path, pool: WorkerPool, tickets: Tickets) -> Iterator[str]:
    """The gateway's address in front of a pool."""
    options = ServeOptions(port=0)
    gateway = Gateway(admission_for(few_people(), folder), pool, tickets=tickets, options=options, pages=NO_PAGES)
    server = uvicorn_server(gateway.app(), options)
    with listen(options.bind, options.port) as listener, served_in_thread(server, listener):
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


def answer(connection: ClientConnection) -> tuple[str, int]:
    """(who the worker thinks we are, its pid)."""
    connection.send(pack(PRESS))
    received = connection.recv(timeout=PATIENCE_S)
    text = received if isinstance(received, str) else received.decode()
    return text.split()[0], int(text.split()[1])


@pytest.mark.parametrize(
    ("harm", "heartbeat", "line"),
    [
        pytest.param(signal.SIGKILL, None, "viser worker 1 ended", id="killed"),
        pytest.param(
            signal.SIGSTOP,
            Heartbeat(every_s=0.05, patience_s=3),
            "viser worker 1 has not answered for 3 s and was killed",
            id="hangs",
        ),
    ],
)
def test_a_worker_that_ended_or_hangs_is_started_again_and_the_same_ticket_leads_to_it(
    tmp_path: Path, harm: signal.Signals, heartbeat: Heartbeat | None, line: str
) -> None:
    tickets, told = Tickets(), []
    with (
        pool_of(tmp_path, "good", 1, told, tickets, heartbeat=heartbeat) as pool,
        served(tmp_path, pool, tickets) as address,
    ):
        url, headers = enter(address, "good")
        with connect(url, additional_headers=headers, proxy=None) as before:
            code, pid = answer(before)
            assert code == "p01"
            os.kill(pid, harm)
            with pytest.raises(ConnectionClosed) as ended:
                before.recv(timeout=PATIENCE_S)
            assert ended.value.rcvd.code == 1012
        wait_until(lambda: pool.workers[0].door is not None and len(pids(tmp_path)) >= 2)
        with connect(url, additional_headers=headers, proxy=None) as after:
            code, new_pid = answer(after)
        assert (code, new_pid != pid, is_running(pid)) == ("p01", True, False)
    told = told[:1] if heartbeat else told  # a machine under load may take more than 3 s for an answer
    assert told == [f"{line}; it is started again. Nothing acknowledged is lost."]
    assert not any(is_running(pid) for pid in pids(tmp_path))


def test_people_of_the_other_worker_notice_nothing(tmp_path: Path) -> None:
    tickets = Tickets()
    with (
        pool_of(tmp_path, "good", 2, [], tickets) as pool,
        served(tmp_path, pool, tickets) as address,
        ExitStack() as at,
    ):
        sockets = []
        for token in ("good", "fine"):
            url, headers = enter(address, token)
            sockets.append(at.enter_context(connect(url, additional_headers=headers, proxy=None)))
        (_, killed), (_, spared) = (answer(connection) for connection in sockets)
        assert killed != spared
        os.kill(killed, signal.SIGKILL)
        with pytest.raises(ConnectionClosed):
            sockets[0].recv(timeout=PATIENCE_S)
        assert answer(sockets[1]) == ("p02", spared)
        url, headers = enter(address, "good")
        with connect(url, additional_headers=headers, proxy=None) as again:
            assert answer(again)[0] == "p01"


def test_a_slow_worker_is_left_alone(tmp_path: Path) -> None:
    told: list[str] = []
    with pool_of(tmp_path, "slow", 1, told, heartbeat=Heartbeat(every_s=0.01, patience_s=600)):
        (pid,) = pids(tmp_path)
        asked = tmp_path / f"{pid}.asked"
        wait_until(asked.exists)
        (tmp_path / "go").touch()  # the answer is as late as this test is slow, and the next question follows
        wait_until(lambda: asked.read_text().count("once") > 2)
        assert pids(tmp_path) == [pid]
        assert is_running(pid)
    assert told == []

"""The question whether a worker's event loop runs, asked of viser itself, of a closed port and of a blocked loop."""

import resource
import socket
import threading
from collections.abc import Iterator

import pytest
import viser

from personal_viz.study_app.gateway.heartbeat import answers

NEVER = threading.Event()
LONG_S, SHORT_S = 120.0, 0.3


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    """A viser server on a free port."""
    running = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        yield running
    finally:
        running.stop()


def test_viser_answers(server: viser.ViserServer) -> None:
    assert all(answers(server.get_port(), patience_s=LONG_S, over=NEVER) for _ in range(3))


def test_a_viser_with_a_blocked_event_loop_answers_only_when_the_loop_goes_on(
    server: viser.ViserServer,
) -> None:
    blocked, go_on, found = threading.Event(), threading.Event(), []

    def block() -> None:
        blocked.set()
        go_on.wait()

    server.get_event_loop().call_soon_threadsafe(block)
    assert blocked.wait(LONG_S)
    asking = threading.Thread(target=lambda: found.append(answers(server.get_port(), patience_s=LONG_S, over=NEVER)))
    asking.start()
    try:
        assert not answers(server.get_port(), patience_s=SHORT_S, over=NEVER)
    finally:
        go_on.set()
    asking.join(LONG_S)
    assert found == [True]


def test_a_port_where_nobody_listens_does_not_answer() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        assert not answers(probe.getsockname()[1], patience_s=SHORT_S, over=NEVER)


def test_waiting_ends_when_the_answer_is_no_longer_needed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        over, found = threading.Event(), []
        port = deaf.getsockname()[1]
        asking = threading.Thread(target=lambda: found.append(answers(port, patience_s=LONG_S / 4, over=over)))
        asking.start()
        over.set()
        asking.join(LONG_S)
        assert found == [True]


def test_more_open_files_than_select_can_take_do_not_kill_a_healthy_worker(server: viser.ViserServer) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2048:
        pytest.skip("this machine does not let us open 2,048 files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    kept = [socket.socketpair() for _ in range(520)]
    try:
        assert max(end.fileno() for pair in kept for end in pair) > 1024
        assert answers(server.get_port(), patience_s=LONG_S, over=NEVER)
    finally:
        for pair in kept:
            for end in pair:
                end.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))

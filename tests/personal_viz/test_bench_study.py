"""The human study's benchmark: its parts measure what they say; speed is judged only when asked for."""

import socket
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from personal_viz.bench.harness import Findings, Progress, markdown, run_benchmark
from personal_viz.bench.study import parts as bench
from personal_viz.bench.study.browser import delayed
from personal_viz.bench.study.kills import KillSettings
from personal_viz.bench.study.store import StoreSettings, store_acks_ms
from personal_viz.cli.bench import Bench
from sim.errors import PersonalVizError, StudyError


def test_the_command_measures_the_parts_that_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Mapping[str, bench.PartSettings], tuple[str, ...]]] = []

    def measured(
        settings: Mapping[str, bench.PartSettings], progress: Progress, parts: tuple[str, ...] = ()
    ) -> Findings:
        asked.append((settings, parts))
        return Findings({})

    monkeypatch.setattr(bench, "measure", measured)
    assert Bench("study", out=tmp_path, quick=True).run() == 0
    assert Bench("study", out=tmp_path, parts=("soak", "kills")).run() == 0
    assert asked == [(bench.QUICK, ()), (bench.FULL, ("soak", "kills"))]
    assert bench.FULL["kills"] == KillSettings(kills=200)


def test_unknown_parts_are_refused_before_work_starts(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="--parts nap: is none of the parts; expected some of store, load"):
        Bench("study", out=tmp_path, quick=True, parts=("nap",)).run()
    with pytest.raises(PersonalVizError, match="bench sim: --parts is soak; expected none"):
        Bench("sim", out=tmp_path, parts=("soak",)).run()


def test_only_the_parts_that_were_asked_for_are_measured() -> None:
    settings = {**bench.QUICK, "store": StoreSettings(seconds=0.5)}
    report = run_benchmark(
        "study", lambda: bench.measure(settings, lambda _: None, parts=("store",)), bench.PLAN, quick=True
    )
    values = report.values
    assert 0 < values["store"]["ack_p50_ms"] <= values["store"]["ack_p95_ms"]
    assert (values["lost"], values["participants"]) == (None, None)
    assert "kills" not in values
    assert set(values["load_of"]) == {"store"}
    assert [figure.name for figure in report.figures if figure.target] == ["store.ack_p95_ms"]
    assert "kills" in report.left_out
    assert "- store: the store alone, 50 people for 0.5 s." in markdown(report)


def test_the_store_acknowledges_every_key(tmp_path: Path) -> None:
    acks = store_acks_ms(tmp_path, participants=4, rate=40.0, seconds=0.25)
    assert len(acks) == 40
    assert min(acks) > 0


def test_the_slow_line_hands_on_every_byte_later() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def echo() -> None:
            connection, _ = server.accept()
            with connection:
                while data := connection.recv(65536):
                    connection.sendall(data)

        answering = threading.Thread(target=echo)
        answering.start()
        with delayed(f"http://127.0.0.1:{port}/#token", one_way_s=0.05) as link:
            assert link.endswith("/#token")
            near = int(link.split(":")[2].split("/")[0])
            assert near != port
            with socket.create_connection(("127.0.0.1", near), timeout=30) as client:
                sent = bytes(range(256)) * 1000
                began_s = time.perf_counter()
                client.sendall(b"?")
                assert client.recv(1) == b"?"
                assert time.perf_counter() - began_s >= 0.1  # it cannot be faster than the line
                client.sendall(sent)
                client.shutdown(socket.SHUT_WR)
                received = b""
                while data := client.recv(65536):
                    received += data
                assert received == sent
        answering.join(30)


@pytest.mark.bench
def test_a_quick_run_meets_the_limits() -> None:
    report = run_benchmark("study", lambda: bench.measure(bench.QUICK, print), bench.PLAN, quick=True)
    assert report.missed() == []

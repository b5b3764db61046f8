"""The human study's benchmark: its parts measure what they say; speed is judged only when asked for."""

import json
import socket
import threading
import time
from pathlib import Path

import pytest

import personal_viz.commands.bench as command
from personal_viz.bench import study as bench
from personal_viz.bench.study import LIMITS, StudyFigures, StudySettings, figure_rows, markdown
from personal_viz.bench.study_delay import delayed
from personal_viz.bench.study_store import store_acks_ms
from personal_viz.bots_run import BotFigures

KEYS = {
    "ack_p50_ms",
    "ack_p95_ms",
    "key_to_image_p50_ms",
    "key_to_image_p95_ms",
    "lost",
    "duplicated",
    "participants",
}
"""What the issue asks for."""


def made_up(**changes: object) -> StudyFigures:
    load = BotFigures(
        participants=50,
        kinds=("random",),
        rate=2.0,
        seconds=300.0,
        actions=30_000,
        actions_per_s=100.0,
        frames=30_050,
        ack_p50_ms=8.0,
        ack_p95_ms=40.0,
        ack_max_ms=90.0,
        key_to_frame_p50_ms=12.0,
        key_to_frame_p95_ms=70.0,
        unanswered=0,
        lost=0,
        duplicated=0,
        unknown=0,
        cut_off=0,
        dropped={},
        connections=50,
        problems=(),
        server_cpu_ms_per_action=15.0,
        bots_cpu_ms_per_action=1.0,
        cores=2,
        actions_per_s_per_core=50.0,
        load_before=0.1,
    )
    values = {
        "settings": StudySettings(),
        "participants": 50,
        "ack_p50_ms": 8.0,
        "ack_p95_ms": 40.0,
        "key_to_image_p50_ms": 70.0,
        "key_to_image_p95_ms": 250.0,
        "lost": 0,
        "duplicated": 0,
        "alone_p50_ms": 40.0,
        "alone_p95_ms": 55.0,
        "delayed_p50_ms": 130.0,
        "delayed_p95_ms": 150.0,
        "delayed_p50_over_round_trip_ms": 50.0,
        "store_ack_p50_ms": 2.0,
        "store_ack_p95_ms": 6.0,
        "load": load,
        "cores": 2,
        "load_before": 0.1,
        "created_utc": "2026-11-22T00:00:00+00:00",
    }
    return StudyFigures.model_validate(values | changes)


def test_figures_stand_beside_their_targets() -> None:
    figures = made_up()
    assert set(figures.model_dump()) >= KEYS
    assert set(LIMITS) <= set(StudyFigures.model_fields)
    rows = {row[0]: row[1:] for row in figure_rows(figures)}
    assert rows["key_to_image_p50_ms"] == ("70.0", "<= 100", "yes")
    assert rows["key_to_image_p95_ms"] == ("250.0", "<= 200", "no")
    assert rows["lost"] == ("0.0", "<= 0", "yes")
    assert rows["load: actions_per_s"] == ("100.0", "", "")
    text = markdown(figures)
    assert "2 cores, load average 0.10" in text
    assert "| ack_p95_ms | 40.0 | <= 50 | yes |" in text


def test_figures_without_a_browser_are_said_to_be_missing() -> None:
    figures = made_up(key_to_image_p50_ms=None, alone_p50_ms=None)
    rows = {row[0]: row[1:] for row in figure_rows(figures)}
    assert rows["key_to_image_p50_ms"] == ("-", "<= 100", "not measured")
    assert rows["alone_p50_ms"] == ("-", "<= 60", "not measured")


def test_the_command_writes_figures_and_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[StudySettings] = []

    def measured(settings: StudySettings, **_: object) -> StudyFigures:
        asked.append(settings)
        return made_up()

    monkeypatch.setattr(bench, "measure_study", measured)
    assert command.bench_study(out=tmp_path, quick=True, json=True) == 0
    assert asked == [bench.QUICK]
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "bench-study.json").read_text())
    assert printed["ack_p95_ms"] == 40.0
    assert (tmp_path / "bench-study.md").read_text() == markdown(made_up())


def test_the_store_acknowledges_every_key() -> None:
    acks = store_acks_ms(participants=4, rate=40.0, seconds=0.25)
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
def test_a_quick_run_meets_the_targets(tmp_path: Path) -> None:
    figures = bench.measure_study(bench.QUICK, progress=print)
    missed = [row for row in figure_rows(figures) if row[3] == "no"]
    assert not missed, missed

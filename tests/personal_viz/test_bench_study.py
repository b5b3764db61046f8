"""The human study's benchmark: its parts measure what they say; speed is judged only when asked for."""

import json
import socket
import threading
import time
from pathlib import Path
from typing import get_args

import pytest

from personal_viz.bench.study import parts as bench
from personal_viz.bench.study.delay import delayed
from personal_viz.bench.study.figures import (
    LIMITS,
    PARTS,
    StoreFigures,
    StudyFigures,
    StudySettings,
    figure_rows,
    markdown,
    missed,
)
from personal_viz.bench.study.kills import KillFigures
from personal_viz.bench.study.online import BrowserFigures
from personal_viz.bench.study.soak import SoakFigures
from personal_viz.bench.study.store import store_acks_ms
from personal_viz.cli.bench import Bench
from sim.errors import PersonalVizError, StudyError

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
BROWSER = BrowserFigures(
    alone_p50_ms=40.0,
    alone_p95_ms=55.0,
    key_to_image_p50_ms=70.0,
    key_to_image_p95_ms=250.0,
    delayed_p50_ms=130.0,
    delayed_p95_ms=150.0,
    delayed_p50_over_round_trip_ms=50.0,
)
KILLS = KillFigures(
    kills=6,
    gateway_kills=3,
    seconds=60.0,
    restart_p50_s=7.0,
    acked_keys=90,
    lost_after_kill=1,
    duplicated_after_kill=0,
    unknown_after_kill=0,
    cut_off=4,
    chain_failures=0,
    resumes=9,
    resumed_elsewhere=0,
    steps_done_again=80,
    problems=("p01: step 4 was counted, 3 are stored",),
)


def made_up(**changes: object) -> StudyFigures:
    values = {
        "settings": StudySettings(parts=("store", "browser", "kills")),
        "participants": None,
        "ack_p50_ms": None,
        "ack_p95_ms": None,
        "key_to_image_p50_ms": 70.0,
        "key_to_image_p95_ms": 250.0,
        "lost": None,
        "duplicated": None,
        "store": StoreFigures(ack_p50_ms=2.0, ack_p95_ms=6.0),
        "browser": BROWSER,
        "kills": KILLS,
        "cores": 2,
        "load_before": 0.1,
        "load_of": {"kills": 0.5},
        "created_utc": "2026-11-22T00:00:00+00:00",
    }
    return StudyFigures.model_validate(values | changes)


def test_figures_stand_beside_their_limits() -> None:
    figures = made_up()
    assert set(figures.model_dump()) >= KEYS
    rows = {row[0]: row[1:] for row in figure_rows(figures)}
    assert rows["browser.key_to_image_p50_ms"] == ("70.0", "<= 100", "met")
    assert rows["browser.key_to_image_p95_ms"] == ("250.0", "<= 200", "missed")
    assert rows["kills.lost_after_kill"] == ("1", "<= 0", "missed")
    assert rows["kills.acked_keys"] == ("90", "", "")
    assert missed(figures) == ["browser.key_to_image_p95_ms", "kills.lost_after_kill"]
    text = markdown(figures)
    assert "2 cores, load average 0.10" in text
    assert "Load average before it: 0.50" in text
    assert "| store.ack_p95_ms | 6.0 | <= 50 | met |" in text
    assert "- kills: p01: step 4 was counted, 3 are stored" in text


def test_every_limit_is_one_of_a_figure() -> None:
    fields = StudyFigures.model_fields
    for name in LIMITS:
        part, _, figure = name.partition(".")
        kinds = [kind for kind in get_args(fields[part].annotation) if kind is not type(None)]
        assert figure in kinds[0].model_fields, name
    assert {part.replace("-", "_") for part in PARTS} <= set(StudySettings.model_fields)


def test_a_part_that_was_asked_for_and_has_no_figures_is_said_to_be_missing() -> None:
    rows = {row[0]: row[1:] for row in figure_rows(made_up(browser=None))}
    assert rows["browser.key_to_image_p50_ms"] == ("-", "<= 100", "not measured")
    assert "soak.lost" not in rows  # nobody asked for it


def test_a_figure_that_this_system_cannot_give_is_left_out() -> None:
    soak = SoakFigures(
        participants=8,
        seconds=30.0,
        actions=500,
        connections=12,
        lost=0,
        duplicated=0,
        at_start=None,
        at_end=None,
        at_leave=None,
        fds_growth=None,
        threads_growth=None,
        clients_growth=None,
        rss_growth_mb=None,
        rss_growth_second_half_mb=None,
        rss_mb=(),
        peak_mb=None,
        clients_left=None,
        leases_left=0,
        problems=(),
    )
    rows = {row[0]: row[1:] for row in figure_rows(made_up(settings=StudySettings(parts=("soak",)), soak=soak))}
    assert "soak.fds_growth" not in rows
    assert rows["soak.leases_left"] == ("0", "<= 0", "met")


def test_the_command_writes_figures_and_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[StudySettings] = []

    def measured(settings: StudySettings, **_: object) -> StudyFigures:
        asked.append(settings)
        return made_up()

    monkeypatch.setattr(bench, "measure_study", measured)
    assert Bench("study", out=tmp_path, quick=True, json=True).work() == 0
    assert Bench("study", out=tmp_path, parts=("soak", "kills")).work() == 0
    assert asked[0] == bench.QUICK
    assert asked[1].parts == ("kills", "soak")
    assert asked[1].kills.kills == 200
    printed = json.JSONDecoder().raw_decode(capsys.readouterr().out)[0]
    assert printed == json.loads((tmp_path / "bench-study.json").read_text())
    assert printed["kills"]["acked_keys"] == 90
    assert (tmp_path / "bench-study.md").read_text() == markdown(made_up())


def test_unknown_parts_are_refused_before_work_starts(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="--parts nap: is none of the parts; expected some of store, load"):
        Bench("study", out=tmp_path, quick=True, json=True, parts=("nap",)).work()  # type: ignore[arg-type]
    with pytest.raises(PersonalVizError, match="bench sim: --parts is soak; expected none"):
        Bench("sim", out=tmp_path, parts=("soak",)).work()


def test_only_the_parts_that_were_asked_for_are_measured() -> None:
    settings = bench.QUICK.model_copy(update={"parts": ("store",)})
    settings = settings.model_copy(update={"store": settings.store.model_copy(update={"seconds": 0.5})})
    figures = bench.measure_study(settings, progress=lambda _: None)
    assert figures.store is not None
    assert 0 < figures.store.ack_p50_ms <= figures.store.ack_p95_ms
    assert (figures.load, figures.kills, figures.lost, figures.participants) == (None, None, None, None)
    assert set(figures.load_of) == {"store"}


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
def test_a_quick_run_meets_the_limits() -> None:
    figures = bench.measure_study(bench.QUICK, progress=print)
    assert not missed(figures), [row for row in figure_rows(figures) if row[3] == "missed"]

"""Sinks of running episodes: forms of the option, the file after a crash, errors of a full disk or dead viewer."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb
import rerun_cli
from rerun.chunk import RrdReader

from recordings.sinks import MAX_PARTS, LiveSink, live_sink
from recordings.viewer.process import running_rerun
from sim.errors import RecordingError
from sim.types import EpisodeKey

KEYS = (EpisodeKey("easy", "Box", "1"), EpisodeKey("easy", "Box", "2"))
PROGRAM = Path(rerun_cli.__file__).with_name("rerun")


def rows(rrd: Path, entity: str) -> int:
    """Number of readable rows of an entity, in an unfinished file too."""
    return sum(chunk.num_rows for chunk in RrdReader(str(rrd)).stream() if chunk.entity_path == entity)


def verifies(rrd: Path) -> bool:
    return subprocess.run([PROGRAM, "rrd", "verify", rrd], capture_output=True).returncode == 0


def log_steps(stream: rr.RecordingStream, numbers: range) -> None:
    for number in numbers:
        stream.set_time("step", sequence=number)
        stream.log("/figure", rr.Scalars(float(number)))


@pytest.fixture
def dead_port() -> Iterator[int]:
    """A port without a listener, reserved so that no other program takes it."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        yield taken.getsockname()[1]


def test_a_file_grows_with_each_flush_and_is_valid_when_closed(tmp_path: Path) -> None:
    sink = LiveSink("file", str(tmp_path / "deep" / "a.rrd"))
    recording = sink.open(KEYS[0])
    log_steps(recording.stream, range(3))
    recording.flush()
    assert rows(tmp_path / "deep" / "a.rrd", "/figure") == 3
    log_steps(recording.stream, range(3, 5))
    recording.close()
    assert rows(tmp_path / "deep" / "a.rrd", "/figure") == 5
    assert verifies(tmp_path / "deep" / "a.rrd")
    (store,) = RrdReader(str(tmp_path / "deep" / "a.rrd")).recordings()
    assert (store.application_id, store.recording_id) == ("personal-viz", "personal/easy/Box/1")


def test_a_folder_gets_one_file_per_episode_and_closing_again_changes_nothing(tmp_path: Path) -> None:
    recording = LiveSink("file", str(tmp_path / "a.rrd")).open(KEYS[0])
    log_steps(recording.stream, range(2))
    recording.close()
    before = (tmp_path / "a.rrd").read_bytes()
    recording.close()
    assert (tmp_path / "a.rrd").read_bytes() == before
    with live_sink(str(tmp_path / "live"), KEYS) as sink:
        for key in KEYS:
            sink.open(key).close()
    assert sorted(path.name for path in (tmp_path / "live").iterdir()) == ["easy-Box-1.rrd", "easy-Box-2.rrd"]


def test_the_many_small_parts_of_a_file_are_joined_when_it_closes(tmp_path: Path) -> None:
    recording = LiveSink("file", str(tmp_path / "a.rrd")).open(KEYS[0])
    recording.lay_out(rrb.Blueprint(rrb.TimeSeriesView(name="Figure"), auto_views=False))
    for number in reversed(range(MAX_PARTS + 10)):
        log_steps(recording.stream, range(number, number + 1))
        recording.flush()
    in_parts = (tmp_path / "a.rrd").stat().st_size
    recording.close()
    assert (tmp_path / "a.rrd").stat().st_size < in_parts / 3
    assert rows(tmp_path / "a.rrd", "/figure") == MAX_PARTS + 10
    assert verifies(tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    assert [store.application_id for store in RrdReader(str(tmp_path / "a.rrd")).blueprints()] == ["personal-viz"]


def test_one_file_for_several_episodes_and_a_file_that_is_no_recording_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"found 2 episodes for one file; expected one\. Give a folder") as caught:
        live_sink(str(tmp_path / "a.rrd"), KEYS).__enter__()
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RecordingError, match=r"found a file that does not end in \.rrd"):
        live_sink(str(tmp_path / "notes.txt"), KEYS).__enter__()
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("option", ["http://127.0.0.1:1", "grpc://host", "rerun+http://:9/proxy", "grpc://a:99999"])
def test_an_address_in_a_wrong_form_gives_one_clear_line(option: str) -> None:
    with pytest.raises(RecordingError, match=r"expected FILE\.rrd, a folder, rerun\+http://HOST:PORT/proxy or spawn"):
        live_sink(option, KEYS).__enter__()


@pytest.mark.parametrize("form", ["rerun+http://127.0.0.1:{}/proxy", "grpc://127.0.0.1:{}"])
def test_an_address_without_a_viewer_gives_one_clear_line(form: str, dead_port: int) -> None:
    with pytest.raises(RecordingError, match=r"no viewer answers there .*Start one first with: rerun --port") as caught:
        live_sink(form.format(dead_port), KEYS).__enter__()
    assert "\n" not in str(caught.value)


def test_a_listener_that_never_answers_gives_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recordings.sinks.CONNECT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute, pytest.raises(RecordingError, match="no viewer answers there"):
        live_sink(f"grpc://127.0.0.1:{mute.getsockname()[1]}", KEYS).__enter__()


def test_both_forms_of_an_address_mean_the_same() -> None:
    with running_rerun("--serve-grpc") as server:
        port = server.port
        for form in ("grpc://127.0.0.1:{}", "grpc://127.0.0.1:{}/", "rerun+http://127.0.0.1:{}/proxy"):
            with live_sink(form.format(port), KEYS) as sink:
                assert sink == LiveSink("address", f"rerun+http://127.0.0.1:{port}/proxy")


def test_spawn_streams_to_a_viewer_that_we_start(monkeypatch: pytest.MonkeyPatch) -> None:
    lived: list[str] = []

    @contextlib.contextmanager
    def viewer() -> Iterator[str]:
        lived.append("opened")
        yield "rerun+http://127.0.0.1:1/proxy"
        lived.append("ended")

    monkeypatch.setattr("recordings.viewer.window.live_viewer", viewer)
    with live_sink("spawn", KEYS) as sink:
        assert sink == LiveSink("address", "rerun+http://127.0.0.1:1/proxy")
        assert lived == ["opened"]
    assert lived == ["opened", "ended"]


def test_a_viewer_that_disappears_gives_one_clear_line_and_nothing_hangs() -> None:
    with running_rerun("--serve-grpc") as server, live_sink(f"grpc://127.0.0.1:{server.port}", KEYS) as sink:
        recording = sink.open(KEYS[0])
        log_steps(recording.stream, range(3))
        recording.flush()
        server.process.kill()
        server.process.wait()
        log_steps(recording.stream, range(3, 6))
        with pytest.raises(RecordingError, match=r"the viewer took no more data .*expected it to stay open"):
            recording.flush()
        recording.close()


def in_child(body: str, *args: str) -> subprocess.CompletedProcess[str]:
    """Runs a program that has opened the sink `recording` on the file args[0]."""
    opening = """
        import os, signal, sys
        import rerun as rr
        from recordings.sinks import LiveSink
        from sim.types import EpisodeKey
        recording = LiveSink("file", sys.argv[1]).open(EpisodeKey("easy", "Box", "1"))
        def log(numbers):
            for number in numbers:
                recording.stream.set_time("step", sequence=number)
                recording.stream.log("/figure", rr.Scalars(float(number)))
    """
    program = textwrap.dedent(opening) + textwrap.dedent(body)
    return subprocess.run([sys.executable, "-c", program, *args], capture_output=True, text=True, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["os.kill(os.getpid(), signal.SIGKILL)", "os._exit(3)"])
def test_a_crash_during_an_episode_leaves_every_flushed_row_readable(tmp_path: Path, end: str) -> None:
    done = in_child(f"log(range(50)); recording.flush(); log(range(50, 60)); {end}", str(tmp_path / "a.rrd"))
    assert done.returncode in (-signal.SIGKILL, 3), done.stderr
    with pytest.warns(match="no footer"):
        assert rows(tmp_path / "a.rrd", "/figure") >= 50


def test_a_program_that_ends_during_an_episode_completes_the_file(tmp_path: Path) -> None:
    done = in_child("log(range(5)); sys.exit('agent failed')", str(tmp_path / "a.rrd"))
    assert done.returncode == 1
    assert done.stderr.strip() == "agent failed"
    assert rows(tmp_path / "a.rrd", "/figure") == 5
    assert verifies(tmp_path / "a.rrd")


@pytest.mark.slow
def test_a_full_disk_gives_one_clear_line_and_nothing_hangs(tmp_path: Path) -> None:
    body = """
        import resource
        from sim.errors import RecordingError
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))  # writing beyond it fails as on a full disk
        blob = os.urandom(3_000_000)  # more than a pipe holds
        try:
            for number in range(3):
                recording.stream.set_time("step", sequence=number)
                recording.stream.log("/picture", rr.EncodedImage(contents=blob, media_type="image/png"))
                recording.flush()
        except RecordingError as error:
            print(number, error)
    """
    done = in_child(body, str(tmp_path / "a.rrd"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"0 --rerun {tmp_path / 'a.rrd'}: cannot be written ([Errno")
    assert "expected a folder with space that you can write" in done.stdout
    assert done.stdout.count("\n") == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write everywhere")
def test_a_folder_without_write_permission_gives_one_clear_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(RecordingError, match="cannot be written"):
        LiveSink("file", str(tmp_path / "a.rrd")).open(KEYS[0])


def test_a_folder_in_the_place_of_a_file_gives_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "a.rrd").mkdir()
    with pytest.raises(RecordingError, match=r"a\.rrd: cannot be written .*Is a directory"):
        LiveSink("file", str(tmp_path / "a.rrd")).open(KEYS[0])


def test_closed_recordings_leave_no_threads_and_no_open_files(tmp_path: Path) -> None:
    def count() -> tuple[int, int]:
        return threading.active_count(), len(os.listdir("/dev/fd"))

    LiveSink("file", str(tmp_path / "warm.rrd")).open(KEYS[0]).close()
    before = count()
    for number in range(5):
        LiveSink("file", str(tmp_path / f"{number}.rrd")).open(KEYS[0]).close()
    assert count() == before

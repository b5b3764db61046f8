"""Destinations of recordings: an .rrd file that appears when whole, or a file, folder or viewer of a running episode.

The file of a running episode is written as the episode goes on, so that a crash leaves everything that was flushed; a
viewer shows it at once.
"""

import contextlib
import http.client
import os
import re
import select
import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, OptimizationProfile, RrdReader

from sim.errors import RecordingError
from sim.files import write_whole

from . import paths

CONNECT_S = 10.0
"""Longest wait for a viewer's answer; on a machine that is not busy it answers at once."""
FLUSH_S = 10.0
"""Longest wait until a viewer has received the data; after that it counts as gone."""
MAX_PARTS = 64
"""A file that was flushed more often is rewritten at its end, which takes half a second."""
SPAWN = "spawn"
_OTHER_OUT = "Give another --out."
_OTHER_PLACE = "Give another place; finished episodes are kept."
_ADDRESS = re.compile(
    r"(?:rerun\+http|grpc)://(?P<host>\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):(?P<port>\d{1,5})(?:/proxy)?/?"
)
_HOW_TO_CHOOSE = {"episode": " with --episode SPLIT/SCENE/ID", "exploration": ""}


@contextmanager
def open_recording(out: Path, key: paths.RecordingKey) -> Iterator[rr.RecordingStream]:
    """Yields the recording of one episode or exploration; the file appears at `out` if the block ends without an error.

    Rerun's strict mode is on inside; without it Rerun would warn about unusable data and drop it. Times of logging are
    left out, so that two recordings of the same runs have the same content. Rerun's own file writer is not used: on a
    full disk it waits for ever or raises without saying why.

    Raises:
        RecordingError: The file cannot be written.
    """
    beside = out.with_name(out.name + ".part")
    was_strict = rr.strict_mode()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        beside.open("wb").close()
    except OSError as error:
        raise _cannot_write(f"{out}", error, _OTHER_OUT) from None
    rr.set_strict_mode(True)
    try:
        stream = rr.RecordingStream(paths.APPLICATION_ID, recording_id=paths.recording_id(key), send_properties=False)
        stream.set_log_time_enabled(False)
        memory = stream.memory_recording()
        try:
            yield stream
            stream.flush()
            data = memory.drain_as_bytes()
        finally:
            stream.disconnect()
        try:
            write_whole(out, data)
        except OSError as error:
            raise _cannot_write(f"{out}", error, _OTHER_OUT) from None
    finally:
        rr.set_strict_mode(was_strict)
        beside.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class LiveSink:
    """A place for recordings of running episodes; small, so that it can be sent to worker processes."""

    kind: Literal["file", "folder", "address"]
    where: str
    """The file, the folder, or the viewer's address."""
    application_id: str = paths.APPLICATION_ID
    """A viewer separates recordings and layouts by application, because two people may do one episode at once."""

    def file_of(self, key: paths.RecordingKey) -> Path | None:
        """The file of a recording; None if a viewer receives it."""
        if self.kind == "address":
            return None
        return Path(self.where) if self.kind == "file" else Path(self.where) / paths.file_name(key)

    def open(self, key: paths.RecordingKey) -> "LiveRecording":
        """Opens the recording of one episode or exploration; an existing file is replaced.

        Raises:
            RecordingError: The file cannot be written.
        """
        rr.set_strict_mode(True)  # stays on: otherwise Rerun warns about unusable data and drops it
        stream = rr.RecordingStream(self.application_id, recording_id=paths.recording_id(key), send_properties=False)
        stream.set_log_time_enabled(False)
        path = self.file_of(key)
        if path is None:
            stream.connect_grpc(self.where)
            return LiveRecording(key, stream, self.where, None)
        return LiveRecording(key, stream, str(path), _PipedFile(path, stream))


@contextlib.contextmanager
def live_sink(option: str, keys: Sequence[paths.RecordingKey]) -> Iterator[LiveSink]:
    """Yields the sink that an option `--rerun` names: FILE.rrd, a folder, rerun+http://HOST:PORT/proxy, or spawn.

    Args:
        option: The user's option; grpc://HOST:PORT means the same as rerun+http://HOST:PORT/proxy.
        keys: The episodes or explorations that will be recorded.

    Raises:
        RecordingError: The option names one file for several episodes or has an unknown form, nobody listens at the
            address, or no viewer can be started.
    """
    if option == SPAWN:
        from .viewer.window import live_viewer

        with live_viewer() as address:
            yield LiveSink("address", address)
    elif "://" in option:
        yield LiveSink("address", _answering(option))
    elif option.endswith(".rrd"):
        if len(keys) > 1:
            raise RecordingError(
                f"--rerun {option}: found {len(keys)} {_what(keys[0])}s for one file; expected one. Give a folder (one "
                f"file per {_what(keys[0])}), or choose one{_HOW_TO_CHOOSE[_what(keys[0])]}."
            )
        yield LiveSink("file", option)
    else:
        if Path(option).is_file():
            raise RecordingError(
                f"--rerun {option}: found a file that does not end in .rrd; expected FILE.rrd, a folder, "
                "rerun+http://HOST:PORT/proxy or spawn. Give another name."
            )
        yield LiveSink("folder", option)


class LiveRecording:
    """One open recording. Call `flush` to make logged data visible, and `close` at the end."""

    def __init__(
        self, key: paths.RecordingKey, stream: rr.RecordingStream, where: str, file: "_PipedFile | None"
    ) -> None:
        """Takes an open stream; use `LiveSink.open` instead."""
        self.stream = stream
        self._key = key
        self._blueprint: rrb.Blueprint | None = None
        self._num_parts = 0
        self._where = where
        self._file = file
        self._finalizer = weakref.finalize(self, _end, stream, file)  # also at exit in the middle of an episode

    def lay_out(self, blueprint: rrb.Blueprint) -> None:
        """Makes the viewer show this layout from now on."""
        self._blueprint = blueprint
        self.stream.send_blueprint(blueprint)

    def flush(self) -> None:
        """Returns when all logged data is in the file, or with the viewer.

        Raises:
            RecordingError: The file cannot be written, or the viewer is gone.
        """
        try:
            self.stream.flush(timeout_sec=FLUSH_S)
        except RuntimeError as error:  # Rerun raises it for a lost connection
            self._finalizer.detach()
            threading.Thread(target=self.stream.disconnect, daemon=True).start()  # it may wait for an answer for ever
            reason = " ".join(str(error).split())
            raise RecordingError(
                f"--rerun {self._where}: the viewer took no more data ({reason}); expected it to stay open. Start it "
                "again, or write to a file: --rerun FILE.rrd."
            ) from None
        self._num_parts += 1
        if self._file is not None:
            self._file.require_written()

    def close(self) -> None:
        """Ends the recording, which completes a file.

        Raises:
            RecordingError: The file cannot be written, or the viewer is gone.
        """
        if not self._finalizer.alive:
            return
        self.flush()
        self._finalizer()
        if self._file is not None:
            self._file.require_written()
            if self._num_parts > MAX_PARTS and self._blueprint is not None:
                self._join_parts(self._file.path)

    def _join_parts(self, path: Path) -> None:
        """Rewrites the finished file with a few large chunks: each small chunk spends 2 kB on describing itself."""
        assert self._blueprint is not None
        reader = RrdReader(str(path))
        (store,) = reader.recordings()
        joined = reader.stream(store=store).collect(optimize=OptimizationProfile.OBJECT_STORE)
        with open_recording(path, self._key) as stream:
            # in time order, because a viewer starts at the first moment that it reads
            stream.send_chunks(sorted(joined.stream(), key=_first_step))
            stream.send_blueprint(self._blueprint)


class _PipedFile:
    """A file that receives the output of Rerun's own file writer through a pipe.

    If Rerun wrote the file itself, it would wait for ever on a full disk, or raise without saying why. Its byte streams
    in memory do not help: each part is a whole recording, and joined parts cannot be read.
    """

    def __init__(self, path: Path, stream: rr.RecordingStream) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._problem: OSError | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise _cannot_write(f"--rerun {path}", error, _OTHER_PLACE) from None
        self._outlet, inlet = os.pipe()
        os.set_blocking(self._outlet, False)
        self._thread = threading.Thread(target=self._copy_all, name=f"recording {path.name}", daemon=True)
        self._thread.start()
        try:
            stream.save(f"/dev/fd/{inlet}")
        finally:
            os.close(inlet)  # Rerun has its own copy; when it closes that, the thread ends

    def require_written(self) -> None:
        """Returns when all data that Rerun has flushed is in the file; raises RecordingError if that fails."""
        self._copy()
        if self._problem is not None:
            raise _cannot_write(f"--rerun {self.path}", self._problem, _OTHER_PLACE) from None

    def wait(self) -> None:
        """Returns when Rerun has closed its end and all data is in the file."""
        self._thread.join()

    def _copy_all(self) -> None:
        while True:
            select.select([self._outlet], [], [])
            if self._copy():
                break
        with self._lock:
            os.close(self._outlet)
            self._outlet = -1
            self._file.close()

    def _copy(self) -> bool:
        """Moves the pipe's contents into the file; returns whether the pipe has ended.

        It reads on after an error, because Rerun waits for it.
        """
        with self._lock:
            while self._outlet >= 0:
                try:
                    data = os.read(self._outlet, 1 << 20)
                except BlockingIOError:
                    return False
                if not data:
                    break
                self._write(data)
        return True

    def _write(self, data: bytes) -> None:
        if self._problem is not None:
            return
        try:
            left = memoryview(data)
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._problem = error


def _end(stream: rr.RecordingStream, file: _PipedFile | None) -> None:
    stream.disconnect()
    if file is not None:
        file.wait()


def _what(key: paths.RecordingKey) -> str:
    return "exploration" if isinstance(key, paths.ExplorationKey) else "episode"


def _first_step(chunk: Chunk) -> int:
    """The earliest step in a chunk; -1 for data that is shown at all times."""
    batch = chunk.to_record_batch()
    return -1 if chunk.is_static or paths.STEP not in batch.schema.names else min(batch.column(paths.STEP).to_pylist())


def _answering(option: str) -> str:
    """The address in Rerun's form, after checking that a viewer answers there."""
    match = _ADDRESS.fullmatch(option)
    port = int(match["port"]) if match else 0
    if match is None or not 0 < port < 65536:
        raise RecordingError(
            f"--rerun is {option!r}; expected FILE.rrd, a folder, rerun+http://HOST:PORT/proxy or spawn. "
            "Rerun's viewer says its address when it starts; by default it is rerun+http://127.0.0.1:9876/proxy."
        )
    probe = http.client.HTTPConnection(match["host"].strip("[]"), port, timeout=CONNECT_S)
    try:
        probe.request("HEAD", "/")  # Rerun would wait for ever for a server that never answers
        probe.getresponse()
    except (OSError, http.client.HTTPException) as error:
        raise RecordingError(
            f"--rerun {option}: no viewer answers there ({error}); expected a Rerun viewer. Start one first with: "
            f"rerun --port {port}, or let us do it: --rerun spawn."
        ) from None
    finally:
        probe.close()
    return f"rerun+http://{match['host']}:{port}/proxy"


def _cannot_write(where: str, error: OSError, advice: str) -> RecordingError:
    return RecordingError(
        f"{where}: cannot be written ({error}); expected a folder with space that you can write. {advice}"
    )

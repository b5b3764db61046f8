"""Open an .rrd for writing: gathered in memory, strict, written beside its place, renamed when whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr

from sim.errors import RecordingError
from sim.files import write_whole

from . import paths


@contextmanager
def open_recording(out: Path, key: paths.RecordingKey) -> Iterator[rr.RecordingStream]:
    """The recording of one episode or exploration; the file appears at `out` only when the block ends without an error.

    Rerun's strict mode is on inside: it would else warn and drop what it cannot use. Times of logging are left out, so
    that two recordings of the same runs have the same content. Rerun's own file writer is not used: on a full disk it
    waits for ever or raises without saying why.

    Raises:
        RecordingError: The file cannot be written.
    """
    beside = out.with_name(out.name + ".part")
    was_strict = rr.strict_mode()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        beside.open("wb").close()
    except OSError as error:
        raise _cannot_write(out, error) from None
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
            raise _cannot_write(out, error) from None
    finally:
        rr.set_strict_mode(was_strict)
        beside.unlink(missing_ok=True)


def _cannot_write(out: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"{out}: cannot be written ({error}); expected a folder with space that you can write. Give another --out."
    )

"""Open an .rrd for writing: beside its place, strict, renamed when whole."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr

from sim.errors import RecordingError
from sim.types import EpisodeKey

from . import paths


@contextmanager
def open_recording(out: Path, key: EpisodeKey) -> Iterator[rr.RecordingStream]:
    """The recording of one episode; the file appears at `out` only when the block ends without an error.

    Rerun's strict mode is on inside: it would else warn and drop what it cannot use. Times of logging are left out, so
    that two recordings of the same runs have the same content.

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
        stream.save(beside)
        try:
            yield stream
        finally:
            stream.flush()
            stream.disconnect()
        os.replace(beside, out)
    except OSError as error:
        raise _cannot_write(out, error) from None
    finally:
        rr.set_strict_mode(was_strict)
        beside.unlink(missing_ok=True)


def _cannot_write(out: Path, error: OSError) -> RecordingError:
    return RecordingError(f"{out}: cannot be written ({error}). Give --out a file in a folder that you can write.")

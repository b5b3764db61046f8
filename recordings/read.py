"""Logs the lines of run files into our recordings, and reads them back as runs.

A file that a crash cut short is read as far as possible: everything after the last whole message is left out, and so
are runs without an end.
"""

import re
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct
from typing import BinaryIO, NamedTuple, TypeVar

import pyarrow as pa
import rerun as rr
from pydantic import BaseModel, ValidationError
from rerun.chunk import Chunk, RrdReader

from sim.errors import RecordingError, line_from_validation_error
from sim.files import TooLargeError
from sim.sequences.runs import SequenceEnd, SequenceRun, SequenceStart
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, EpisodeStart, Run, RunInfo, Step

from . import paths

LINE, INFO, START, END = "line", "info", "start", "end"
"""Component names below a run's `record`: JSON texts as in the run folder."""
_Line = TypeVar("_Line", bound=BaseModel)
_HEAD = b"RRF2"
_HEAD_BYTES = 12
_MESSAGE = Struct("<QQ")
"""Head of each message of an .rrd file: the kind and length of the message after it (Rerun 0.41)."""
_DATA_KIND = 2
"""Kind of a message with rows, which are packed."""
_UNPACKED_FIELD = 3
"""Protobuf field of a message with rows: the size of its unpacked rows in bytes. Rerun trusts it."""
_MOST_FIELDS = 64
MAX_MESSAGE, MAX_ALL = 64 << 20, 1 << 30
"""Bytes that one message, and a whole file, may unpack to, in addition to `MAX_RATIO` times the file's size; an episode
of 500 steps with pictures needs a hundredth of that."""
MAX_RATIO = 8
_LAST_KIND = 0
"""Kind of the message that ends a recording; only its own start position follows it."""
_ENTITY = re.compile(rf"({paths.RUNS}/(?:\\.|[^/\\])+)/{paths.RECORD}(?:/(?:{LINE}|{END}))?")
_ADVICE = "Write the recording again from its run folders."


def log_record_start(
    stream: rr.RecordingStream, label: str, info: RunInfo, start: EpisodeStart | SequenceStart
) -> None:
    """Logs the run's facts and the start of its episode or home sequence."""
    texts = {INFO: info.model_dump_json(), START: start.model_dump_json()}
    stream.log(paths.run_path(label, paths.RECORD), rr.AnyValues(True, **texts), static=True)


def log_record_steps(
    stream: rr.RecordingStream, label: str, steps: Sequence[Step], *, times: Sequence[rr.TimeColumn]
) -> None:
    """Logs T steps at once; each of `times` has T rows."""
    lines = [step.model_dump_json() for step in steps]
    columns = rr.AnyValues.columns(True, **{LINE: lines})
    stream.send_columns(paths.run_path(label, paths.RECORD, LINE), times, columns)


def log_record_end(stream: rr.RecordingStream, label: str, end: EpisodeEnd | SequenceEnd) -> None:
    """Logs how it ended; a recording without it holds a run that was cut off."""
    entity = paths.run_path(label, paths.RECORD, END)
    stream.log(entity, rr.AnyValues(True, **{END: end.model_dump_json()}), static=True)


def log_record_answer(stream: rr.RecordingStream, label: str, info: RunInfo, answer: Answer) -> None:
    """Logs a whole POG answer."""
    texts = {INFO: info.model_dump_json(), LINE: answer.model_dump_json()}
    stream.log(paths.run_path(label, paths.RECORD), rr.AnyValues(True, **texts), static=True)


class Recorded(NamedTuple):
    """The contents of a recording."""

    runs: list[Run]
    """Whole runs and answers, grouped by `run.json` as in run folders, in the recording's order."""
    incomplete: tuple[str, ...]
    """Entities of the runs without an end, which are left out: their program was stopped."""
    is_whole: bool
    """Whether the file ends as Rerun ends a file; if not, whole runs may be lost too."""
    sequences: tuple[tuple[RunInfo, tuple[SequenceRun, ...]], ...] = ()
    """Runs of home sequences with the facts of their run folders, in the recording's order."""


def read_rrd(path: Path) -> list[Run]:
    """The whole runs and answers of a recording that `replay`, an observer or a study wrote.

    Runs of one `run.json` become one `Run`; runs that were cut off are left out (`read_recorded` names them).

    Raises:
        RecordingError: The file is no .rrd, holds none of our runs, or is damaged.
    """
    return read_recorded(path).runs


def read_recorded(path: Path) -> Recorded:
    """Like `read_rrd`, with the names of runs that were cut off.

    Raises:
        RecordingError: The file is no .rrd, holds none of our runs, or is damaged.
    """
    with _readable(path) as (readable, is_whole):
        records = _records(readable)
    if not records and is_whole:
        raise RecordingError(
            f"{path}: found no run; expected a recording made by personal-viz (replay, run --rerun, study serve "
            "--rerun). Other programs' recordings hold no run files."
        )
    infos: dict[str, RunInfo] = {}
    found: dict[str, list[EpisodeRun | Answer | SequenceRun]] = {}
    incomplete: list[str] = []
    for entity, record in records.items():
        where = f"{path}: {entity}/{paths.RECORD}"
        text = record.texts.get(INFO, "")
        if text and text not in infos:
            infos[text] = _parsed(RunInfo, text, where)
        item = record.item(where) if is_whole or text else None
        if item is None:
            incomplete.append(entity)
            continue
        found.setdefault(text, []).append(item)
    runs = [
        Run(
            info=infos[text],
            episodes=tuple(item for item in items if isinstance(item, EpisodeRun)),
            answers=tuple(item for item in items if isinstance(item, Answer)),
        )
        for text, items in found.items()
        if not isinstance(items[0], SequenceRun)
    ]
    sequences = {text: tuple(item for item in items if isinstance(item, SequenceRun)) for text, items in found.items()}
    told = tuple((infos[text], items) for text, items in sequences.items() if items)
    return Recorded(runs, tuple(incomplete), is_whole, told)


@dataclass(slots=True)
class _Record:
    """Gathers the JSON texts of one run or answer."""

    texts: dict[str, str] = field(default_factory=dict)
    """Text by component name; only an answer has `line`."""
    steps: list[tuple[int, str]] = field(default_factory=list)
    """(number from 1, line) of each step."""

    def add(self, chunk: Chunk) -> None:
        """Adds the texts of one chunk of a record's entity."""
        batch = chunk.to_record_batch()
        for name in {INFO, START, LINE, END} & set(batch.schema.names):
            texts = [row[0] for row in batch.column(name).to_pylist() if row]
            if chunk.is_static:
                self.texts[name] = texts[-1]
            else:
                self.steps += zip(batch.column(paths.STEP).cast(pa.int64()).to_pylist(), texts, strict=True)

    def item(self, where: str) -> EpisodeRun | Answer | SequenceRun | None:
        """The run or answer; None if its end is missing."""
        if INFO not in self.texts or not {START, LINE} & set(self.texts):
            raise RecordingError(f"{where}: found {sorted(self.texts)}; expected {INFO} and {START}. {_ADVICE}")
        if LINE in self.texts:
            return _parsed(Answer, self.texts[LINE], where)
        if END not in self.texts:
            return None
        numbers = [number for number, _ in sorted(self.steps)]
        if numbers != list(range(1, len(numbers) + 1)):
            raise RecordingError(f"{where}: found steps {numbers}; expected 1, 2, 3, ... {_ADVICE}")
        steps = tuple(_parsed(Step, text, where) for _, text in sorted(self.steps))
        is_sequence = self.texts[START].startswith('{"kind":"sequence"')
        start = _parsed(SequenceStart if is_sequence else EpisodeStart, self.texts[START], where)
        end = _parsed(SequenceEnd if is_sequence else EpisodeEnd, self.texts[END], where)
        try:
            if isinstance(start, SequenceStart) and isinstance(end, SequenceEnd):
                return SequenceRun(start=start, steps=steps, end=end)
            assert isinstance(start, EpisodeStart)
            assert isinstance(end, EpisodeEnd)
            return EpisodeRun(start=start, steps=steps, end=end)
        except ValidationError as error:
            raise RecordingError(line_from_validation_error(where, error, advice=_ADVICE)) from None


def _parsed(model: type[_Line], text: str, where: str) -> _Line:
    try:
        return model.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise RecordingError(line_from_validation_error(where, error, advice=_ADVICE)) from None


def _records(path: Path) -> dict[str, _Record]:
    """Entity of each run, `/runs/<label>`, to its texts, in the order of the file."""
    records: dict[str, _Record] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Rerun warns about every file that a crash cut short
        reader = RrdReader(str(path))
        for number, store in enumerate(reader.recordings()):
            for chunk in reader.stream(store=store):
                match = _ENTITY.fullmatch(chunk.entity_path)
                if match:
                    name = match[1] if number == 0 else f"{match[1]} of recording {number + 1}"
                    records.setdefault(name, _Record()).add(chunk)
    return records


@contextmanager
def _readable(path: Path) -> Iterator[tuple[Path, bool]]:
    """Yields a file that Rerun can read, and whether the recording is whole.

    The file is `path` itself, or a copy up to its last whole message: Rerun's reader returns nothing for a file that
    ends within a message, as files of killed programs do.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            end, is_whole = _end_of_messages(file, path.stat().st_size)
            file.seek(0)
            kept = b"" if is_whole else file.read(end)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error}); expected a recording. Check the path.") from None
    if not head.startswith(_HEAD) or len(head) < _HEAD_BYTES:
        raise RecordingError(
            f"{path}: found bytes {head[:4]!r} at its start; expected an .rrd file. Give a file that ends in .rrd."
        )
    if is_whole:
        yield path, True
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "cut.rrd"
        copy.write_bytes(kept)
        yield copy, False


def _end_of_messages(file: BinaryIO, size: int) -> tuple[int, bool]:
    """Position where the last whole message ends, and whether it is the one that ends a recording.

    Reads on from the end of the file's head.
    """
    end, kind, total = _HEAD_BYTES, -1, 0
    while kind != _LAST_KIND and len(message := file.read(_MESSAGE.size)) == _MESSAGE.size:
        kind_read, length = _MESSAGE.unpack(message)
        if end + _MESSAGE.size + length > size:
            break
        if kind_read == _DATA_KIND:
            unpacked = _announced(file, end + _MESSAGE.size, length)
            total += unpacked
            if unpacked > MAX_MESSAGE + MAX_RATIO * size or total > MAX_ALL + MAX_RATIO * size:
                raise TooLargeError("unpacks to more than any recording of its size")
        end, kind = end + _MESSAGE.size + length, kind_read
        file.seek(end)
    return end, kind == _LAST_KIND


def _announced(file: BinaryIO, start: int, length: int) -> int:
    """The unpacked size in bytes that a message with rows announces; the rows themselves are not read.

    Raises:
        TooLargeError: The message has more fields than Rerun writes, or different ones.
    """
    at, end, largest = start, start + length, 0
    for _ in range(_MOST_FIELDS):
        if at >= end:
            return largest
        file.seek(at)
        head = file.read(min(20, end - at))
        tag, used = _varint(head, 0)
        if tag & 7 == 1 or tag & 7 == 5:  # eight bytes, four bytes
            at += used + (8 if tag & 7 == 1 else 4)
            continue
        value, used = _varint(head, used)
        if tag >> 3 == _UNPACKED_FIELD and tag & 7 == 0:
            largest = max(largest, value)
        at += used + (value if tag & 7 == 2 else 0)
    raise TooLargeError("has a message of more fields than any recording")


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """(number, end position) of a protobuf varint; 7 bits per byte, the lowest first."""
    value = 0
    for used, byte in enumerate(data[at : at + 10]):
        value |= (byte & 127) << (7 * used)
        if byte < 128:
            return value, at + used + 1
    raise TooLargeError("has a message that is no row of a recording")

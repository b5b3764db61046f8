"""Files that are never half-written, and files from elsewhere that are read up to a limit.

A small file can announce huge content, or unpack to it. Read such files with `bounded_bytes` and `bounded_json`. Above
a limit they raise `TooLargeError`, an OSError, so callers report it like any file that cannot be read.
"""

import errno
import io
import math
import os
import secrets
import stat
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MAX_JSON_BYTES = 32 << 20
"""Largest JSON document, unpacked; the largest released content file has 1.2 MB."""
MAX_JSON_VALUES = 250_000
"""Most values of a JSON document; the largest released file has 37,000. Each one that fits no model takes 800 bytes."""
MAX_LINE_BYTES = 4 << 20
"""Longest line of a JSONL file; a step has 300 bytes."""
MAX_LINE_VALUES = 100_000
_MAX_MEMBERS = 100
"""Most parts of a gzip file; programs write one."""


class TooLargeError(OSError):
    """A file holds, or unpacks to, more than any real one of its kind; its text is only the reason."""

    def __init__(self, found: str) -> None:
        """Takes the reason: the amount that is too large."""
        super().__init__(errno.EFBIG, found)

    def __str__(self) -> str:
        """The reason, without an error number."""
        return str(self.strerror)


def bounded_bytes(path: Path, most: int) -> bytes:
    """All bytes of a file.

    Raises:
        TooLargeError: There are more than `most` bytes, or the file is not a regular one and could have any number.
        OSError: It cannot be read.
    """
    with open(path, "rb", opener=_open_at_once) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise TooLargeError("is not a regular file")
        data = file.read(most + 1)
    if len(data) > most:
        raise TooLargeError(f"has more than {_amount(most)}")
    return data


def bounded_json(path: Path, *, most: int = MAX_JSON_BYTES, most_values: int = MAX_JSON_VALUES) -> bytes:
    """The text of a JSON file, unpacked when its name ends in .gz; not parsed, but safe to parse.

    Raises:
        TooLargeError: It holds more than `most` bytes or `most_values` values.
        OSError: It cannot be read.
        EOFError: It ends in the middle of the packed data.
        zlib.error: It is not a gzip file.
    """
    data = bounded_bytes(path, most)
    if path.suffix == ".gz":
        data = _unpacked(data, most)
    require_few_values(data, most_values)
    return data


def bounded_lines(path: Path) -> Iterator[bytes]:
    """The lines of a file of JSON lines one after the other, each safe to parse.

    Raises:
        TooLargeError: A line holds more bytes or values than any real one.
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        while line := file.readline(MAX_LINE_BYTES + 1):
            if len(line) > MAX_LINE_BYTES:
                raise TooLargeError(f"has a line of more than {_amount(MAX_LINE_BYTES)}")
            require_few_values(line, MAX_LINE_VALUES)
            yield line


def require_few_values(data: bytes, most: int) -> None:
    """Raises TooLargeError where JSON text holds more than `most` values; commas in texts count too."""
    if sum(map(data.count, (b",", b"[", b"{"))) > most:
        raise TooLargeError(f"holds more than {most} values")


def npy_array(data: bytes) -> NDArray[np.generic]:
    """The array of a `.npy` file's bytes, read-only and without a copy; its announced size must be that of its bytes.

    Raises:
        ValueError, SyntaxError, TypeError: The bytes are not such a file, or hold Python objects.
    """
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, dtype = read(stream)
    if dtype.hasobject:
        raise ValueError("it is pickled; expected plain numbers")
    left = len(data) - stream.tell()
    if math.prod(shape) * dtype.itemsize != left:
        raise ValueError(f"it announces {shape} x {dtype.itemsize} bytes and holds {left}")
    if not dtype.itemsize:  # empty texts
        return np.zeros(shape, dtype)
    values = np.frombuffer(data, dtype, offset=stream.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")


def require_small_archive(archive: zipfile.ZipFile, *, most: int, most_members: int = 1000) -> None:
    """Raises TooLargeError where a zip file announces more; bytes beyond a member's announced size are not read."""
    members = archive.infolist()
    if len(members) > most_members:
        raise TooLargeError(f"has {len(members)} members")
    if sum(member.file_size for member in members) > most:
        raise TooLargeError(f"unpacks to more than {_amount(most)}")


def _unpacked(data: bytes, most: int) -> bytes:
    """The unpacked content of a gzip file: all its members, at most `most` bytes."""
    parts: list[bytes] = []
    for _ in range(_MAX_MEMBERS):
        member = zlib.decompressobj(wbits=31)
        parts.append(member.decompress(data, most + 1 - sum(map(len, parts))))
        if sum(map(len, parts)) > most:
            raise TooLargeError(f"unpacks to more than {_amount(most)}")
        if not member.eof:
            raise EOFError("it ends in the middle of the packed data")
        data = member.unused_data.lstrip(b"\0")
        if not data:
            return b"".join(parts)
    raise TooLargeError(f"has more than {_MAX_MEMBERS} gzip members")


def _amount(size: int) -> str:
    return f"{size >> 20} MB" if size >= 1 << 20 else f"{size >> 10} kB"


def _open_at_once(name: str, flags: int) -> int:
    """Opens without waiting for the other end of a pipe."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a new file, then rename it: readers see the old file or the whole new one. Makes the folder.

    Several processes may write one path at once; the last one stays.

    Raises:
        OSError: The folder or the file cannot be written; the file is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    try:
        with beside.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def append_whole(path: Path, text: str) -> None:
    """Append to a text file; it is on disk when this returns; if writing fails, the file is cut back to its old length.

    Raises:
        OSError: The file cannot be written, e.g. because the disk is full; it is as it was.
    """
    with path.open("ab", buffering=0) as file:  # a buffer would be written again when the file is closed
        size = file.tell()
        left = memoryview(text.encode())
        try:
            while left:
                left = left[file.write(left) :]
            os.fsync(file.fileno())
        except OSError:
            os.truncate(path, size)
            raise

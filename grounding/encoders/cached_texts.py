"""Encodes each text once: vectors are kept in memory and, for slow encoders, in a file between runs.

A sweep encodes the same 16,000 phrases again and again. The file is SQLite, one per vector space, shared by processes.
It may be deleted at any time; if it cannot be used, all texts are encoded.
"""

import contextlib
import sqlite3
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .protocol import TextEncoder

_MAX_TEXTS = 50_000
_WAIT_S = 30.0
"""Longest wait for another process's write."""
_PER_READ = 500
"""Texts per query; SQLite allows at least 999 values."""
_PER_WRITE = 256
"""Number of new vectors to collect in memory before a write; a write waits for the disk (20 ms on a busy one), and a
killed process loses at most this many."""


class CachedTextEncoder:
    """A `TextEncoder` that asks the real one only for texts that it does not know."""

    def __init__(self, encoder: TextEncoder, *, file: Path | None = None, max_texts: int = _MAX_TEXTS) -> None:
        """Wraps `encoder`; reads nothing yet.

        Args:
            file: Keeps the vectors between runs; its name must hold everything that they depend on. None = no file.
            max_texts: With this many texts in memory, all are forgotten.
        """
        self.name, self.dim = encoder.name, encoder.dim
        self._encoder, self._file, self._max_texts = encoder, file, max_texts
        self._rows: dict[str, NDArray[np.float32]] = {}
        self._unwritten: dict[str, NDArray[np.float32]] = {}
        if file is not None:  # writes the rest when the program ends, too
            weakref.finalize(self, _write, file, self._unwritten)

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; all new texts are encoded in one call."""
        wanted = dict.fromkeys(texts)
        if len(self._rows | wanted) > self._max_texts:
            self._rows.clear()
        unknown = [text for text in wanted if text not in self._rows]
        if self._file is not None and unknown:
            self._rows |= _read(self._file, unknown, dim=self.dim)
            unknown = [text for text in unknown if text not in self._rows]
        if unknown:
            self._add(dict(zip(unknown, self._encoder.encode_texts(unknown), strict=True)))
        return np.array([self._rows[text] for text in texts], np.float32).reshape(len(texts), self.dim)

    def _add(self, rows: dict[str, NDArray[np.float32]]) -> None:
        self._rows |= rows
        if self._file is not None:
            self._unwritten |= rows
            if len(self._unwritten) >= _PER_WRITE:
                _write(self._file, self._unwritten)


def _read(path: Path, texts: list[str], *, dim: int) -> dict[str, NDArray[np.float32]]:
    """The vectors of those texts that the file knows; damaged ones are left out."""
    found: dict[str, NDArray[np.float32]] = {}
    if not path.is_file():
        return found
    with contextlib.suppress(sqlite3.Error, OSError), _open(path) as store:
        for start in range(0, len(texts), _PER_READ):
            some = texts[start : start + _PER_READ]
            marks = ",".join("?" * len(some))
            for text, data in store.execute(f"SELECT text, vector FROM vectors WHERE text IN ({marks})", some):
                if len(data) == 4 * dim:
                    found[text] = np.frombuffer(data, "<f4").astype(np.float32)
    return found


def _write(path: Path, rows: dict[str, NDArray[np.float32]]) -> None:
    """Moves the rows to the file; if that fails they are dropped."""
    some = [(text, np.asarray(row, "<f4").tobytes()) for text, row in rows.items()]
    rows.clear()
    if not some:
        return
    with contextlib.suppress(sqlite3.Error, OSError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with _open(path) as store:
            store.execute("CREATE TABLE IF NOT EXISTS vectors (text TEXT PRIMARY KEY, vector BLOB)")
            store.executemany("INSERT OR IGNORE INTO vectors VALUES (?, ?)", some)


@contextlib.contextmanager
def _open(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection whose changes are kept when the block ends without an error."""
    with contextlib.closing(sqlite3.connect(path, timeout=_WAIT_S)) as store, store:
        yield store

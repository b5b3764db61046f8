"""Keeps vectors of texts on disk between runs, because a sweep encodes the same 16,000 phrases again and again.

One SQLite file per vector space in the cache folder, shared by processes. It may be deleted at any time; if it cannot
be used, all texts are encoded.
"""

import contextlib
import sqlite3
import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.cache import cache_dir

from .protocol import TextEncoder

_WAIT_S = 30.0
"""Longest wait for another process's write."""
_PER_READ = 500
"""Texts per query; SQLite allows at least 999 values."""
_PER_WRITE = 256
"""Number of new vectors to collect in memory before a write; a write waits for the disk (20 ms on a busy one), and a
killed process loses at most this many."""


class StoredTextEncoder:
    """A `TextEncoder` that loads the real one only when a text has never been encoded before on this machine."""

    def __init__(
        self, load: Callable[[], TextEncoder], *, name: str, dim: int, key: str, folder: Path | None = None
    ) -> None:
        """Loads and reads nothing yet.

        Args:
            load: Makes the encoder; called once, when it is needed.
            name: The encoder's name.
            dim: The encoder's dimension.
            key: Everything that the vectors depend on, e.g. a digest of the weights; part of the file's name.
            folder: Folder of the file; default `vectors` in the cache folder.
        """
        self.name, self.dim = name, dim
        self._load, self._encoder = load, None
        self._path = (folder or cache_dir() / "vectors") / f"{name}-{key}.sqlite"
        self._unwritten: dict[str, NDArray[np.float32]] = {}
        # writes the rest when the program ends, too
        weakref.finalize(self, _write, self._path, self._unwritten)

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows, taken from the file where it has them."""
        different = list(dict.fromkeys(texts))
        known = self._unwritten | self._read([text for text in different if text not in self._unwritten])
        new = [text for text in different if text not in known]
        if new:
            self._encoder = self._encoder or self._load()
            rows = dict(zip(new, self._encoder.encode_texts(new), strict=True))
            known |= rows
            self._unwritten |= rows
            if len(self._unwritten) >= _PER_WRITE:
                _write(self._path, self._unwritten)
        return np.array([known[text] for text in texts], np.float32).reshape(len(texts), self.dim)

    def _read(self, texts: list[str]) -> dict[str, NDArray[np.float32]]:
        found: dict[str, NDArray[np.float32]] = {}
        if not texts or not self._path.is_file():
            return found
        with contextlib.suppress(sqlite3.Error, OSError), _open(self._path) as store:
            for start in range(0, len(texts), _PER_READ):
                some = texts[start : start + _PER_READ]
                marks = ",".join("?" * len(some))
                for text, data in store.execute(f"SELECT text, vector FROM vectors WHERE text IN ({marks})", some):
                    if len(data) == 4 * self.dim:
                        found[text] = np.frombuffer(data, "<f4").astype(np.float32)
        return found


def _write(path: Path, rows: dict[str, NDArray[np.float32]]) -> None:
    """Writes the rows to the file; if that fails they are dropped."""
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

"""Keeps the vectors of a long recording's pictures in a folder until its map is written, so that a run can continue.

Encoding is the costly part of a map. Each batch of pictures is one file, named by the encoder and the pictures'
content; a later run with the same encoder, recording and batches reads it and makes the same map, bit for bit.
"""

import hashlib
import io
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError
from sim.files import npy_array, write_whole
from sim.tasks.shards import Shard
from sim.types import Frame

from .protocol import DenseEncoder


class ResumedEncoder:
    """A `DenseEncoder` that asks the real one only for batches that no earlier run has encoded.

    As a shard it asks only for every N-th batch, and gives zeros for the others: runs of all shards fill one folder.
    """

    def __init__(self, encoder: DenseEncoder, folder: Path, *, settings: str, shard: Shard = Shard()) -> None:  # noqa: B008 - frozen value
        """Wraps `encoder`; reads and writes nothing yet.

        Args:
            folder: Made with the first batch, and removed by `remove`.
            settings: All that the vectors depend on besides the encoder's name, such as its arithmetic.
            shard: The part of the batches that is encoded; each run must get the same batches in the same order.
        """
        self.name, self.dim = encoder.name, encoder.dim
        self.num_kept = 0
        """Number of pictures whose vectors were read."""
        self.num_encoded = 0
        """Number of pictures whose vectors were made and written."""
        self._num_batches, self._shard = 0, shard
        self._encoder, self._folder = encoder, folder
        self._settings = f"{encoder.name}\0{encoder.dim}\0{settings}"

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows, by the real encoder."""
        return self._encoder.encode_texts(texts)

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows, one per picture."""
        return self._kept("images", frames, self._encoder.encode_images, absent=(self.dim,))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of patches."""
        return self._kept("patches", frames, self._encoder.encode_patches, absent=(1, 1, self.dim))

    def remove(self) -> None:
        """Removes the folder, when the map is written."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _kept(
        self,
        what: str,
        frames: Sequence[Frame],
        encode: Callable[[Sequence[Frame]], NDArray[np.float32]],
        *,
        absent: tuple[int, ...],
    ) -> NDArray[np.float32]:
        """The vectors of a batch; zeros of shape `absent` for each picture where another shard encodes it."""
        self._num_batches += 1
        if (self._num_batches - 1) % self._shard.of != self._shard.number - 1:
            return np.zeros((len(frames), *absent), np.float32)
        path = self._folder / f"{self._digest(what, frames)}.npy"
        if (found := _read(path, len(frames))) is not None:
            self.num_kept += len(frames)
            return found
        vectors = encode(frames)
        self.num_encoded += len(frames)
        stream = io.BytesIO()
        np.lib.format.write_array(stream, np.ascontiguousarray(vectors, np.float32), allow_pickle=False)
        try:
            write_whole(path, stream.getvalue())
        except OSError as error:
            raise RunFileError(
                f"{path}: cannot be written ({error.strerror}); expected a folder with room that you may write. Give "
                "another --out."
            ) from None
        return vectors

    def _digest(self, what: str, frames: Sequence[Frame]) -> str:
        digest = hashlib.blake2b(f"{self._settings}\0{what}".encode(), digest_size=16)
        for frame in frames:
            digest.update(f"\0{frame.rgb.shape}\0".encode())
            digest.update(frame.rgb.tobytes())
            digest.update(frame.depth_m.tobytes())  # a user's own encoder may look at it
        return digest.hexdigest()


def _read(path: Path, count: int) -> NDArray[np.float32] | None:
    """The vectors of a batch; None if they are missing or damaged."""
    try:
        found = npy_array(path.read_bytes())
    except (OSError, ValueError, SyntaxError, TypeError, EOFError):
        return None
    return found.astype(np.float32) if found.dtype == np.float32 and found.ndim and len(found) == count else None

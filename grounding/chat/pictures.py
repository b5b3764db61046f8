"""Pictures in a form that chat endpoints take."""

import base64
import io
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image

LONGEST_SIDE = 1024
"""Pictures are scaled down to this many pixels: servers charge for more, and many scale them down themselves."""
_KEPT = 40
"""Pictures whose files are kept: the episodes of a home show the same ones, and packing one takes 50 ms."""


def png_of(picture: NDArray[np.uint8], *, longest: int = LONGEST_SIDE) -> bytes:
    """A PNG file of a picture (H, W, 3); it is scaled down if a side is longer than `longest` pixels."""
    assert picture.shape[2:] == (3,), picture.shape
    return _png_of(np.asarray(picture, np.uint8).tobytes(), picture.shape[1], picture.shape[0], longest)


@lru_cache(maxsize=_KEPT)
def _png_of(pixels: bytes, width: int, height: int, longest: int) -> bytes:
    image = Image.frombytes("RGB", (width, height), pixels)
    if max(image.size) > longest:
        image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def data_url(png: bytes) -> str:
    """The address that holds the whole file."""
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"

"""Pictures in a form that chat endpoints take."""

import base64
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

LONGEST_SIDE = 1024
"""Pictures are scaled down to this many pixels: servers charge for more, and many scale them down themselves."""


def png_of(picture: NDArray[np.uint8], *, longest: int = LONGEST_SIDE) -> bytes:
    """A PNG file of a picture (H, W, 3); it is scaled down if a side is longer than `longest` pixels."""
    assert picture.shape[2:] == (3,), picture.shape
    image = Image.fromarray(np.ascontiguousarray(picture, np.uint8))
    if max(image.size) > longest:
        image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def data_url(png: bytes) -> str:
    """The address that holds the whole file."""
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"

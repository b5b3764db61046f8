"""A robot's view as HTML for a panel."""

import base64
import html
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

_QUALITY = 80


def picture_html(rgb: NDArray[np.uint8], *, step: int, caption: str) -> str:
    """The picture (H, W, 3) as an inline JPEG with a line below it."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=_QUALITY)
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'<div class="bw"><img alt="What the robot saw" data-step="{step}" src="data:image/jpeg;base64,{data}" '
        f'style="width:100%;height:auto;border-radius:6px"><p class="dim">{html.escape(caption)}</p></div>'
    )

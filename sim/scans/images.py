"""PNG, JPEG, WebP and Basis images as arrays; sizes are read from the headers first, to refuse images that are huge."""

import io
import struct
from typing import Literal, NamedTuple

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .basis import basis_rgb, basis_size, is_basis
from .scene_files import Bytes, FilePart

MAX_SIDE = 16384
MAX_TEXELS = 3 << 27
"""Most texels of all textures of one scene together, 1.2 GB: 96 of 2048 x 2048."""
MAX_WORK = 1 << 29
"""Most bytes for decoding an image, and for all images that are decoded at once."""
_PNG_CHANNELS = {0: 2, 2: 4, 3: 4, 4: 2, 6: 4}
"""Channels by colour type; types without alpha may have a transparent colour, which becomes an alpha channel."""
_BASIS_WORK = 8
"""Bytes per texel: RGBA, its flipped rows, and the packed copy."""
_WEBP_WORK = 8
"""Bytes per texel: RGBA, and RGB with its copy in another tint."""
_CMYK_WORK = 12
_PROGRESSIVE = frozenset({0xC2, 0xC6, 0xCA, 0xCE})
_MAX_SCANS = 100
"""Most scans of a progressive JPEG; encoders make fewer, and more would take minutes to decode."""
_SIZE_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xD8)})
_KIND = "a PNG, JPEG, WebP or Basis image"


class EncodedImage(NamedTuple):
    """An image in the form of its file."""

    data: Bytes
    kind: Literal["png", "jpeg", "webp", "basis"]
    width: int
    height: int
    work: int
    """Most bytes for decoding it, including the final texels and their copy in another tint."""
    part: FilePart
    """Its name in errors."""


def measured(data: Bytes, part: FilePart) -> EncodedImage:
    """An image's kind and size, from its first bytes.

    Raises:
        SceneError: The kind is unknown, the header is damaged, or the image has more than 16384 texels a side or takes
            more than `MAX_WORK` to decode, which is possible for small files too.
    """
    head = bytes(data[:32])
    kind = "basis"
    if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) >= 24:
        kind, size, each = "png", struct.unpack(">II", head[16:24]), _png_work(head)
    elif head.startswith(b"\xff\xd8"):
        kind, (*size, each) = "jpeg", _jpeg_size(data, part)
    elif (webp := _webp_size(head)) is not None:
        kind, size, each = "webp", webp, _WEBP_WORK
    elif is_basis(data):
        size, each = basis_size(data, part), _BASIS_WORK
    else:
        raise part.refused(f"starts with {head[:8]!r}", _KIND, advice="Export the scene with such textures.")
    width, height = size
    work = int(width * height * each)
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and work <= MAX_WORK):
        expected = f"at least 1, at most {MAX_SIDE} a side and {MAX_WORK} bytes while it is decoded, not {work}"
        raise part.refused(f"has {width} x {height} texels", expected, advice="Make the texture smaller.")
    return EncodedImage(data, kind, width, height, work, part)


def decoded(image: EncodedImage) -> NDArray[np.uint8]:
    """The texels (height, width, 3) of an image, top row first, alpha dropped. Runs without the interpreter lock.

    Raises:
        SceneError: The content is damaged.
        MissingDependencyError: It is a Basis image and the extra `basis` is not installed.
    """
    try:
        if image.kind == "basis":
            texels = basis_rgb(image.data, (image.width, image.height), image.part)
        elif image.kind == "png":
            texels = _rgb(imagecodecs.png_decode(bytes(image.data)))
        elif image.kind == "webp":
            texels = _rgb(imagecodecs.webp_decode(bytes(image.data)))
        else:
            texels = _jpeg(bytes(image.data))
    except (imagecodecs.PngError, imagecodecs.Jpeg8Error, imagecodecs.WebpError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:80]
        raise image.part.refused(f"cannot be decoded ({reason})", f"a whole {image.kind.upper()} image") from None
    if texels.shape != (image.height, image.width, 3):
        raise image.part.refused(f"decodes to {texels.shape}", f"{(image.height, image.width, 3)}, as its header says")
    return texels


def tinted(texels: NDArray[np.uint8], factor: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The texels (h, w, 3) times a base colour (3,), 0-1; the same array where it is white."""
    if (np.abs(factor - 1) <= 1e-8).all():
        return texels
    levels = np.clip(np.arange(256)[:, None] * factor + 0.5, 0, 255).astype(np.uint8)
    tinted = np.empty_like(texels)
    for channel in range(3):
        tinted[..., channel] = levels[:, channel][texels[..., channel]]
    return tinted


def _rgb(texels: NDArray) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 from grey, grey with alpha, RGB or RGBA of 8 or 16 bits."""
    if texels.ndim == 2:
        texels = texels[..., None]
    texels = texels[..., : 3 if texels.shape[2] >= 3 else 1]
    if texels.shape[2] == 3 and texels.dtype == np.uint8:
        return np.ascontiguousarray(texels)
    rgb = np.empty((*texels.shape[:2], 3), np.uint8)
    np.right_shift(texels, 8 if texels.dtype == np.uint16 else 0, out=rgb, casting="unsafe")
    return rgb


def _jpeg(data: bytes) -> NDArray[np.uint8]:
    if data.rfind(b"\xff\xd9") < 0:  # the decoder would invent the missing part
        raise ValueError("it has no end")
    texels = imagecodecs.jpeg8_decode(data)
    if texels.ndim == 3 and texels.shape[2] == 4:  # CMYK: only Pillow knows whether it is inverted
        del texels
        with Image.open(io.BytesIO(data), formats=["JPEG"]) as image:
            return np.array(image.convert("RGB"))
    return _rgb(texels)


def _webp_size(head: bytes) -> tuple[int, int] | None:
    """(width, height) from the first 30 bytes of a WebP image, None if they begin no such image.

    Its first part is a lossy picture (`VP8 `), a lossless one (`VP8L`), or says what follows (`VP8X`).
    """
    if len(head) < 30 or head[:4] != b"RIFF" or head[8:12] != b"WEBP":
        return None
    if head[12:16] == b"VP8X":
        return int.from_bytes(head[24:27], "little") + 1, int.from_bytes(head[27:30], "little") + 1
    if head[12:16] == b"VP8L":
        bits = int.from_bytes(head[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    width, height = struct.unpack("<HH", head[26:30])
    return (width & 0x3FFF, height & 0x3FFF) if head[12:16] == b"VP8 " else None


def _png_work(head: bytes) -> int:
    """Bytes per texel for decoding, from depth and colour type in a PNG's header; unknown types cannot be decoded."""
    depth, colour_type = head[24:26].ljust(2, b"\0")
    return _PNG_CHANNELS.get(colour_type, 4) * (2 if depth > 8 else 1) + 3


def _jpeg_work(content: bytes, at: int) -> float:
    """Bytes per texel for decoding, from the frame header at `at`.

    If each scan holds only a part of the coefficients, a decoder keeps all of them, two bytes for each.
    """
    count = content[at + 9] if len(content) > at + 9 else 0
    if count > 3:
        return _CMYK_WORK
    each = 6.0
    if content[at + 1] in _PROGRESSIVE or content.count(b"\xff\xda", at) > 1:
        sampling = [(value >> 4) * (value & 15) for value in content[at + 11 : at + 10 + 3 * count : 3]]
        each += 2 * sum(sampling) / max(*sampling, 1)
    return each


def _jpeg_size(data: Bytes, part: FilePart) -> tuple[int, int, float]:
    """(width, height, work per texel) from the frame header; the segments before it are skipped."""
    content = bytes(data)
    if content.count(b"\xff\xda") > _MAX_SCANS:
        raise part.refused(f"has more than {_MAX_SCANS} scans", "an ordinary JPEG image")
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0:  # decoders would look for the next segment inside this one
            break
        if marker in _SIZE_MARKERS:
            height, width = struct.unpack(">HH", content[at + 5 : at + 9])
            return width, height, _jpeg_work(content, at)
        if marker == 0xFF or marker in _WITHOUT_LENGTH:
            at += 1 if marker == 0xFF else 2
        else:
            at += 2 + struct.unpack(">H", content[at + 2 : at + 4])[0]
    raise part.refused("is a JPEG without size", _KIND)

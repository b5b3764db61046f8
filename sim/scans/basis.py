"""Basis Universal textures (`.basis` and KTX2) of HM3D's small files as arrays. Needs the extra `basis`.

Each texture is transcoded once; its lossless copy in the cache (zstd) is read four times faster.
"""

import binascii
import hashlib
import math
import struct

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from sim.cache import cached_bytes
from sim.errors import MissingDependencyError

from .scene_files import Bytes, FilePart

_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
_VERSION = "rgb-1"
"""Part of the cache's key; change it with every change of the texels."""
_BASIS_HEADER = 77
_SLICE = 23
_KTX2_HEADER = 80
_BLOCK_BYTES = 16
"""Bytes of the largest kind of block, 4 x 4 texels."""
_MAX_LEVELS = 16
_CODEC_NAMES = ("ETC1S", "UASTC")
_EXPECTED = "a whole Basis image"
_LEVEL = 1
"""Compression level of zstd; higher levels gain little here."""


def is_basis(data: Bytes) -> bool:
    """Whether a file starts as `.basis` or KTX2."""
    return bytes(data[:12]) == _KTX2 or bytes(data[:2]) == b"sB"


def basis_size(data: Bytes, part: FilePart) -> tuple[int, int]:
    """(width, height) of the largest level, from the header alone.

    Raises:
        SceneError: The header is damaged, or the file is not one image with its mip levels.
    """
    if bytes(data[:12]) == _KTX2:
        if len(data) < _KTX2_HEADER:
            raise part.refused(f"has {len(data)} bytes", _EXPECTED)
        width, height, depth, layers, faces, levels = struct.unpack("<6I", bytes(data[20:44]))
        if depth or layers > 1 or faces != 1:
            found = f"is a KTX2 file of depth {depth}, {layers} layers and {faces} faces"
            raise part.refused(found, "one image", advice="Export the scene with plain textures.")
        _require_honest_levels(data, (width, height, levels), part)
        return width, height
    if len(data) < _BASIS_HEADER + _SLICE:
        raise part.refused(f"has {len(data)} bytes", _EXPECTED)
    data = _basis_file(data, part)
    (start,) = struct.unpack("<I", bytes(data[65:69]))
    piece = bytes(data[start : start + _SLICE])
    if len(piece) < _SLICE:
        raise part.refused(f"has its first level at byte {start}", f"at most {len(data) - _SLICE}")
    width, height = struct.unpack("<HH", piece[5:9])
    return width, height


def basis_rgb(data: Bytes, size: tuple[int, int], part: FilePart) -> NDArray[np.uint8]:
    """The largest level (height, width, 3) of a Basis image, top row first; made once and kept in the cache folder.

    A `.basis` file has its bottom row first, as HM3D's have; like Habitat, we ignore its flag. A KTX2 file has its top
    row first unless its `KTXorientation` says that y points up. `size` is that of `basis_size`, which checks the file.

    Raises:
        SceneError: The content is damaged.
        MissingDependencyError: The image is not in the cache and the extra `basis` is not installed.
    """
    width, height = size
    if bytes(data[:2]) == b"sB":
        data = data[: _BASIS_HEADER + struct.unpack("<I", bytes(data[8:12]))[0]]

    def packed() -> bytes:
        texels = _transcoded(bytes(data), part)
        return bytes(imagecodecs.zstd_encode(texels.tobytes(), level=_LEVEL))

    key = f"{_VERSION} {hashlib.sha256(data.data).hexdigest()}"
    texels = _unpacked(cached_bytes("texels", key, packed), (height, width, 3))
    if texels is None:  # a damaged copy only costs time
        texels = _unpacked(packed(), (height, width, 3))
    if texels is None:
        raise part.refused(f"is not {width} x {height}", "the size in its header")
    return texels


def _transcoded(data: bytes, part: FilePart) -> NDArray[np.uint8]:
    """The texels (height, width, 3), top row first."""
    try:
        import opengl_basisu
    except ImportError:
        raise MissingDependencyError(
            f"{part.path}: {part.what} is a Basis texture, which needs opengl_basisu; expected the extra `basis`. "
            'Install it with: pip install "personal-viz[basis]"; or use the plain <name>.glb.'
        ) from None
    try:
        texture = opengl_basisu.open(data)
        if texture.codec.name.split("_")[0] not in _CODEC_NAMES or texture.is_video:
            raise part.refused(f"is of Basis kind {texture.codec.name}", "ETC1S or UASTC")
        rgba = np.asarray(texture.transcode(opengl_basisu.Target.RGBA8).data, np.uint8)
    except (opengl_basisu.BasisuError, IndexError) as error:
        raise part.refused(f"cannot be decoded ({error})", _EXPECTED) from None
    rows = rgba[::-1] if texture.container == "basis" or _points_up(data) else rgba
    return np.ascontiguousarray(rows[..., :3])


def _unpacked(content: bytes, shape: tuple[int, int, int]) -> NDArray[np.uint8] | None:
    """The texels of a packed image; None unless their number is right."""
    try:
        texels = np.frombuffer(imagecodecs.zstd_decode(content, out=math.prod(shape)), np.uint8)
    except imagecodecs.ZstdError:
        return None
    return texels.reshape(shape) if texels.size == math.prod(shape) else None


def _points_up(data: bytes) -> bool:
    """Whether the key-value data of a KTX2 file says that the first row is the bottom one."""
    start, length = struct.unpack("<II", data[56:64])
    block = data[start : start + length]
    at = 0
    while at + 4 <= len(block):
        (size,) = struct.unpack("<I", block[at : at + 4])
        name, _, value = block[at + 4 : at + 4 + size].partition(b"\0")
        if name == b"KTXorientation":
            return value[1:2] == b"u"
        at += 4 + size + -size % 4
    return False


def _require_honest_levels(data: Bytes, size: tuple[int, int, int], part: FilePart) -> None:
    """Raises SceneError when a level of a KTX2 file lies outside the file, or unpacks to more than its blocks."""
    width, height, levels = size
    blocks = (width + 3) // 4 * ((height + 3) // 4) * _BLOCK_BYTES
    for level in range(min(max(levels, 1), _MAX_LEVELS + 1)):
        piece = bytes(data[_KTX2_HEADER + 24 * level : _KTX2_HEADER + 24 * (level + 1)])
        start, length, unpacked = struct.unpack("<3Q", piece.ljust(24, b"\xff"))
        if level >= _MAX_LEVELS or start + length > len(data) or unpacked > blocks:
            found = f"has a level {level} of {length} bytes at {start}, {unpacked} unpacked"
            raise part.refused(found, f"at most {_MAX_LEVELS} levels in {len(data)} bytes, {blocks} unpacked")


def _basis_file(data: Bytes, part: FilePart) -> Bytes:
    """A `.basis` file without its padding; raises SceneError unless its content's checksum is right."""
    header_size, _, size, crc = struct.unpack("<HHIH", bytes(data[4:14]))
    content = data[_BASIS_HEADER : _BASIS_HEADER + size]
    if header_size != _BASIS_HEADER or len(content) < size:
        raise part.refused(f"has {len(data)} bytes", f"{_BASIS_HEADER} + {size}")
    if binascii.crc_hqx(content.data, 0xFFFF) ^ 0xFFFF != crc:  # CRC-16 with all bits inverted at both ends
        raise part.refused("has a wrong checksum", _EXPECTED)
    return data[: _BASIS_HEADER + size]

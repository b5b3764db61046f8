"""The look of a glTF primitive's faces: base colour, image, and the place on it. Feeds glb.py.

A mesh's textures repeat. Images that the file clamps or mirrors are enlarged to the part that its faces really show;
where that would be more than nine times the image, they repeat anyway.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .gltf_file import GltfFile
from .gltf_schema import CLAMP_TO_EDGE, MIRRORED_REPEAT, REPEAT, Sampler, TextureInfo
from .images import MAX_TEXELS, MAX_WORK, EncodedImage, decoded, measured, tinted
from .scene_files import FilePart, MissingFileError, file_beside, resource, warn_of_missing

MAX_TEXTURES = 1 << 15
_MAX_ENCODED = 1 << 30
"""Most bytes of all images in the file together; images may overlap there."""
_PLAIN = (200 / 255, 200 / 255, 200 / 255)
"""Grey of materials without a colour."""
_MAX_UV = float(1 << 20)
"""Larger texture coordinates have no digits left for a place on the image; they become 0, as NaN does."""
_MAX_GROWTH = 9
"""A clamped or mirrored image may grow to this many times its own size."""
_MODES: dict[int, Literal["edge", "symmetric"]] = {CLAMP_TO_EDGE: "edge", MIRRORED_REPEAT: "symmetric"}


class Look(NamedTuple):
    """The visible part of a primitive's material without lights."""

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Base colour; texels and vertex colours are multiplied by it."""
    plain: tuple[float, float, float] = _PLAIN
    """Colour of faces without image and vertex colours."""
    image: int | None = None
    """Index into the file's images."""
    coordinates: str = ""
    """Attribute with the texture coordinates."""
    uv_from_uv: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """(2, 3) matrix of KHR_texture_transform, None without."""
    wrap: tuple[int, int] = (REPEAT, REPEAT)
    """Wrapping modes along u and v."""


class _Padding(NamedTuple):
    """The growth of an image along one side."""

    before: int
    """Texels added before the image."""
    after: int
    mode: Literal["edge", "symmetric"]
    """Mode of `np.pad` for the added texels."""


_NO_PADDING = _Padding(0, 0, "edge")


class _Texture(NamedTuple):
    """One image of the mesh, made from one image of the file."""

    image: int
    factor: tuple[float, float, float]
    padding: tuple["_Padding", "_Padding"]
    """Padding along v and u."""


def look_of(file: GltfFile, material: int | None) -> Look:
    """The look of a material; lights, other maps and alpha are left out. A missing file of an image is a warning.

    Raises:
        SceneError: The material names a texture or image that the file does not list, or a format that we cannot read.
    """
    if material is None:
        return Look()
    found = file.get("materials", material, of="a primitive")
    pbr, glossiness = found.pbr_metallic_roughness, found.extensions.glossiness
    factor = pbr.base_color_factor if pbr else None
    info = pbr.base_color_texture if pbr else None
    if info is None and factor is None and glossiness is not None:
        factor, info = glossiness.diffuse_factor, glossiness.diffuse_texture
    look = Look()
    if factor is not None:
        red, green, blue = (min(max(value, 0.0), 1.0) for value in factor[:3])
        look = Look((red, green, blue), (red, green, blue))
    if info is None:
        return look
    texture = file.get("textures", info.index, of=f"materials.{material}")
    image = _image_of(file, info.index)
    if _is_missing(file, image):
        return look
    sampler = Sampler()
    if texture.sampler is not None:
        sampler = file.get("samplers", texture.sampler, of=f"textures.{info.index}")
    transform = info.extensions.transform
    uv_set = info.tex_coord if transform is None or transform.tex_coord is None else transform.tex_coord
    return look._replace(
        image=image,
        coordinates=f"TEXCOORD_{uv_set}",
        uv_from_uv=_uv_from_uv(info),
        wrap=(sampler.wrap_s, sampler.wrap_t),
    )


class TextureSet:
    """Collects the textures that parts of a mesh use, and decodes each once."""

    def __init__(self, file: GltfFile) -> None:
        """Starts empty."""
        self._file = file
        self._images: dict[int, EncodedImage] = {}
        self._sources: dict[object, int] = {}
        self._textures: dict[_Texture, int] = {}
        self._texels = self._bytes = 0

    def place(self, look: Look, uv: NDArray[np.float32]) -> int:
        """The index that the look's texture will have; `uv` is changed to coordinates on that texture.

        Args:
            look: A look with an image.
            uv: (N, 2) the file's coordinates; changed in place.

        Raises:
            SceneError: The image is missing or unreadable, or all textures together are too large.
        """
        assert look.image is not None
        if look.uv_from_uv is not None:
            matrix = np.array(look.uv_from_uv)
            with np.errstate(over="ignore", invalid="ignore"):
                uv[...] = uv @ matrix[:, :2].T + matrix[:, 2]
        usable = np.abs(uv) <= _MAX_UV
        if not usable.all():
            uv[~usable] = 0
        image, encoded = self._encoded(look.image)
        sides = encoded.width, encoded.height
        across, down = (_padding(uv[:, axis], sides[axis], look.wrap[axis]) for axis in (0, 1))
        if (sides[0] + sum(across[:2])) * (sides[1] + sum(down[:2])) > _MAX_GROWTH * sides[0] * sides[1]:
            across = down = _NO_PADDING
        for axis, (before, after, _) in enumerate((across, down)):
            if before or after:
                uv[:, axis] = (uv[:, axis] * sides[axis] + before) / (sides[axis] + before + after)
        return self._index(_Texture(image, look.factor, (down, across)), encoded)

    def textures(self) -> tuple[NDArray[np.uint8], ...]:
        """All textures, (h, w, 3) each, in the order of their indices.

        Raises:
            SceneError: An image is damaged.
            MissingDependencyError: An image is a Basis texture and the extra `basis` is not installed.
        """
        used = sorted({texture.image for texture in self._textures})
        most = max((self._images[index].work for index in used), default=1)
        workers = min(len(used), os.cpu_count() or 1, MAX_WORK // most) or 1
        made: dict[_Texture, NDArray[np.uint8]] = {}
        with ThreadPoolExecutor(workers) as pool:
            for textures in pool.map(self._made_of, used):
                made |= textures
        return tuple(made[texture] for texture in self._textures)

    def _index(self, texture: _Texture, encoded: EncodedImage) -> int:
        if texture not in self._textures:
            down, across = texture.padding
            self._texels += (encoded.height + sum(down[:2])) * (encoded.width + sum(across[:2]))
            if self._texels > MAX_TEXELS or len(self._textures) >= MAX_TEXTURES:
                found = f"{len(self._textures) + 1} textures have {self._texels} texels"
                expected = f"at most {MAX_TEXELS} in {MAX_TEXTURES}"
                raise self._file.refused(found, expected, advice="Make the textures smaller.")
            self._textures[texture] = len(self._textures)
        return self._textures[texture]

    def _encoded(self, index: int) -> tuple[int, EncodedImage]:
        """The file's first image with the same content, and that content."""
        image = self._file.get("images", index, of="a texture")
        source = image.buffer_view if image.uri is None else image.uri
        index = self._sources.setdefault(source, index)
        if index not in self._images:
            part = FilePart(self._file.path, f"images.{index}")
            if source is None:
                raise part.refused("has no bufferView and no uri", "one of them")
            by_uri = isinstance(source, str)
            content = resource(part, source) if by_uri else self._file.view(source, of=part.what)
            self._bytes += len(content)
            if self._bytes > _MAX_ENCODED:
                found = f"the images have {self._bytes} bytes or more"
                raise self._file.refused(found, f"at most {_MAX_ENCODED}", advice="Make the textures smaller.")
            self._images[index] = measured(content, part)
        return index, self._images[index]

    def _made_of(self, index: int) -> dict[_Texture, NDArray[np.uint8]]:
        """All textures made from one image; the image itself is not kept."""
        texels = decoded(self._images[index])
        return {texture: _finished(texels, texture) for texture in self._textures if texture.image == index}


def _image_of(file: GltfFile, index: int) -> int:
    """The image of a texture; a plain one is preferred to WebP, and both to Basis, which needs an extra."""
    texture = file.document.textures[index]
    other = texture.extensions.webp or texture.extensions.khronos or texture.extensions.google
    source = texture.source if texture.source is not None else other and other.source
    if source is None:
        used = ", ".join(file.document.extensions_used[:5]) or "none"
        found = f"textures.{index} has no image that we know (the file's extensions: {used})"
        raise file.refused(found, "PNG, JPEG, WebP or Basis", advice="Export the scene with such textures.")
    file.get("images", source, of=f"textures.{index}")
    return source


def _is_missing(file: GltfFile, index: int) -> bool:
    """Whether an image should lie in a file of its own and does not, after a warning."""
    uri = file.document.images[index].uri
    if uri is None or uri.startswith("data:"):
        return False
    try:
        file_beside(FilePart(file.path, f"images.{index}"), uri)
    except MissingFileError as error:
        warn_of_missing(error)
        return True
    return False


def _uv_from_uv(info: TextureInfo) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """(2, 3): first scale, then turn, then shift. v points down, so that turning left takes +u towards -v."""
    transform = info.extensions.transform
    if transform is None:
        return None
    cos, sin = math.cos(transform.rotation), math.sin(transform.rotation)
    (su, sv), (u, v) = transform.scale, transform.offset
    return (cos * su, sin * sv, u), (-sin * su, cos * sv, v)


def _padding(values: NDArray[np.float32], texels: int, wrap: int) -> _Padding:
    """The padding for coordinates (N,) of faces that reach beyond a non-repeating image of this many texels.

    Less than one texel outside is a rounding error of coordinates that should end at the edge.
    """
    if wrap not in _MODES:
        return _NO_PADDING
    before, after = -float(values.min()) * texels, (float(values.max()) - 1) * texels
    if max(before, after) < 1:
        return _NO_PADDING
    return _Padding(math.ceil(before) if before >= 1 else 0, math.ceil(after) if after >= 1 else 0, _MODES[wrap])


def _finished(texels: NDArray[np.uint8], texture: _Texture) -> NDArray[np.uint8]:
    """The texels times the base colour, enlarged where the image must not repeat."""
    texels = tinted(texels, np.array(texture.factor))
    for axis, (before, after, mode) in enumerate(texture.padding):
        if before or after:
            pads = [(0, 0)] * 3
            pads[axis] = (before, after)
            texels = np.pad(texels, pads, mode=mode)
    return texels

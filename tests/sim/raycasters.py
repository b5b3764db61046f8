"""Shared by tests of the raycaster: a view from above, and random triangles."""

import math
from dataclasses import replace

import numpy as np

from sim.errors import MissingDependencyError
from sim.frames import T_world_camera
from sim.mesh import TriangleMesh
from sim.render import embree
from sim.render.raycast import Raycaster
from sim.types import Camera, Frame, Pose

from .meshes import floor, mesh_of

LOOK_DOWN = Pose((0.0, 0.0, 0.0), 0.0, -math.pi / 2)
"""A view whose image right is +x and image down +z, from a camera 0.88 m up."""


def has_embree() -> bool:
    """Whether Embree's packets can be used here."""
    try:
        return embree.self_test().name == "embree"
    except MissingDependencyError:
        return False


def seen_from_above(raycaster: Raycaster, x: float, z: float, camera: Camera | None = None):
    """RGB and id of the floor at (x, z), seen by a robot at the origin that looks down."""
    camera = camera or Camera()
    frame = raycaster.render(T_world_camera(LOOK_DOWN, camera), camera)
    f = camera.focal / 0.88
    row, col = math.floor(camera.height / 2 + f * z), math.floor(camera.width / 2 + f * x)
    return tuple(frame.rgb[row, col].tolist()), int(frame.instance_ids[row, col])


def soup(seed: int, *, faces: int = 200, is_lit: bool = False) -> TriangleMesh:
    """Random triangles around the origin with an object id each; half of them are textured, all lit if `is_lit`."""
    rng = np.random.default_rng(seed)
    mesh = mesh_of(*[floor(0, 0, 1, 1)] * ((faces + 1) // 2))
    centres = rng.uniform(-3, 3, (len(mesh.faces), 1, 3))
    return replace(
        mesh,
        vertices=(centres + rng.uniform(-1, 1, (len(mesh.faces), 3, 3))).reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * len(mesh.faces), dtype=np.int32).reshape(-1, 3),
        face_rgb=rng.integers(0, 256, (len(mesh.faces), 3), np.uint8),
        face_instance=np.arange(1, len(mesh.faces) + 1, dtype=np.int32),
        face_texture=rng.integers(-1, 1, len(mesh.faces)).astype(np.int16),
        face_uv=rng.uniform(-2, 2, (len(mesh.faces), 3, 2)).astype(np.float32),
        textures=(rng.integers(0, 256, (13, 10, 3), np.uint8),),
        vertex_rgb=rng.integers(0, 256, (3 * len(mesh.faces), 3), np.uint8) if is_lit else None,
    )


def assert_same(one: Frame, other: Frame) -> None:
    """Fails unless the two frames are equal to the last bit."""
    np.testing.assert_array_equal(one.rgb, other.rgb)
    np.testing.assert_array_equal(one.depth_m, other.depth_m)
    np.testing.assert_array_equal(one.instance_ids, other.instance_ids)

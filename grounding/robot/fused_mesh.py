"""A coloured mesh of a recording, which everything that opens a scan opens: depth fused in Open3D's TSDF volume."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from sim.errors import SceneError
from sim.mesh import VERTEX_COLOURS, TriangleMesh
from sim.types import Frame

from ..maps.occupancy import measured

VOXEL = 0.02
"""Side of a voxel, metres."""
_BLOCK, _BLOCKS = 8, 20_000
"""Voxels along a side of a block, and the number of blocks for which there is room at first."""
_STRIDE = 4
"""Open3D looks at every fourth pixel of every fourth row for the blocks that a picture touches."""
_LEAST_VIEWS = 2.0
"""A voxel that fewer frames see is no surface."""
_LEAST_FACES = 200
"""Smaller loose parts are noise."""


def fused_mesh(frames: Iterable[Frame], *, max_depth: float) -> TriangleMesh:
    """The surfaces that these frames show, in the frame of their poses, with colours at the vertices.

    Args:
        frames: Posed views; they are read once.
        max_depth: Farther returns are left out, planar metres.

    Raises:
        SceneError: The views show no surface.
    """
    import open3d  # takes seconds to import

    o3d: Any = open3d
    core, image = o3d.core, lambda pixels: o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(pixels)))
    volume = o3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(core.float32, core.float32, core.float32),
        attr_channels=((1,), (1,), (3,)),
        voxel_size=VOXEL,
        block_resolution=_BLOCK,
        block_count=_BLOCKS,
    )
    is_empty = True
    for frame in frames:
        fx, fy, cx, cy = frame.camera.lens
        K = core.Tensor(np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1.0]]))  # its pixels' centres are whole
        depth_m = np.nan_to_num(np.abs(measured(frame.depth_m)), nan=0.0)  # no edges; a flat angle is no harm here
        looked_at = depth_m[::_STRIDE, ::_STRIDE]
        if not ((looked_at > 0) & (looked_at < max_depth)).any():
            continue  # Open3D raises where a picture touches no block
        depth = image(depth_m)
        T_camera_map = core.Tensor(np.linalg.inv(frame.T_world_camera))
        reach = {"depth_scale": 1.0, "depth_max": max_depth}
        blocks = volume.compute_unique_block_coordinates(depth, K, T_camera_map, **reach)
        rgb = image(frame.rgb.astype(np.float32))
        volume.integrate(blocks, depth, rgb, K, K, T_camera_map, **reach)
        is_empty = False
    if is_empty:  # Open3D finds no surface in an empty volume, and raises
        found = o3d.geometry.TriangleMesh()
    else:
        found = volume.extract_triangle_mesh(weight_threshold=_LEAST_VIEWS).to_legacy()
    part, counts, _ = found.cluster_connected_triangles()
    is_kept = np.asarray(counts)[np.asarray(part)] >= _LEAST_FACES if len(counts) else np.zeros(0, bool)
    if not is_kept.any():
        raise SceneError(
            f"--mesh: the recording has {len(np.asarray(found.triangles))} triangles, none of them in a surface of "
            f"{_LEAST_FACES} or more; expected surfaces that {_LEAST_VIEWS:g} frames see. Take more frames (--every)."
        )
    return _mesh_of(found, is_kept)


def _mesh_of(found: Any, is_kept: np.ndarray) -> TriangleMesh:
    """Open3D's mesh with the faces that are kept (F,) and their vertices."""
    found.remove_triangles_by_mask(~is_kept)
    found.remove_unreferenced_vertices()
    faces = np.asarray(found.triangles, np.int32)
    rgb = np.rint(np.clip(np.asarray(found.vertex_colors), 0, 255)).astype(np.uint8)
    return TriangleMesh(
        vertices=np.asarray(found.vertices, np.float32),
        faces=faces,
        face_rgb=rgb[faces].mean(axis=1).astype(np.uint8),
        face_instance=np.zeros(len(faces), np.int32),
        face_texture=np.full(len(faces), VERTEX_COLOURS, np.int16),
        face_uv=np.zeros((len(faces), 3, 2), np.float32),
        vertex_rgb=rgb,
    )

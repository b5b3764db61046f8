"""A recording's frames become a coloured mesh whose surfaces lie where the room's are."""

from dataclasses import replace

import numpy as np
import pytest

from grounding.checks.room import check_views
from grounding.robot.fused_mesh import fused_mesh
from sim.errors import SceneError
from sim.mesh import VERTEX_COLOURS

FRAMES = [replace(view.frame, ids=None) for view in check_views()]


def test_surfaces_and_colours_are_those_of_the_room() -> None:
    mesh = fused_mesh(FRAMES, max_depth=5.0)
    assert (mesh.face_texture == VERTEX_COLOURS).all()
    assert mesh.vertex_rgb is not None
    on_floor = np.abs(mesh.vertices[:, 1]) < 0.03
    assert on_floor.mean() > 0.1
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lies = np.abs(corners[:, :, 1]).max(axis=1) < 0.03
    assert (normals[lies, 1] > 0).mean() > 0.95  # the floor faces up
    seen = np.unique(np.concatenate([frame.rgb.reshape(-1, 3) for frame in FRAMES]), axis=0).astype(int)
    off = np.abs(mesh.vertex_rgb[::50].astype(int)[:, None] - seen[None]).max(axis=2).min(axis=1)
    assert np.median(off) < 6


def test_the_same_frames_give_the_same_places() -> None:
    first, again = (fused_mesh(FRAMES[::2], max_depth=5.0) for _ in range(2))
    assert len(first.faces) == len(again.faces)
    np.testing.assert_allclose(np.sort(first.vertices, axis=0), np.sort(again.vertices, axis=0), atol=1e-5)


def test_frames_without_depth_are_refused() -> None:
    blind = [replace(frame, depth_m=np.zeros_like(frame.depth_m)) for frame in FRAMES[:2]]
    with pytest.raises(SceneError, match=r"--mesh: .*Take more frames"):
        fused_mesh(blind, max_depth=5.0)

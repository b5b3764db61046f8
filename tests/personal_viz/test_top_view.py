"""Pictures from straight above: parallel, to scale, in true colours, and exact between pixels and the world."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from human_study.trial.events import Clicked, event_from_json, event_to_json
from personal_viz.study_app.home.top_view import PAPER, PIXELS_PER_METRE, STRIP, TopView, map_grid, top_views
from sim.mesh import FLAT, Scene, SceneObject, TriangleMesh
from sim.types import GridSpec

from ..human_study.small_world import HALF, SquareRoom
from ..human_study.trials import RAY

GREY, RED, BLUE = (120, 120, 120), (200, 30, 30), (20, 40, 220)
VIEW = TopView(GridSpec((-4.0, -3.0), 0.02, (300, 400)), 3.0, "Storey 1 of 1", b"")


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[NDArray, NDArray]:
    """Corners (8, 3) and faces (12, 3) of an upright box."""
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))], np.int32)


def room(*, kind: str = "scan", digest: str = "a" * 64) -> Scene:
    """A grey floor with a red box of 0.5 x 0.4 m, 1.5 m high, near a corner, and a blue thin wall."""
    parts = [
        (box((-HALF, -0.1, -HALF), (HALF, 0.0, HALF)), GREY),
        (box((2.0, 0.0, 2.0), (2.5, 1.5, 2.4)), RED),
        (box((-2.52, 0.0, -2.0), (-2.48, 1.6, 2.0)), BLUE),
    ]
    vertices = np.concatenate([corners for (corners, _), _ in parts])
    faces = np.concatenate([part + 8 * number for number, ((_, part), _) in enumerate(parts)]).astype(np.int32)
    rgb = np.repeat(np.array([colour for _, colour in parts], np.uint8), 12, axis=0)
    count = len(faces)
    mesh = TriangleMesh(
        vertices=vertices,
        faces=faces,
        face_rgb=rgb,
        face_instance=np.zeros(count, np.int32),
        face_texture=np.full(count, FLAT, np.int16),
        face_uv=np.zeros((count, 3, 2), np.float32),
    )
    item = SceneObject(1, "chest_1", "chest", (2.25, 0.75, 2.2), (0.5, 1.5, 0.4))
    return Scene("room", kind, mesh, (item,), SquareRoom(), digest)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("cache")
def test_edges_in_the_world_are_edges_in_the_picture_whatever_their_height_and_colours_are_true() -> None:
    (view,) = top_views(room())
    rgb, grid = view.rgb()[:-STRIP].astype(int), view.grid
    red = np.argwhere(np.abs(rgb - RED).max(axis=2) <= 2)
    low, high = grid.uv_from_xz(np.array([(2.0, 2.0), (2.5, 2.4)]))
    assert red.min(axis=0).tolist() == pytest.approx(low[::-1], abs=0.51)
    assert (red.max(axis=0) + 1).tolist() == pytest.approx(high[::-1], abs=0.51)
    assert len(red) == pytest.approx(0.5 * 0.4 / grid.cell**2, rel=0.02)
    blue = np.argwhere(np.abs(rgb - BLUE).max(axis=2) <= 2)
    assert np.ptp(blue[:, 1]) + 1 == pytest.approx(0.04 / grid.cell, abs=1.01)  # a wall 1.6 m high does not lean
    row, col = grid.rc_from_xz(np.array([0.0, 0.0]))
    assert rgb[row, col].tolist() == list(GREY)
    assert rgb[0, 0].tolist() == list(PAPER)
    assert Image.open(io.BytesIO(view.jpeg())).size == (grid.shape[1], grid.shape[0] + STRIP)


def test_the_picture_covers_all_walkable_places_out_to_whole_metres() -> None:
    grid = map_grid(room())
    per_metre = round(1 / grid.cell)
    assert per_metre == PIXELS_PER_METRE[0]
    assert grid.origin_xz == (-4.0, -4.0)
    assert grid.shape == (8 * per_metre, 8 * per_metre)


def test_pixels_nest_in_the_agents_cells() -> None:
    grid = map_grid(room())
    agents = GridSpec((-25.0, -25.0), 1.0, (50, 50))  # corners on whole metres, as grounding.oracle lays them
    rc = np.argwhere(np.ones(grid.shape, bool))[::997]
    per_metre = round(1 / grid.cell)
    cells = agents.rc_from_xz(grid.xz_from_rc(rc))
    offset = np.array([21, 21])
    assert (cells == rc // per_metre + offset).all()


@given(u=st.floats(0, 399.999), v=st.floats(0, 299.999))
def test_a_place_on_the_picture_is_one_place_in_the_world_and_back(u: float, v: float) -> None:
    xz = VIEW.grid.xz_from_uv(np.array([u, v]))
    pixel = VIEW.pixel_at((float(xz[0]), float(xz[1])))
    if pixel is None:  # rounding at the very edge
        assert min(u, v, 400 - u, 300 - v) < 1e-6
        return
    assert pixel.uv == pytest.approx((u, v), abs=1e-9)
    point = pixel.point(VIEW.floor_y)
    assert point == pytest.approx((-4.0 + 0.02 * u, 3.0, -3.0 + 0.02 * v), abs=1e-9)
    stored = event_from_json(event_to_json(Clicked(ray=RAY, hit=point, pixel=pixel)))
    assert isinstance(stored, Clicked)
    assert stored.pixel.point(3.0) == stored.hit == point


@pytest.mark.parametrize("xz", [(-4.001, 0.0), (4.0, 0.0), (0.0, -3.001), (0.0, 3.0)])
def test_a_point_outside_the_picture_or_on_its_strip_is_no_place(xz: tuple[float, float]) -> None:
    assert VIEW.pixel_at(xz) is None


def test_a_picture_is_made_once_and_anew_for_another_home(cache: Path) -> None:
    first = top_views(room())
    (kept,) = (cache / "png").iterdir()
    kept.write_bytes(b"kept")
    assert top_views(room())[0].png == b"kept"
    other = top_views(room(digest="b" * 64))
    assert other[0].png == first[0].png  # the same bytes again
    assert len(list((cache / "png").iterdir())) == 2


@pytest.mark.usefixtures("cache")
def test_only_homes_that_are_no_scans_have_their_objects_named() -> None:
    scan, invented = (top_views(room(kind=kind, digest=kind))[0].rgb() for kind in ("scan", "invented"))
    row, col = map_grid(room()).rc_from_xz(np.array([2.25, 2.2]))
    patch = slice(row - 8, row + 8), slice(col - 20, col + 20)
    assert (scan[patch] == RED).all()
    assert not (invented[patch] == RED).all()

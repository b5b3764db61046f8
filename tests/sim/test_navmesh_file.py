"""The reader of `.navmesh` files reads all their parts and refuses every damaged file."""

import contextlib
import struct

import numpy as np
import pytest

from sim.errors import SceneError
from sim.walk.navmesh import NavMesh, load_navmesh
from sim.walk.navmesh_file import NavMeshSettings, read_navmesh
from tests.sim.navmesh_files import l_shape, navmesh_bytes, plate, two_storeys, write_navmesh

TILE = 96 + 8  # the byte at which the tile starts in a file of version 2
POLYGONS = TILE + 100 + 8 * 12  # the L has 8 corners


@pytest.fixture
def path(tmp_path):
    return tmp_path / "home.navmesh"


def changed(content: bytes, at: int, form: str, *values) -> bytes:
    size = struct.calcsize("<" + form)
    return content[:at] + struct.pack("<" + form, *values) + content[at + size :]


def refusal(path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_navmesh(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    return text


def test_polygons_neighbours_and_settings_are_read(path):
    settings = NavMeshSettings(agent_height=0.88, agent_radius=0.18, filter_ledge_spans=False)
    data = read_navmesh(write_navmesh(path, l_shape(), settings=settings))
    assert data.version == 2
    assert (data.settings.agent_height, data.settings.agent_radius) == pytest.approx((0.88, 0.18))
    assert (data.settings.filter_ledge_spans, data.settings.filter_low_hanging_obstacles) == (False, True)
    assert data.counts.tolist() == [4, 4, 4]
    assert data.neighbours[:, :4].tolist() == [[-1, -1, 1, -1], [0, 2, -1, -1], [-1, -1, -1, 1]]
    assert data.vertices[data.corners[0, :4]].tolist() == plate(0, 0, 4, 2).tolist()


def test_a_mesh_fits_the_agent_it_was_built_for_and_one_of_version_1_fits_habitats_default_agent(path):
    mesh = load_navmesh(write_navmesh(path, l_shape(), version=1))
    assert mesh.settings == NavMeshSettings()
    assert mesh.fits(0.1, 1.5)
    assert not mesh.fits(0.18, 0.88)
    assert mesh.distance(np.array([1, 0, 1]), np.array([3, 0, 1])) == 2.0
    mesh = load_navmesh(write_navmesh(path, l_shape(), settings=NavMeshSettings(agent_height=0.88, agent_radius=0.18)))
    assert mesh.fits(0.18, 0.88)
    assert mesh.fits(0.180009, 0.88)
    assert not mesh.fits(0.1801, 0.88)
    assert not mesh.fits(0.18, 0.89)


def test_the_digest_depends_on_the_content_and_every_truncation_is_refused_in_one_line(path):
    first = read_navmesh(write_navmesh(path, l_shape())).digest
    assert read_navmesh(write_navmesh(path, l_shape())).digest == first
    assert read_navmesh(write_navmesh(path, l_shape(), climb=0.1)).digest != first
    content = navmesh_bytes(two_storeys())
    for length in range(0, len(content), 7):
        refusal(path, content[:length])
    assert "bytes in" in refusal(path, content + b"\0")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"none\.navmesh: cannot be read \(No such file"):
        load_navmesh(tmp_path / "none.navmesh")
    with pytest.raises(SceneError, match="cannot be read"):
        load_navmesh(tmp_path)


@pytest.mark.parametrize(
    ("at", "form", "values", "text"),
    [
        (0, "i", (0x12345678,), "magic 0x12345678"),
        (4, "i", (3,), "version 3; expected a .navmesh of version 1 or 2"),
        (8, "i", (4,), "4 tiles; expected one tile, as Habitat writes"),
        (8, "i", (10**9,), "1000000000 tiles"),
        (TILE - 4, "i", (-1,), "a tile of -1 bytes"),
        (TILE, "i", (1,), "tile magic 0x00000001"),
        (TILE + 24, "i", (-5,), "counts"),
        (TILE + 24, "2i", (3, 2**31 - 1), "bytes left for the vertices; expected 25769803764"),
        (TILE + 32, "i", (2**31 - 1,), "left for the links"),
        (TILE + 36, "i", (2,), "2 detail meshes"),
        (TILE + 48, "i", (0,), "0 tree nodes"),
        (TILE + 52, "i", (1,), "1 off-mesh connections"),
        (TILE + 8, "i", (1,), "tile (1, 0)"),
        (TILE + 96, "f", (float("nan"),), "nan in the header"),
        (TILE + 96, "f", (2e4,), "tree units per metre"),
        (TILE + 72, "f", (99.0,), "expected a tile of positive size"),
        (TILE + 100, "f", (float("inf"),), "inf in the vertices"),
        (TILE + 100, "f", (1e30,), "in the vertices; expected numbers within 100000 of zero"),
        (POLYGONS + 4, "H", (8,), "vertex 8 in a polygon; expected less than 8"),
        (POLYGONS + 16, "H", (4,), "neighbour 3 of a polygon; expected less than 3"),
        (POLYGONS + 30, "B", (2,), "polygons with 2-4 corners"),
        (POLYGONS + 30, "B", (7,), "polygons with 4-7 corners"),
        (POLYGONS + 31, "B", (64,), "expected ground polygons"),
        (POLYGONS + 96, "I", (1,), "outside the detail vertices"),
        (POLYGONS + 100, "I", (2**32 - 1,), "outside the detail triangles"),
        (POLYGONS + 105, "B", (0,), "without triangles"),
        (POLYGONS + 105, "B", (6,), "share triangles"),
        (POLYGONS + 96 + 36, "B", (4,), "a corner that its polygon lacks"),
        (-4, "i", (3,), "tree indices"),
        (-4, "i", (-5,), "tree indices"),
    ],
)
def test_false_numbers_in_the_file_are_refused_in_one_line(path, at, form, values, text):
    content = navmesh_bytes(l_shape())
    assert text in refusal(path, changed(content, at if at >= 0 else len(content) + at, form, *values))


def test_a_mesh_larger_than_any_home_or_without_walkable_polygons_is_refused(path):
    content = navmesh_bytes([plate(0, 0, 3000, 3000)])
    assert "span 9000000 m2; expected a home" in refusal(path, content)
    assert "none of them walkable" in refusal(path, navmesh_bytes(l_shape(), flags={0: 0, 1: 16, 2: 0}))


def test_disabled_polygons_slivers_and_edges_on_the_border_of_a_tile_are_walls(path):
    sliver = np.array([[6, 0, 0], [6, 0, 1], [6.000001, 0, 1]])
    mesh = load_navmesh(write_navmesh(path, [*l_shape(), sliver], flags={1: 16}))
    assert mesh.area == pytest.approx(16)  # two plates of 8 m2 at the ends of the L
    assert mesh.distance(np.array([1, 0, 1]), np.array([5, 0, 5])) == np.inf
    assert mesh.snap(np.array([5.5, 0, 1])).tolist() == [5.5, 0, 2]
    content = changed(navmesh_bytes(l_shape()), POLYGONS + 16 + 4, "H", 0x8002)
    path.write_bytes(content)
    assert read_navmesh(path).neighbours[0, :4].tolist() == [-1, -1, -1, -1]


def test_flipped_bytes_are_refused_or_harmless(path):
    content = navmesh_bytes(two_storeys())
    rng = np.random.default_rng(0)
    loaded = 0
    for _ in range(300):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), 3):
            damaged[at] = rng.integers(256)
        path.write_bytes(bytes(damaged))
        with contextlib.suppress(SceneError):
            mesh = load_navmesh(path)
            loaded += 1
            _ask_everything(mesh)
    assert loaded > 50


def _ask_everything(mesh: NavMesh) -> None:
    """Fails if any answer on this mesh is not a number or has a wrong shape."""
    a, b = np.array([1.0, 0, 1]), np.array([5.0, 3, 12])
    assert not np.isnan(mesh.distances(np.stack([a, b]), np.stack([b, a]))).any()
    for slide in (False, True):
        assert np.isfinite(mesh.step(a, a + np.array([0.2, 0, 0.1]), slide=slide).position).all()
    assert not np.isnan(mesh.distance_to_obstacle(a))
    assert mesh.points_within(a[None], 0.3, max_dy=1.0).shape[1] == 3
    assert len(mesh.storey_heights) >= 1

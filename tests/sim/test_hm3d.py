"""Handmade semantic files in HM3D's format: ids on the scan, and objects with names and boxes."""

from pathlib import Path

import numpy as np
import pytest

from sim.errors import SceneError
from sim.mesh import FACE_IDS, TriangleMesh
from sim.scans.glb import load_glb
from sim.scans.hm3d import Semantics, find_semantics, load_semantics

from .gltf_files import FACES, SQUARE, UV, GltfWriter, four_colours, png

TEXT = """HM3D Semantic Annotations
1,FF0000,"wall",0
7,0000FF,"shelf, low",0
300,00FF00,"bed",2
301,123456,"never seen",3
"""
WALL, SHELF, BED, UNKNOWN = (255, 0, 0), (0, 0, 255), (0, 255, 0), (9, 9, 9)
LEFT, RIGHT = (0.25, 0.4), (0.75, 0.6)
"""Places on a square, as shares of its width and of its height from the top."""


def flat(*columns: tuple[int, int, int]) -> bytes:
    """A PNG of vertical stripes."""
    return png(np.repeat(np.repeat(np.array([columns], np.uint8), 4, axis=1), 8, axis=0))


def squares(*images: bytes, order: np.ndarray = FACES, shift: float = 0.0) -> GltfWriter:
    """Squares behind each other, two metres apart, each with its own image."""
    writer = GltfWriter()
    for k, image in enumerate(images):
        points = SQUARE + np.array([shift, 0, 2 * k], np.float32)
        primitive = writer.square(points=points, uv=UV, material=writer.material(writer.image(image)))
        writer.show(primitive | {"indices": writer.accessor(order)})
    return writer


def scan(tmp_path: Path, count: int = 2) -> TriangleMesh:
    path = squares(*[png(four_colours())] * count).save(tmp_path / "a.glb")
    return load_glb(path)


def semantics(tmp_path: Path, writer: GltfWriter, mesh: TriangleMesh, text: str = TEXT) -> Semantics:
    (tmp_path / "a.semantic.txt").write_text(text)
    return load_semantics(writer.save(tmp_path / "a.semantic.glb"), tmp_path / "a.semantic.txt", mesh)


def ids_at(mesh: TriangleMesh, z: float, share: tuple[float, float]) -> set[int]:
    """Ids at a place of the square at height z, metres, one from each triangle that holds the place."""
    point = np.array([2 * share[0], z, -3 * (1 - share[1])])
    found = set()
    for face, corners in enumerate(mesh.vertices[mesh.faces].astype(float)):
        if abs(corners[:, 1] - z).max() > 0.1:
            continue
        weights = np.linalg.solve(corners.T[[0, 2]][:, :2] - corners[2, [0, 2]][:, None], (point - corners[2])[[0, 2]])
        weights = np.append(weights, 1 - weights.sum())
        if weights.min() > 0:
            image = FACE_IDS if mesh.ids is None else mesh.ids.face_image[face]
            if image == FACE_IDS:
                found.add(int(mesh.face_instance[face]))
                continue
            assert mesh.ids is not None
            u, v = weights @ mesh.ids.face_uv[face]
            texels = mesh.ids.images[image]
            found.add(int(texels[int(v * texels.shape[0]), int(u * texels.shape[1])]))
    return found


def test_colours_of_textures_become_ids_texel_by_texel(tmp_path):
    result = semantics(tmp_path, squares(flat(WALL, SHELF), flat(BED, UNKNOWN)), scan(tmp_path))
    mesh = result.mesh
    assert mesh.ids is not None
    assert mesh.ids.images[0].dtype == np.uint16
    assert [ids_at(mesh, z, share) for z in (0, 2) for share in (LEFT, RIGHT)] == [{1}, {7}, {300}, {0}]
    np.testing.assert_array_equal(mesh.textures[0], four_colours())


def test_faces_in_another_order_and_turned_are_found_by_their_corners(tmp_path):
    order = np.array([3, 0, 2, 1, 2, 0], np.uint16)
    writer = squares(flat(BED, UNKNOWN), flat(WALL, SHELF), order=order, shift=2e-4)
    for node in writer.json["nodes"]:
        node["translation"] = [0, 0, 2]
    writer.json["nodes"][1]["translation"] = [0, 0, -2]  # the second square is the lower one now
    mesh = semantics(tmp_path, writer, scan(tmp_path)).mesh
    assert mesh.ids is not None
    assert (mesh.ids.face_image != FACE_IDS).all()
    assert [ids_at(mesh, z, share) for z in (0, 2) for share in (LEFT, RIGHT)] == [{1}, {7}, {300}, {0}]


def test_faces_missing_from_the_semantic_file_take_the_nearest_id_within_reach(tmp_path):
    """The first two squares of the scan are painted 5 cm off; the third is 2 m away from any painted one."""
    writer = squares(flat(WALL), flat(BED), shift=0.05)
    mesh = semantics(tmp_path, writer, scan(tmp_path, 3)).mesh
    assert mesh.ids is None
    assert mesh.face_instance.tolist() == [1, 1, 300, 300, 0, 0]


def coloured(*colours: np.ndarray) -> GltfWriter:
    writer = GltfWriter()
    for k, rgb in enumerate(colours):
        writer.show(writer.square(points=SQUARE + np.array([0, 0, 2 * k], np.float32), colours=rgb))
    return writer


def test_vertex_colours_give_each_face_the_id_of_most_corners_in_srgb_and_linear_light(tmp_path):
    lower = np.array([WALL, WALL, SHELF, SHELF], np.uint8)
    upper = np.array([BED, SHELF, WALL, UNKNOWN], np.uint8)
    result = semantics(tmp_path, coloured(lower, upper), scan(tmp_path))
    assert result.mesh.ids is None
    assert result.mesh.face_instance.tolist() == [1, 7, 300, 300]
    linear = np.repeat([[0.006049, 0.034340, 0.093059]], 4, axis=0).astype(np.float32)
    result = semantics(tmp_path, coloured(linear), scan(tmp_path, 1))
    assert result.mesh.face_instance.tolist() == [301, 301]


def test_objects_have_names_and_boxes_in_world_axes_and_files_that_do_not_match_are_refused(tmp_path):
    result = semantics(tmp_path, squares(flat(WALL), flat(SHELF)), scan(tmp_path))
    assert [item.name for item in result.objects] == ["wall_1", "shelf, low_7"]
    shelf = result.objects[1]
    assert (shelf.instance_id, shelf.category) == (7, "shelf, low")
    assert shelf.centre == pytest.approx((1.0, 2.0, -1.5))  # (1, 1.5, 2) in the file
    assert shelf.size == pytest.approx((2.0, 0.0, 3.0))
    with pytest.raises(SceneError, match=r"found no colour that a\.semantic\.txt names; expected the colours of its 4"):
        semantics(tmp_path, squares(flat(UNKNOWN)), scan(tmp_path))


def test_the_box_of_an_object_is_the_largest_box_of_its_connected_parts(tmp_path):
    writer = GltfWriter()
    material = writer.material(writer.image(flat(BED)))
    small = np.array([[9.0, 0, 0], [9.5, 0, 0.5], [9.5, 0.5, 0], [9, 0.5, 0.5]], np.float32)
    large = np.array([[0.0, 0, 0], [2, 0, 1], [2, 3, 0], [0, 3, 1]], np.float32)
    far = np.concatenate([small] * 5) + np.repeat(np.arange(5.0)[:, None], 4, axis=0).astype(np.float32)
    for points in (small, large):
        writer.show(writer.square(points=points, uv=UV, material=material))
    many = np.concatenate([FACES + 4 * k for k in range(5)]).astype(np.uint16)
    primitive = writer.square(points=far, uv=np.tile(UV, (5, 1)), material=material)
    writer.show(primitive | {"indices": writer.accessor(many)})
    (bed,) = semantics(tmp_path, writer, scan(tmp_path)).objects
    assert bed.centre == pytest.approx((1, 0.5, -1.5))
    assert bed.size == pytest.approx((2, 1, 3))


def test_semantic_files_are_found_beside_the_scan_and_only_together(tmp_path):
    path = tmp_path / "a.basis.glb"
    assert find_semantics(path, "a") is None
    (tmp_path / "a.semantic.glb").touch()
    with pytest.raises(SceneError, match=r"a\.semantic\.glb: found without a\.semantic\.txt; expected both semantic"):
        find_semantics(path, "a")
    (tmp_path / "a.semantic.txt").touch()
    assert find_semantics(path, "a") == (tmp_path / "a.semantic.glb", tmp_path / "a.semantic.txt")

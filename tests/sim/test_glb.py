"""GLB and glTF files made in the test: axes, node transforms, colours, textures. test_glb_hostile.py has refusals."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from sim.frames import T_world_camera
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.types import Camera, Pose

from .gltf_files import (
    BLUE,
    FACES,
    GREEN,
    SQUARE,
    UV,
    YELLOW,
    GltfWriter,
    drawn,
    four_colours,
    loaded,
    plain_square,
    png,
    shown,
)

TRIANGLES = FACES.reshape(2, 3)


def glb_bytes(scene: trimesh.Scene) -> bytes:
    data = scene.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def write(path: Path, visual=None, *, T=None, vertices=SQUARE, faces=TRIANGLES) -> Path:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(vertices, faces, visual=visual, process=False), transform=T)
    path.write_bytes(glb_bytes(scene))
    return path


def two_colours() -> Image.Image:
    """Red above, blue below."""
    return Image.fromarray(np.array([[[255, 0, 0]], [[0, 0, 255]]], np.uint8).repeat(4, axis=0).repeat(4, axis=1))


def textured(image: Image.Image, **material) -> TextureVisuals:
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])  # trimesh: v = 1 is the top of the image
    return TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=image, **material))


def test_a_z_up_file_becomes_y_up_and_node_transforms_and_mirroring_are_applied(tmp_path):
    mesh = load_glb(write(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [2, 0, 0], [2, 0, -3], [0, 0, -3]], atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, TRIANGLES)
    assert (mesh.face_instance == 0).all()
    T = trimesh.transformations.translation_matrix([10, 20, 30])
    mesh = load_glb(write(tmp_path / "a.glb", T=T), up="y")
    np.testing.assert_allclose(mesh.vertices, SQUARE + np.array([10, 20, 30]))
    lying = SQUARE[:, [0, 2, 1]] * [1, 1, -1]
    T = np.diag([-1.0, 1, 1, 1])
    mesh = load_glb(write(tmp_path / "a.glb", T=T, vertices=lying), up="y")
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert mesh.vertices[:, 0].min() == -2
    assert np.cross(b - a, c - a)[1] > 0


def test_a_mesh_that_two_nodes_show_is_loaded_twice(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(SQUARE, TRIANGLES, process=False), geom_name="square", node_name="one")
    scene.graph.update("two", matrix=trimesh.transformations.translation_matrix([5, 0, 0]), geometry="square")
    path = tmp_path / "a.glb"
    path.write_bytes(glb_bytes(scene))
    mesh = load_glb(path, up="y")
    assert len(mesh.faces) == 4
    assert mesh.vertices[:, 0].max() == 7


def test_the_image_is_not_upside_down(tmp_path):
    """The square's upper half (larger y in the file) shows the image's upper half."""
    mesh = load_glb(write(tmp_path / "a.glb", textured(two_colours())), up="y")
    assert len(mesh.textures) == 1
    assert tuple(mesh.textures[0][0, 0]) == (255, 0, 0)
    np.testing.assert_allclose(mesh.face_uv[0], [[0, 1], [1, 1], [1, 0]], atol=1e-6)
    camera = Camera(64, 64, 90.0, 0.0)
    frame = Raycaster(mesh).render(T_world_camera(Pose((1.0, 1.5, 1.0), 0.0), camera), camera)
    assert tuple(frame.rgb[4, 32]) == (255, 0, 0)
    assert tuple(frame.rgb[60, 32]) == (0, 0, 255)


def test_a_base_colour_tints_a_jpeg_and_without_a_texture_is_the_colour_of_the_faces(tmp_path):
    image = Image.new("RGB", (16, 16), (200, 100, 50))
    image.format = "JPEG"
    mesh = load_glb(write(tmp_path / "a.glb", textured(image, baseColorFactor=[0.5, 1.0, 1.0, 1.0])))
    np.testing.assert_allclose(mesh.textures[0][8, 8].astype(int), [100, 100, 50], atol=3)
    visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[10, 20, 30, 255]))
    mesh = load_glb(write(tmp_path / "a.glb", visual))
    assert mesh.face_rgb.tolist() == [[10, 20, 30], [10, 20, 30]]
    assert mesh.face_texture.tolist() == [-1, -1]


def test_an_image_that_two_parts_share_is_kept_once(tmp_path):
    scene = trimesh.Scene()
    visual = textured(two_colours())
    for shift in (0, 5):
        scene.add_geometry(trimesh.Trimesh(SQUARE + np.array([shift, 0, 0]), TRIANGLES, visual=visual, process=False))
    path = tmp_path / "a.glb"
    path.write_bytes(glb_bytes(scene))
    mesh = load_glb(path)
    assert mesh.face_texture.max() == len(mesh.textures) - 1 == 0
    assert len(mesh.faces) == 4


def test_a_text_file_reads_buffer_and_image_from_data_uris_and_from_files_beside_it(tmp_path):
    inside = loaded(plain_square(), tmp_path, "inside.gltf")
    writer = plain_square()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "my image.png").write_bytes(png(four_colours()))
    writer.json["images"] = [{"uri": "parts/my%20image.png"}]
    (tmp_path / "a.bin").write_bytes(bytes(writer.data) + b"more")
    path = writer.save(tmp_path / "outside.gltf")
    text = path.read_text()
    first, _, rest = text.partition('"uri": "data:')
    path.write_text(first + '"uri": "a.bin"' + rest[rest.index('"') + 1 :])
    outside = load_glb(path, up="y")
    again = loaded(plain_square(), tmp_path, "again.gltf")
    assert inside.digest() == outside.digest() == again.digest() == loaded(plain_square(), tmp_path).digest()
    assert shown(inside) == [BLUE, YELLOW, GREEN]


def test_child_nodes_get_the_scale_rotation_and_translation_of_their_parent(tmp_path):
    writer = GltfWriter()
    child = writer.show(writer.square(), translation=[1, 0, 0])
    turn = [0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4)]  # 90 degrees about z
    parent = writer.add("nodes", {"children": [child], "rotation": turn, "scale": [2, 2, 2], "translation": [0, 0, 5]})
    writer.json["scenes"] = [{"nodes": []}, {"nodes": [parent]}]
    writer.json["scene"] = 1
    mesh = loaded(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, [[0, 2, 5], [0, 6, 5], [-6, 6, 5], [-6, 2, 5]], atol=1e-6)


def test_matrices_are_read_by_column_integer_positions_stay_and_older_materials_have_a_diffuse_colour(tmp_path):
    mesh = drawn(tmp_path, GltfWriter.square, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1])
    np.testing.assert_allclose(mesh.vertices[0], [7, 8, 9])
    mesh = drawn(tmp_path, lambda w: w.square(points=(SQUARE * 10).astype(np.int16)), scale=[0.1, 0.1, 0.1])
    np.testing.assert_allclose(mesh.vertices, SQUARE, atol=1e-6)
    old = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.2, 0.4, 0.6, 1]}}}
    mesh = drawn(tmp_path, lambda w: w.square(material=w.add("materials", old)))
    assert mesh.face_rgb.tolist() == [[51, 102, 153]] * 2


def test_without_scenes_all_nodes_are_shown(tmp_path):
    writer = GltfWriter()
    child = writer.show(writer.square())
    writer.add("nodes", {"children": [child], "translation": [0, 0, 1]})
    writer.show(writer.square())
    del writer.json["scenes"], writer.json["scene"]
    mesh = loaded(writer, tmp_path)
    assert sorted(set(mesh.vertices[:, 2].tolist())) == [0, 1]


def test_parts_of_one_mesh_share_the_vertices_that_the_file_shares(tmp_path):
    def parts(writer):
        first = writer.square()
        return [first, first | {"indices": writer.accessor(np.array([3, 1, 0], np.uint8))}]

    mesh = drawn(tmp_path, parts)
    assert len(mesh.vertices) == 4
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [3, 1, 0]]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32, None])
def test_indices_may_have_any_width_or_be_missing(tmp_path, kind):
    def square(writer):
        if kind is not None:
            return writer.square(indices=writer.accessor(FACES.astype(kind)))
        bare = writer.square(points=SQUARE[FACES])
        del bare["indices"]
        return bare

    mesh = drawn(tmp_path, square)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], SQUARE[TRIANGLES])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_small_indices_do_not_wrap_around_in_a_file_of_many_vertices(tmp_path, kind):
    """The file has squares one above the other; the vertices of the last ones lie beyond the range of their indices."""
    writer = GltfWriter()
    size = np.iinfo(kind).max // 3
    points = np.tile(SQUARE, (size // 4 + 1, 1))
    for height in range(5):
        shifted = points + np.array([0, 0, height], np.float32)
        writer.show(writer.square(points=shifted, indices=writer.accessor(FACES.astype(kind) + kind(size - 3))))
    mesh = loaded(writer, tmp_path)
    assert len(mesh.vertices) > np.iinfo(kind).max
    np.testing.assert_array_equal(mesh.vertices[mesh.faces][:, :, 2], np.repeat(np.arange(5), 2)[:, None].repeat(3, 1))


def test_integers_may_be_written_with_a_decimal_point(tmp_path):
    writer = GltfWriter()
    writer.show(writer.square(mode=4.0))
    for accessor in writer.json["accessors"]:
        accessor["count"] = float(accessor["count"])
        accessor["componentType"] = float(accessor["componentType"])
    writer.json["scene"] = 0.0
    assert loaded(writer, tmp_path).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("mode", "corners", "faces"), [(5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]), (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]])]
)
def test_strips_and_fans_face_the_right_side(tmp_path, mode, corners, faces):
    mesh = drawn(tmp_path, lambda w: w.square(mode=mode, indices=w.accessor(np.array(corners, np.uint8))))
    assert mesh.faces.tolist() == faces
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_lines_points_and_parts_without_vertices_are_left_out(tmp_path):
    assert len(drawn(tmp_path, lambda w: [w.square(mode=1), w.square(), w.square(mode=0)]).faces) == 2

    def parts(writer):
        return [{"attributes": {"POSITION": writer.accessor(np.zeros((0, 3), np.float32))}}, writer.square()]

    np.testing.assert_array_equal(drawn(tmp_path, parts).vertices, SQUARE)


def test_interleaved_attributes_are_read_with_their_stride(tmp_path):
    writer = GltfWriter()
    material = writer.material(writer.image(png(four_colours())))
    rows = np.concatenate([SQUARE, np.full((4, 1), 9, np.float32), UV], axis=1)
    view = writer.view(rows.tobytes(), byteStride=24)
    primitive = writer.square(material=material)
    common = {"bufferView": view, "componentType": 5126, "count": 4}
    primitive["attributes"] = {
        "POSITION": writer.add("accessors", common | {"type": "VEC3"}),
        "TEXCOORD_0": writer.add("accessors", common | {"type": "VEC2", "byteOffset": 16}),
    }
    writer.show(primitive)
    assert loaded(writer, tmp_path).digest() == loaded(plain_square(), tmp_path, "b.glb").digest()


@pytest.mark.parametrize("has_base", [True, False])
def test_a_sparse_accessor_replaces_some_of_the_values(tmp_path, has_base):
    writer = GltfWriter()
    primitive = writer.square()
    accessor = writer.json["accessors"][primitive["attributes"]["POSITION"]]
    if not has_base:
        del accessor["bufferView"]
    indices = writer.view(np.array([1, 3], np.uint8).tobytes())
    values = writer.view(np.array([[5, 5, 5], [6, 6, 6]], np.float32).tobytes())
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": values},
    }
    writer.show(primitive)
    vertices = loaded(writer, tmp_path).vertices
    assert vertices[[1, 3]].tolist() == [[5, 5, 5], [6, 6, 6]]
    assert vertices[2].tolist() == ([2, 3, 0] if has_base else [0, 0, 0])


def test_quantized_attributes_become_metres_and_texture_coordinates(tmp_path):
    writer = GltfWriter()
    material = writer.material(writer.image(png(four_colours())))
    primitive = writer.square(material=material)
    primitive["attributes"] = {
        "POSITION": writer.accessor(np.array([[0, 0, 0], [127, 0, 0], [127, -128, 0]], np.int8), normalized=True),
        "TEXCOORD_0": writer.accessor(np.array([[0, 65535], [65535, 65535], [65535, 0]], np.uint16), normalized=True),
    }
    primitive["indices"] = writer.accessor(np.array([0, 1, 2], np.uint8))
    writer.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    writer.show(primitive, scale=[4, 4, 4])
    mesh = loaded(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [4, 0, 0], [4, -4, 0]], atol=1e-6)
    np.testing.assert_allclose(mesh.face_uv[0], [[0, 1], [1, 1], [1, 0]], atol=1e-6)

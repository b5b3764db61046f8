"""Vertex colours of glTF files: alone, with base colours, and as light on textures."""

import numpy as np
import pytest

from sim.frames import T_world_camera
from sim.mesh import FLAT, VERTEX_COLOURS
from sim.render.raycast import Raycaster
from sim.types import Camera, Pose

from .gltf_files import RED, UV, GltfWriter, drawn, four_colours, loaded, png


def test_vertex_colours_are_averaged_per_face(tmp_path):
    colours = np.array([[0, 0, 0, 255], [90, 0, 0, 255], [0, 60, 0, 255], [0, 0, 30, 255]], np.uint8)
    mesh = drawn(tmp_path, lambda w: w.square(colours=colours))
    assert mesh.face_rgb.tolist() == [[30, 20, 0], [0, 20, 10]]
    assert mesh.face_texture.tolist() == [VERTEX_COLOURS, VERTEX_COLOURS]
    np.testing.assert_array_equal(mesh.vertex_rgb, colours[:, :3])


@pytest.mark.parametrize(("coloured", "count"), [(False, 4), (True, 8)])
def test_parts_of_two_base_colours_share_vertices_unless_these_have_colours(tmp_path, coloured, count):
    def parts(writer):
        square = writer.square(colours=np.full((4, 4), 200, np.uint8) if coloured else None)
        tints = [{"baseColorFactor": tint} for tint in ([0.5, 1, 1, 1], [1, 0.5, 1, 1])]
        return [square | {"material": writer.add("materials", {"pbrMetallicRoughness": tint})} for tint in tints]

    mesh = drawn(tmp_path, parts)
    assert len(mesh.vertices) == count
    low, high = (100, 200) if coloured else (128, 255)
    assert mesh.face_rgb.tolist() == [[low, high, high]] * 2 + [[high, low, high]] * 2


@pytest.mark.parametrize(
    ("colours", "expected"),
    [
        (np.array([[1.0, 0.5, 0]] * 4, np.float32), [255, 128, 0]),
        (np.array([[1.0, 0.5, 0, 0.2]] * 4, np.float32), [255, 128, 0]),
        (np.array([[65535, 32768, 0]] * 4, np.uint16), [255, 128, 0]),
        (np.array([[255, 128, 0, 7]] * 4, np.uint8), [255, 128, 0]),
        (np.array([[np.nan, 7, -1]] * 4, np.float32), [0, 255, 0]),
    ],
)
def test_vertex_colours_of_every_kind_are_read(tmp_path, colours, expected):
    mesh = drawn(tmp_path, lambda w: w.square(colours=colours))
    assert mesh.vertex_rgb.tolist() == [expected] * 4
    assert mesh.face_rgb.tolist() == [expected] * 2


def test_vertex_colours_are_multiplied_by_the_base_colour_once_and_by_a_texture(tmp_path):
    writer = GltfWriter()
    factor = [0.5, 1, 1, 1]
    tint = writer.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": factor}})
    texture = writer.image(png(np.full((2, 2, 3), RED, np.uint8)))
    image, tinted = writer.material(texture), writer.material(texture, factor)
    colours = np.array([[200, 100, 50]] * 4, np.uint8)
    primitives = [writer.square(uv=UV, colours=colours, material=material) for material in (tint, image, tinted)]
    white = writer.square(uv=UV, material=image)
    for shift, primitive in enumerate([*primitives, white, writer.square()]):
        writer.show(primitive, translation=[3.0 * shift, 0, 0])
    mesh = loaded(writer, tmp_path)
    assert mesh.face_texture.tolist() == [VERTEX_COLOURS, VERTEX_COLOURS, 0, 0, 1, 1, 0, 0, FLAT, FLAT]
    assert mesh.face_rgb[[0, 8]].tolist() == [[100, 100, 50], [200, 200, 200]]
    assert mesh.vertex_rgb is not None
    light = mesh.vertex_rgb[mesh.faces[::2, 0]].tolist()
    assert light == [[100, 100, 50], [200, 100, 50], [200, 100, 50], [255, 255, 255], [255, 255, 255]]
    # image x colours, image x factor x colours, image; 200 * 200 / 255 = 157, 40 * 100 / 255 = 16, 40 * 50 / 255 = 8
    seen = [(157, 16, 8), (78, 16, 8), (200, 40, 40)]
    camera, raycaster = Camera(16, 16, 60.0, 0.0), Raycaster(mesh)
    for shift, rgb in enumerate(seen, start=1):
        frame = raycaster.render(T_world_camera(Pose((3.0 * shift + 1, 1.5, 1.0), 0.0), camera), camera)
        assert frame.rgb[8, 8].tolist() == pytest.approx(rgb, abs=1)


def test_parts_of_two_base_colours_share_vertices_if_their_colours_only_light_textures(tmp_path):
    def parts(writer):
        texture = writer.image(png(four_colours()))
        square = writer.square(uv=UV, colours=np.full((4, 4), 200, np.uint8), material=writer.material(texture))
        return [square, square | {"material": writer.material(texture, [0.5, 1, 1, 1])}]

    mesh = drawn(tmp_path, parts)
    assert len(mesh.vertices) == 4
    assert mesh.vertex_rgb.tolist() == [[200, 200, 200]] * 4


@pytest.mark.filterwarnings("error")
def test_base_colours_out_of_range_are_clipped_to_black_and_full_light(tmp_path):
    writer = GltfWriter()
    wild = {"baseColorFactor": [1e300, -1, 0.5, 1]}
    tinted = writer.add("materials", {"pbrMetallicRoughness": wild})
    primitive = writer.square(material=tinted)
    primitive["attributes"]["COLOR_0"] = writer.accessor(np.array([[100, 100, 100, 255]] * 4, np.uint8))
    writer.show(primitive, writer.square(material=tinted))
    assert loaded(writer, tmp_path).face_rgb[[0, 2]].tolist() == [[100, 0, 50], [255, 0, 128]]

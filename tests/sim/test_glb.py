"""GLB files made in the test: axes, node transforms, colours, textures, and every refusal."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from sim.errors import SceneError
from sim.frames import T_world_camera
from sim.scenes.glb import load_glb
from sim.types import Camera, Pose
from sim.world.raycast import Raycaster

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def glb_bytes(scene: trimesh.Scene) -> bytes:
    data = scene.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def write(path: Path, visual=None, *, T=None, vertices=SQUARE, faces=FACES) -> Path:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(vertices, faces, visual=visual, process=False), transform=T)
    path.write_bytes(glb_bytes(scene))
    return path


def rewrite_json(path: Path, change) -> Path:
    """Write the file again with `change(header)` applied to its JSON part."""
    data = path.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    header = json.loads(data[20 : 20 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    path.write_bytes(
        struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
    )
    return path


def two_colours() -> Image.Image:
    """Red above, blue below."""
    return Image.fromarray(np.array([[[255, 0, 0]], [[0, 0, 255]]], np.uint8).repeat(4, axis=0).repeat(4, axis=1))


def textured(image: Image.Image, **material) -> TextureVisuals:
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])  # trimesh: v = 1 is the image's top
    return TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=image, **material))


def test_a_z_up_file_becomes_y_up(tmp_path):
    mesh = load_glb(write(tmp_path / "a.glb"))
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [2, 0, 0], [2, 0, -3], [0, 0, -3]], atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert (mesh.face_instance == 0).all()


def test_a_y_up_file_keeps_its_axes_and_node_transforms_are_applied(tmp_path):
    T = trimesh.transformations.translation_matrix([10, 20, 30])
    mesh = load_glb(write(tmp_path / "a.glb", T=T), up="y")
    np.testing.assert_allclose(mesh.vertices, SQUARE + np.array([10, 20, 30]))


def test_a_mirrored_node_keeps_floors_facing_up(tmp_path):
    lying = SQUARE[:, [0, 2, 1]] * [1, 1, -1]
    T = np.diag([-1.0, 1, 1, 1])
    mesh = load_glb(write(tmp_path / "a.glb", T=T, vertices=lying), up="y")
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert mesh.vertices[:, 0].min() == -2
    assert np.cross(b - a, c - a)[1] > 0


def test_a_mesh_that_two_nodes_show_is_loaded_twice(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(SQUARE, FACES, process=False), geom_name="square", node_name="one")
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


def test_a_jpeg_is_read_and_the_base_colour_tints_it(tmp_path):
    image = Image.new("RGB", (16, 16), (200, 100, 50))
    image.format = "JPEG"
    mesh = load_glb(write(tmp_path / "a.glb", textured(image, baseColorFactor=[0.5, 1.0, 1.0, 1.0])))
    np.testing.assert_allclose(mesh.textures[0][8, 8].astype(int), [100, 100, 50], atol=3)


def test_a_base_colour_without_texture_is_the_faces_colour(tmp_path):
    visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[10, 20, 30, 255]))
    mesh = load_glb(write(tmp_path / "a.glb", visual))
    assert mesh.face_rgb.tolist() == [[10, 20, 30], [10, 20, 30]]
    assert mesh.face_texture.tolist() == [-1, -1]


def test_vertex_colours_are_averaged_per_face(tmp_path):
    colours = np.array([[0, 0, 0, 255], [90, 0, 0, 255], [0, 60, 0, 255], [0, 0, 30, 255]], np.uint8)
    mesh = load_glb(write(tmp_path / "a.glb", ColorVisuals(vertex_colors=colours)))
    assert mesh.face_rgb.tolist() == [[30, 20, 0], [0, 20, 10]]


def test_an_image_that_two_parts_share_is_kept_once(tmp_path):
    scene = trimesh.Scene()
    visual = textured(two_colours())
    for shift in (0, 5):
        scene.add_geometry(trimesh.Trimesh(SQUARE + np.array([shift, 0, 0]), FACES, visual=visual, process=False))
    path = tmp_path / "a.glb"
    path.write_bytes(glb_bytes(scene))
    mesh = load_glb(path)
    assert mesh.face_texture.max() == len(mesh.textures) - 1 == 0
    assert len(mesh.faces) == 4


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        load_glb(path)
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


def test_a_missing_file_is_named(tmp_path):
    assert "cannot be read (No such file or directory)" in refusal(tmp_path / "none.glb")


def test_other_content_is_refused(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(b"PK\x03\x04 not a mesh at all, but long enough")
    assert "expected binary glTF 2.0" in refusal(path)
    path.write_bytes(b"")
    assert "starts with b''" in refusal(path)


@pytest.mark.parametrize("kept", [30, 200, -1])
def test_a_truncated_file_is_refused(tmp_path, kept):
    path = write(tmp_path / "a.glb")
    path.write_bytes(path.read_bytes()[:kept])
    assert "expected the whole file" in refusal(path)


def test_damaged_json_is_refused(tmp_path):
    path = write(tmp_path / "a.glb")
    data = bytearray(path.read_bytes())
    data[20:24] = b"\xff\xff\xff\xff"
    path.write_bytes(bytes(data))
    assert "JSON part: (top level) is text that is not JSON" in refusal(path)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            lambda header: header.update(extensionsUsed=5),
            "extensionsUsed is 5; expected: Input should be a valid array",
        ),
        (lambda header: header.update(extensionsUsed=[5]), "extensionsUsed.0 is 5; expected: Input should be a valid"),
        (lambda header: header.update(nodes="x"), "nodes is 'x'"),
        (lambda header: header.update(meshes=None), "meshes is None"),
        (lambda header: header["meshes"][0].update(primitives={}), "meshes.0.primitives is {}"),
        (lambda header: header.update(textures=5), "textures is 5"),
        (lambda header: header["textures"][0].update(source=-1), "textures.0.source is -1"),
        (lambda header: header.update(textures=[]), "found GLB content that cannot be read (IndexError: "),
        (lambda header: header["materials"][0].update(pbrMetallicRoughness=[]), "materials.0.pbrMetallicRoughness is"),
        (lambda header: header.update(accessors=5), "found GLB content that cannot be read (TypeError: "),
        (lambda header: header["accessors"][0].update(count=10**30), "cannot be read (OverflowError: "),
        (lambda header: header.pop("bufferViews"), "found GLB content that cannot be read (UnboundLocalError: "),
        (lambda header: header["bufferViews"][0].update(byteOffset=-1), "cannot be read (AssertionError: "),
    ],
)
def test_a_wrongly_typed_header_is_one_line_that_names_the_file(tmp_path, change, expected):
    path = rewrite_json(write(tmp_path / "a.glb", textured(two_colours())), change)
    message = refusal(path)
    assert expected in message
    assert len(message) < len(str(path)) + 350


def test_a_face_that_uses_a_missing_vertex_is_refused(tmp_path):
    path = write(tmp_path / "a.glb", faces=FACES)
    data = path.read_bytes()
    corners = struct.pack("<6I", *FACES.ravel())
    assert data.count(corners) == 1
    path.write_bytes(data.replace(corners, struct.pack("<6I", 0, 1, 2, 0, 2, 4)))
    assert "face 1 of mesh 'geometry_0' uses vertex 4; expected 0 to 3" in refusal(path)


def test_json_that_points_nowhere_is_refused(tmp_path):
    def break_accessor(header):
        header["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 99

    assert "GLB content that cannot be read" in refusal(rewrite_json(write(tmp_path / "a.glb"), break_accessor))


def test_a_file_without_faces_is_refused(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(glb_bytes(trimesh.Scene([trimesh.PointCloud(SQUARE)])))
    assert "found no faces" in refusal(path)


def test_a_vertex_that_is_not_finite_is_refused(tmp_path):
    vertices = SQUARE.copy()
    vertices[2, 1] = np.nan
    assert "vertex 2 is [nan, nan, nan]; expected finite metres" in refusal(
        write(tmp_path / "a.glb", vertices=vertices)
    )


@pytest.mark.parametrize("name", ["GOOGLE_texture_basis", "KHR_texture_basisu"])
def test_basis_textures_are_refused_with_the_file_to_use_instead(tmp_path, name):
    path = rewrite_json(write(tmp_path / "a.glb"), lambda header: header.update(extensionsUsed=[name]))
    assert refusal(path).endswith("Basis textures are not supported yet, use the plain <Name>.glb.")


def test_compressed_meshes_are_refused(tmp_path):
    used = ["KHR_draco_mesh_compression"]
    path = rewrite_json(write(tmp_path / "a.glb"), lambda header: header.update(extensionsUsed=used))
    assert "expected uncompressed meshes" in refusal(path)


def test_a_texture_that_cannot_be_read_is_refused_and_never_grey(tmp_path):
    path = write(tmp_path / "a.glb", textured(two_colours()))
    data = path.read_bytes()
    path.write_bytes(data.replace(b"\x89PNG", b"\x00\x00\x00\x00"))
    assert "found 0 readable of 1 textures" in refusal(path)
    path.write_bytes(data.replace(b"IDAT", b"IDAX"))
    assert "texture" in refusal(path)

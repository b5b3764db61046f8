"""PLY and OBJ scenes, the choice by suffix, and files that announce too much or name files outside their folder."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from sim.errors import SceneError
from sim.mesh import FLAT, VERTEX_COLOURS
from sim.scans.meshes import load_mesh

from .gltf_files import BLUE, FACES, GREEN, SQUARE, UV, YELLOW, four_colours, plain_square, png, shown

OBJ = """mtllib a.mtl
v 0 0 0
v 2 0 0
v 2 3 0
v 0 3 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wall
f 1/1 2/2 3/3
f 1/1 3/3 4/4
"""


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        load_mesh(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path.parent))
    assert len(text) < len(str(path)) + 350
    return text


def ply(path: Path, **more) -> Path:
    data = trimesh.Trimesh(SQUARE, FACES.reshape(2, 3), process=False, **more).export(file_type="ply")
    assert isinstance(data, bytes)
    path.write_bytes(data)
    return path


def obj(path: Path, *, material: str = "newmtl wall\nmap_Kd image.png\n", text: str = OBJ) -> Path:
    path.write_text(text)
    (path.parent / "a.mtl").write_text(material)
    (path.parent / "image.png").write_bytes(png(four_colours()))
    return path


def test_the_suffix_decides_the_format(tmp_path):
    glb = load_mesh(plain_square().save(tmp_path / "a.glb"), up="y")
    gltf = load_mesh(plain_square().save(tmp_path / "a.gltf"), up="y")
    assert glb.digest() == gltf.digest()
    (tmp_path / "a.fbx").touch()
    assert "is a .fbx file; expected one of .glb, .gltf, .ply, .obj. Export the scene as .glb." in refusal(
        tmp_path / "a.fbx"
    )
    assert "has no suffix" in refusal(tmp_path / "a")
    assert "cannot be read (No such file" in refusal(tmp_path / "a.ply")


def test_a_ply_file_is_turned_upright_and_keeps_its_vertex_colours(tmp_path):
    colours = np.array([[0, 0, 0, 255], [90, 0, 0, 255], [0, 60, 0, 255], [0, 0, 30, 255]], np.uint8)
    mesh = load_mesh(ply(tmp_path / "a.ply", vertex_colors=colours))
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [2, 0, 0], [2, 0, -3], [0, 0, -3]])
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.face_texture.tolist() == [VERTEX_COLOURS] * 2
    assert mesh.vertex_rgb is not None
    np.testing.assert_array_equal(mesh.vertex_rgb, colours[:, :3])
    assert mesh.face_rgb.tolist() == [[30, 20, 0], [0, 20, 10]]
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.int32


def test_a_ply_file_may_have_face_colours_or_none(tmp_path):
    plain = load_mesh(ply(tmp_path / "a.ply"))
    assert plain.face_texture.tolist() == [FLAT] * 2
    assert plain.face_rgb.tolist() == [[200, 200, 200]] * 2
    assert plain.vertex_rgb is None
    colours = np.array([[10, 20, 30, 255], [40, 50, 60, 255]], np.uint8)
    painted = load_mesh(ply(tmp_path / "b.ply", face_colors=colours))
    assert painted.face_rgb.tolist() == [[10, 20, 30], [40, 50, 60]]


def test_an_obj_file_shows_its_image_upright_or_else_its_colour_or_grey(tmp_path):
    mesh = load_mesh(obj(tmp_path / "a.obj"), up="y")
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    np.testing.assert_allclose(mesh.face_uv[0], UV[:3])
    assert shown(mesh) == [BLUE, YELLOW, GREEN]
    painted = load_mesh(obj(tmp_path / "a.obj", material="newmtl wall\nKd 0.2 0.4 0.6\n"))
    assert painted.face_rgb.tolist() == [[51, 102, 153]] * 2
    plain = obj(tmp_path / "a.obj", text=OBJ.replace("mtllib a.mtl\n", "").replace("usemtl wall\n", ""))
    assert load_mesh(plain).face_texture.tolist() == [FLAT] * 2
    assert load_mesh(plain).face_rgb.tolist() == [[200, 200, 200]] * 2


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ("newmtl wall\nmap_Kd ../secret.png\n", "the file names '../secret.png'; expected a file in the folder"),
        ("newmtl wall\nmap_Kd /etc/passwd\n", "the file names '/etc/passwd'; expected a file in the folder"),
        ("newmtl wall\nmap_Kd http://127.0.0.1/a.png\n", "expected a file in the folder of the scene"),
    ],
)  # fmt: skip
def test_an_obj_file_reads_nothing_outside_its_folder(tmp_path, material, expected):
    (tmp_path / "home").mkdir()
    Image.fromarray(four_colours()).save(tmp_path / "secret.png")
    assert expected in refusal(obj(tmp_path / "home" / "a.obj", material=material))
    text = OBJ.replace("a.mtl", "../a.mtl")
    assert "names '../a.mtl'; expected a file in the folder" in refusal(obj(tmp_path / "home" / "a.obj", text=text))
    text = OBJ.replace("a.mtl", "none.mtl")
    assert "names 'none.mtl'; expected a file, but there is none" in refusal(
        obj(tmp_path / "home" / "a.obj", text=text)
    )


def test_a_missing_image_of_an_obj_file_is_a_warning_and_its_faces_have_their_materials_colour(tmp_path):
    path = obj(tmp_path / "a.obj", material="newmtl wall\nKd 0.2 0.4 0.6\nmap_Kd none.png\n")
    with pytest.warns(UserWarning, match=r"a\.obj: the file names 'none\.png'; expected a file, .* plain colour"):
        mesh = load_mesh(path)
    assert (mesh.face_texture.tolist(), mesh.textures) == ([FLAT] * 2, ())
    assert mesh.face_rgb.tolist() == [[51, 102, 153]] * 2


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (b"element vertex 1000000000\nelement face 2\n", "announces 1000000002 elements in"),
        (b"element vertex 99999999999999999999\n", "has the line 'element vertex 99999999999999999999'"),
        (b"element vertex -4\n", "has the line 'element vertex -4'; expected `element NAME COUNT`"),
        (b"element face\n", "has the line 'element face'"),
    ],
)
def test_a_ply_header_that_announces_too_much_is_refused(tmp_path, header, expected):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nformat binary_little_endian 1.0\n" + header + b"property float x\nend_header\n" + bytes(99))
    assert expected in refusal(path)


ASCII = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
2 0 0
2 3 0
0 3 0
3 0 1 2
3 0 2 3
"""


@pytest.mark.parametrize(
    ("kept", "expected"),
    [
        (-9, "announces 4 'vertex', 2 'face': 6 lines, and has 5; expected all of them. Copy the file again"),
        (-30, "announces 4 'vertex', 2 'face': 6 lines, and has 2; expected all of them"),
        (-3, "the last of 6 lines ends after 3 of its numbers; expected 4 of them"),
    ],
)
def test_a_ply_text_file_that_ends_early_is_refused(tmp_path, kept, expected):
    path = tmp_path / "a.ply"
    path.write_text(ASCII[:kept])
    assert expected in refusal(path)


@pytest.mark.parametrize("text", [ASCII, ASCII[:-1], ASCII + "\n\n", ASCII.replace("\n", "\r\n")])
def test_a_complete_ply_text_file_is_read(tmp_path, text):
    path = tmp_path / "a.ply"
    path.write_text(text, newline="")
    assert load_mesh(path, up="y").faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "suffix", "expected"),
    [
        ("PNG", "png", "the image 'image.png' has 12000 x 9500 texels; expected at least 1, at most 16384 a side"),
        ("BMP", "bmp", "has a texture of 12000 x 9500 texels; expected at most 16384 a side, 67108864 together"),
    ],
)
def test_an_obj_file_with_a_huge_image_is_refused_without_warnings(tmp_path, name, suffix, expected):
    path = obj(tmp_path / "a.obj", material=f"newmtl wall\nmap_Kd image.{suffix}\n")
    Image.new("1", (12000, 9500)).save(tmp_path / f"image.{suffix}", name)
    assert expected in refusal(path)


def test_other_content_and_damaged_files_are_refused(tmp_path):
    path = tmp_path / "a.ply"
    for content in (b"", b"PK\3\4", b"ply\nformat ascii 1.0\n"):
        path.write_bytes(content)
        assert "expected a PLY header" in refusal(path)
    data = ply(path).read_bytes()
    path.write_bytes(data[:-20])
    assert "a.ply: " in refusal(path)
    (tmp_path / "b.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n")
    assert "b.obj: " in refusal(tmp_path / "b.obj")
    (tmp_path / "c.obj").write_text("v 0 0 0\nv 1 0 0\n")
    assert "found no faces" in refusal(tmp_path / "c.obj")
    (tmp_path / "parts.obj").write_text("v 0 0 0\n" * 3 + "usemtl a\nf 1 2 3\n" * 8193)
    assert "has 8193 parts; expected at most 8192. Join those of one material." in refusal(tmp_path / "parts.obj")
    with (tmp_path / "d.obj").open("wb") as file:
        file.truncate((1 << 30) + 1)
    assert "has 1073741825 bytes; expected at most 1073741824" in refusal(tmp_path / "d.obj")


@pytest.mark.parametrize("value", [np.nan, np.inf, 2e5])
def test_a_vertex_too_far_away_or_not_finite_is_refused(tmp_path, value):
    path = ply(tmp_path / "a.ply")
    data = path.read_bytes()
    corner = struct.pack("<3f", 2, 3, 0)
    assert data.count(corner) == 1
    path.write_bytes(data.replace(corner, struct.pack("<3f", 2, value, 0)))
    assert "vertex 2 is [2.0, " in refusal(path)


def test_randomly_damaged_files_are_read_or_refused(tmp_path):
    rng = np.random.default_rng(5)
    files = [ply(tmp_path / "a.ply"), obj(tmp_path / "a.obj")]
    refused = 0
    for k in range(200):
        path = files[k % 2]
        whole = path.read_bytes()
        data = bytearray(whole)
        for at in rng.integers(0, len(data), rng.integers(1, 4)):
            data[at] = rng.integers(0, 256)
        path.write_bytes(data)
        try:
            mesh = load_mesh(path)
            assert mesh.faces.max() < len(mesh.vertices)
        except SceneError as error:
            refused += "\n" not in str(error)
        path.write_bytes(whole)
    assert 20 < refused < 200

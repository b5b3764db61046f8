"""Damaged and hostile glTF files are refused in one line that says what is wrong. test_glb_bombs.py has huge ones."""

import io
import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim.errors import SceneError
from sim.scans.glb import load_glb

from .gltf_files import FACES, SQUARE, GltfWriter, jpeg, plain_square, png, with_image

Change = Callable[[GltfWriter], object]


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        load_glb(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    assert len(text) < len(str(path)) + 350
    return text


def test_other_content_is_refused(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(b"PK\x03\x04 not a mesh at all, but long enough")
    assert "expected binary glTF 2.0" in refusal(path)
    path.write_bytes(b"")
    assert "starts with b''" in refusal(path)
    (tmp_path / "a.gltf").write_bytes(b"")
    expected = (
        "(top level) is text that is not JSON (EOF while parsing a value at line 1 column 0); expected: whole JSON."
    )
    assert expected in refusal(tmp_path / "a.gltf")


def test_a_pipe_a_folder_and_transforms_that_overflow_together_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.glb")
    assert "is not a regular file" in refusal(tmp_path / "pipe.glb")
    assert "is not a regular file" in refusal(tmp_path)
    writer = GltfWriter()
    node = writer.show(writer.square(), scale=[1e200, 1e200, 1e200])
    writer.json["scenes"][0]["nodes"] = [writer.add("nodes", {"children": [node], "scale": [1e200, 1e200, 1e200]})]
    assert "expected finite metres" in refusal(writer.save(tmp_path / "a.glb"))


@pytest.mark.parametrize("kept", [10, 19, 30, 200, -1])
def test_a_truncated_file_is_refused(tmp_path, kept):
    path = tmp_path / "a.glb"
    path.write_bytes(plain_square().glb()[:kept])
    assert "expected the whole file" in refusal(path)


def test_a_binary_part_longer_than_the_file_and_damaged_json_are_refused(tmp_path):
    writer = plain_square()
    data = bytearray(writer.glb())
    at = data.index(b"BIN\0") - 4
    data[at : at + 4] = struct.pack("<I", len(writer.data) + 4)
    (tmp_path / "a.glb").write_bytes(data)
    assert "expected the whole file" in refusal(tmp_path / "a.glb")
    data = bytearray(plain_square().glb())
    data[20:24] = b"\xff\xff\xff\xff"
    (tmp_path / "a.glb").write_bytes(bytes(data))
    assert "JSON part: (top level) is text that is not JSON (expected value at line 1 " in refusal(tmp_path / "a.glb")


def test_only_the_first_of_many_wrong_items_is_reported(tmp_path):
    path = tmp_path / "a.gltf"
    items = {"accessors": '{"componentType":"x"}', "extensionsUsed": "5", "nodes": '{"children":[0.5]}'}
    for name, item in items.items():
        path.write_text(f'{{"asset":{{"version":"2.0"}},"{name}":[{",".join([item] * 1000)}]}}')
        message = refusal(path)
        assert f"{name}.0" in message
        assert "more problems" not in message or "(and 2 more problems)" in message  # of the same item
    attributes = ",".join(f'"{k}":-1' for k in range(1025))
    path.write_text(f'{{"meshes":[{{"primitives":[{{"attributes":{{{attributes}}}}}]}}]}}')
    assert "expected: At most 1024 attributes. Copy" in refusal(path)


def part(writer: GltfWriter) -> dict:
    return writer.json["meshes"][0]["primitives"][0]


def accessor(writer: GltfWriter, name: str) -> dict:
    primitive = part(writer)
    return writer.json["accessors"][primitive["indices"] if name == "indices" else primitive["attributes"][name]]


def view_of(writer: GltfWriter, name: str) -> dict:
    return writer.json["bufferViews"][accessor(writer, name)["bufferView"]]


# accessors of the square: 0 positions, 1 texture coordinates, 2 indices
HEADER_CHANGES: list[tuple[Change, str]] = [
    (lambda w: w.json.update(extensionsUsed=5), "extensionsUsed is 5; expected: Input should be a valid array"),
    (lambda w: w.json.update(extensionsUsed=[5]), "extensionsUsed.0 is 5; expected: Input should be a valid"),
    (lambda w: w.json.update(nodes="x"), "nodes is 'x'"),
    (lambda w: w.json.update(meshes=None), "meshes is None"),
    (lambda w: w.json["meshes"][0].update(primitives={}), "meshes.0.primitives is {}"),
    (lambda w: w.json.update(textures=5), "textures is 5"),
    (lambda w: w.json["textures"][0].update(source=-1), "textures.0.source is -1"),
    (lambda w: w.json.update(textures=[]), "materials.0 names textures.0; expected any textures"),
    (lambda w: w.json["materials"][0].update(pbrMetallicRoughness=[]), "materials.0.pbrMetallicRoughness is"),
    (lambda w: w.json.update(accessors=5), "accessors is 5"),
    (lambda w: w.json["accessors"][0].update(count=10**30), "accessors.0.count is 1000000000000000000000000000000"),
    (lambda w: w.json.pop("bufferViews"), "names bufferViews.1; expected any bufferViews"),
    (lambda w: w.json["bufferViews"][0].update(byteOffset=-1), "bufferViews.0.byteOffset is -1"),
    (lambda w: w.json["accessors"][0].update(count=4.5), "accessors.0.count is 4.5; expected: Input should be a valid"),
    (lambda w: w.json["accessors"][0].update(count="4"), "accessors.0.count is '4'; expected: Input should be a valid"),
    (lambda w: w.json["accessors"][0].update(count=True), "accessors.0.count is True; expected: Input should be a"),
    (lambda w: w.json["accessors"][0].update(count=1e30), "accessors.0.count is 10000000000000000198"),
    (lambda w: part(w).update(mode=4.5), "meshes.0.primitives.0.mode is 4.5"),
    (lambda w: w.json["asset"].update(version="1.0"), "asset.version is '1.0'"),
    (lambda w: w.json.update(scene=3), "scene names scenes.3; expected scenes 0 to 0"),
    (lambda w: w.json["scenes"][0]["nodes"].append(9), "the scene names nodes.9; expected nodes 0 to 0"),
    (lambda w: w.json["nodes"][0].update(mesh=2), "nodes.0 names meshes.2; expected meshes 0 to 0"),
    (lambda w: w.json["nodes"][0].update(matrix=[1.0] * 15), "nodes.0.matrix is"),
    (lambda w: part(w).update(mode=9), "meshes.0.primitives.0.mode is 9"),
    (lambda w: part(w).update(material=4), "a primitive names materials.4; expected materials 0 to 0"),
    (lambda w: part(w)["attributes"].update(POSITION=99), "a primitive names accessors.99; expected accessors 0 to 2"),
    (lambda w: w.json["images"][0].update(bufferView=99), "images.0 names bufferViews.99"),
    (lambda w: w.json["images"][0].pop("bufferView"), "images.0 has no bufferView and no uri"),
    (lambda w: w.json["textures"][0].pop("source"), "textures.0 has no image that we know (the file's ext"),
    (lambda w: w.json["buffers"][0].update(byteLength=10**9), "buffers.0 has"),
    (lambda w: w.json["buffers"][0].update(uri="gone.bin"), "buffers.0 names 'gone.bin'; expected a file, but"),
    (lambda w: accessor(w, "POSITION").update(count=10**9), "announces 1000000000 vertices and 2 faces"),
    (lambda w: accessor(w, "indices").update(count=3 * 10**9), "announces 4 vertices and 1000000000 faces"),
    (lambda w: accessor(w, "TEXCOORD_0").update(count=10**9), "has 1000000000 elements; expected 4, one per vertex"),
    (lambda w: accessor(w, "TEXCOORD_0").update(type="VEC3"), "accessors.1 needs 48 bytes of bufferViews.2"),
    (lambda w: accessor(w, "POSITION").update(count=5), "accessors.0 needs 60 bytes of bufferViews.1 in steps of 12"),
    (lambda w: accessor(w, "POSITION").update(byteOffset=4), "accessors.0 needs 52 bytes"),
    (lambda w: accessor(w, "POSITION").update(type="VEC2"), "POSITION (accessors.0) has 2 numbers of float32 each"),
    (lambda w: accessor(w, "POSITION").update(type="MAT4"), "has componentType 5126 and type 'MAT4'"),
    (lambda w: accessor(w, "POSITION").update(componentType=5130), "has componentType 5130 and type 'VEC3'"),
    (lambda w: accessor(w, "POSITION").pop("bufferView"), "accessors.0 has no bufferView"),
    (lambda w: accessor(w, "indices").update(count=5), "a primitive has 5 corners of triangles; expected a"),
    (lambda w: accessor(w, "indices").update(componentType=5122), "holds no indices; expected unsigned integers"),
    (lambda w: view_of(w, "POSITION").update(byteLength=10**6), "ends at byte"),
    (lambda w: view_of(w, "POSITION").update(byteOffset=10**6), "ends at byte"),
    (lambda w: view_of(w, "POSITION").update(byteStride=4), "in steps of 4; expected at most 48 bytes and steps of at"),
    (lambda w: view_of(w, "POSITION").update(byteStride=2**40), "in steps of 1099511627776"),
    (lambda w: view_of(w, "POSITION").update(buffer=7), "bufferViews.1 names buffers.7"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "expected"), HEADER_CHANGES)
def test_a_wrong_header_is_refused_in_one_line_that_names_the_file(tmp_path, change, expected):
    message = refusal(plain_square(change).save(tmp_path / "a.glb"))
    assert expected in message


@pytest.mark.parametrize(
    ("sparse", "expected"),
    [
        ({"count": 10**12}, "accessors.0.sparse has other indices; expected at most 4 unsigned"),
        ({"count": 2, "indices": {"bufferView": 0, "componentType": 5126}}, "has other indices"),
        ({"count": 2, "indices": {"bufferView": 4, "componentType": 5121}}, "accessors.0.sparse names element 9"),
        ({"count": 2, "values": {"bufferView": 99}}, "names bufferViews.99"),
        ({"count": 4}, "accessors.0.sparse needs 4 bytes"),
    ],
)
def test_a_wrong_sparse_accessor_is_refused(tmp_path, sparse, expected):
    writer = GltfWriter()
    primitive = writer.square()
    indices, values = writer.view(b"\0\1"), writer.view(bytes(48))
    writer.view(b"\0\x09")
    common = {"indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}}
    writer.json["accessors"][0]["sparse"] = common | sparse
    writer.show(primitive)
    assert expected in refusal(writer.save(tmp_path / "a.glb"))


def test_a_file_without_faces_or_with_one_that_uses_a_missing_vertex_is_refused(tmp_path):
    data = plain_square().glb()
    assert data.count(FACES.tobytes()) == 1
    path = tmp_path / "a.glb"
    path.write_bytes(data.replace(FACES.tobytes(), struct.pack("<6H", 0, 1, 2, 0, 2, 4)))
    assert "face 1 of accessors.2 uses vertex 4; expected 0 to 3, the vertices that it has" in refusal(path)
    writer = GltfWriter()
    writer.show(writer.square(mode=1))
    assert "found no faces" in refusal(writer.save(tmp_path / "a.glb"))


@pytest.mark.parametrize(("value", "shown"), [(np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf"), (2e5, "200000.0")])
def test_a_vertex_too_far_away_or_not_finite_is_refused(tmp_path, value, shown):
    points = SQUARE.copy()
    points[2, 1] = value
    writer = GltfWriter()
    writer.show(writer.square(points=points))
    with pytest.raises(SceneError, match=rf"vertex 2 is \[2\.0, {shown}, 0\.0\]; expected finite metres within 100000"):
        load_glb(writer.save(tmp_path / "a.glb"), up="y")


@pytest.mark.parametrize("scale", ["NaN", "1e999", "Infinity", "-Infinity", "1e300"])
def test_a_transform_that_is_not_finite_is_refused(tmp_path, scale):
    writer = GltfWriter()
    writer.show(writer.square(), scale=[12345, 1, 1])
    path = writer.save(tmp_path / "a.gltf")
    path.write_text(path.read_text().replace("12345", scale))
    message = refusal(path)
    assert "scale.0 is" in message or (scale == "1e300" and "expected finite metres" in message)


@pytest.mark.parametrize(
    ("children", "expected"),
    [
        ({0: [0]}, "node 0, a child of another"),
        ({0: [1], 1: [0]}, "2 nodes are children of each other in a cycle"),
        ({1: [2], 2: [1]}, "2 nodes are children of each other in a cycle"),
        ({0: [2], 1: [2]}, "node 2 is a child of nodes 0 and 1; expected one parent"),
        ({0: [2, 2]}, "node 2 is a child of nodes 0 and 0; expected one parent"),
        ({1: [0]}, "the scene names node 0, a child of another"),
        ({0: [77]}, "nodes.0 names nodes.77; expected nodes 0 to 2"),
    ],
)
def test_nodes_that_do_not_form_trees_are_refused(tmp_path, children, expected):
    writer = plain_square()
    writer.json["nodes"] += [{}, {}]
    for node, below in children.items():
        writer.json["nodes"][node]["children"] = below
    message = refusal(writer.save(tmp_path / "a.glb"))
    assert expected in message or (children == {0: [0]} and "in a cycle" in message)


@pytest.mark.parametrize(
    "uri",
    ["../secret.png", "/etc/passwd", "%2e%2e/secret.png", "a/../../secret.png", "..\\secret.png", "file:///etc/passwd",
     "http://127.0.0.1/a.png", "C:\\a.png", "link/secret.png", "a%00.png", "x" * 5000],
)  # fmt: skip
def test_file_names_outside_the_folder_are_refused(tmp_path, uri):
    (tmp_path / "secret.png").write_bytes(png(np.zeros((2, 2, 3), np.uint8)))
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path)
    writer = plain_square(lambda w: w.json.update(images=[{"uri": uri}]))
    message = refusal(writer.save(folder / "a.glb"))
    assert "expected a file in the folder of the scene" in message


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("data:image/png;base64,@@@", "images.0 has a damaged data: URI"),
        ("data:image/png", "images.0 has a damaged data: URI (no comma)"),
        ("data:image/png;base64,AAAA", "images.0 starts with b'\\x00\\x00\\x00'; expected a PNG, JPEG, WebP or Ba"),
    ],
)
def test_damaged_data_uris_are_refused(tmp_path, uri, expected):
    with pytest.raises(SceneError) as caught:
        load_glb(plain_square(lambda w: w.json.update(images=[{"uri": uri}])).save(tmp_path / "a.glb"))
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("EXT_meshopt_compression", "found EXT_meshopt_compression; expected uncompressed meshes"),
        ("EXT_mesh_gpu_instancing", "expected one node per copy of a mesh"),
    ],
)  # fmt: skip
def test_geometry_that_we_cannot_read_is_refused_even_if_the_file_calls_it_optional(tmp_path, name, expected):
    assert expected in refusal(plain_square(lambda w: w.json.update(extensionsUsed=[name])).save(tmp_path / "a.glb"))


def test_unknown_extensions_are_refused_only_if_the_file_requires_them(tmp_path):
    needed = plain_square(lambda w: w.json.update(extensionsRequired=["EXT_new"])).save(tmp_path / "a.glb")
    assert "needs the extension 'EXT_new'" in refusal(needed)
    load_glb(plain_square(lambda w: w.json.update(extensionsUsed=["EXT_new"])).save(tmp_path / "b.glb"))


def huge_png(width: int, height: int) -> bytes:
    data = bytearray(png(np.zeros((4, 4, 3), np.uint8)))
    data[16:24] = struct.pack(">II", width, height)
    return bytes(data)


def deep_png(width: int, height: int) -> bytes:
    """A PNG whose header announces RGBA of 16 bits and this size."""
    data = bytearray(huge_png(width, height))
    data[24:26] = 16, 6
    return bytes(data)


def huge_webp(width: int, height: int) -> bytes:
    """A header without content."""
    sides = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    return b"RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0" + sides


def huge_jpeg(width: int, height: int, *, mode: str = "RGB", progressive: bool = False) -> bytes:
    """A JPEG without subsampling whose header announces this size."""
    file = io.BytesIO()
    Image.new(mode, (8, 9)).save(file, "JPEG", progressive=progressive, subsampling=0)
    size = struct.pack(">HH", 9, 8)
    assert file.getvalue().count(size) == 1
    return file.getvalue().replace(size, struct.pack(">HH", height, width))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (huge_png(60000, 60000), "images.0 has 60000 x 60000 texels; expected at least 1, at most 16384 a side"),
        (huge_png(16384, 16384), "16384 x 16384 texels"),
        (huge_png(9000, 9000), "images.0 has 9000 x 9000 texels; expected at least 1, at most 16384 a side and 5368"),
        (deep_png(7000, 7000), "7000 x 7000 texels; expected at least 1, at most 16384 a side and 536870912 bytes"),
        (huge_jpeg(9500, 9500), "images.0 has 9500 x 9500 texels; expected at least 1, at most 16384 a side and 53687"),
        (huge_jpeg(8000, 8000, progressive=True), "8000 x 8000 texels; expected at least 1, at most 16384 a side and"),
        (huge_jpeg(7000, 7000, mode="CMYK"), "7000 x 7000 texels; expected at least 1, at most 16384 a side and 5368"),
        (huge_png(0, 4), "0 x 4 texels"),
        (huge_png(4, 5), "images.0 cannot be decoded"),
        (png(np.zeros((4, 4, 3), np.uint8)).replace(b"IDAT", b"IDAX"), "images.0 cannot be decoded"),
        (png(np.zeros((99, 99, 3), np.uint8))[:-40], "images.0 cannot be decoded"),
        (b"RIFF\0\0\0\0WEBPVP8 ", "images.0 starts with b'RIFF"),
        (huge_webp(16384, 9000), "images.0 has 16384 x 9000 texels; expected at least 1, at most 16384 a side and 536"),
        (huge_webp(8, 8), "images.0 cannot be decoded"),
        (b"", "images.0 starts with b''"),
        (jpeg()[:-2], "images.0 cannot be decoded (it has no end)"),
        (jpeg()[:30], "is a JPEG without size"),
        (b"\xff\xd8" + b"\xff\xda\0\2" * 101, "images.0 has more than 100 scans"),
        (b"\xff\xd8" + b"\xff" * 2000, "is a JPEG without size"),
        (b"\xff\xd8\xff\0\0\x08" + bytes(6) + jpeg()[2:], "is a JPEG without size"),
    ],
    ids=range(20),
)  # fmt: skip
def test_an_image_that_cannot_be_read_is_refused_and_never_replaced_by_grey(tmp_path, content, expected):
    assert expected in refusal(with_image(content).save(tmp_path / "a.glb"))

"""Basis Universal images, alone and in GLB files: texels, row order, cache, damage. data/README.md lists the files."""

import binascii
import random
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from sim.cache import VARIABLE
from sim.errors import MissingDependencyError, SceneError
from sim.scans.basis import basis_rgb, basis_size, is_basis
from sim.scans.glb import load_glb
from sim.scans.scene_files import FilePart

from .gltf_files import BLUE, DATA, GREEN, RED, YELLOW, four_colours, loaded, shown, with_basis

FILES = ("corners_etc1s.basis", "corners_uastc.basis", "corners_etc1s.ktx2", "corners_uastc.ktx2")
PART = FilePart(Path("scene.glb"), "images.0")


def content(name: str) -> bytes:
    return (DATA / name).read_bytes()


def texels(data: bytes) -> np.ndarray:
    array = np.frombuffer(data, np.uint8)
    return basis_rgb(array, basis_size(array, PART), PART)


def refusal(data: bytes) -> str:
    with pytest.raises(SceneError) as caught:
        texels(data)
    message = str(caught.value)
    assert message.startswith("scene.glb: images.0 ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("name", FILES)
def test_every_kind_is_read_with_its_top_row_first(name):
    data = np.frombuffer(content(name), np.uint8)
    assert is_basis(data)
    assert basis_size(data, PART) == (64, 64)
    image = texels(content(name))
    assert image.shape == (64, 64, 3)
    assert image.flags.c_contiguous
    np.testing.assert_allclose(image.astype(int), four_colours(64), atol=4 if "etc1s" in name else 1)


@pytest.mark.parametrize("name", FILES)
def test_a_glb_with_basis_textures_shows_them_upright(tmp_path, name):
    mesh = loaded(with_basis(name), tmp_path)
    corners = np.array(shown(mesh) + shown(mesh, 1)[2:])
    np.testing.assert_allclose(corners, [BLUE, YELLOW, GREEN, RED], atol=4)


def with_orientation(data: bytes, orientation: bytes) -> bytes:
    """A KTX2 file whose key-value data also has KTXorientation; the content after it moves back."""
    start, length = struct.unpack("<II", data[56:64])
    (levels,) = struct.unpack("<I", data[40:44])
    pair = b"KTXorientation\0" + orientation + b"\0"
    pair = struct.pack("<I", len(pair)) + pair + b"\0" * (-len(pair) % 4)
    head = bytearray(data[:start])
    head[56:64] = struct.pack("<II", start, length + len(pair))
    for at in range(80, 80 + 24 * levels, 24):
        (offset,) = struct.unpack("<Q", head[at : at + 8])
        head[at : at + 8] = struct.pack("<Q", offset + len(pair))
    return bytes(head) + pair + data[start:]


@pytest.mark.parametrize(("orientation", "top_left"), [(b"rd", RED), (b"ru", BLUE)])
def test_a_ktx2_file_may_say_that_its_first_row_is_the_bottom_one(orientation, top_left):
    image = texels(with_orientation(content("corners_uastc.ktx2"), orientation))
    assert tuple(image[5, 5].tolist()) == top_left


def test_a_converted_image_is_read_from_the_cache_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    path = with_basis("corners_etc1s.basis").save(tmp_path / "a.glb")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "opengl_basisu", None)
        with pytest.raises(MissingDependencyError) as caught:
            load_glb(path)
        assert 'pip install "personal-viz[basis]"' in str(caught.value)
        assert str(caught.value).startswith(f"{path}: images.0 is a Basis texture")
    first = load_glb(path)
    (copy,) = (tmp_path / "cache").rglob("*.texels")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "opengl_basisu", None)
        assert load_glb(path).digest() == first.digest()
    for damage in (b"", copy.read_bytes()[:-5], b"something else"):
        copy.write_bytes(damage)
        assert load_glb(path).digest() == first.digest()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("kept", [2, 12, 60, 79, 99, 300, -1])
def test_a_truncated_image_is_refused(name, kept):
    refusal(content(name)[:kept])


def test_one_wrong_bit_in_a_basis_file_is_noticed_and_bytes_after_its_end_are_ignored():
    data = bytearray(content("corners_etc1s.basis"))
    data[-3] ^= 1
    assert "images.0 has a wrong checksum; expected a whole Basis image" in refusal(bytes(data))
    np.testing.assert_array_equal(texels(content(FILES[0]) + bytes(3)), texels(content(FILES[0])))


def changed(name: str, at: int, new: bytes) -> bytes:
    data = content(name)
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize(
    ("at", "new", "expected"),
    [
        (28, struct.pack("<I", 3), "a KTX2 file of depth 3, 0 layers and 1 faces; expected one image"),
        (36, struct.pack("<I", 6), "0 layers and 6 faces"),
        (40, struct.pack("<I", 10**9), "at most 16 levels"),
        (80, struct.pack("<Q", 10**12), "has a level 0 of 65 bytes at 1000000000000"),
        (96, struct.pack("<Q", 2**31), "2147483648 unpacked; expected at most 16 levels in 1309 bytes, 4096 unpacked"),
        (12, struct.pack("<I", 37), "cannot be decoded"),
    ],
)
def test_a_ktx2_header_that_announces_too_much_is_refused(at, new, expected):
    assert expected in refusal(changed("corners_uastc.ktx2", at, new))


def with_right_checksums(data: bytearray) -> bytes:
    """A `.basis` file with its checksums made right, so that they do not reveal the damage."""
    if data[:2] == b"sB" and len(data) > 77:
        data[4:6], data[8:12] = struct.pack("<H", 77), struct.pack("<I", len(data) - 77)
        data[12:14] = struct.pack("<H", binascii.crc_hqx(bytes(data[77:]), 0xFFFF) ^ 0xFFFF)
        data[6:8] = struct.pack("<H", binascii.crc_hqx(bytes(data[8:77]), 0xFFFF) ^ 0xFFFF)
    return bytes(data)


def test_randomly_damaged_images_are_read_or_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    rng = random.Random(3)
    read = refused = 0
    for k in range(800):
        data = bytearray(content(FILES[k % 4]))
        for _ in range(rng.choice([1, 1, 2, 8])):
            data[rng.randrange(min(len(data), rng.choice([200, 6000])))] = rng.choice([0, 255, rng.randrange(256)])
        try:
            image = texels(with_right_checksums(data))
        except SceneError as error:
            refused += "\n" not in str(error)
            continue
        read += image.ndim == 3
    assert read + refused == 800
    assert min(read, refused) > 100

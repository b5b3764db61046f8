"""Where a glTF material puts its images, and images of every kind. test_basis.py has Basis images."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from sim.mesh import FLAT

from .gltf_files import BLUE, DATA, GREEN, RED, UV, YELLOW, GltfWriter, drawn, four_colours, loaded, png, shown


def pictured(writer, content=None, *, uv=UV, sampler=None, **info):
    """A square that shows an encoded image; None = four colours."""
    texture = writer.image(png(four_colours()) if content is None else content, **(sampler or {}))
    return writer.square(uv=uv, material=writer.material(texture, **info))


def test_the_material_chooses_its_texture_coordinates(tmp_path):
    def squares(writer):
        texture = writer.image(png(four_colours()))
        infos = [{"texCoord": 1}, {"extensions": {"KHR_texture_transform": {"texCoord": 1}}}, {}]
        primitives = [writer.square(uv=UV, material=writer.material(texture, **info)) for info in infos]
        for primitive in primitives:
            primitive["attributes"]["TEXCOORD_1"] = writer.accessor(UV[::-1].copy())
        return primitives

    mesh = drawn(tmp_path, squares)
    assert len(mesh.textures) == 1
    for face, corners in ((0, UV[::-1]), (2, UV[::-1]), (4, UV)):
        np.testing.assert_array_equal(mesh.face_uv[face], corners[:3])


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"offset": [0.5, 0.25]}, [[0.5, 1.25], [1.5, 1.25], [1.5, 0.25]]),
        ({"scale": [2, 3]}, [[0, 3], [2, 3], [2, 0]]),
        # the example of the extension's specification: the lower left quarter of the image, turned clockwise
        ({"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}, [[0.5, 1], [0.5, 0.5], [0, 0.5]]),
        ({"scale": [1, -1], "offset": [0, 1]}, [[0, 0], [1, 0], [1, 1]]),
    ],
)
def test_texture_transforms_scale_then_turn_then_shift(tmp_path, transform, expected):
    def square(writer):
        writer.json["extensionsRequired"] = ["KHR_texture_transform", "KHR_materials_unlit"]
        return pictured(writer, extensions={"KHR_texture_transform": transform})

    np.testing.assert_allclose(drawn(tmp_path, square).face_uv[0], expected, atol=1e-6)


def test_one_image_in_two_tints_is_two_textures_and_two_images_with_the_same_bytes_are_one(tmp_path):
    writer = GltfWriter()
    texture = writer.image(png(four_colours()))
    materials = [writer.material(texture, factor) for factor in (None, [1, 1, 1, 0.5], [0.5, 0.5, 0.5, 1])]
    writer.show(*(writer.square(uv=UV, material=material) for material in materials))
    mesh = loaded(writer, tmp_path)
    assert mesh.face_texture.tolist() == [0, 0, 0, 0, 1, 1]
    assert mesh.textures[1][0, 0].tolist() == [100, 20, 20]
    writer = GltfWriter()
    first = writer.image(png(four_colours()))
    second = writer.add("textures", {"source": writer.add("images", dict(writer.json["images"][0]))})
    writer.show(*(writer.square(uv=UV, material=writer.material(texture)) for texture in (first, second)))
    assert len(loaded(writer, tmp_path).textures) == 1


@pytest.mark.parametrize("mode", ["L", "1", "P", "LA", "RGBA", "I;16"])
def test_png_images_of_every_kind_are_read(tmp_path, mode):
    image = Image.fromarray(four_colours()).convert("L" if mode == "I;16" else mode)
    expected = np.array(image.convert("RGB"))
    if mode == "I;16":
        image = Image.fromarray(np.array(image, np.uint16) * 257)
    file = io.BytesIO()
    image.save(file, "PNG")
    mesh = drawn(tmp_path, lambda w: pictured(w, file.getvalue()))
    np.testing.assert_array_equal(mesh.textures[0], expected)


@pytest.mark.parametrize("mode", ["L", "RGB", "CMYK"])
def test_jpeg_images_of_every_kind_are_read(tmp_path, mode):
    file = io.BytesIO()
    Image.fromarray(four_colours(32)).convert(mode).save(file, "JPEG", quality=95)
    texture = drawn(tmp_path, lambda w: pictured(w, file.getvalue(), sampler={"mime": "image/jpeg"})).textures[0]
    expected = np.array(Image.fromarray(four_colours(32)).convert(mode).convert("RGB"))
    np.testing.assert_allclose(texture[8, 8].astype(int), expected[8, 8], atol=6)
    assert texture.flags.c_contiguous


@pytest.mark.parametrize(
    ("has_alpha", "lossless", "first_part"),
    [(False, True, b"VP8L"), (False, False, b"VP8 "), (True, True, b"VP8L"), (True, False, b"VP8X")],
)
def test_webp_images_are_read_where_the_file_requires_their_extension(tmp_path, has_alpha, lossless, first_part):
    image, file = Image.fromarray(four_colours(32)).resize((32, 24)), io.BytesIO()
    if has_alpha:
        image.putalpha(Image.fromarray(np.tile(np.arange(100, 132, dtype=np.uint8), (24, 1))))
    image.save(file, "WEBP", lossless=lossless, quality=100)
    assert file.getvalue()[12:16] == first_part

    def shown(writer):
        source = writer.add("images", {"bufferView": writer.view(file.getvalue()), "mimeType": "image/webp"})
        texture = writer.add("textures", {"extensions": {"EXT_texture_webp": {"source": source}}})
        writer.json["extensionsUsed"] = writer.json["extensionsRequired"] = ["EXT_texture_webp"]
        return writer.square(uv=UV, material=writer.material(texture))

    (texture,) = drawn(tmp_path, shown).textures
    expected = np.array(Image.open(file).convert("RGB"))
    assert texture.shape == (24, 32, 3)
    np.testing.assert_allclose(texture.astype(int), expected, atol=0 if lossless else 3)


@pytest.mark.parametrize("uri", ["none.png", "", "textures/none.jpg"])
@pytest.mark.parametrize(("factor", "rgb"), [(None, 200), ([0.2, 0.2, 0.2, 1.0], 51)])
def test_a_missing_image_file_is_a_warning_and_its_faces_have_the_materials_colour(tmp_path, uri, factor, rgb):
    def shown(writer):
        texture = writer.add("textures", {"source": writer.add("images", {"uri": uri})})
        return writer.square(uv=UV, material=writer.material(texture, factor))

    with pytest.warns(
        UserWarning, match=rf"images\.0 names '{uri}'; expected a file, but there is none .* plain colour"
    ):
        mesh = drawn(tmp_path, shown)
    assert (set(mesh.face_texture.tolist()), mesh.textures) == ({FLAT}, ())
    assert np.unique(mesh.face_rgb).tolist() == [rgb]


CLAMP, MIRROR = 33071, 33648


@pytest.mark.parametrize(
    ("reach", "wrap", "corners"),
    [
        (0.4, {"wrapS": CLAMP, "wrapT": CLAMP}, [BLUE, YELLOW, GREEN]),
        (0.4, {"wrapS": MIRROR, "wrapT": MIRROR}, [BLUE, YELLOW, GREEN]),
        (0.4, {}, [GREEN, RED, BLUE]),
        (0.8, {"wrapS": CLAMP, "wrapT": CLAMP}, [BLUE, YELLOW, GREEN]),
        (0.8, {"wrapS": MIRROR, "wrapT": MIRROR}, [GREEN, RED, BLUE]),
        (0.8, {}, [BLUE, YELLOW, GREEN]),
        (0.8, {"wrapS": MIRROR, "wrapT": CLAMP}, [YELLOW, BLUE, RED]),
        (9.8, {"wrapS": MIRROR, "wrapT": MIRROR}, [BLUE, YELLOW, GREEN]),  # repeated: mirrored, it would be too large
    ],
)
def test_images_are_clamped_or_mirrored_where_faces_reach_beyond_them(tmp_path, reach, wrap, corners):
    """The square reaches beyond the image by `reach` image sizes on every side."""
    uv = (UV - 0.5) * (1 + 2 * reach) + 0.5
    mesh = drawn(tmp_path, lambda w: pictured(w, png(four_colours(80)), uv=uv, sampler=wrap))
    side = 80 + 2 * 80 * reach if wrap and reach < 1 else 80
    assert mesh.textures[0].shape == pytest.approx((side, side, 3), abs=1)
    assert shown(mesh) == corners


def test_a_clamped_image_shown_within_its_edges_is_kept_and_invalid_coordinates_become_zero(tmp_path):
    wrap = {"wrapS": CLAMP, "wrapT": CLAMP}
    mesh = drawn(tmp_path, lambda w: pictured(w, uv=UV * 1.01 - 0.005, sampler=wrap))
    assert mesh.textures[0].shape == (8, 8, 3)
    np.testing.assert_allclose(mesh.face_uv[0], UV[:3] * 1.01 - 0.005, atol=1e-6)
    uv = np.array([[np.nan, 1], [np.inf, 0.5], [1e30, -np.inf], [0.25, 3]], np.float32)
    mesh = drawn(tmp_path, lambda w: pictured(w, uv=uv))
    np.testing.assert_array_equal(mesh.face_uv[1], [[0, 1], [0, 0], [0.25, 3]])


def test_a_plain_image_is_preferred_to_a_basis_one(tmp_path):
    writer = GltfWriter()
    basis = writer.add("images", {"bufferView": writer.view((DATA / "corners_etc1s.ktx2").read_bytes())})
    texture = writer.image(png(four_colours()))
    writer.json["textures"][texture]["extensions"] = {"KHR_texture_basisu": {"source": basis}}
    writer.show(writer.square(uv=UV, material=writer.material(texture)))
    np.testing.assert_array_equal(loaded(writer, tmp_path).textures[0], four_colours())

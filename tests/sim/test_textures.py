"""Textures of finishes: their colours, no seams, and patterns that differ."""

import hashlib
import itertools
import subprocess
import sys
from typing import get_args

import numpy as np
import pytest

from sim.homes.building.textures import second_colour, texture_of
from sim.homes.plan import Finish
from sim.words.finishes import Material, Pattern, Rgb

MATERIALS: tuple[Material, ...] = get_args(Material)
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
SMOOTH = ("glass", "plastic", "ceramic")
LAID = ("wood", "stone", "carpet")
REPEATED = [
    (Finish(material=material, pattern=pattern, rgb=(150, 90, 70), rgb2=(226, 210, 180)), is_floor)
    for material, pattern in itertools.product(MATERIALS, PATTERNS)
    for is_floor in (False, True)
    if not (is_floor and material not in LAID)
    if material != "picture" and not (pattern == "plain" and material in (*SMOOTH, "metal"))
]


def image_of(finish: Finish, *, is_floor: bool = False) -> np.ndarray:
    """The image of the finish as floats, so that images can be subtracted."""
    texture = texture_of(finish, is_floor=is_floor)
    assert texture is not None
    return texture.image.astype(float)


def fabric(pattern: Pattern, rgb: Rgb = (150, 60, 52), rgb2: Rgb | None = (226, 200, 160)) -> Finish:
    """Cloth with a pattern."""
    return Finish(material="fabric", pattern=pattern, rgb=rgb, rgb2=rgb2)


@pytest.mark.parametrize(("finish", "is_floor"), REPEATED)
def test_an_image_repeats_without_a_seam(finish: Finish, is_floor: bool) -> None:
    image = image_of(finish, is_floor=is_floor)
    for axis in (0, 1):
        steps = np.abs(image - np.roll(image, 1, axis=axis)).mean(axis=(1 - axis, 2))
        assert steps[0] <= 1.1 * steps[1:].max()


@pytest.mark.parametrize(("finish", "is_floor"), REPEATED)
def test_the_mean_is_between_the_colours(finish: Finish, is_floor: bool) -> None:
    mean = image_of(finish, is_floor=is_floor).mean(axis=(0, 1))
    first, second = np.array(finish.rgb, float), np.array(second_colour(finish), float)
    share = (mean - first) @ (second - first) / ((second - first) @ (second - first))
    np.testing.assert_allclose(mean, first + share * (second - first), atol=2)
    if finish.pattern == "plain":
        np.testing.assert_allclose(mean, first, atol=2)
    else:
        assert 0.1 < share < 0.8


@pytest.mark.parametrize("rgb", [(255, 255, 255), (250, 250, 240), (0, 0, 0), (20, 20, 24), (255, 0, 0)])
@pytest.mark.parametrize("material", ["wood", "tile", "leaf", "wicker"])
def test_extreme_colours_keep_their_mean_and_show_their_material(material: Material, rgb: Rgb) -> None:
    image = image_of(Finish(material=material, rgb=rgb))
    np.testing.assert_allclose(image.mean(axis=(0, 1)), rgb, atol=14)
    assert image.std(axis=(0, 1)).max() > 1


@pytest.mark.parametrize("material", MATERIALS)
def test_images_are_small_and_can_be_read_by_the_renderer(material: Material) -> None:
    for is_floor in (False, True):
        texture = texture_of(Finish(material=material, pattern="plaid", rgb=(100, 120, 90)), is_floor=is_floor)
        assert texture is not None
        assert texture.image.dtype == np.uint8
        assert texture.image.flags.c_contiguous
        assert 64 <= min(texture.image.shape[:2]) <= max(texture.image.shape[:2]) <= 256
        assert min(texture.metres) > 0.1
        np.testing.assert_allclose(texture.rgb, texture.image.mean(axis=(0, 1)))
        with pytest.raises(ValueError, match="read-only"):
            texture.image[0, 0] = 0


def test_smooth_materials_without_a_pattern_have_no_image_and_a_missing_second_colour_is_derived() -> None:
    for material in SMOOTH:
        assert texture_of(Finish(material=material, rgb=(200, 200, 200))) is None
        assert texture_of(Finish(material=material, pattern="dotted", rgb=(200, 200, 200))) is not None
    assert texture_of(Finish(material="metal", rgb=(186, 190, 196))) is not None, "steel is brushed"
    assert texture_of(Finish(material="metal", rgb=(186, 40, 40))) is None, "painted metal is smooth"
    assert second_colour(fabric("plaid", (200, 100, 60), None)) == (100, 50, 30)
    assert second_colour(fabric("plaid", (40, 60, 20), None)) == (148, 158, 138)
    assert second_colour(fabric("plaid", (40, 60, 20), (1, 2, 3))) == (1, 2, 3)


def test_patterns_differ_from_each_other_and_from_plain_cloth() -> None:
    images = [image_of(fabric(pattern)) - image_of(fabric(pattern)).mean(axis=(0, 1)) for pattern in PATTERNS]
    contrast = [image.std() for image in images]
    assert min(contrast[1:]) > 2.5 * contrast[0], dict(zip(PATTERNS, contrast, strict=True))
    for (i, one), (j, other) in itertools.combinations(enumerate(images), 2):
        one, other = np.resize(one, other.shape), other
        alike = (one * other).sum() / (np.linalg.norm(one) * np.linalg.norm(other))
        assert abs(alike) < 0.75, (PATTERNS[i], PATTERNS[j])


def test_stripes_run_down_plaid_runs_both_ways_and_checked_tiles_are_whole() -> None:
    striped, plaid = image_of(fabric("striped"))[..., 1], image_of(fabric("plaid"))[..., 1]
    assert striped.mean(axis=0).std() > 10 * striped.mean(axis=1).std()
    assert plaid.mean(axis=0).std() == pytest.approx(plaid.mean(axis=1).std(), rel=0.2)
    texture = texture_of(Finish(material="tile", pattern="checked", rgb=(230, 230, 230), rgb2=(40, 40, 40)))
    assert texture is not None
    middles = texture.image[32::64, 32::64, 0] > 128
    assert middles.tolist() == [[True, False, True, False], [False, True, False, True]] * 2


def test_wood_has_planks_on_floors_only() -> None:
    wood = Finish(material="wood", rgb=(156, 110, 66))
    laid = texture_of(wood, is_floor=True)
    assert laid is not None
    rows = laid.image.astype(float).mean(axis=(1, 2))
    assert laid.metres[1] / 0.125 == 8, "eight planks of 12.5 cm"
    joints = rows[::32]
    assert (joints < np.minimum(np.roll(rows, -2)[::32], np.roll(rows, 2)[::32]) - 15).all()
    solid = image_of(wood).mean(axis=(1, 2))
    assert np.abs(np.diff(solid)).max() < 15


def test_a_picture_covers_its_piece_once_and_differs_by_colour() -> None:
    finishes = [Finish(material="picture", rgb=(60 + 20 * k, 90, 160 - 10 * k)) for k in range(6)]
    textures = [texture_of(finish) for finish in finishes]
    images = [texture.image for texture in textures if texture is not None and texture.is_whole]
    assert len({image.tobytes() for image in images}) == 6
    assert all(image.std(axis=(0, 1)).max() > 15 for image in images), "no picture is plain"


def test_the_same_finish_has_the_same_image_in_another_process() -> None:
    program = (
        "import hashlib\nfrom sim.homes.plan import Finish\nfrom sim.homes.building.textures import texture_of\n"
        "for material in ('wood', 'leaf', 'picture', 'carpet'):\n"
        "    texture = texture_of(Finish(material=material, pattern='floral', rgb=(10, 90, 160)), is_floor=True)\n"
        "    print(hashlib.sha256(texture.image.tobytes()).hexdigest())\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    here = [
        texture_of(Finish(material=material, pattern="floral", rgb=(10, 90, 160)), is_floor=True)
        for material in ("wood", "leaf", "picture", "carpet")
    ]
    digests = [hashlib.sha256(texture.image.tobytes()).hexdigest() for texture in here if texture is not None]
    assert done.stdout.split() == digests

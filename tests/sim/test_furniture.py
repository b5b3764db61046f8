"""Pieces of furniture as shapes: inside their boxes, of few triangles, facing outwards, and always the same."""

import numpy as np
import pytest

from personal_viz.contact_sheet.portrait import portrait
from sim.homes.building.quads import QuadBuilder, add_piece
from sim.homes.furniture.appearance import finish_from_text
from sim.homes.furniture.families import Vec, look_of
from sim.homes.furniture.lofts import ball, cushion, cylinder, lathe, ring, sheet, tube
from sim.homes.furniture.parts import parts_of
from sim.homes.furniture.shapes import Part, Shape, box, prism, rounded_box, slab
from sim.homes.plan import Finish, Furniture

from .furniture_catalogue import RELEASE_CATEGORIES, WORDS

ALL = sorted({*RELEASE_CATEGORIES, *WORDS, "strange thing"})
TOLERANCE = 0.002
MOST_TRIANGLES = 1000


def piece_of(category: str, caption: str = "", size: Vec | None = None, name: str = "") -> Furniture:
    return Furniture(
        name=name or f"{category}_1",
        category=category,
        centre=(0.0, 0.0, 0.0),
        size=size or look_of(category).size,
        finish=finish_from_text(caption, category),
        caption=caption,
    )


def bounds(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.concatenate([part.shape.corners.reshape(-1, 3) for part in parts])
    return corners.min(axis=0), corners.max(axis=0)


def triangles(shape: Shape) -> np.ndarray:
    """Triangles (T, 3, 3) with an area."""
    both = np.concatenate([shape.corners[:, [0, 1, 2]], shape.corners[:, [0, 2, 3]]])
    area = np.linalg.norm(np.cross(both[:, 1] - both[:, 0], both[:, 2] - both[:, 0]), axis=1)
    return both[area > 1e-9]


def volume(shape: Shape) -> float:
    """Enclosed volume, cubic metres; negative if the faces look inwards."""
    a, b, c = np.moveaxis(triangles(shape), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("category", ALL)
def test_a_piece_fills_its_box_and_stays_inside(category: str) -> None:
    usual = np.array(look_of(category).size)
    for factors in ((1, 1, 1), (0.1, 1, 1), (1, 1, 0.12), (1.4, 0.3, 1.2), (0.7, 1.3, 0.7)):
        size: Vec = tuple((usual * factors).tolist())
        low, high = bounds(parts_of(piece_of(category, size=size)))
        least, most = np.array([-size[0] / 2, 0.0, -size[2] / 2]), np.array([size[0] / 2, size[1], size[2] / 2])
        assert (low >= least - TOLERANCE).all(), (factors, low)
        assert (high <= most + TOLERANCE).all(), (factors, high)
        assert ((high - low) > 0.45 * np.array(size)).all(), (factors, high - low)


@pytest.mark.parametrize("category", ALL)
def test_a_piece_has_few_triangles_and_unit_normals_and_is_the_same_when_built_again(category: str) -> None:
    parts = parts_of(piece_of(category))
    assert 12 <= sum(len(triangles(part.shape)) for part in parts) <= MOST_TRIANGLES
    for part, again in zip(parts, parts_of(piece_of(category)), strict=True):
        assert part.finish == again.finish
        assert all(np.array_equal(a, b) for a, b in zip(part.shape, again.shape, strict=True))
        assert np.isfinite(part.shape.corners).all()
        assert np.isfinite(part.shape.uv).all()
        lengths = np.linalg.norm(part.shape.normals, axis=2)
        flat = np.ptp(part.shape.corners, axis=1).max(axis=1) < 1e-6
        np.testing.assert_allclose(lengths[~flat & (lengths.min(axis=1) > 0.5)], 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (box((1, 2, 3), (2, 3, 4)), 24.0),
        (slab((0, 0, 0), (2, 1, 1), faces="+x-x+y-y+z-z"), 2.0),
        (cylinder((0, 1, 0), 1.0, 2.0, sides=64), 2 * np.pi),
        (cylinder((0, 0, 0), 1.0, 3.0, top=0.0, sides=64), np.pi),
        (ball((0, 5, 0), (2, 2, 2), sides=64, rings=40), 4 / 3 * np.pi),
        (tube([(0, 0, 0), (0, 0, 2), (0, 0, 4)], 0.1, sides=32), np.pi * 0.01 * 4),
        (ring((0, 0, 0), 1.0, 0.1, axis="y", sides=64, around=32), 2 * np.pi**2 * 0.01),
        (prism([(0, 0), (2, 0), (0, 2)], low=1.0, high=2.0, axis="x"), 2.0),
        (prism([(0, 0), (2, 0), (0, 2)], low=1.0, high=2.0, axis="y"), 2.0),
        (prism([(0, 0), (2, 0), (0, 2)], low=1.0, high=2.0, axis="z"), 2.0),
    ],
)
def test_solids_are_closed_and_face_outwards(shape: Shape, expected: float) -> None:
    assert volume(shape) == pytest.approx(expected, rel=0.03)


def test_a_rounded_box_lacks_its_edges_and_curved_surfaces_have_smooth_normals() -> None:
    shape = rounded_box((1, 1, 1), (2, 2, 2), 0.1)
    assert len(triangles(shape)) == 44
    assert volume(shape) == pytest.approx(8 - 12 * 2 * 0.1**2 / 2, rel=0.01)
    away = (shape.corners.mean(axis=1) - 1) / np.linalg.norm(shape.corners.mean(axis=1) - 1, axis=1, keepdims=True)
    assert ((shape.normals.mean(axis=1) * away).sum(axis=1) > 0).all()
    assert volume(cushion((0, 0, 0), (0.5, 0.2, 0.4))) > 0.35 * 0.5 * 0.2 * 0.4
    shape = lathe([(1.0, 0.0), (1.0, 1.0), (0.5, 1.0)], sides=12)
    side, lid = shape.normals[:12], shape.normals[12:]
    outwards = shape.corners[:12] * [1, 0, 1]
    np.testing.assert_allclose(side, outwards / np.linalg.norm(outwards, axis=2, keepdims=True), atol=1e-9)
    np.testing.assert_allclose(lid, np.broadcast_to([0, 1, 0], lid.shape), atol=1e-9)


def test_texture_coordinates_are_in_metres_and_normals_stay_perpendicular_after_stretching() -> None:
    flat = box((0, 0, 0), (2.0, 0.5, 1.0))
    np.testing.assert_allclose(np.ptp(flat.uv, axis=1).max(axis=0), [2.0, 1.0])
    hung = sheet([[(0, 1, 0), (1, 1, 0)], [(0, 0, 0), (1, 0, 0)]])
    np.testing.assert_allclose(hung.normals, np.broadcast_to([0, 0, 1.0], (1, 4, 3)))
    np.testing.assert_allclose(np.ptp(hung.uv, axis=1)[0], [1.0, 1.0])
    shape = ball((0, 0, 0), (1, 1, 1), sides=32, rings=24).scaled((4.0, 1.0, 1.0))
    flat = np.cross(shape.corners[:, 2] - shape.corners[:, 0], shape.corners[:, 3] - shape.corners[:, 1])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert ((flat * shape.normals.mean(axis=1)).sum(axis=1) > 0.9).all()


def same_shape(a: list[Part], b: list[Part]) -> bool:
    return len(a) == len(b) and all(np.array_equal(x.shape.corners, y.shape.corners) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    ("category", "plain", "said"),
    [
        ("table", "a wooden table", "a round wooden table"),
        ("couch", "grey couch", "grey L-shaped couch"),
        ("mirror", "a mirror", "an oval mirror"),
        ("rug", "red rug", "round red rug"),
        ("wardrobe", "white wardrobe", "white wardrobe with a mirror as doors"),
        ("plant", "a plant", "a christmas tree"),
        ("cabinet", "bathroom cabinet", "sink cabinet"),
        ("ottoman", "square ottoman", "round ottoman"),
    ],
)
def test_words_of_a_caption_change_the_shape(category: str, plain: str, said: str) -> None:
    changed = parts_of(piece_of(category, said))
    if category == "cabinet":
        assert same_shape(parts_of(piece_of("cabinet", plain)), changed)  # both have a basin
        return
    assert not same_shape(parts_of(piece_of(category, plain)), changed)


def test_words_about_other_objects_change_nothing_and_shapes_without_words_vary_with_the_name() -> None:
    near = parts_of(piece_of("table", "a wooden table next to the round rug", name="table_4"))
    assert same_shape(near, parts_of(piece_of("table", "a wooden table", name="table_4")))
    found = [parts_of(piece_of("nightstand", name=f"nightstand_{k}")) for k in range(12)]
    assert any(not same_shape(found[0], other) for other in found[1:])


def test_a_piece_stands_in_the_world_turned_by_its_yaw() -> None:
    builder = QuadBuilder()
    finish = Finish(rgb=(30, 30, 30))
    tv = Furniture(name="tv_1", category="tv", centre=(5, 1, 2), size=(1, 0.6, 0.1), finish=finish, yaw=np.pi / 2)
    add_piece(builder, tv, instance=7)
    mesh = builder.mesh()
    assert (mesh.face_instance == 7).all()
    used = mesh.vertices[np.unique(mesh.faces)]
    np.testing.assert_allclose(used.min(axis=0), [4.95, 0.7, 1.5], atol=0.02)
    np.testing.assert_allclose(used.max(axis=0), [5.05, 1.3, 2.5], atol=0.02)
    sheen = np.abs(mesh.face_rgb.astype(int) - mesh.face_rgb[:, :1]).max(axis=1) > 10  # the bluish glare of the screen
    assert used[:, 0].max() - mesh.vertices[mesh.faces[sheen]][..., 0].mean() < 0.03  # the front looks along +x


def test_a_portrait_shows_the_piece_in_its_colour() -> None:
    picture = portrait(piece_of("armchair", "red armchair"), side=64).astype(int)
    assert picture.shape == (64, 64, 3)
    is_red = picture[..., 0] > 1.6 * picture[..., 1]
    assert 0.15 < is_red.mean() < 0.8
    assert not is_red[0].any()
    assert not is_red[:, [0, -1]].any()

"""Labels on objects in robots' pictures, and clicks on cut storeys."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.copies.cut import storey_cut, storey_mesh
from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import LabelledRenderer, renderer_of
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.pog import PogScene
from sim.types import CUT_HEIGHT, Camera, Pose


@pytest.fixture(scope="module")
def scene(demo_root: Path) -> Scene:
    """The invented home Demo."""
    return open_scene(PersonalDataset(demo_root), "Demo")


def test_labels_change_the_picture_only_if_objects_are_in_view(scene: Scene) -> None:
    plain = Raycaster(scene.mesh)
    named = LabelledRenderer(plain, scene)
    camera = Camera(width=320, height=240)
    views = [
        T_world_camera(Pose(tuple(scene.navigation.random_point(np.random.default_rng(seed))), 0.5 * seed), camera)
        for seed in range(6)
    ]
    changed = 0
    for view in views:
        before, after = plain.render(view, camera), named.render(view, camera)
        assert np.array_equal(before.depth_m, after.depth_m)
        assert np.array_equal(before.instance_ids, after.instance_ids)
        counts = np.bincount(before.instance_ids.ravel(), minlength=2)[1:]
        differs = not np.array_equal(before.rgb, after.rgb)
        assert differs == bool((counts >= 5e-4 * 320 * 240).any())
        changed += differs
        assert np.array_equal(after.rgb, named.render(view, camera).rgb)
    assert changed


def test_pictures_have_labels_only_where_the_scene_was_opened_with_them(scene: Scene, demo_root: Path) -> None:
    assert isinstance(renderer_of(scene).wrapped, Raycaster)
    assert isinstance(renderer_of(replace(scene, kind="schematic")).wrapped, Raycaster)
    labelled = open_scene(PersonalDataset(demo_root), "Demo", labels=True)
    assert isinstance(renderer_of(labelled).wrapped, LabelledRenderer)
    assert labelled.digest == scene.digest, "words change no step and no distance"
    assert (scene.label, labelled.label) == ("Demo (invented home)", "Demo (invented home, labels)")


def test_a_click_from_above_hits_the_floor_below_the_cut_and_a_click_on_the_sky_hits_nothing(scene: Scene) -> None:
    pog_scene = PogScene(scene, make_renderer=Raycaster)
    assert len(pog_scene.storeys) == 2
    for index, floor_y in enumerate(pog_scene.storeys):
        x, y, z = scene.navigation.random_point(np.random.default_rng(3), storey_y=floor_y)
        hit = pog_scene.hit(index, (x, floor_y + 30.0, z), (0.0, -2.0, 0.0))
        assert hit is not None
        assert (hit[0], hit[2]) == pytest.approx((x, z), abs=1e-4)
        assert y - 0.05 <= hit[1] <= floor_y + CUT_HEIGHT + 0.05
    assert pog_scene.hit(0, (0.0, 30.0, 0.0), (0.0, 1.0, 0.0)) is None


def test_the_object_under_a_ray_is_that_of_the_face_that_the_ray_meets(scene: Scene) -> None:
    pog_scene = PogScene(scene, make_renderer=Raycaster)
    names = {item.instance_id: item.name for item in scene.objects}
    rng = np.random.default_rng(5)
    found = set[str | None]()
    for storey, floor_y in enumerate(pog_scene.storeys):
        mesh = storey_mesh(scene, floor_y)
        for item in scene.objects:
            origin = np.array(item.centre) + rng.uniform((-3.0, 2.0, -3.0), (3.0, 6.0, 3.0))
            direction = 0.3 * (np.array(item.centre) - origin)
            face = int(Raycaster(mesh).cast(origin[None], direction[None]).face_ids[0])
            expected = names.get(int(mesh.face_instance[face])) if face >= 0 else None
            met = pog_scene.object_at(storey, origin.tolist(), direction.tolist())
            assert (met.name if met is not None else None) == expected
            found.add(expected)
    assert None in found
    assert len(found) > 10


def test_no_ray_and_a_ray_that_is_no_number_meet_no_object(scene: Scene) -> None:
    pog_scene = PogScene(scene, make_renderer=Raycaster)
    for direction in ((0.0, 0.0, 0.0), (float("nan"), 1.0, 0.0), (float("inf"), 1.0, 0.0)):
        assert pog_scene.object_at(0, (0.0, 5.0, 0.0), direction) is None


def test_the_middle_of_an_object_is_no_higher_than_its_storey_is_shown(scene: Scene) -> None:
    pog_scene = PogScene(scene, make_renderer=Raycaster)
    low = scene.objects[0]
    assert pog_scene.middle_of(0, low) == low.centre
    x, _, z = low.centre
    assert pog_scene.middle_of(0, replace(low, centre=(x, 9.0, z))) == (x, storey_cut(scene, 0.0).top_y, z)

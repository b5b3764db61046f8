"""Figures of `personal-viz homes`: path ratios, held-out episodes and shares, with values computed by hand."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from personal_viz.bench.homes.held_out import (
    Served,
    Walk,
    held_out_ratios,
    held_out_walks,
    path_ratios,
    served,
    starts_on_floor,
)
from personal_viz.bench.homes.picture_and_walk import Count, PictureAndWalk
from personal_viz.bench.homes.playability import (
    EditionFigures,
    HomeFacts,
    HomesReport,
    build_home,
    home_facts,
    measure_home,
    report_of,
)
from sim.authoring.findable import FindVerdict
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Storey
from sim.types import EpisodeKey, GridSpec
from sim.walk.floor_grid import FloorGrid

from .cell_plans import block, plan_of_cells, two_storeys
from .synthetic import SCENE, example_content, example_episode, example_goal, example_view_point, write_dataset

KEY = EpisodeKey("easy", SCENE, "3")
AHEAD = [0.0, 0.0, 0.0, 1.0]


def corridor() -> FloorGrid:
    """Free cells from x = 0 to 6 m and, after a gap, from x = 7 to 8 m; z from 0 to 0.5 m."""
    rc = [(row, col) for row in range(10) for col in [*range(120), *range(140, 160)]]
    return FloorGrid.from_cells(np.array(rc), np.zeros(len(rc)), grid=GridSpec((0.0, 0.0), 0.05, (10, 160)))


def walk(x0: float, x1: float, recorded: float) -> Walk:
    return Walk(KEY, (x0, 0.0, 0.25), (x1, 0.0, 0.25), recorded)


def test_ratios_are_lengths_over_recorded_lengths_and_infinite_without_a_path() -> None:
    walks = [walk(1, 5, 4.0), walk(1, 5, 3.2), walk(1, 7.5, 6.5), walk(4, 1, 6.0), walk(1, 5, 0.0)]
    ratios = path_ratios(walks, corridor())
    assert ratios[[0, 1, 3]] == pytest.approx([1.0, 1.25, 0.5], abs=1e-6)
    assert np.isinf(ratios[[2, 4]]).all()
    assert path_ratios([], corridor()).shape == (0,)


def test_missing_stairs_and_storeys_and_guessed_floor_are_said() -> None:
    joined = two_storeys()
    said = home_facts(scene_from_plan(joined), joined)
    assert "0% of the floor is guessed" in said
    assert "stairs" not in said
    assert "no record" not in said
    storeys = (Storey(label="first floor", floor_y=0.0), Storey(label="floor 3", floor_y=2.8))
    cells = (*block(20, 20, 40, 40), *block(20, 70, 40, 40, y_cm=280, guessed=True))
    apart = plan_of_cells(cells, storeys=storeys)
    said = home_facts(scene_from_plan(apart), apart)
    assert "of forwards are blocked by what the picture does not show; 50% of the floor is guessed" in said
    assert said.endswith("; 1 storey without stairs to the next; no record tells of: ground floor, second floor.")


def point(x: float, z: float) -> dict[str, Any]:
    return example_view_point(x, z, quat_xyzw=AHEAD, iou=0.4)


LATTICE = [point(1.0 + 0.25 * i, 0.25 * j) for i in range(9) for j in range(5)]


def three_splits(root: Path) -> PersonalDataset:
    """A table in all splits, seen from x = 1-3 and z = 0-1, and a lamp that only `hard` has.

    In `hard`, "1" starts 0.4 m and "2" 0.6 m from the nearest place of the other splits, and "3" asks for the lamp.
    `easy` and `medium` have one episode each, whose start is a place of the other splits too.
    """
    table = example_goal(view_points=LATTICE)
    lamp = example_goal(object_name="lamp_9", object_id=9, object_category="lamp", view_points=[point(2.0, 0.0)])
    own = {f"{SCENE}.basis.glb_coffee table": [table]}
    with_lamp = {**own, f"{SCENE}.basis.glb_lamp": [lamp]}

    def asks(number: int, x: float, length: float, **changes: Any) -> dict[str, Any]:
        info = {"geodesic_distance": length, "euclidean_distance": 2.0, "closest_goal_object_id": 7}
        return example_episode(episode_id=str(number), start_position=[x, 0.0, 0.0], info=info, **changes)

    hard = [asks(1, 3.4, 2.4), asks(2, 3.6, 2.6), asks(3, 3.0, 2.0, object_category="lamp", object_id="lamp_9")]
    return PersonalDataset(
        write_dataset(
            root,
            {
                ("easy", SCENE): example_content(goals_by_category=own, episodes=[asks(1, 3.0, 2.0)]),
                ("medium", SCENE): example_content(goals_by_category=own, episodes=[asks(1, 3.0, 2.5)]),
                ("hard", SCENE): example_content(goals_by_category=with_lamp, episodes=hard),
            },
        )
    )


def test_held_out_episodes_start_near_known_places_and_have_known_targets(tmp_path: Path) -> None:
    dataset = three_splits(tmp_path)
    assert [walk.key.episode_id for walk in held_out_walks(dataset, SCENE, "hard")] == ["1"]
    assert [walk.key.split for walk in held_out_walks(dataset, SCENE, "easy")] == ["easy"]
    (only,) = held_out_walks(dataset, SCENE, "medium")
    assert only == Walk(EpisodeKey("medium", SCENE, "1"), (3.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.5)


def test_held_out_ratios_come_from_homes_built_without_the_split_and_a_single_split_has_none(tmp_path: Path) -> None:
    # easy: 2.0 of 2.0 m; medium: 2.0 of 2.5 m; hard: the map of the others ends at 3.18 m, so at most 2.18 of 2.4 m
    easy, medium, hard = held_out_ratios(three_splits(tmp_path), SCENE)
    assert (easy, medium) == (pytest.approx(1.0, abs=0.02), pytest.approx(0.8, abs=0.02))
    assert 0.8 < hard < 1.1
    assert held_out_ratios(PersonalDataset(write_dataset(tmp_path / "one")), SCENE).shape == (0,)


def test_a_start_is_on_the_floor_within_25_cm_of_it_and_on_its_storey() -> None:
    starts = [
        (1.0, 0.0, 0.25),
        (6.2, 0.0, 0.25),
        (6.3, 0.0, 0.25),
        (1.0, 1.4, 0.25),
        (1.0, 1.6, 0.25),
        (40.0, 0.0, 0.0),
    ]
    assert starts_on_floor(starts, corridor()).tolist() == [True, True, False, True, False, False]


def test_another_edition_is_asked_for_the_episodes_that_the_home_was_not_made_from(tmp_path: Path) -> None:
    def asks(number: int, x: float, length: float) -> dict[str, Any]:
        info = {"geodesic_distance": length, "euclidean_distance": 2.0, "closest_goal_object_id": 7}
        return example_episode(episode_id=str(number), start_position=[x, 0.0, 0.25], info=info)

    def edition(name: str, *episodes: dict[str, Any]) -> Path:
        goals = {f"{SCENE}.basis.glb_coffee table": [example_goal(view_points=[point(1.0, 0.25)])]}
        content = example_content(goals_by_category=goals, episodes=list(episodes))
        return write_dataset(tmp_path / name, {("easy", SCENE): content})

    evidence = edition("evidence", asks(1, 4.0, 3.0))
    dataset = PersonalDataset(edition("own", asks(1, 3.0, 2.0)), evidence=[evidence])
    # the first two are known; then 4 of 3.9 m, 5.3 of 5.0 m from beyond the floor, and one beyond a gap
    episodes = [asks(7, 3.0, 2.0), asks(8, 4.0, 3.0), asks(9, 5.0, 3.9), asks(10, 6.3, 5.0), asks(11, 7.5, 6.0)]
    found = served(PersonalDataset(edition("other", *episodes)), dataset, SCENE, corridor())
    assert found.ratios[0] == pytest.approx(4 / 3.9, abs=1e-3)
    assert found.ratios[1] == pytest.approx(5.0 / 5.0, abs=0.02)
    assert np.isinf(found.ratios[2])
    assert found.on_floor.tolist() == [True, False, True]
    assert served(dataset, dataset, SCENE, corridor()).ratios.shape == (0,)
    assert served(dataset, dataset, "Elsewhere", corridor()).ratios.shape == (0,)


def test_editions_and_their_episodes_are_pooled_over_homes() -> None:
    def gave(starts: int, *left_out: str) -> EditionFigures:
        return EditionFigures(folder="d", starts=starts, view_points=10, objects=2, left_out=left_out)

    first = facts("a", [1.0], sources=(gave(3),), other=Served(np.array([1.0, 1.08]), np.array([True, False])))
    second = facts("b", [1.0], sources=(gave(4, "b/lamp_1"),), other=Served(np.array([math.inf]), np.array([True])))
    total = report_of([first, second]).total
    assert total.sources == (EditionFigures(folder="d", starts=7, view_points=20, objects=4, left_out=("b/lamp_1",)),)
    assert total.other is not None
    assert total.other.model_dump() == {
        "episodes": 3,
        "playable": 0.6667,
        "ratio_median": 1.04,
        "within_5": 0.3333,
        "within_10": 0.6667,
        "starts_on_floor": 0.6667,
    }
    assert report_of([facts("a", [1.0])]).total.other is None


def verdict(*, number: int, pixels: int, alike: tuple[str, ...]) -> FindVerdict:
    return FindVerdict(EpisodeKey("easy", SCENE, str(number)), "couch_1", pixels, (), alike)


def facts(name: str, ratios: list[float], **changes: Any) -> HomeFacts:
    fields: dict[str, Any] = {"name": name, "is_playable": np.isfinite(ratios), "ratios": np.array(ratios)}
    fields |= {"scene_kind": "schematic", "held_out": None, "view_points": (0, 0), "cells": (0, 0), "verdicts": ()}
    fields |= {
        "area_m2": 50.0,
        "storeys": 1,
        "lifts": 0,
        "missing_storeys": (),
        "build_s": 1.234,
        "triangles": 1000,
        "glb_mb": 1.5,
    }
    fields |= {"agreement": PictureAndWalk(*[Count(0, 0)] * 9)}
    return HomeFacts(**fields | changes)


def test_shares_are_pooled_over_homes() -> None:
    first = facts(
        "a",
        [1.0, 1.04, 0.96, math.inf],
        held_out=np.array([1.0, 1.2]),
        view_points=(9, 10),
        cells=(1, 10),
        verdicts=(verdict(number=1, pixels=900, alike=()), verdict(number=2, pixels=900, alike=("couch_2",))),
    )
    second = facts("b", [1.08], held_out=np.array([0.95]), view_points=(20, 30), cells=(29, 90), storeys=2)
    report = report_of([first, second])
    total = report.total
    assert (total.phantom, total.beds) == (None, 0)
    assert (total.episodes, total.playable, total.storeys, total.area_m2) == (5, 0.8, 3, 100.0)
    assert total.ratio_median == pytest.approx(1.02)
    assert total.ratio_p95 == pytest.approx(1.074)  # interpolated between 1.04 and 1.08, at 0.95 of three steps
    assert (total.within_5, total.within_10) == (0.6, 0.8)
    assert (total.heldout_split_within_10, total.heldout_n) == (0.6667, 3)
    assert (total.viewpoints_ok, total.viewpoints_n, total.guessed_area) == (0.725, 40, 0.3)
    assert total.findable == 0.5
    assert report.scenes["a"].not_findable == (f"easy/{SCENE}/2",)
    assert report.scenes["a"].why_not_findable == {f"easy/{SCENE}/2": "couch_1 cannot be told from couch_2"}
    assert (report.scenes["b"].build_s, report.scenes["b"].findable) == (1.23, None)


def test_disagreements_of_picture_and_navigation_are_pooled_over_homes() -> None:
    first = facts("a", [1.0], agreement=PictureAndWalk(*(Count(found, 10) for found in range(1, 10))))
    second = facts("b", [1.0], agreement=PictureAndWalk(*[Count(0, 10)] * 9))
    total = report_of([first, second]).total
    assert (total.phantom, total.phantom_free_ahead, total.mesh_over_map) == (0.05, 0.1, 0.15)
    assert (total.storey_pairs_joined, total.floating, total.in_walls) == (0.2, 0.25, 0.3)
    assert (total.on_beds, total.beds, total.clearance_starts, total.clearance_views) == (7, 20, 0.4, 0.45)


def test_the_report_has_the_agreed_keys_and_is_the_same_after_json() -> None:
    report = report_of([facts("a", [1.0])])
    keys = {"episodes", "playable", "ratio_median", "within_5", "within_10", "heldout_split_within_10"}
    keys |= {"viewpoints_ok", "guessed_area", "findable", "ratio_p95", "area_m2", "storeys"}
    assert keys <= set(report.total.model_dump())
    assert keys | {"build_s", "triangles", "glb_mb", "not_findable"} <= set(report.scenes["a"].model_dump())
    assert report.total.heldout_split_within_10 is None
    assert HomesReport.model_validate_json(report.model_dump_json()) == report


def test_a_small_home_is_measured_from_its_files(tmp_path: Path) -> None:
    dataset = three_splits(tmp_path)
    home = build_home(dataset, SCENE)
    found = measure_home(dataset, home, folds=False)
    assert home.is_recovered
    assert found.held_out is None
    assert found.is_playable.tolist() == [True] * 5
    assert found.ratios[:2] == pytest.approx([1.0, 0.8], abs=0.02)
    assert found.view_points[1] == 46
    # floor for the robot's centre: 0.05 m around the lattice of 2 m by 1 m, and a strip of 0.2 m along a side of it to
    # the start at 3.6 m
    assert found.area_m2 == pytest.approx(2.1 * 1.15 + 0.55 * 0.2, abs=0.1)
    assert found.storeys == 1
    assert found.triangles > 50
    assert found.glb_mb > 0
    assert len(found.verdicts) == 5
    assert found.agreement.phantom.of == 2000
    assert found.agreement.close_starts.of == 5


def test_a_start_off_the_map_or_a_missing_target_is_not_playable(tmp_path: Path) -> None:
    dataset = three_splits(tmp_path)
    home = build_home(dataset, SCENE)
    objects = tuple(item for item in home.scene.objects if item.name != "lamp_9")
    scene = type(home.scene)(SCENE, "schematic", home.scene.mesh, objects, home.scene.navigation, "")
    without_lamp = type(home)(home.plan, scene, is_recovered=True, build_s=0.0)
    assert measure_home(dataset, without_lamp, folds=False).is_playable.tolist() == [True] * 4 + [False]
    far = FloorGrid.from_cells(np.array([[0, 0]]), np.zeros(1), grid=GridSpec((2.0, 0.0), 0.05, (1, 1)))
    off = type(home)(home.plan, type(scene)(SCENE, "schematic", scene.mesh, scene.objects, far, ""), True, 0.0)
    assert not measure_home(dataset, off, folds=False).is_playable.any()


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["XB4GS9ShBRE"])
def test_a_released_home_can_play_its_episodes(dataset_root: Path, scene: str) -> None:
    dataset = PersonalDataset(dataset_root)
    figures = report_of([measure_home(dataset, build_home(dataset, scene))]).total
    assert figures.playable == 1.0
    assert figures.ratio_median == pytest.approx(1.0, abs=0.02)
    assert figures.within_10 is not None
    assert figures.within_10 >= 0.7
    assert figures.heldout_n is not None
    assert figures.heldout_n >= 20
    assert figures.viewpoints_ok is not None
    assert figures.viewpoints_ok >= 0.85
    assert figures.guessed_area is not None
    assert figures.guessed_area <= 0.2

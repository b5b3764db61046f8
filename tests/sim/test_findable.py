"""Targets that can be told apart: homes with two tables and known answers, and how descriptions name objects."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.authoring.cues import delta_e
from sim.authoring.findable import MIN_PIXELS, Sight, best_sight, find_verdict, pose_towards
from sim.episodes.dataset import PersonalDataset
from sim.episodes.described import Described, described_object, names_category
from sim.episodes.schema import EpisodeRecord, Goal
from sim.frames import forward_from_yaw
from sim.homes.cells import CellGrid, CellRun
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Finish, Furniture, HomePlan, Room, Storey
from sim.mesh import Scene, SceneObject
from sim.render.raycast import Raycaster
from sim.types import TURN_STEP

from .plans import GROUND, piece
from .synthetic import SCENE, example_content, example_episode, example_goal, example_view_point, write_dataset

RED, BLUE, WHITE = (178, 44, 40), (52, 92, 164), (236, 234, 228)
PLAIN = Finish(material="plaster", rgb=WHITE)


def table(number: int, x: float, *, rgb: tuple[int, int, int] = RED, **changes: Any) -> Furniture:
    """A coffee table at (x, 0.2, 0)."""
    fields = {"finish": Finish(material="wood", rgb=rgb), "room": "lounge"} | changes
    return piece(f"coffee table_{number}", (x, 0.2, 0.0), (0.8, 0.4, 0.6), **fields)


LOUNGE = Room(name="lounge", storey=0, floor=PLAIN, wall=PLAIN)


def home(*furniture: Furniture, rooms: tuple[Room, ...] = (LOUNGE,)) -> HomePlan:
    """A floor of 10 m by 4 m, z from -1 to 3, on which the furniture stands."""
    runs = tuple(CellRun(row, 0, 200, 0) for row in range(80))
    cells = CellGrid(origin_xz=(-5.0, -1.0), shape=(80, 200), walkable=runs)
    return HomePlan(name=SCENE, kind="schematic", storeys=GROUND, rooms=rooms, furniture=furniture, cells=cells)


def scene_of(plan: HomePlan) -> Scene:
    """The plan's objects without a mesh: verdicts read names and ids only."""
    objects = tuple(
        SceneObject(number, piece.name, piece.category, piece.centre, piece.world_size)
        for number, piece in enumerate(plan.furniture, start=1)
    )
    return Scene(plan.name, plan.kind, None, objects, None, "")


def verdict(tmp_path: Path, plan: HomePlan, *, caption: str, sight: Sight | None = None, **texts: Any):
    """The verdict on Ada's coffee table_7; unless `texts` differ, the description names it by its caption."""
    record = example_episode(
        description=[caption, "", ""],
        summary=texts.get("summary", f"In the lounge Ada owns {caption}."),
        extracted_summary=texts.get("extracted_summary", [f"Ada owns {caption} in the lounge"]),
    )
    goals = {f"{SCENE}.basis.glb_coffee table": [example_goal()]}
    root = write_dataset(tmp_path, {("easy", SCENE): example_content(episodes=[record], goals_by_category=goals)})
    episode = next(PersonalDataset(root).episodes())
    everything = frozenset(range(1, len(plan.furniture) + 1))
    sights = {"coffee table_7": sight or Sight(5000, (0.0, 0.0, 2.0), everything)}
    return find_verdict(episode, plan, scene_of(plan), sights=sights)


def test_the_only_object_of_its_kind_on_a_storey_needs_pixels_only(tmp_path: Path) -> None:
    plan = home(table(7, 0.0))
    assert verdict(tmp_path / "a", plan, caption="a table").findable
    hardly = verdict(tmp_path / "b", plan, caption="a table", sight=Sight(MIN_PIXELS - 1, None, frozenset()))
    assert not hardly.findable
    assert hardly.reason == f"coffee table_7 has {MIN_PIXELS - 1} pixels at its best view point"
    above = table(8, 3.0, centre=(3.0, 3.0, 0.0))
    plan = home(table(7, 0.0), above, table(9, 2.0, name="table_9", category="table"))
    two_storeys = plan.model_copy(update={"storeys": (*plan.storeys, Storey(label="first floor", floor_y=2.8))})
    assert verdict(tmp_path, two_storeys, caption="a coffee table").findable


def test_a_colour_tells_tables_apart_only_when_it_is_said_and_shown(tmp_path: Path) -> None:
    red_and_blue = home(table(7, 0.0), table(8, 3.0, rgb=BLUE))
    both_red = home(table(7, 0.0), table(8, 3.0))
    said = verdict(tmp_path / "a", red_and_blue, caption="a red coffee table")
    assert said.findable
    assert said.cues == (("coffee table_8", "colour red"),)
    unsaid = verdict(tmp_path / "b", red_and_blue, caption="a coffee table")
    assert unsaid.alike == ("coffee table_8",)
    assert unsaid.reason == "coffee table_7 cannot be told from coffee table_8"
    assert not verdict(tmp_path / "c", both_red, caption="a red coffee table").findable
    swapped = home(table(7, 0.0, rgb=BLUE), table(8, 3.0))
    assert not verdict(tmp_path / "d", swapped, caption="a red coffee table").findable


def test_a_colour_only_in_the_caption_or_of_another_object_does_not_count(tmp_path: Path) -> None:
    plan = home(table(7, 0.0), table(8, 3.0, rgb=BLUE))
    texts = {
        "summary": "In the lounge Ada owns a coffee table.",
        "extracted_summary": ["Ada owns a coffee table in the lounge"],
    }
    assert not verdict(tmp_path / "a", plan, caption="a red coffee table", **texts).findable
    assert not verdict(tmp_path / "b", plan, caption="a coffee table next to the red chair").findable


@pytest.mark.parametrize(
    ("caption", "change", "cue"),
    [
        ("a striped coffee table", {"finish": Finish(material="wood", pattern="striped", rgb=RED)}, "pattern striped"),
        ("a marble coffee table", {"finish": Finish(material="stone", rgb=RED)}, "material stone"),
        ("a large coffee table", {"size": (1.2, 0.6, 0.9)}, "size large"),
        ("a low coffee table", {"size": (0.8, 0.3, 0.6)}, "size low"),
    ],
)
def test_pattern_material_and_size_count_too(tmp_path: Path, caption: str, change: dict[str, Any], cue: str) -> None:
    different = home(table(7, 0.0, **change), table(8, 3.0))
    assert verdict(tmp_path / "a", different, caption=caption).cues == (("coffee table_8", cue),)
    assert not verdict(tmp_path / "b", home(table(7, 0.0), table(8, 3.0)), caption=caption).findable


def test_a_neighbour_counts_only_if_it_is_near_and_in_view(tmp_path: Path) -> None:
    lamp, far = (piece("lamp_3", (x, 0.7, 0.0), (0.3, 1.4, 0.3), finish=Finish(rgb=WHITE)) for x in (0.9, 1.5))
    caption = "a coffee table next to the lamp"
    near = home(table(7, 0.0), table(8, 4.0), lamp)
    assert verdict(tmp_path / "a", near, caption=caption).cues == (("coffee table_8", "beside lamp"),)
    unseen = Sight(5000, (0.0, 0.0, 2.0), frozenset({1}))
    assert not verdict(tmp_path / "b", near, caption=caption, sight=unseen).findable
    between = home(table(7, 0.0), table(8, 3.0), far)
    assert not verdict(tmp_path / "c", between, caption=caption).findable


def test_rooms_count_only_if_they_look_different(tmp_path: Path) -> None:
    tables = table(7, 0.0), table(8, 3.0, room="study")
    assert not verdict(tmp_path / "a", home(*tables), caption="a coffee table").findable
    other = home(*tables, rooms=(LOUNGE, LOUNGE.model_copy(update={"name": "study"})))
    assert verdict(tmp_path / "b", other, caption="a coffee table").cues == (("coffee table_8", "room lounge"),)


def test_the_description_of_the_other_object_excludes_it(tmp_path: Path) -> None:
    plan = home(table(7, 0.0), table(8, 3.0, rgb=BLUE, caption="a blue coffee table"))
    texts = {
        "summary": "In the lounge Ada owns a coffee table. Bo owns a blue coffee table there.",
        "extracted_summary": ["Ada owns a coffee table in the lounge", "Bo owns a blue coffee table in the lounge"],
    }
    found = verdict(tmp_path / "a", plan, caption="a coffee table", **texts)
    assert found.cues == (("coffee table_8", "the other's colour blue"),)
    assert not verdict(tmp_path / "b", plan, caption="a coffee table").findable


def test_colour_differences_are_those_of_cie76() -> None:
    assert delta_e((10, 20, 30), (10, 20, 30)) == 0
    assert delta_e((0, 0, 0), (255, 255, 255)) == pytest.approx(100, abs=0.05)
    # sRGB red and green in CIE L*a*b* (D65): (53.24, 80.09, 67.20) and (87.74, -86.18, 83.18)
    assert delta_e((255, 0, 0), (0, 255, 0)) == pytest.approx(170.6, abs=0.2)


def test_the_best_view_is_taken_from_a_free_place_and_counts_whole_pixels() -> None:
    scene = scene_from_plan(home(table(7, 0.0), table(8, 3.0)))
    places = ((0.0, -3.0), (4.5, 2.8), (0.0, 2.3))
    views = [example_view_point(x, z, quat_xyzw=[0, 0, 0, 1], iou=0.5) for x, z in places]
    goal = Goal.model_validate(example_goal(position=(0.0, 0.2, 0.0), view_points=views), strict=False)
    sight = best_sight(goal, scene, renderer=Raycaster(scene.mesh))
    assert sight.position == (0.0, 0.0, 2.3)  # the first place is off the map, the second farther away
    assert sight.pixels > 5 * MIN_PIXELS
    assert 1 in sight.beside
    sofa = goal.model_copy(update={"object_name": "sofa_1"})
    assert best_sight(sofa, scene, renderer=Raycaster(scene.mesh)) == Sight(0, None, frozenset())


def test_poses_face_the_object_and_look_up_only_when_needed() -> None:
    level = pose_towards((0.0, 0.0, 2.0), (0.0, 0.9, 0.0))
    assert np.allclose(forward_from_yaw(level.yaw), (0, 0, -1))
    assert level.tilt == 0
    assert pose_towards((0.0, 0.0, 0.5), (0.0, 2.2, 0.0)).tilt == pytest.approx(TURN_STEP)
    assert pose_towards((0.0, 0.0, 0.5), (0.0, 0.0, 0.0)).tilt == pytest.approx(-TURN_STEP)


def record_of(caption: str, **changes: Any) -> EpisodeRecord:
    texts = {
        "summary": f"Ada owns {caption} in the lounge.",
        "extracted_summary": [f"Ada owns {caption} in the lounge"],
        "description": [caption, "", ""],
        **changes,
    }
    return EpisodeRecord.model_validate(example_episode(**texts))


@pytest.mark.parametrize(
    ("caption", "expected"),
    [
        ("a dark brown leather couch", Described(colours=("dark brown",), materials=("leather",), room="lounge")),
        (
            "the sofa with stripes on the white rug",
            Described(patterns=("striped",), room="lounge", upon=frozenset({"rug"})),
        ),
        (
            "a small wooden couch near the red chair. it is round.",
            Described(
                materials=("wood",), sizes=("small",), shapes=("round",), room="lounge", beside=frozenset({"chair"})
            ),
        ),
    ],
)
def test_words_belong_to_the_object_that_they_describe(caption: str, expected: Described) -> None:
    said = described_object(record_of(caption), caption=caption, category="couch", owner="Ada")
    assert said is not None
    assert replace(said, beside=frozenset(), upon=frozenset()) == replace(
        expected, beside=frozenset(), upon=frozenset()
    )
    assert expected.beside <= said.beside
    assert expected.upon <= said.upon


def test_an_unmentioned_object_has_no_description_and_all_or_the_last_word_names_a_category() -> None:
    record = record_of("a red couch")
    assert described_object(record, caption="a metal bin under the desk", category="bin", owner=None) is None
    assert described_object(record, caption="a red couch", category="couch", owner="Bo") is None
    assert names_category({"nightstand"}, "nightstand")
    assert names_category({"lamp"}, "table lamp")
    assert not names_category({"table"}, "table lamp")
    assert names_category({"couch"}, "sofa")

"""From a scan to episodes that an agent wins: look, annotate, generate, validate, run; and what changed in between."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import BrowserContext, expect

from personal_viz.annotate.app import Workplace
from personal_viz.annotate.session import CLEAR_OF_FLOOR, FIRST_HEIGHT, Form, Session, form_of
from personal_viz.browse.app import loopback_app
from personal_viz.view.shown import Point, ShownScan, open_shown
from personal_viz.view.visit import Visit
from sim.authoring.annotations import annotation_path, fold, read_edits
from sim.authoring.change_list import read_changes
from sim.authoring.edition import edits_before
from sim.authoring.refinement import asked_objects, opinion_path
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, SceneError
from sim.mesh import SceneObject
from sim.tasks.metrics import metric_rows
from sim.tasks.run_files import read_run

from ..conftest import SHARED
from .annotating import annotated, describe, field
from .flow_studies import assert_people_take_part
from .program import assert_one_line, personal_viz
from .test_generate_command import defects, small_objects

POLYROOM = SHARED / "scans" / "Polyroom.glb"
THINGS = {
    "speaker": ((-0.85, -0.55), (-1.2, -0.8)),
    "plant": ((-0.8, -1.4), (-1.3, -1.5)),
    "television": ((-0.45, -1.2), (0.0, -1.5)),
    "stereo": ((0.1, -1.1), (0.2, -1.5)),
}
"""x and z of a corner on the floor and of the opposite one, of things at one end of a room of 2.7 x 3.7 m."""
TALL = ("speaker", "plant")


@pytest.mark.release
@pytest.mark.browser
@pytest.mark.timeout(900)
@pytest.mark.filterwarnings("ignore:.*read as y-up")
def test_boxes_drawn_in_a_real_scan_become_episodes_that_can_be_won(tmp_path: Path, browser: BrowserContext) -> None:
    if not POLYROOM.is_file():
        pytest.skip(f"the scan is not at {POLYROOM}")
    data = tmp_path / "data"
    shown = open_shown(POLYROOM)
    assert_scan_is_shown(shown, browser)
    annotate_things(Workplace(shown, data, who="ada"), browser)
    easy = ["--easy", 3, "--medium", 0, "--hard", 0]
    done = personal_viz("generate", data, "--scenes-dir", POLYROOM.parent, *easy)
    assert done.returncode == 0, done.stderr
    assert defects(data) == []
    assert personal_viz("validate", "--dataset", data).returncode == 0
    run = ["--agent", "shortest-path", "--dataset", data, "--scenes-dir", POLYROOM.parent, "--out", tmp_path]
    assert personal_viz("run", *run, "--run-id", "r").returncode == 0
    assert [row.k for row in metric_rows([read_run(tmp_path / "r")]) if row.split == "easy"] == [3]
    assert_people_take_part(tmp_path / "study", data, POLYROOM.parent)
    assert_it_is_asked(data, tmp_path)


def assert_scan_is_shown(shown: ShownScan, browser: BrowserContext) -> None:
    """`view` opens the scan, and a click in the middle of its picture meets it."""
    with loopback_app(lambda client: Visit(client, shown)) as address:
        page = browser.new_page()
        page.goto(f"{address}?fixedDpr=0.1")
        expect(page.locator("h2", has_text="Polyroom")).to_be_visible(timeout=120_000)
        expect(page.locator(".robot")).to_contain_text("step 0")
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        expect(page.locator("table.points tr")).to_have_count(2)
        page.close()


def annotate_things(place: Workplace, browser: BrowserContext) -> None:
    """Draws and describes THINGS on the page: two clicks each, then a drag of the top, or a number."""
    with annotated(place, browser) as shown:
        page = shown.page
        for category, corners in THINGS.items():
            first, second = (top_of(place.shown, xz) for xz in corners)
            shown.draw_box(first, second)
            if category in TALL:
                top_y = first[1] + CLEAR_OF_FLOOR + FIRST_HEIGHT
                shown.drag_up(((first[0] + second[0]) / 2, top_y, (first[2] + second[2]) / 2), 0.4)
                expect(field(page, "Height (m)")).to_have_value(re.compile(r"1\.[12]\d?"))
            else:
                field(page, "Height (m)").fill("0.6")
            field(page, "Category").fill(category)
            expect(page.locator(".row.here")).to_contain_text(category)
            page.keyboard.press("Escape")
            describe(page, f"{category} at the end of the room", "studio")
            assert page.locator(".grid img").count() in range(1, 5)
        items = fold(read_edits(place.path)).values()
    assert [item.category for item in items] == list(THINGS)
    assert [round(item.box.size[1], 1) for item in items if item.box is not None] == [1.2, 1.2, 0.6, 0.6]


def top_of(shown: ShownScan, xz: tuple[float, float]) -> Point:
    """The highest place below the ceiling there."""
    top = shown.hit(0, (xz[0], 0.4, xz[1]), (0.0, -1.0, 0.0))
    assert top is not None
    return top


def assert_it_is_asked(data: Path, folder: Path) -> None:
    """`ask` finds an annotated thing where it was drawn."""
    asked = ("--description", "Mira owns the plant at the end of the room.", "--query", "Mira's plant", "--json")
    done = personal_viz(
        "ask", POLYROOM, "--dataset", data, *asked, "--maps", folder / "maps", "--out", folder / "answer"
    )
    assert done.returncode == 0, done.stderr
    x, _, z = json.loads(done.stdout)["points"][0]["map"]
    (x0, z0), (x1, z1) = THINGS["plant"]
    assert np.hypot(x - (x0 + x1) / 2, z - (z0 + z1) / 2) < 0.4


@pytest.mark.slow
def test_a_new_edition_lists_what_changed_since_the_one_before(small_home_root: Path, tmp_path: Path) -> None:
    scans = small_home_root / "scenes"
    shown = open_shown(scans / "Small.glb")
    session = Workplace(shown, tmp_path, who="ada").session()
    objects = small_objects(small_home_root)
    for item in objects:
        session.select(item.id)
        session.keep(Form(item.category, item.captions, item.room))
        session.save()
    easy = ["--scenes-dir", scans, "--easy", 3, "--medium", 0, "--hard", 0]
    done = personal_viz("generate", tmp_path, *easy)
    assert done.returncode == 0, done.stderr
    assert len(read_changes(tmp_path / "changes.jsonl")) == len(objects)
    session.who = "bo"
    session.select(objects[0].id)
    session.keep(replace(session.form, captions=("A thing | with a bar.",), flagged=True))
    session.save()
    session.select(objects[1].id)
    session.keep(replace(session.form, room="attic"))
    session.save()
    session.undo()
    done = personal_viz("generate", tmp_path, *easy, "--out", tmp_path / "next")
    assert done.returncode == 0, done.stderr
    assert f"Objects that changed since the edition before: 1, in {tmp_path / 'next' / 'changes.md'}." in done.stdout
    assert defects(tmp_path / "next") == []
    (change,) = read_changes(tmp_path / "next" / "changes.jsonl")
    assert change.before == objects[0]
    assert change.after is not None
    assert (change.id, change.who, change.after.flagged) == (objects[0].id, ("bo",), True)
    row = (tmp_path / "next" / "changes.md").read_text().splitlines()[-1]
    assert row.startswith(f"| Small | {objects[0].id} | bo | {objects[0].category}, ")
    assert '"A thing \\| with a bar.", ' in row
    assert row.endswith(", flagged |")
    (tmp_path / "next" / "generated.json").write_text('{"version": 2}')
    with pytest.raises(DatasetError, match=r"next.generated\.json"):
        edits_before(tmp_path / "next", tmp_path)


@pytest.mark.slow
def test_refined_captions_give_a_new_edition_and_its_list_of_changes(small_home_root: Path, tmp_path: Path) -> None:
    dataset = PersonalDataset(small_home_root)
    asked = asked_objects(dataset, "Small")
    one, other, third, *_ = asked.values()
    for who, caption in (("ada", "green thing"), ("bo", "red thing")):
        session = Session(
            opinion_path(tmp_path, who, "Small"), who=who, first={n: form_of(a) for n, a in asked.items()}
        )
        for item, words in ((one, "thing with a note on it"), (other, caption), (third, third.captions[0])):
            session.select(item.id)
            session.keep(replace(session.form, captions=(words,)))
            session.save()
    options = ["generate", small_home_root, "--easy", 3, "--medium", 3, "--hard", 3, "--out", tmp_path / "new"]
    done = personal_viz(*options, "--captions", tmp_path)
    assert done.returncode == 0, done.stderr
    assert defects(tmp_path / "new") == []
    (change,) = read_changes(tmp_path / "new" / "changes.jsonl")  # on `other` they differ, so it stays as it was
    assert (change.id, change.who, change.before) == (one.id, ("ada", "bo"), one)
    said = asked_objects(PersonalDataset(tmp_path / "new"), "Small")
    assert said.get(one.id, change.after) == change.after
    assert all(item == asked[number] for number, item in said.items() if number != one.id)
    assert_one_line(personal_viz(*options, "--captions", tmp_path / "new"), "found no opinions in it")
    assert_one_line(personal_viz("annotate", "--dataset", small_home_root, "--out", tmp_path), "--who is ''; expected")
    assert_one_line(personal_viz("annotate", "--out", tmp_path), "expected --out and either a scan, or an edition")


def test_a_scan_without_floor_or_with_damaged_edits_is_refused_before_a_browser_opens(
    small_home_root: Path, tmp_path: Path
) -> None:
    import trimesh

    trimesh.creation.box(extents=(0.3, 0.5, 0.2)).export(tmp_path / "statue.glb")
    with pytest.raises(SceneError, match="Annotations need floor"):
        Workplace(open_shown(tmp_path / "statue.glb"), tmp_path)
    assert_one_line(personal_viz("annotate", tmp_path / "statue.glb", "--out", tmp_path), "Annotations need floor")
    path = annotation_path(tmp_path, "Small")
    path.parent.mkdir()
    path.write_text("{}\n")
    scan = small_home_root / "scenes" / "Small.glb"
    assert_one_line(personal_viz("annotate", scan, "--out", tmp_path), "Small.jsonl: line 1")


def test_pictures_outline_the_object_and_say_where_no_place_sees_it(small_home_root: Path, tmp_path: Path) -> None:
    from personal_viz.annotate.pictures import OUTLINE, found_sights, pictures_of

    place = Workplace(open_shown(small_home_root / "scenes" / "Small.glb"), tmp_path)
    shown = place.shown
    item = next(item for item in shown.objects if item.category == "sink")
    boxed = SceneObject(0, item.name, item.category, item.centre, item.size)
    for one in (item, boxed):
        poses = found_sights(one, shown.mesh, navigation=place.navigation, renderer=shown.caster)
        pictures = pictures_of(one, poses, renderer=shown.caster)
        assert len(pictures) == 4
        for rgb in pictures:
            assert rgb.shape == (300, 400, 3)
            rows, cols = np.nonzero(np.abs(rgb.astype(int) - OUTLINE).max(axis=2) < 60)
            share = max(np.ptp(rows) / 300, np.ptp(cols) / 400)
            assert 0.33 < share < 0.55  # of the picture, with what stands around it
            assert abs((rows.min() + rows.max()) / 2 - 150) < 30
            assert abs((cols.min() + cols.max()) / 2 - 200) < 40
    nowhere = SceneObject(0, "x", "x", (100.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert "No place where a robot can stand sees it" in place.pictures(nowhere)

"""A recording in a frame that lies on its side becomes a map and a mesh, is asked, annotated, and walked by people."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grounding.maps.files import read_map_header
from personal_viz.annotate.app import Workplace
from personal_viz.annotate.session import Form, with_height
from personal_viz.bench.robot.walks import Walk, handheld_walk
from personal_viz.view.shown import open_shown
from sim.authoring.annotations import Box
from sim.homes.open_home import open_scan
from sim.mesh import SceneObject
from tests.grounding.mapped_views import write_recording

from .flow_studies import assert_people_take_part
from .program import personal_viz
from .test_generate_command import defects

COLOURS = "tests.grounding.mapped_views:colours"


T_RECORDING_WORLD = np.eye(4)
T_RECORDING_WORLD[:3, :3] = Rotation.from_euler("xyz", [100, 20, -40], degrees=True).as_matrix()
T_RECORDING_WORLD[:3, 3] = (1, 2, 3)


def record(folder: Path, walk: Walk, *, every: int) -> None:
    """Writes every n-th picture of a walk."""
    chosen = list(walk.frames())[::every]
    seen = [replace(frame, T_world_camera=T_RECORDING_WORLD @ frame.T_world_camera) for frame in chosen]
    write_recording(folder, seen, up="y")


@pytest.mark.slow
def test_map_mesh_and_ask_truth_of_a_recording(tmp_path: Path) -> None:
    walk = handheld_walk(3, num_frames=300)
    record(tmp_path / "rec", walk, every=5)
    out, mesh = tmp_path / "flat.npz", tmp_path / "flat.glb"
    options = ("--layout", "objects", "--mesh", mesh, "--json")
    done = personal_viz("map", "--frames", tmp_path / "rec", "--encoder", COLOURS, "--out", out, *options)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    up = T_RECORDING_WORLD[:3, 1]
    assert np.degrees(np.arccos(np.clip(up @ found["up"], -1, 1))) < 2
    assert found["floor_y"] == pytest.approx(walk.floor_y + up @ T_RECORDING_WORLD[:3, 3], abs=0.03)
    assert (found["frames"], found["things"] > 5) == (60, True)
    scene = open_scan(mesh)
    assert scene.navigation.storey_heights[0] == pytest.approx(found["floor_y"], abs=0.05)
    assert len(scene.mesh.faces) == found["mesh"]["triangles"] > 20_000
    asked = ("ask", out, "--out", tmp_path / "answer")
    place = json.loads(personal_viz(*asked, "--query", "40 60 190", "--json").stdout)["points"][0]
    y = np.linalg.inv(T_RECORDING_WORLD)[1] @ [*place["recording"], 1.0]
    assert walk.floor_y - 0.1 < y < walk.floor_y + 2.5
    assert place["height"] == pytest.approx(y - walk.floor_y, abs=0.05)
    assert scene.kind == "scan"
    truth = tmp_path / "truth.jsonl"
    truth.write_text(json.dumps({"query": "40 60 190", "points": [place["recording"]], "split": "medium"}) + "\n")
    scored = json.loads(personal_viz(*asked, "--truth", truth, "--json").stdout)
    assert scored["table"]["sr"] == {"easy": None, "medium": 100.0, "hard": None, "total": 100.0}
    assert scored["scores"][0]["distance"] == pytest.approx(0, abs=0.01)


@pytest.mark.release
@pytest.mark.timeout(900)
def test_people_walk_and_point_on_the_mesh_of_a_recording(tmp_path: Path) -> None:
    walk = handheld_walk(3, num_frames=300)
    record(tmp_path / "rec", walk, every=2)
    scans, data, out = tmp_path / "scans", tmp_path / "data", tmp_path / "flat.npz"
    scans.mkdir()
    mapped = ("map", "--frames", tmp_path / "rec", "--encoder", "none", "--out", out, "--mesh", scans / "Flat.glb")
    done = personal_viz(*mapped)
    assert done.returncode == 0, done.stderr
    recording = read_map_header(out).source.recording
    assert recording is not None
    T_map_world = np.array(recording.T_map_recording) @ T_RECORDING_WORLD
    place = Workplace(open_shown(scans / "Flat.glb"), data, who="ada")
    session, seen = place.session(), []
    for thing in walk.scene.objects:
        box = box_in_map(thing, T_map_world)
        item = SceneObject(0, thing.name, thing.category, box.centre, box.size)
        if min(box.size) < 0.2 or not place.pictures(item).count("<img"):
            continue
        floor_y = place.shown.parts[0].floor_y
        (x, y, z), (width, height, depth) = box.centre, box.size
        session.draw_box()
        session.click((x - width / 2, floor_y, z - depth / 2), 0)
        session.click((x + width / 2, floor_y, z + depth / 2), 0)
        drawn = session.form.box
        assert drawn is not None
        higher = with_height(drawn, y - height / 2, height)
        session.keep(Form(thing.category, (f"{thing.category} number {len(seen)}",), "flat", box=higher))
        session.save()
        seen.append(thing)
    assert len(seen) > 10
    easy = ["--easy", 3, "--medium", 0, "--hard", 0]
    done = personal_viz("generate", data, "--scenes-dir", scans, *easy)
    assert done.returncode == 0, done.stderr
    assert defects(data) == []
    assert personal_viz("validate", "--dataset", data).returncode == 0
    assert_people_take_part(tmp_path / "study", data, scans)


def box_in_map(thing: SceneObject, T_map_world: np.ndarray) -> Box:
    """The upright box around a thing of the simulated home, in the map's frame."""
    half = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * thing.size
    corners = (np.array(thing.centre) + half) @ T_map_world[:3, :3].T + T_map_world[:3, 3]
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Box(centre=tuple(((low + high) / 2).tolist()), size=tuple((high - low).tolist()))

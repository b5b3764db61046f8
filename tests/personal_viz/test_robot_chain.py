"""A recording in a frame that lies on its side becomes a map and a mesh, and is asked."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from personal_viz.bench.robot.walks import handheld_walk
from sim.homes.open_home import open_scan
from tests.grounding.mapped_views import write_recording

from .program import personal_viz

COLOURS = "tests.grounding.mapped_views:colours"


@pytest.mark.slow
def test_map_mesh_and_ask_truth_of_a_recording(tmp_path: Path) -> None:
    walk = handheld_walk(3, num_frames=300)
    T_recording_world = np.eye(4)
    T_recording_world[:3, :3] = Rotation.from_euler("xyz", [100, 20, -40], degrees=True).as_matrix()
    T_recording_world[:3, 3] = (1, 2, 3)
    seen = [
        replace(frame, T_world_camera=T_recording_world @ frame.T_world_camera) for frame in list(walk.frames())[::5]
    ]
    write_recording(tmp_path / "rec", seen, up="y")
    out, mesh = tmp_path / "flat.npz", tmp_path / "flat.glb"
    options = ("--layout", "objects", "--mesh", mesh, "--json")
    done = personal_viz("map", "--frames", tmp_path / "rec", "--encoder", COLOURS, "--out", out, *options)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    up = T_recording_world[:3, 1]
    assert np.degrees(np.arccos(np.clip(up @ found["up"], -1, 1))) < 2
    assert found["floor_y"] == pytest.approx(walk.floor_y + up @ T_recording_world[:3, 3], abs=0.03)
    assert (found["frames"], found["things"] > 5) == (60, True)
    scene = open_scan(mesh)
    assert scene.navigation.storey_heights[0] == pytest.approx(found["floor_y"], abs=0.05)
    assert len(scene.mesh.faces) == found["mesh"]["triangles"] > 20_000
    asked = ("ask", out, "--out", tmp_path / "answer")
    place = json.loads(personal_viz(*asked, "--query", "40 60 190", "--json").stdout)["points"][0]
    y = np.linalg.inv(T_recording_world)[1] @ [*place["recording"], 1.0]
    assert walk.floor_y - 0.1 < y < walk.floor_y + 2.5
    assert place["height"] == pytest.approx(y - walk.floor_y, abs=0.05)
    assert scene.kind == "scan"
    truth = tmp_path / "truth.jsonl"
    truth.write_text(json.dumps({"query": "40 60 190", "points": [place["recording"]], "split": "medium"}) + "\n")
    scored = json.loads(personal_viz(*asked, "--truth", truth, "--json").stdout)
    assert scored["table"]["sr"] == {"easy": None, "medium": 100.0, "hard": None, "total": 100.0}
    assert scored["scores"][0]["distance"] == pytest.approx(0, abs=0.01)

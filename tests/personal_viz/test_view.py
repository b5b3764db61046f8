"""`view`: any scan is shown, measured and pointed at, and one without floor too."""

import shutil
import socket
from pathlib import Path

import numpy as np
import pytest
import trimesh

from personal_viz.cli.scans import view as view_verb
from personal_viz.view.shown import ShownScan, open_shown
from sim.errors import SceneError
from sim.types import Pose

from .program import assert_one_line, personal_viz


@pytest.fixture(scope="module")
def demo(demo_root: Path) -> ShownScan:
    """The invented home Demo, of two storeys, from its file alone; its stage_config says that z is up."""
    return open_shown(demo_root / "scenes" / "Demo.glb")


@pytest.fixture
def statue(tmp_path: Path) -> Path:
    """A box of 0.3 x 0.5 x 0.2 m on which nobody can stand."""
    box = trimesh.creation.box(extents=(0.3, 0.5, 0.2))
    box.export(tmp_path / "statue.glb")
    return tmp_path / "statue.glb"


def test_each_storey_is_a_part_and_a_click_meets_it_in_the_scan(demo: ShownScan) -> None:
    assert demo.navigation is not None
    assert [part.floor_y for part in demo.parts] == list(demo.navigation.storey_heights)
    assert len(demo.parts) == 2
    assert demo.notes == ()
    assert all(part.glb[:4] == b"glTF" for part in demo.parts)
    for index, part in enumerate(demo.parts):
        x, y, z = demo.navigation.random_point(np.random.default_rng(0), storey_y=part.floor_y).tolist()
        found = demo.hit(index, (x, y + 1.0, z), (0.0, -1.0, 0.0))
        assert found == pytest.approx((x, y, z), abs=0.05)
        assert demo.hit(index, (x, y + 50.0, z), (0.0, 1.0, 0.0)) is None


def test_the_way_on_foot_is_measured_between_the_nearest_places_to_stand(demo: ShownScan) -> None:
    assert demo.navigation is not None
    low, high = demo.parts
    start, end = (demo.navigation.random_point(np.random.default_rng(1), storey_y=y.floor_y) for y in (low, high))
    on_foot = demo.walk(tuple(start.tolist()), tuple(end.tolist()))
    assert on_foot == pytest.approx(float(demo.navigation.distances(start[None], end[None])[0]))
    assert on_foot is not None
    assert on_foot > np.linalg.norm(end - start)
    assert demo.walk(tuple(start.tolist()), (1000.0, 0.0, 0.0)) is None


def test_the_robot_sees_the_scan(demo: ShownScan) -> None:
    assert demo.navigation is not None
    x, y, z = demo.navigation.random_point(np.random.default_rng(0)).tolist()
    rgb = demo.picture(Pose((x, y, z), 0.0))
    assert rgb.shape == (480, 640, 3)
    assert rgb.std() > 5


def test_a_thing_without_floor_opens_for_looking_and_pointing(statue: Path) -> None:
    shown = open_shown(statue)
    assert (shown.name, shown.navigation, len(shown.parts)) == ("statue", None, 1)
    (note,) = shown.notes
    assert note.startswith("It opens for looking and pointing only: ")
    assert "no floor" in note
    assert shown.hit(0, (0.0, 2.0, 0.0), (0.0, -1.0, 0.0)) == pytest.approx((0.0, 0.25, 0.0), abs=1e-5)
    assert shown.hit(0, (2.0, 2.0, 0.0), (0.0, -1.0, 0.0)) is None
    assert shown.walk((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)) is None
    part = shown.parts[0]
    assert (*part.low_xz, *part.high_xz, part.floor_y, part.top_y) == pytest.approx(
        (-0.15, -0.1, 0.15, 0.1, -0.25, 0.25)
    )


def test_up_decides_and_without_it_the_doubt_is_said(demo_root: Path, tmp_path: Path) -> None:
    alone = tmp_path / "house.glb"
    shutil.copy(demo_root / "scenes" / "Demo.glb", alone)
    upright = open_shown(alone, up="z")
    assert (len(upright.parts), upright.notes) == (2, ())
    doubted = open_shown(alone)
    assert any("with z up" in note or "no floor" in note for note in doubted.notes)


def test_a_damaged_or_missing_file_and_a_busy_port_are_refused_in_one_line(
    statue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SceneError, match=r"nothing\.glb"):
        open_shown(tmp_path / "nothing.glb")
    statue.write_bytes(statue.read_bytes()[:100])
    assert_one_line(personal_viz("view", statue), "statue.glb")
    monkeypatch.setattr(view_verb.signal, "signal", lambda *_: None)
    trimesh.creation.box(extents=(0.3, 0.5, 0.2)).export(statue)
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        assert_one_line(personal_viz("view", statue, "--port", port), f"--port {port}")

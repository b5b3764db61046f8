"""Looks of a study's conditions for agents: the pixels of the page, and the views of a walk from the start."""

import base64
import io
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.agents.exploration import Exploration, save_exploration
from grounding.agents.explore import EXPLORER_VERSION
from grounding.agents.explored_storeys import exploration_name
from personal_viz.study_app.home.agent_looks import StudyLook
from personal_viz.study_app.home.top_view import top_views
from personal_viz.study_app.screens.look import picture_html
from sim.tasks.run_files import Step
from sim.types import Action, Camera, Pose

from .test_top_view import room

CAMERA = Camera(32, 24)


def test_an_agent_gets_the_pixels_that_the_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path))
    scene = room(kind="invented")
    look = StudyLook("topdown", CAMERA, tmp_path, 0)(scene, Pose((0.0, 0.0, 0.0), 0.0))
    (view,), (picture,) = top_views(scene), look.pictures
    shown = picture_html(view, "From above").partition("base64,")[2].partition('"')[0]
    page = np.asarray(Image.open(io.BytesIO(base64.b64decode(shown))).convert("RGB"))
    assert np.array_equal(picture.rgb, page)
    assert picture.metres_per_pixel == view.grid.cell
    assert list(look.views()) == []


def test_the_views_of_the_walk_are_told_from_the_start_of_the_episode(tmp_path: Path) -> None:
    scene = room()
    places = ((0.0, 0.0, -0.25), (0.0, 0.0, -0.5), (0.0, 0.0, -0.5))
    walk = Exploration(
        scene=scene.name,
        scene_kind=scene.kind,
        scene_digest=scene.digest,
        seed=5,
        camera=Camera(),
        start=Pose((0.0, 0.0, 0.0), 0.0),
        storey_y=0.0,
        steps=tuple(
            Step(action=action, position=place, yaw=0.0)
            for action, place in zip((Action.FORWARD, Action.FORWARD, Action.STOP), places, strict=True)
        ),
        stop_reason="no-frontier",
        coverage=(0.1, 0.2, 0.3, 0.3),
        area_m2=36.0,
        policy=EXPLORER_VERSION,
    )
    save_exploration(tmp_path / exploration_name(scene, storey=0, seed=5, camera=Camera()), walk)
    look = StudyLook("glb", CAMERA, tmp_path, 5)(scene, Pose((1.0, 0.0, 0.0), math.pi / 2))
    first, second = look.views()  # every second pose; the one after STOP equals the one before
    assert first.gps == pytest.approx((1.0, 0.0))
    assert second.gps == pytest.approx((1.0, 0.5)), "forward is -x, right is -z"
    assert first.compass == second.compass == pytest.approx(-math.pi / 2)
    assert second.T_start_camera[:3, 3].tolist() == pytest.approx([0.5, 0.88, -1.0])
    assert [view.step for view in (first, second)] == [0, 1]
    assert first.rgb is not None
    assert first.depth_m is not None
    assert first.depth_m[12, 16] == pytest.approx(0.0), "ahead is no wall"
    assert look.pictures == ()

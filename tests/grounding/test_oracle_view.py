"""Perception of an episode in a rendered home: ids where the robot looks, segmenters, how much of a thing is seen."""

import math
from dataclasses import replace

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.perception.boxes import boxes_of_ids, overlap
from grounding.perception.by_name import EpisodeTruth, frame_of_observation, make_perception
from grounding.perception.oracle_view import SeenShares, frames_with_ids, oracle_perception_of
from grounding.perception.segmenters import DepthRegion, IdRegion
from sim.errors import AgentError
from sim.frames import T_world_agent
from sim.frames import T_world_camera as camera_pose
from sim.homes.open_home import scene_from_plan
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.observers import Detection
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Frame, Observation, Pose

from ..sim import plans

CAMERA = Camera(width=160, height=120)
START = Pose((1.0, 0.0, 2.0), math.radians(-90))  # looks along +x, towards the east wall
CABINET = (3.0, 0.3, 2.0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A room of 8 x 4 m with a cabinet ahead of the start, and a box behind it that it partly hides."""
    pieces = (
        plans.piece("cabinet_1", CABINET, (0.4, 0.6, 1.0)),
        plans.piece("cabinet_2", (6.0, 0.5, 2.5), (0.5, 1.0, 1.0)),
    )
    return scene_from_plan(plans.two_rooms(*pieces, name="Seen", walls=plans.walls_around(plans.Rect(0, 0, 8, 4))))


@pytest.fixture(scope="module")
def truth(scene: Scene) -> EpisodeTruth:
    captions = {number_of(scene, "cabinet_1"): "low oak cabinet", number_of(scene, "cabinet_2"): "tall steel locker"}
    return EpisodeTruth(scene, START, captions)


def number_of(scene: Scene, name: str) -> int:
    return next(item.instance_id for item in scene.objects if item.name == name)


def observations(scene: Scene, *actions: Action) -> list[Observation]:
    env = PanEnv(START, scene.navigation, renderer=renderer_of(scene), camera=CAMERA)
    return [env.reset(), *(env.step(action) for action in actions)]


def test_the_ids_are_those_of_the_pixels_that_the_robot_sees(scene: Scene, truth: EpisodeTruth) -> None:
    look = frames_with_ids(scene, START)
    for seen in observations(scene, Action.LEFT, Action.FORWARD, Action.LOOK_DOWN, Action.RIGHT):
        frame = look(seen)
        assert frame.rgb is seen.rgb
        assert frame.depth_m is seen.depth_m
        assert np.array_equal(frame.T_world_camera, seen.T_start_camera)
        # ids and depth fit: every pixel of an object lies inside the object's box in the world
        for item in scene.objects:
            rows, cols = np.nonzero(frame.instance_ids == item.instance_id)
            points = points_of(frame, rows, cols) @ T_world_agent(START)[:3, :3].T + T_world_agent(START)[:3, 3]
            assert (np.abs(points - item.centre) <= np.array(item.size) / 2 + 0.02).all()
    drawn = look(replace(observations(scene)[0], rgb=None, depth_m=None))
    first = look(observations(scene)[0])
    assert np.allclose(drawn.depth_m, first.depth_m, atol=1e-4)
    assert np.array_equal(drawn.instance_ids, first.instance_ids)
    assert first.instance_ids.any()


def test_what_the_robot_just_saw_is_not_drawn_again(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[np.ndarray] = []
    render = Raycaster.render

    def counted(self: Raycaster, T: np.ndarray, camera: Camera) -> Frame:
        drawn.append(T)
        return render(self, T, camera)

    monkeypatch.setattr(Raycaster, "render", counted)
    env = PanEnv(START, scene.navigation, renderer=renderer_of(scene), camera=CAMERA)
    look, before = frames_with_ids(scene, START), env.reset()
    look(before)
    for action in (Action.LEFT, Action.FORWARD, Action.LOOK_DOWN):
        look(env.step(action))
    assert len(drawn) == 4
    look(before)
    assert len(drawn) == 5, "an earlier picture is drawn anew"


def points_of(frame: Frame, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
    fx, fy, cx, cy = frame.camera.lens
    depth = frame.depth_m[rows, cols].astype(float)
    points = np.column_stack([(cols + 0.5 - cx) / fx * depth, (rows + 0.5 - cy) / fy * depth, depth])
    return points @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]


def test_clean_perception_finds_the_described_thing_and_its_pixels(scene: Scene, truth: EpisodeTruth) -> None:
    eye = make_perception("oracle", truth=truth)
    assert eye.name == "oracle:clean (no faults) in hashed"
    frame = eye.frame_of(observations(scene)[0])
    eye.detector.set_query("low oak cabinet")
    (found,) = eye.detector.detect(frame)
    ids = frame.instance_ids == number_of(scene, "cabinet_1")
    assert found.box == boxes_of_ids(frame.instance_ids)[number_of(scene, "cabinet_1")]
    assert np.array_equal(eye.segmenter.mask(frame, found), ids)
    near, far = eye.scorer.score(frame, ["low oak cabinet", "copper lamp"])
    assert near > 0.5
    assert far < 0.2


def test_depth_alone_gives_nearly_the_things_own_pixels(scene: Scene) -> None:
    look = frames_with_ids(scene, START)
    for seen in observations(scene, Action.FORWARD, Action.FORWARD):
        frame = look(seen)
        for number, box in boxes_of_ids(frame.instance_ids).items():
            mask, ids = DepthRegion().mask(frame, Detection("thing", box, 1.0)), frame.instance_ids == number
            assert (mask & ids).sum() / (mask | ids).sum() > 0.85


def test_without_depth_in_the_middle_nothing_is_found_and_a_thing_on_the_floor_keeps_its_pixels() -> None:
    depth = np.full((120, 160), 3.0, np.float32)
    pose = camera_pose(Pose((0.0, 0.0, 0.0), 0.0), CAMERA)
    lens = Camera.of_lens(160, 120, fx=120.0, fy=120.0, cx=80.0, cy=60.0)
    frame = Frame(np.zeros((120, 160, 3), np.uint8), depth, pose, lens)
    box = Detection("thing", (40.0, 40.0, 120.0, 80.0), 1.0)
    empty = replace(frame, depth_m=np.zeros_like(depth))
    assert not DepthRegion().mask(empty, box).any()
    assert not DepthRegion().mask(frame, replace(box, box=(190.0, 0.0, 199.0, 9.0))).any()  # beyond the picture
    floor = depth.copy()
    floor[61:] = (0.88 / ((np.arange(61, 120) + 0.5 - 60) / 120))[:, None]
    rug = Detection("rug", (40.0, 90.0, 120.0, 110.0), 1.0)
    assert DepthRegion().mask(replace(frame, depth_m=floor), rug).sum() == 80 * 20
    stepped = depth.copy()
    stepped[:, 90:] = 4.0  # parts the wall; what is left of it holds more of the middle
    mask = DepthRegion().mask(replace(frame, depth_m=stepped), box)
    assert mask[40:80, 40:90].all()
    assert mask.sum() == 40 * 50


def test_an_oracle_mask_takes_the_instance_whose_box_fits_best_and_a_false_detection_leads_somewhere(
    scene: Scene, truth: EpisodeTruth
) -> None:
    frame = frames_with_ids(scene, START)(observations(scene)[0])
    number = number_of(scene, "cabinet_1")
    left, top, right, bottom = boxes_of_ids(frame.instance_ids)[number]
    moved = (left + 4, top + 4, right + 4, bottom + 4)
    mask = IdRegion().mask(frame, Detection("thing", moved, 1.0))
    assert (frame.instance_ids[mask] == number).all()
    assert mask.sum() > 0.6 * (frame.instance_ids == number).sum()
    wall = (2.0, 2.0, 30.0, 20.0)
    assert all(overlap(wall, box) == 0 for box in boxes_of_ids(frame.instance_ids).values())
    mask = IdRegion().mask(frame, Detection("nothing", wall, 1.0))
    assert mask.any()
    assert not frame.instance_ids[mask].any()


def test_the_seen_share_is_one_in_the_open_and_falls_behind_things_and_at_the_edge(scene: Scene) -> None:
    shares, look = SeenShares(scene, START), frames_with_ids(scene, START)
    front, behind = number_of(scene, "cabinet_1"), number_of(scene, "cabinet_2")
    frame = look(observations(scene)[0])
    assert shares(frame, front) == pytest.approx(1, abs=0.05)
    alone = silhouette(scene, frame, behind)
    seen = (frame.instance_ids == behind).sum() / alone.sum()
    assert 0.1 < seen < 0.9
    assert shares(frame, behind) == pytest.approx(seen, abs=0.08)
    turned = look(observations(scene, Action.LEFT)[1])  # the cabinet is cut by the right edge, or gone
    assert shares(turned, front) < 0.9
    with pytest.raises(AgentError, match=r"instance 999 is asked for in a view of 'Seen'"):
        shares(frame, 999)


def silhouette(scene: Scene, frame: Frame, number: int) -> np.ndarray:
    """(H, W) the pixels that the object would fill alone."""
    from sim.render.raycast import Raycaster

    alone = Raycaster(scene.mesh.select(scene.mesh.face_instance == number))
    return alone.depth(T_world_agent(START) @ frame.T_world_camera, frame.camera) > 0


def test_levels_of_faults_are_in_the_name_and_agree_with_the_seed(scene: Scene, truth: EpisodeTruth) -> None:
    seen = observations(scene, Action.FORWARD)
    answers = []
    for seed in (0, 0, 1):
        eye = make_perception("oracle:strong", truth=truth, seed=seed)
        eye.detector.set_query("cabinet")
        answers.append([eye.detector.detect(eye.frame_of(item)) for item in seen])
    assert answers[0] == answers[1]
    assert "oracle:strong (view_noise=0.15" in eye.name
    own = oracle_perception_of(scene, START, truth.captions, text_encoder=HashedWords(), level="mild", seed=3)
    assert own.name.startswith("oracle:mild (view_noise=0.05, object_noise=0.05, confusion=0.1")


def test_a_robots_frame_has_no_ids_and_needs_pictures(scene: Scene) -> None:
    seen = observations(scene)[0]
    frame = frame_of_observation(seen)
    assert frame.ids is None
    assert np.array_equal(frame.T_world_camera, seen.T_start_camera)
    with pytest.raises(AgentError, match="an observation has no picture"):
        frame_of_observation(replace(seen, rgb=None))

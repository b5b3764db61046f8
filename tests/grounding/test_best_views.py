"""The pictures that see a point best: near, in the middle, with nothing before it, from different places."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.maps.best_views import best_views
from sim.frames import R_agent_camera
from sim.types import Camera, Frame

CAMERA = Camera(64, 48, 90.0)
POINT = (0.0, 1.0, -3.0)


@dataclass
class View:
    """A camera at a height of 1 m that looks along -z, before a wall at a planar depth."""

    x: float = 0.0
    z: float = 0.0
    wall: float = 9.0
    is_damaged: bool = False

    camera = CAMERA

    @property
    def T_map_camera(self) -> NDArray[np.float64]:
        T = np.eye(4)
        T[:3, :3] = R_agent_camera
        T[:3, 3] = (self.x, 1.0, self.z)
        return T

    def load(self) -> Frame | None:
        depth = np.full((CAMERA.height, CAMERA.width), self.wall, np.float32)
        rgb = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
        return None if self.is_damaged else Frame(rgb, depth, self.T_map_camera, CAMERA)


def places(views: list[View], **more: int) -> list[tuple[float, float]]:
    return [tuple(sight.frame.T_world_camera[[0, 2], 3].tolist()) for sight in best_views(views, POINT, **more)]


def test_the_point_is_marked_where_the_picture_shows_it() -> None:
    (sight,) = best_views([View(x=-1.5)], POINT)
    assert sight.uv == pytest.approx((48.0, 24.0))  # 1.5 m to the right at 3 m, focal length 32 pixels


def test_near_and_central_pictures_come_first_and_similar_ones_once() -> None:
    views = [View(x=2.0), View(z=-1.0), View(z=-1.1), View(z=1.0), View(x=1.0)]
    assert places(views, count=4) == [(0, -1), (0, 1), (1, 0), (2, 0)]
    assert places(views, count=1) == [(0, -1)]


def test_walls_damage_and_distance_leave_pictures_out() -> None:
    unusable = [View(wall=1.5), View(z=-1.0, is_damaged=True), View(z=-4.0), View(x=9.0), View(z=8.0)]
    assert places(unusable) == []
    assert places([*unusable, View(x=1.0)]) == [(1, 0)]


def test_a_point_inside_a_thing_and_a_gap_in_depth_are_seen() -> None:
    assert places([View(wall=2.8)]) == [(0, 0)]
    assert places([View(wall=0.0)]) == [(0, 0)]


@dataclass
class RecordedView(View):
    """A view whose depth is read apart from its colours, as those of a recording are."""

    loaded: list[str] = field(default_factory=list)
    has_colours: bool = True

    def load_depth(self) -> NDArray[np.float32] | None:
        self.loaded.append("depth")
        frame = super().load()
        return None if frame is None else frame.depth_m

    def load(self) -> Frame | None:
        self.loaded.append("colours")
        return super().load() if self.has_colours else None


def test_colours_are_loaded_only_of_pictures_whose_depth_shows_the_point() -> None:
    views = [
        RecordedView(wall=1.5),
        RecordedView(x=0.6, is_damaged=True),
        RecordedView(x=-0.6, has_colours=False),
        RecordedView(x=1.0),
        RecordedView(x=1.1),
        RecordedView(x=-2.0),
        RecordedView(x=9.0),
    ]
    assert places(list(views), count=2) == [(1, 0), (-2, 0)]
    both = ["depth", "colours"]
    assert [view.loaded for view in views] == [["depth"], ["depth"], both, both, [], both, []]

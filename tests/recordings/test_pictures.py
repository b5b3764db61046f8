"""Pictures from poses: each view is rendered once, and the number of pixels is limited."""

import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from recordings.replay import picture_cameras, rendered_jpegs
from sim.render.raycast import Raycaster
from sim.render.renderer import Hits
from sim.types import Camera, Frame, Pose


class Counting:
    """A renderer that notes the views it renders."""

    def __init__(self, renderer: Raycaster) -> None:
        self.asked: list[tuple[int, bytes]] = []
        self._renderer = renderer

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        return self.render_batch(T_world_camera[None], camera)[0]

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        self.asked += [(camera.width, T.tobytes()) for T in Ts_world_camera]
        return self._renderer.render_batch(Ts_world_camera, camera)

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        return self._renderer.depth(T_world_camera, camera)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        return self._renderer.cast(origins, directions)


def walk(count: int, *, z: float = 1.1) -> tuple[Pose, ...]:
    return tuple(Pose((-3.0 + 0.25 * number, 0.0, z), 0.1 * number) for number in range(count))


def test_every_view_is_rendered_once_and_used_at_all_its_poses(renderer: Raycaster) -> None:
    counting, large, small = Counting(renderer), Camera(64, 48), Camera(32, 24)
    first = walk(20)
    ways = [(*first, first[3], first[3]), first[::-1], first[:5]]
    pictures = rendered_jpegs(counting, ways, [large, large, small])
    assert len(counting.asked) == len(set(counting.asked)) == 25
    assert [len(jpegs) for jpegs in pictures] == [22, 20, 5]
    assert pictures[0][3] == pictures[0][20] == pictures[0][21] == pictures[1][16]
    assert pictures[1] == pictures[0][19::-1]
    assert len(set(pictures[0])) == 20
    assert Image.open(io.BytesIO(pictures[2][0])).size == (32, 24)


@pytest.mark.parametrize(
    ("lengths", "sizes"),
    [
        ((81, 501), [(640, 480), (640, 480)]),
        ((81, 301, 101), [(640, 480), (640, 480), (320, 240)]),
        ((81, 401, 901), [(640, 480), (640, 480), (160, 120)]),
        ((81, 501, 1320), [(480, 360), (480, 360), (160, 120)]),
        ((900, 1000), [(320, 240), (320, 240)]),
        ((9000, 9000), [(320, 240), (320, 240)]),
    ],
)
def test_pictures_become_smaller_if_there_are_many(lengths: tuple[int, ...], sizes: list[tuple[int, int]]) -> None:
    ways = [walk(count, z=float(number)) for number, count in enumerate(lengths)]
    cameras = picture_cameras(ways, Camera(), is_shown=[True, True, *[False] * (len(ways) - 2)])
    assert [(camera.width, camera.height) for camera in cameras] == sizes
    assert {camera.hfov_deg for camera in cameras} == {79.0}


def test_poses_that_runs_share_are_counted_once() -> None:
    way = walk(580)
    cameras = picture_cameras([way, way, way[:200]], Camera(), is_shown=[True, True, True])
    assert {camera.width for camera in cameras} == {640}

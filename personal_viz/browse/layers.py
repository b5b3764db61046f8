"""The 3-D view of one browser: a home, target, view points, start, success region, paths, answers, object boxes."""

import math
from collections.abc import Awaitable, Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray
from viser.transforms import SO3

from recordings.traces import Rgb, Trace
from sim.episodes.schema import Goal
from sim.frames import T_world_camera, forward_from_yaw
from sim.tasks.rules import success_region
from sim.tasks.run_files import Answer, EpisodeRun, Vector3
from sim.types import Camera, Pose
from sim.walk.storeys import same_storey

from ..study_app.home.looks import VIEW_ANGLE, place_camera, window_aspect
from ..study_app.home.surfaces import box_edges
from ..study_app.screens.camera import three
from .library import OpenHome, ShownEpisode

Array = NDArray[np.float32]
HEADING_VERTICES = np.array([[0, 0, -0.5], [0.3, 0, 0.35], [0, 0, 0.15], [-0.3, 0, 0.35], [0, 0.12, 0.1]], np.float32)
"""(5, 3) a dart that points along -z at yaw 0, one metre long; its spine is a little higher, so that light shows it."""
HEADING_FACES = np.array([[0, 4, 1], [0, 3, 4], [1, 4, 2], [3, 2, 4], [0, 1, 2], [0, 2, 3]], np.uint32)
TARGET_RGB: Rgb = (214, 30, 60)
OBJECT_RGB: Rgb = (70, 90, 130)
MARKED_RGB: Rgb = (255, 170, 0)
START_RGB: Rgb = (30, 110, 60)
REGION_RGB: Rgb = (255, 120, 140)
POINT_RGB: Rgb = (0, 45, 140)
PALE_RGB: Rgb = (70, 150, 230)
"""View points with the largest iou, and with nearly none."""
EXTRA_RGB: Rgb = (150, 150, 150)
REGION_CELL = 0.12
"""The success region has one dot per square of this side, metres."""
_GROWN = 0.06
"""Metres by which boxes stand off from their objects."""
_MARGIN = 1.12
"""Room around a storey, as a factor."""
_LOWER = 0.1
"""Share of a storey's depth by which the camera looks in front of its middle: a panel may cover the lower corner."""
_NEAR = 4.5
"""Metres from which one object is shown."""
FIRST_LAYERS = frozenset({"view_points", "region"})
"""Layers that are on at first; the third one is `names`, category names over all objects."""
OnObject = Callable[[int], Awaitable[None]]


class Outlined(NamedTuple):
    """An object that is marked, and the text over it."""

    centre: Vector3
    size: Vector3
    text: str


class Layers:
    """The nodes of one browser's 3-D view, on one storey of a home at a time."""

    def __init__(self, client: viser.ClientHandle, on_object: OnObject) -> None:
        """Shows nothing yet; `on_object` is called with the index of the object node whose box is clicked."""
        self._scene, self._on_object = client.scene, on_object
        self._home: tuple[OpenHome, int] | None = None
        self._home_nodes: list[Any] = []
        self._names: list[Any] = []
        self._nodes: list[Any] = []
        self._mark: list[Any] = []
        self._walker = Walker(client)
        client.scene.configure_default_lights(True, cast_shadow=False)

    def show_home(self, home: OpenHome, storey: int, *, names: bool) -> None:
        """Shows one cut storey, with category names over its objects if wanted; what is shown already stays."""
        if self._home != (home, storey):
            self.clear()
            self._home = (home, storey)
            self._home_nodes = [self._scene.add_glb("/home", home.copies.glbs[storey])]
        if names and not self._names:
            self._names = [
                self._scene.add_label(
                    f"/names/{item.instance_id}",
                    item.category,
                    position=(item.centre[0], item.centre[1] + item.size[1] / 2 + 0.08, item.centre[2]),
                    anchor="bottom-center",
                    font_screen_scale=0.8,
                )
                for item in home.copies.objects(storey)
            ]
        elif not names:
            remove_nodes(self._names)

    def show_episode(self, shown: ShownEpisode, *, hidden: Collection[str], layers: Collection[str]) -> None:
        """Shows everything of an episode that stands on the storey that is shown.

        Args:
            hidden: Labels of runs that are switched off.
            layers: Layers that are switched on.
        """
        assert self._home is not None, "no home is shown"
        home, storey = self._home
        self._clear_episode()
        floor_y = home.copies.storeys[storey]
        self._add_boxes(home, storey, shown)
        self._add_start(shown.episode.start, floor_y)
        if "region" in layers:
            self._add_region(success_region(shown.episode, home.scene.navigation), floor_y)
        if "view_points" in layers:
            self._add_view_points(shown.episode.targets, floor_y)
        for index, trace in enumerate(shown.traces):
            name = f"/episode/run{index}"
            if trace.title in hidden:
                continue
            if isinstance(trace.run, EpisodeRun):
                self._add_path(name, trace, floor_y, lift=0.12 + 0.04 * (index % 4))
            elif isinstance(trace.run, Answer):
                self._add_answer(name, trace, trace.run, floor_y)

    def mark(self, objects: Sequence[Outlined]) -> None:
        """Outlines and names these objects and no others."""
        remove_nodes(self._mark)
        for number, (centre, size, text) in enumerate(objects):
            grown = np.asarray(size) + 2.5 * _GROWN
            name = f"/mark{number}"
            top = (centre[0], centre[1] + grown[1] / 2 + 0.45, centre[2])
            self._mark += [
                self._lines(name, box_edges(centre, grown), MARKED_RGB, 6.0),
                self._scene.add_box(f"{name}_fill", MARKED_RGB, three(grown), opacity=0.45, position=centre),
                self._scene.add_label(
                    f"{name}_label", text, position=top, anchor="bottom-center", font_screen_scale=1.2
                ),
            ]

    def show_walker(self, pose: Pose | None, rgb: Rgb = (0, 0, 0)) -> None:
        """Shows a robot at a step of its run; None takes it away."""
        self._walker.show(pose, rgb)

    def clear(self) -> None:
        """Takes everything away."""
        self._clear_episode()
        remove_nodes(self._names)
        remove_nodes(self._home_nodes)
        self._home = None

    def _clear_episode(self) -> None:
        self._walker.show(None)
        for nodes in (self._mark, self._nodes):
            remove_nodes(nodes)

    def _add_boxes(self, home: OpenHome, storey: int, shown: ShownEpisode) -> None:
        """A box around each linked object of the storey; it takes clicks, the home itself does not."""
        for index, link in enumerate(shown.links):
            goal = shown.goals.get(link.goal or "")
            if goal is None or home.storey(goal.floor_y) != storey:
                continue
            centre, size = home.box(goal)
            rgb = TARGET_RGB if link.is_target else OBJECT_RGB
            grown = np.asarray(size) + _GROWN
            name = f"/episode/object{index}"
            box = self._scene.add_box(name, rgb, three(grown), opacity=0.3, position=three(centre))
            self._listen(box, index)
            edges = self._lines(f"{name}/edges", box_edges((0, 0, 0), grown), rgb, 3.0)
            label = self._scene.add_label(
                f"{name}/label",
                f"{index + 1}. {goal.object_category}",
                position=(0.0, grown[1] / 2 + 0.08, 0.0),
                anchor="bottom-center",
            )
            self._nodes += [label, edges, box]

    def _listen(self, box: viser.BoxHandle, index: int) -> None:
        @box.on_click
        async def _(_: object) -> None:
            await self._on_object(index)

    def _add_start(self, start: Pose, floor_y: float) -> None:
        x, y, z = start.position
        if not same_storey(y, floor_y):
            return
        tail = np.array([x, y + 0.25, z])
        line = np.stack([tail, tail + 0.8 * forward_from_yaw(start.yaw)])[None].astype(np.float32)
        self._nodes += [
            self._scene.add_arrows(
                "/episode/start", line, START_RGB, shaft_radius=0.06, head_radius=0.15, head_length=0.28
            ),
            self._scene.add_label("/episode/start_label", "start", position=(x, y + 0.55, z), anchor="bottom-center"),
        ]

    def _add_region(self, region: NDArray[np.float64], floor_y: float) -> None:
        here = thinned(region[same_storey(region[:, 1], floor_y)], REGION_CELL)
        if len(here):
            points = (here + np.array([0, 0.06, 0])).astype(np.float32)
            self._nodes.append(
                self._scene.add_point_cloud(
                    "/episode/region", points, REGION_RGB, point_size=0.03, point_shape="circle", precision="float32"
                )
            )

    def _add_view_points(self, targets: Sequence[Goal], floor_y: float) -> None:
        """One batched node of darts: larger and bluer with more `iou`, small and grey for extra points."""
        points = [point for goal in targets for point in goal.view_points]
        most = max((point.iou or 0.0 for point in points), default=0.0) or 1.0
        here = [point for point in points if same_storey(point.agent_state.position[1], floor_y)]
        if not here:
            return
        shares = np.array([(point.iou or 0.0) / most for point in here])
        is_extra = np.array([point.iou is None for point in here])
        quats_xyzw = np.array([point.agent_state.rotation for point in here], np.float32)
        pale, full = np.array(PALE_RGB), np.array(POINT_RGB)
        colors = np.where(is_extra[:, None], EXTRA_RGB, pale + shares[:, None] * (full - pale)).astype(np.uint8)
        self._nodes.append(
            self._scene.add_batched_meshes_simple(
                "/episode/view_points",
                HEADING_VERTICES,
                HEADING_FACES,
                batched_wxyzs=quats_xyzw[:, [3, 0, 1, 2]],
                batched_positions=np.array([point.agent_state.position for point in here], np.float32)
                + np.array([0, 0.08, 0], np.float32),
                batched_scales=np.where(is_extra, 0.14, 0.16 + 0.14 * shares).astype(np.float32),
                batched_colors=colors,
                flat_shading=True,
                side="double",
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
        )

    def _add_path(self, name: str, trace: Trace, floor_y: float, *, lift: float) -> None:
        """A run's path over the floor with a ball at its end; `lift` keeps paths apart."""
        pieces = path_segments(trace.positions, floor_y, lift=lift)
        if len(pieces):
            self._nodes.append(self._lines(f"{name}/path", pieces, trace.rgb, 4.0))
        x, y, z = trace.positions[-1]
        if same_storey(y, floor_y):
            end = self._scene.add_icosphere(f"{name}/end", radius=0.1, color=trace.rgb, position=(x, y + lift, z))
            self._nodes.append(end)

    def _add_answer(self, name: str, trace: Trace, answer: Answer, floor_y: float) -> None:
        """Ranked points, the first one largest; a person's ray from the camera to the point."""
        for rank, point in enumerate(answer.candidates[:10], start=1):
            if not 0 <= point[1] - floor_y + 0.3 < 3.5:
                continue
            place, radius = f"{name}/rank{rank}", 0.13 if rank == 1 else 0.08
            ball = self._scene.add_icosphere(place, radius=radius, color=trace.rgb, position=point)
            label = self._scene.add_label(f"{place}/label", f"#{rank} {trace.title}", position=(0, 0.2, 0))
            self._nodes += [label, ball]
        if answer.ray is not None and answer.candidates:
            ray = np.array([[answer.ray.origin, answer.candidates[0]]])
            self._nodes.append(self._lines(f"{name}/ray", ray, trace.rgb, 2.0))

    def _lines(self, name: str, pieces: NDArray[np.floating], rgb: Rgb, pixels: float) -> viser.LineSegmentsHandle:
        return self._scene.add_line_segments(
            name, pieces.astype(np.float32), rgb, thickness=pixels, thickness_units="screen"
        )


class Walker:
    """A robot in the 3-D view of one browser: a dart on the floor, and the cone of its camera."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Shows nothing yet."""
        self._scene = client.scene
        self._nodes: list[Any] = []

    def show(self, pose: Pose | None, rgb: Rgb = (0, 0, 0)) -> None:
        """Shows the robot at a pose; None takes it away."""
        if pose is None:
            remove_nodes(self._nodes)
            return
        camera = Camera()
        if not self._nodes:
            dart = self._scene.add_mesh_simple(
                "/walker", HEADING_VERTICES, HEADING_FACES, color=rgb, side="double", scale=0.6
            )
            fov = 2 * math.atan(camera.height / 2 / camera.focal)
            frustum = self._scene.add_camera_frustum(
                "/walker_camera", fov, camera.width / camera.height, scale=0.3, color=rgb
            )
            self._nodes = [dart, frustum]
        dart, frustum = self._nodes
        T_camera = T_world_camera(pose, camera)
        x, y, z = pose.position
        dart.position, dart.wxyz = (x, y + 0.15, z), SO3.from_y_radians(pose.yaw).wxyz
        frustum.position, frustum.wxyz = T_camera[:3, 3], SO3.from_matrix(T_camera[:3, :3]).wxyz


def look_at_storey(client: viser.ClientHandle, home: OpenHome, storey: int) -> None:
    """Turns the camera to all of a storey, from above."""
    xz = home.copies.walkable_xz(storey)
    low, high = xz.min(axis=0), xz.max(axis=0)
    x, z = (low + high) / 2
    width, depth = (high - low) / 2
    reach = math.tan(client.camera.fov / 2)  # of half the canvas's height at 1 m
    near_side = depth * math.cos(VIEW_ANGLE)  # that much nearer than the middle
    across = width / (reach * window_aspect(client.camera)) + near_side
    upright = depth * math.sin(VIEW_ANGLE) / reach + near_side
    distance = _MARGIN * max(across, upright) + 1.0
    offset = distance * np.array([0.0, math.sin(VIEW_ANGLE), math.cos(VIEW_ANGLE)])
    centre = (x, home.copies.storeys[storey], z + _LOWER * (high - low)[1])
    place_camera(client.camera, centre, offset, up=(0.0, 1.0, 0.0))


def look_at_object(client: viser.ClientHandle, centre: Vector3, size: Vector3) -> None:
    """Turns the camera to one object, from the side on which it is and from above the walls."""
    away = np.asarray(client.camera.position, float) - centre
    flat = np.array([away[0], 0.0, away[2]])
    norm = float(np.linalg.norm(flat))
    side = flat / norm if norm > 0.1 else np.array([0.0, 0.0, 1.0])
    offset = (_NEAR + max(size)) * (math.cos(VIEW_ANGLE) * side + np.array([0.0, math.sin(VIEW_ANGLE), 0.0]))
    place_camera(client.camera, centre, offset, up=(0.0, 1.0, 0.0))


def path_segments(positions: NDArray[np.floating], floor_y: float, *, lift: float) -> Array:
    """(K, 2, 3) pieces of a polyline (N, 3) that lie on a storey, lifted over its floor so that they can be seen."""
    lifted = np.asarray(positions, np.float32) + np.array([0, lift, 0], np.float32)
    pieces = np.stack([lifted[:-1], lifted[1:]], axis=1)
    moved = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) > 1e-6
    return pieces[moved & same_storey(pieces[:, :, 1].mean(axis=1) - lift, floor_y)]


def thinned(points: NDArray[np.floating], cell: float) -> NDArray[np.floating]:
    """One of the points (N, 3) per square of the floor: regions are dense, and browsers draw each point."""
    _, first = np.unique(np.floor(points[:, [0, 2]] / cell).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def remove_nodes(nodes: list[Any]) -> None:
    """Takes nodes out of the browser, and empties the list."""
    for node in nodes:
        node.remove()
    nodes.clear()

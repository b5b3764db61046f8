"""What one browser shows over a home: target, view points, start, success region, paths, answers, object boxes."""

import math
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.episodes.schema import Episode, Goal
from sim.frames import T_world_camera, forward_from_yaw
from sim.tasks.rules import success_region
from sim.types import Camera, Pose
from sim.walk.storeys import same_storey

from .library import OpenHome
from .object_links import ObjectLink
from .shown import LayerChoice, Rgb, Shown

Array = NDArray[np.float32]
_EDGES = np.array([(a, b) for a in range(8) for b in range(8) if a < b and (a ^ b) in (1, 2, 4)])
_CORNERS = np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)], np.float32) - 0.5
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
"""View points with the most iou, and with none to speak of."""
EXTRA_RGB: Rgb = (150, 150, 150)
REGION_CELL = 0.12
"""One dot of the success region per square of this side, metres."""
UNKNOWN_SIZE = (0.5, 0.5, 0.5)
"""Box of an object whose extents nothing tells (scans without semantics), metres."""
_GROWN = 0.06
"""Metres by which boxes stand off from their objects."""
_THICK = 3.0
"""Lines, pixels."""
OnObject = Callable[[int], Awaitable[None]]


class Outlined(NamedTuple):
    """An object that is marked, and what is written over it."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    text: str


class Layers:
    """The nodes of one browser; `show_storey` builds what stands on a storey, `mark` follows the mouse."""

    def __init__(self, client: viser.ClientHandle, on_object: OnObject) -> None:
        """Shows nothing yet.

        Args:
            client: The browser.
            on_object: Told the index of the object node whose box is clicked.
        """
        self._client, self._on_object = client, on_object
        self._home: tuple[OpenHome, int, bool] | None = None
        self._home_nodes: list = []
        self._nodes: list = []
        self._mark: list = []
        self._walker: list = []
        client.scene.configure_default_lights(True, cast_shadow=False)

    def show_home(self, home: OpenHome, storey: int, *, names: bool) -> None:
        """The cut storey itself; stays as it is when it is shown already."""
        if self._home == (home, storey, names):
            return
        if self._home is None or self._home[:2] != (home, storey):
            self.clear()
            self._home_nodes.append(self._client.scene.add_glb("/home", home.copies.glbs[storey]))
        for node in self._home_nodes[1:]:
            node.remove()
        del self._home_nodes[1:]
        if names:
            self._name_objects(home, storey)
        self._home = (home, storey, names)

    def show_episode(
        self,
        episode: Episode,
        links: Sequence[ObjectLink],
        shown: Sequence[Shown],
        *,
        goals: Mapping[str, Goal],
        hidden: Collection[str],
        choice: LayerChoice,
    ) -> None:
        """Everything of an episode that stands on the storey that is shown.

        Args:
            episode: With its targets.
            links: Of its ownership graph.
            shown: Its runs and answers.
            goals: The home's goal objects by name.
            hidden: Labels of runs that are switched off.
            choice: Layers that are switched on.
        """
        assert self._home is not None, "no home is shown"
        home, storey, _ = self._home
        self._clear_episode()
        floor_y = home.copies.storeys[storey]
        self._add_boxes(home, storey, links, goals)
        self._add_start(episode.start, floor_y)
        if choice.region:
            self._add_region(success_region(episode, home.scene.navigation), floor_y)
        if choice.view_points:
            self._add_view_points(episode.targets, floor_y)
        for index, one in enumerate(shown):
            if one.label not in hidden:
                self._add_shown(f"/episode/run{index}", one, floor_y, lift=0.12 + 0.04 * (index % 4))

    def mark(self, objects: Sequence["Outlined"]) -> None:
        """Outlines and names these objects and no others."""
        for node in self._mark:
            node.remove()
        self._mark = []
        scene = self._client.scene
        for number, (centre, size, text) in enumerate(objects):
            grown = np.asarray(size) + 2.5 * _GROWN
            name = f"/mark{number}"
            edges = box_edges(centre, grown)
            top = (centre[0], centre[1] + grown[1] / 2 + 0.45, centre[2])
            self._mark += [
                scene.add_line_segments(name, edges, MARKED_RGB, thickness=6.0, thickness_units="screen"),
                scene.add_box(f"{name}_fill", MARKED_RGB, _three(grown), opacity=0.45, position=centre),
                scene.add_label(f"{name}_label", text, position=top, anchor="bottom-center", font_screen_scale=1.2),
            ]

    def show_walker(self, pose: Pose | None, rgb: Rgb = (0, 0, 0)) -> None:
        """A robot's mark at a step of its run; None takes it away."""
        if pose is None:
            for node in self._walker:
                node.remove()
            self._walker = []
            return
        x, y, z = pose.position
        T_camera = T_world_camera(pose, Camera())
        if not self._walker:
            scene = self._client.scene
            dart = scene.add_mesh_simple(
                "/walker", HEADING_VERTICES, HEADING_FACES, color=rgb, side="double", scale=0.6
            )
            fov = 2 * math.atan(Camera().height / 2 / Camera().focal)
            frustum = scene.add_camera_frustum(
                "/walker_camera", fov, Camera().width / Camera().height, scale=0.3, color=rgb
            )
            self._walker = [dart, frustum]
        dart, frustum = self._walker
        dart.position, dart.wxyz = (x, y + 0.15, z), quat_wxyz_from_yaw(pose.yaw)
        frustum.position, frustum.wxyz = T_camera[:3, 3], quat_wxyz_from_matrix(T_camera[:3, :3])

    def clear(self) -> None:
        """Takes everything away."""
        self._clear_episode()
        for node in self._home_nodes:
            node.remove()
        self._home_nodes, self._home = [], None

    def _clear_episode(self) -> None:
        self.mark(())
        self.show_walker(None)
        for node in self._nodes:
            node.remove()
        self._nodes = []

    def _name_objects(self, home: OpenHome, storey: int) -> None:
        bottom_y, top_y = home.copies.cuts[storey]
        for item in home.scene.objects:
            x, y, z = item.centre
            if bottom_y <= y <= top_y:
                self._home_nodes.append(
                    self._client.scene.add_label(
                        f"/names/{item.instance_id}",
                        item.category,
                        position=(x, y + item.size[1] / 2 + 0.08, z),
                        anchor="bottom-center",
                        font_screen_scale=0.8,
                    )
                )

    def _add_boxes(self, home: OpenHome, storey: int, links: Sequence[ObjectLink], goals: Mapping[str, Goal]) -> None:
        """A box around each linked object of the storey; it takes clicks, the home itself does not."""
        for index, link in enumerate(links):
            goal = goals.get(link.goal) if link.goal is not None else None
            if goal is None or home.storey(goal.floor_y) != storey:
                continue
            centre, size = box_of(goal, home)
            rgb = TARGET_RGB if link.is_target else OBJECT_RGB
            grown = np.asarray(size) + _GROWN
            scene = self._client.scene
            box = scene.add_box(f"/episode/object{index}", rgb, _three(grown), opacity=0.3, position=_three(centre))
            self._listen(box, index)
            edges = scene.add_line_segments(
                f"/episode/object{index}/edges",
                box_edges((0, 0, 0), grown),
                rgb,
                thickness=_THICK,
                thickness_units="screen",
            )
            label = scene.add_label(
                f"/episode/object{index}/label",
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
        if not on_storey(np.array([start.position]), floor_y)[0]:
            return
        scene = self._client.scene
        line = nose(start, height=0.25, length=0.8)[None]
        arrow = scene.add_arrows(
            "/episode/start", line, START_RGB, shaft_radius=0.06, head_radius=0.15, head_length=0.28
        )
        x, y, z = start.position
        label = scene.add_label("/episode/start_label", "start", position=(x, y + 0.55, z), anchor="bottom-center")
        self._nodes += [arrow, label]

    def _add_region(self, region: np.ndarray, floor_y: float) -> None:
        here = thinned(region[on_storey(region, floor_y)], REGION_CELL)
        if not len(here):
            return
        self._nodes.append(
            self._client.scene.add_point_cloud(
                "/episode/region",
                (here + np.array([0, 0.06, 0])).astype(np.float32),
                REGION_RGB,
                point_size=0.03,
                point_shape="circle",
                precision="float32",
            )
        )

    def _add_view_points(self, targets: Sequence[Goal], floor_y: float) -> None:
        """One batched node of darts: larger and bluer with more `iou`, small and grey for extra points."""
        points = [point for goal in targets for point in goal.view_points]
        positions = np.array([point.agent_state.position for point in points], np.float32).reshape(-1, 3)
        here = np.flatnonzero(on_storey(positions, floor_y))
        if not len(here):
            return
        most = max((point.iou or 0.0 for point in points), default=0.0) or 1.0
        shares = np.array([(points[index].iou or 0.0) / most for index in here])
        is_extra = np.array([points[index].iou is None for index in here])
        quats_xyzw = np.array([points[index].agent_state.rotation for index in here], np.float32)
        pale, full = np.array(PALE_RGB), np.array(POINT_RGB)
        colors = np.where(is_extra[:, None], EXTRA_RGB, pale + shares[:, None] * (full - pale)).astype(np.uint8)
        self._nodes.append(
            self._client.scene.add_batched_meshes_simple(
                "/episode/view_points",
                HEADING_VERTICES,
                HEADING_FACES,
                batched_wxyzs=quats_xyzw[:, [3, 0, 1, 2]],
                batched_positions=positions[here] + np.array([0, 0.08, 0], np.float32),
                batched_scales=np.where(is_extra, 0.14, 0.16 + 0.14 * shares).astype(np.float32),
                batched_colors=colors,
                flat_shading=True,
                side="double",
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
        )

    def _add_shown(self, name: str, one: Shown, floor_y: float, *, lift: float) -> None:
        """A run's path over the floor with a ball at its end, or an answer's points; `lift` keeps paths apart."""
        if one.run is not None:
            positions = np.array([pose.position for pose in one.run.poses])
            pieces = path_segments(positions, floor_y, lift=lift)
            if len(pieces):
                self._lines(f"{name}/path", pieces, one.rgb, 4.0)
            end = one.run.poses[-1]
            if on_storey(np.array([end.position]), floor_y)[0]:
                x, y, z = end.position
                self._nodes.append(
                    self._client.scene.add_icosphere(
                        f"{name}/end", radius=0.1, color=one.rgb, position=(x, y + lift, z)
                    )
                )
        if one.answer is not None:
            self._add_answer(name, one, floor_y)

    def _add_answer(self, name: str, one: Shown, floor_y: float) -> None:
        """Ranked points, the first one largest; a person's ray from the camera to the point."""
        assert one.answer is not None
        scene = self._client.scene
        for rank, point in enumerate(one.answer.candidates[:10], start=1):
            if not 0 <= point[1] - floor_y + 0.3 < 3.5:
                continue
            radius = 0.13 if rank == 1 else 0.08
            ball = scene.add_icosphere(f"{name}/rank{rank}", radius=radius, color=one.rgb, position=point)
            label = scene.add_label(f"{name}/rank{rank}/label", f"#{rank} {one.label}", position=(0, 0.2, 0))
            self._nodes += [label, ball]
        if one.answer.ray is not None and one.answer.candidates:
            self._lines(f"{name}/ray", np.array([[one.answer.ray.origin, one.answer.candidates[0]]]), one.rgb, 2.0)

    def _lines(self, name: str, pieces: np.ndarray, rgb: Rgb, pixels: float) -> None:
        self._nodes.append(
            self._client.scene.add_line_segments(
                name, pieces.astype(np.float32), rgb, thickness=pixels, thickness_units="screen"
            )
        )


def box_of(goal: Goal, home: OpenHome) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Centre and extents of a goal's object, metres; extents are UNKNOWN_SIZE where the home does not know it."""
    item = home.objects.get(goal.object_name)
    return (goal.position, UNKNOWN_SIZE) if item is None else (item.centre, item.size)


def box_edges(centre: Sequence[float], size: Sequence[float] | NDArray[np.floating]) -> Array:
    """(12, 2, 3) edges of an upright box."""
    return (np.asarray(centre, np.float32) + _CORNERS * np.asarray(size, np.float32))[_EDGES].astype(np.float32)


def quat_wxyz_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """viser's order."""
    return (math.cos(yaw / 2), 0.0, math.sin(yaw / 2), 0.0)


def quat_wxyz_from_matrix(R_world_node: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """viser's order, of a rotation (3, 3)."""
    x, y, z, w = Rotation.from_matrix(R_world_node).as_quat()
    return (float(w), float(x), float(y), float(z))


def path_segments(positions: NDArray[np.floating], floor_y: float, *, lift: float) -> Array:
    """(K, 2, 3) pieces of a polyline (N, 3) that lie on a storey, lifted over its floor so that they can be seen."""
    lifted = np.asarray(positions, np.float32) + np.array([0, lift, 0], np.float32)
    pieces = np.stack([lifted[:-1], lifted[1:]], axis=1)
    moved = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) > 1e-6
    return pieces[moved & same_storey(pieces[:, :, 1].mean(axis=1) - lift, floor_y)]


def on_storey(points: NDArray[np.floating], floor_y: float) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) stand on the storey's floor."""
    return same_storey(np.asarray(points)[:, 1], floor_y)


def nose(pose: Pose, *, height: float, length: float) -> Array:
    """(2, 3) a line from over the robot's feet along its heading."""
    start = np.array(pose.position, np.float32) + np.array([0, height, 0], np.float32)
    return np.stack([start, start + length * forward_from_yaw(pose.yaw).astype(np.float32)])


def thinned(points: NDArray[np.floating], cell: float) -> NDArray[np.floating]:
    """One of the points (N, 3) per square of the floor: regions are dense, and browsers draw each point."""
    if not len(points):
        return points
    _, first = np.unique(np.floor(points[:, [0, 2]] / cell).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def _three(values) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return (x, y, z)

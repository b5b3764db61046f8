"""What a recording shows of a home: which one it is, its storeys' meshes and maps, and at the end where the goal is."""

import io
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.copies.browser_glb import browser_glb
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.rules import success_radius, success_region
from sim.types import GridSpec
from sim.walk.navigation_map import NavigationMap
from sim.walk.storeys import storey_of

from . import paths
from .traces import Rgb

GLB = "model/gltf-binary"
_FILTER = re.compile(rb'"(?:mag|min)Filter":\d+,')
_JSON_AT = 20
"""Where the text begins in binary glTF; its length stands 8 bytes before."""
FREE_RGB, WALL_RGB = (236, 236, 232), (58, 60, 66)
MARGIN = 0.5
"""Metres of map shown around the free space."""
MAP_WHOLE, MAP_TRAIL, ROBOT, POINT = -0.8, -2.0, -2.5, -5.0
"""Radii on the map; negative = points of the screen, so that they can be seen on maps of any size."""
LIFT = 0.15
"""Paths are drawn this far above the feet (metres), so that no floor covers them; recorded heights are noisy."""
GOAL_RGB: Rgb = (255, 60, 60)
PLACE_RGB: Rgb = (255, 190, 190)
PATH_RGB: Rgb = (255, 120, 120)
RIM, WAY = -1.2, -1.5
"""Radii; negative = points of the screen."""
PLACE = 0.03
"""Radius of a place to stand, metres: places are 5 cm apart and fill their area."""
_RIM_ANGLES = np.linspace(0, 2 * np.pi, 65)


def may_be_shown(scene: Scene, *, with_pixels: bool) -> bool:
    """Whether geometry, maps and pictures of a home may be logged: those of a licensed scan need leave, others none."""
    return scene.kind != "scan" or with_pixels


def log_identity(stream: rr.RecordingStream, episode: Episode, scene: Scene) -> None:
    """Names the recording and says of which episode and home it is, and which way is up."""
    stream.send_recording_name(f"{episode.key} in {scene.label}")
    facts = rr.AnyValues(episode=str(episode.key), scene=scene.name, scene_kind=scene.kind, scene_digest=scene.digest)
    stream.send_property("episode", facts)
    log_up(stream)


def log_up(stream: rr.RecordingStream) -> None:
    """Says which way is up."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)


def log_scene(stream: rr.RecordingStream, scene: Scene, *, storeys: Sequence[int]) -> None:
    """Logs the copy of each storey in `storeys` (indices into the scene's storey heights) below `/scene/mesh`.

    Raises:
        SceneError: A storey has no faces.
    """
    for index in storeys:
        glb = browser_glb(scene, scene.navigation.storey_heights[index], srgb_colours=True)
        stream.log(
            f"{paths.MESH}/{paths.storey_part(index)}",
            rr.Asset3D(contents=_without_filters(glb), media_type=GLB),
            static=True,
        )


def _without_filters(glb: bytes) -> bytes:
    """A browser copy whose textures ask for no filters: Rerun has only one, and warns of each that wants another."""
    (length,) = struct.unpack_from("<I", glb, _JSON_AT - 8)
    text = glb[_JSON_AT : _JSON_AT + length]
    return glb[:_JSON_AT] + _FILTER.sub(lambda found: b" " * len(found[0]), text) + glb[_JSON_AT + length :]


@dataclass(frozen=True, slots=True)
class StoreyMap:
    """One storey from above, cropped to its free space."""

    index: int
    """Place in the scene's storey heights."""
    floor_y: float
    """Metres."""
    free: NDArray[np.bool_]
    """(rows, cols)."""
    grid: GridSpec

    @property
    def part(self) -> str:
        """Name of the storey's entities."""
        return paths.storey_part(self.index)

    @property
    def entity(self) -> str:
        """Entity of its picture."""
        return f"{paths.TOPDOWN}/{self.part}"

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (..., 2) in the picture, column first, of world points (..., 3)."""
        return (points[..., [0, 2]] - np.asarray(self.grid.origin_xz)) / self.grid.cell

    def flat_boxes(
        self, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low corners and sizes (N, 2) in the picture of boxes with these corners (N, 3) in the world."""
        corners = np.stack([self.pixels(low), self.pixels(high)], axis=1)  # (N, 2, 2)
        return corners.min(axis=1), np.ptp(corners, axis=1)


def storey_map(navigation: NavigationMap, index: int) -> StoreyMap:
    """The map of one storey of a scene; the whole grid when nothing is free there."""
    floor_y = navigation.storey_heights[index]
    free, grid, _ = navigation.top_down(floor_y)
    return cropped_map(index, floor_y, free, grid, around=free)


def cropped_map(
    index: int, floor_y: float, free: NDArray[np.bool_], grid: GridSpec, *, around: NDArray[np.bool_]
) -> StoreyMap:
    """A storey whose picture ends `MARGIN` behind the cells `around` (rows, cols); the whole grid where none is set."""
    rows, cols = np.flatnonzero(around.any(axis=1)), np.flatnonzero(around.any(axis=0))
    if not len(rows):
        return StoreyMap(index, floor_y, free, grid)
    pad = round(MARGIN / grid.cell)
    top, bottom = max(0, rows[0] - pad), min(grid.shape[0], rows[-1] + 1 + pad)
    left, right = max(0, cols[0] - pad), min(grid.shape[1], cols[-1] + 1 + pad)
    origin = (float(grid.origin_xz[0] + left * grid.cell), float(grid.origin_xz[1] + top * grid.cell))
    cropped = free[top:bottom, left:right]
    return StoreyMap(index, floor_y, cropped, GridSpec(origin, grid.cell, cropped.shape))


def storeys_of(heights: NDArray[np.float64], navigation: NavigationMap) -> NDArray[np.int64]:
    """Index of the storey (N,) that points at each height (N,) belong to."""
    storeys = [(height, height) for height in navigation.storey_heights]
    return np.array([storey_of(float(y), storeys) for y in heights], np.int64)


def log_map_picture(stream: rr.RecordingStream, storey: StoreyMap) -> None:
    """Logs the picture of a storey's free space."""
    rgb = np.where(storey.free[..., None], np.array(FREE_RGB, np.uint8), np.array(WALL_RGB, np.uint8))
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "PNG")
    stream.log(storey.entity, rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"), static=True)


@dataclass(frozen=True, slots=True)
class GoalRegion:
    """The truth of an episode as the success rule `paper` sees it; M targets."""

    names: tuple[str, ...]
    """(M,) object names."""
    centres: NDArray[np.float64]
    """(M, 3) world metres."""
    floors_y: NDArray[np.float64]
    """(M,) height of each target's floor."""
    storeys: NDArray[np.int64]
    """(M,) index of each target's storey."""
    radii: NDArray[np.float64]
    """(M,) largest planar distance that succeeds: 1 m, 1.5 m where relaxed."""
    places: NDArray[np.float64]
    """(K, 3) places to stand from which STOP succeeds."""
    place_storeys: NDArray[np.int64]
    """(K,) index of each place's storey."""
    path: NDArray[np.float64] | None
    """(P, 3) shortest path from the start to the nearest place; None where none can be reached."""
    path_storeys: NDArray[np.int64]
    """(P,) index of the storey of each of its corners; (0,) without a path."""

    @property
    def rims(self) -> NDArray[np.float64]:
        """(M, 65, 3) the closed circle around each target's centre, on its floor."""
        ring = np.stack([np.cos(_RIM_ANGLES), np.zeros(len(_RIM_ANGLES)), np.sin(_RIM_ANGLES)], axis=1)
        feet = np.column_stack([self.centres[:, 0], self.floors_y, self.centres[:, 2]])
        return feet[:, None] + self.radii[:, None, None] * ring

    def apart(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, M) planar metres from points (N, 3) to each target's centre."""
        return np.linalg.norm(positions[:, None, [0, 2]] - self.centres[:, [0, 2]], axis=-1)


def goal_region(episode: Episode, navigation: NavigationMap) -> GoalRegion:
    """The targets of an episode, their success region and the shortest path to it on the scene's map."""
    places = success_region(episode, navigation)
    path = navigation.shortest_path(np.array(episode.start.position), places) if len(places) else None
    floors_y = np.array([target.floor_y for target in episode.targets], float)
    return GoalRegion(
        names=tuple(target.object_name for target in episode.targets),
        centres=np.array([target.position for target in episode.targets], float),
        floors_y=floors_y,
        storeys=storeys_of(floors_y, navigation),
        radii=np.array([success_radius(target) for target in episode.targets]),
        places=places,
        place_storeys=storeys_of(places[:, 1], navigation),
        path=path,
        path_storeys=storeys_of(np.empty(0) if path is None else path[:, 1], navigation),
    )


def log_goal(stream: rr.RecordingStream, goal: GoalRegion, maps: Sequence[StoreyMap]) -> None:
    """Logs the goal below `/goal` at the stream's present time, which must be the end of all that is shown."""
    up = np.array([0.0, LIFT, 0.0])
    centres = rr.Points3D(goal.centres, colors=[GOAL_RGB], radii=0.14, labels=goal.names)
    stream.log(f"{paths.GOAL}/centre", centres)
    stream.log(f"{paths.GOAL}/region", rr.LineStrips3D(list(goal.rims + up), colors=[GOAL_RGB], radii=RIM))
    stream.log(f"{paths.GOAL}/places", rr.Points3D(goal.places + up / 2, colors=[PLACE_RGB], radii=PLACE))
    if goal.path is not None:
        stream.log(f"{paths.GOAL}/path", rr.LineStrips3D([goal.path + up], colors=[PATH_RGB], radii=WAY))
    for storey in maps:
        _log_on_map(stream, goal, storey)


def _log_on_map(stream: rr.RecordingStream, goal: GoalRegion, storey: StoreyMap) -> None:
    entity = f"{paths.GOAL}/map/{storey.part}"
    here = goal.storeys == storey.index
    labels = [name for name, is_here in zip(goal.names, here, strict=True) if is_here]
    spots = storey.pixels(goal.centres[here])
    stream.log(entity, rr.Points2D(spots, colors=[GOAL_RGB], radii=POINT, labels=labels, draw_order=60.0))
    rims = storey.pixels(goal.rims[here])
    stream.log(f"{entity}/region", rr.LineStrips2D(list(rims), colors=[GOAL_RGB], radii=RIM, draw_order=55.0))
    places = storey.pixels(goal.places[goal.place_storeys == storey.index])
    stream.log(
        f"{entity}/places", rr.Points2D(places, colors=[PLACE_RGB], radii=PLACE / storey.grid.cell, draw_order=10.0)
    )
    if goal.path is not None:
        here = goal.path_storeys == storey.index
        corners = storey.pixels(goal.path)
        pieces = np.stack([corners[:-1], corners[1:]], axis=1)[here[:-1] & here[1:]]
        stream.log(f"{entity}/path", rr.LineStrips2D(list(pieces), colors=[PATH_RGB], radii=WAY, draw_order=54.0))

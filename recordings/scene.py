"""Logs a home into a recording: its identity, its storeys' meshes and maps, and at the end the goal."""

import io
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.copies.browser_glb import browser_glb
from sim.episodes.schema import Episode, Goal
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap, storeys_of
from sim.tasks.rules import success_radius, success_region
from sim.types import EpisodeKey
from sim.walk.navigation_map import NavigationMap

from . import paths
from .traces import Rgb

GLB = "model/gltf-binary"
_FILTER = re.compile(rb'"(?:mag|min)Filter":\d+,')
_JSON_AT = 20
"""Byte at which the text begins in binary glTF; its length stands 8 bytes earlier."""
FREE_RGB, WALL_RGB = (236, 236, 232), (58, 60, 66)
MAP_WHOLE, MAP_TRAIL, ROBOT, POINT = -0.8, -2.0, -2.5, -5.0
"""Radii on the map; negative = points of the screen, so that they can be seen on maps of any size."""
LIFT = 0.15
"""Paths are drawn this far above the feet (metres), so that no floor covers them; recorded heights are noisy."""
GOAL_RGB: Rgb = (255, 60, 60)
OLD = "old"
"""Entity below the goal of a home sequence: the object that was right before the last change."""
OLD_RGB: Rgb = (255, 170, 0)
PLACE_RGB: Rgb = (255, 190, 190)
PATH_RGB: Rgb = (255, 120, 120)
RIM, WAY = -1.2, -1.5
"""Radii; negative = points of the screen."""
PLACE = 0.03
"""Radius of a place to stand, metres: places are 5 cm apart and fill their area."""
_RIM_ANGLES = np.linspace(0, 2 * np.pi, 65)


def may_be_shown(scene: Scene, *, with_pixels: bool) -> bool:
    """Whether geometry, maps and pictures of a home may be logged: for a licensed scan only with `with_pixels`."""
    return scene.kind != "scan" or with_pixels


def log_identity(
    stream: rr.RecordingStream, key: EpisodeKey, scene: Scene, *, what: Literal["episode", "sequence"] = "episode"
) -> None:
    """Logs the recording's name, its episode or home sequence and its home, and which way is up."""
    stream.send_recording_name(f"{key} in {scene.label}")
    named: dict[str, Any] = {what: str(key)}
    facts = rr.AnyValues(**named, scene=scene.name, scene_kind=scene.kind, scene_digest=scene.digest)
    stream.send_property(what, facts)
    log_up(stream)


def log_up(stream: rr.RecordingStream) -> None:
    """Logs which way is up."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)


def log_storeys(stream: rr.RecordingStream, scene: Scene, maps: Sequence[StoreyMap]) -> None:
    """Logs the storeys' meshes below `/scene/mesh`, and the pictures of their maps.

    Raises:
        SceneError: A storey has no faces.
    """
    for storey in maps:
        glb = browser_glb(scene, scene.navigation.storey_heights[storey.index], srgb_colours=True)
        mesh = rr.Asset3D(contents=_without_filters(glb), media_type=GLB)
        stream.log(f"{paths.MESH}/{storey.name}", mesh, static=True)
    for storey in maps:
        log_map_picture(stream, storey)


def _without_filters(glb: bytes) -> bytes:
    """The file without its textures' filters: Rerun has only one filter, and warns about each texture with another."""
    (length,) = struct.unpack_from("<I", glb, _JSON_AT - 8)
    text = glb[_JSON_AT : _JSON_AT + length]
    return glb[:_JSON_AT] + _FILTER.sub(lambda found: b" " * len(found[0]), text) + glb[_JSON_AT + length :]


def log_map_picture(stream: rr.RecordingStream, storey: StoreyMap) -> None:
    """Logs the picture of a storey's free space."""
    rgb = np.where(storey.free[..., None], np.array(FREE_RGB, np.uint8), np.array(WALL_RGB, np.uint8))
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "PNG")
    picture = rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png")
    stream.log(paths.map_entity(storey.name), picture, static=True)


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
    """(M,) largest planar distance that succeeds: 1 m, or 1.5 m if relaxed."""
    places: NDArray[np.float64]
    """(K, 3) places to stand from which STOP succeeds."""
    place_storeys: NDArray[np.int64]
    """(K,) index of each place's storey."""
    path: NDArray[np.float64] | None
    """(P, 3) shortest path from the start to the nearest place; None if no place can be reached."""
    path_storeys: NDArray[np.int64]
    """(P,) index of the storey of each of the path's corners; (0,) without a path."""

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
    """Logs the goal below `/goal` at the stream's present time, which must be the end of the recording."""
    up = np.array([0.0, LIFT, 0.0])
    centres = rr.Points3D(goal.centres, colors=[GOAL_RGB], radii=0.14, labels=goal.names)
    stream.log(f"{paths.GOAL}/centre", centres)
    stream.log(f"{paths.GOAL}/region", rr.LineStrips3D(list(goal.rims + up), colors=[GOAL_RGB], radii=RIM))
    stream.log(f"{paths.GOAL}/places", rr.Points3D(goal.places + up / 2, colors=[PLACE_RGB], radii=PLACE))
    if goal.path is not None:
        stream.log(f"{paths.GOAL}/path", rr.LineStrips3D([goal.path + up], colors=[PATH_RGB], radii=WAY))
    for storey in maps:
        _log_on_map(stream, goal, storey)


def log_old_object(stream: rr.RecordingStream, old: Goal | None, maps: Sequence[StoreyMap], storey: int) -> None:
    """Logs the object that was right before a change, on this storey, at the stream's present time; None = none."""
    centres = np.array([] if old is None else [old.position]).reshape(-1, 3)
    labels = [] if old is None else [f"before: {old.object_name}"]
    stream.log(f"{paths.GOAL}/{OLD}", rr.Points3D(centres, colors=[OLD_RGB], radii=0.14, labels=labels))
    for shown in maps:
        spots = shown.pixels(centres if shown.index == storey else centres[:0])
        flat = rr.Points2D(spots, colors=[OLD_RGB], radii=POINT, labels=labels[: len(spots)], draw_order=59.0)
        stream.log(f"{paths.GOAL}/map/{shown.name}/{OLD}", flat)


def _log_on_map(stream: rr.RecordingStream, goal: GoalRegion, storey: StoreyMap) -> None:
    entity = f"{paths.GOAL}/map/{storey.name}"
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

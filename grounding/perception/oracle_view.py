"""Oracle perception of one episode: the simulator's ids of what the robot sees, behind the protocols of perception.

It needs the home and the episode's start, which are ground truth, so the researcher's side makes it and hands it to an
agent, which asks it questions and never reads the ids.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.frames import T_world_agent
from sim.homes.renderers import renderer_of
from sim.mesh import Scene, SceneObject
from sim.types import Camera, Frame, Observation, Pose

from ..encoders.protocol import TextEncoder
from .encoder_scorer import EncoderScorer
from .oracle_detector import Level, OracleDetector, OracleLevel, oracle_level
from .oracle_perception import OraclePerception
from .protocol import Perception
from .segmenters import IdRegion

if TYPE_CHECKING:
    from sim.render.raycast import Raycaster

_RAYS = 24
"""Rays along each side of the rectangle around an object; they measure its seen share to about 0.03."""
_NEAR = 0.05
"""An object with a point nearer than this in front of the camera may be anywhere in the picture, metres."""
Alone = tuple["Raycaster", NDArray[np.float64]]
"""A caster of rays to the faces of one object, and its points (N, 3), world frame."""
_ALONE: "WeakKeyDictionary[Scene, dict[int, Alone | None]]" = WeakKeyDictionary()
"""Objects of the scenes that are in use."""


def oracle_perception_of(
    scene: Scene,
    episode_start: Pose,
    captions: Mapping[int, str],
    *,
    text_encoder: TextEncoder,
    level: Level | OracleLevel = "clean",
    seed: int = 0,
) -> Perception:
    """Perception of an episode from the simulator's ids, with the errors of a level. Ground truth.

    Args:
        scene: The episode's home; its renderer draws the ids.
        episode_start: The robot's start, which is where the start frame stands in the world.
        captions: Instance id to text, as `grounding.maps.oracle_map.object_texts` gives them.
        text_encoder: Compares queries with captions.
        level: A named level, or errors of your own with their own seed.
        seed: Of the draws of a named level; they depend on the home's name and the view as well.

    Returns:
        Perception named after the level and every setting, for rows of results.

    Raises:
        AgentError: There is no such level.
    """
    errors = oracle_level(level, seed=seed) if isinstance(level, str) else level
    encoder = OraclePerception(text_encoder, captions, options=errors.perception, home=scene.name)
    detector = OracleDetector(
        encoder,
        categories={item.instance_id: item.category for item in scene.objects},
        faults=errors.detector,
        seen_share=SeenShares(scene, episode_start),
    )
    own = f"oracle:{level}" if isinstance(level, str) else "oracle:own"
    return Perception(
        name=f"{own} ({errors.settings}) in {text_encoder.name}",
        frame_of=frames_with_ids(scene, episode_start),
        scorer=EncoderScorer(encoder),
        encoder=encoder,
        detector=detector,
        segmenter=IdRegion(),
    )


def frames_with_ids(scene: Scene, episode_start: Pose) -> Callable[[Observation], Frame]:
    """A function that gives an observation's picture with the ids of its pixels, in the frame of this start.

    Colours and depth are the observation's own; where it has none, those of the home.
    """
    renderer, T_world_start = renderer_of(scene), T_world_agent(episode_start)

    def frame_of(observation: Observation) -> Frame:
        T_start_camera = observation.T_start_camera
        drawn = renderer.render_again(T_world_start @ T_start_camera, observation.camera)
        return replace(
            drawn,
            rgb=drawn.rgb if observation.rgb is None else observation.rgb,
            depth_m=drawn.depth_m if observation.depth_m is None else observation.depth_m,
            T_world_camera=T_start_camera,
        )

    return frame_of


class SeenShares:
    """The share of an object's pixels that a frame shows, by rays to the object alone."""

    def __init__(self, scene: Scene, episode_start: Pose) -> None:
        """Takes the home, and the start whose frame the views are in."""
        self._T_world_start = T_world_agent(episode_start)
        self._scene = scene
        self._objects = {item.instance_id: item for item in scene.objects}

    def __call__(self, frame: Frame, instance: int) -> float:
        """0 to 1: of the pixels that the object would fill if nothing else were there and the picture had no edge.

        Raises:
            AgentError: The home has no such object, or the frame has no ids.
        """
        if frame.ids is None or instance not in self._objects:
            raise AgentError(
                f"perception: instance {instance!r} is asked for in a view of {self._scene.name!r}; expected an object "
                "of this home, in a view with ids. Make the perception for the home of the episode."
            )
        T_world_camera = self._T_world_start @ frame.T_world_camera
        caster, corners = _object_alone(self._scene, instance) or (None, _corners(self._objects[instance]))
        uv = _ray_grid(corners, T_world_camera, frame.camera)
        if caster is None:
            is_hit = _hits_box(uv, self._objects[instance], T_world_camera, frame.camera)
        else:
            directions = _directions(uv, frame.camera) @ T_world_camera[:3, :3].T
            origins = np.broadcast_to(T_world_camera[:3, 3], directions.shape)
            is_hit = caster.cast(np.ascontiguousarray(origins), directions).face_ids >= 0
        cols, rows = np.floor(uv[is_hit]).astype(int).T
        height, width = frame.ids.shape
        inside = (cols >= 0) & (cols < width) & (rows >= 0) & (rows < height)
        seen = frame.ids[rows[inside], cols[inside]] == instance
        return float(seen.sum() / is_hit.sum()) if is_hit.any() else 1.0  # seen through fewer pixels than rays


def _object_alone(scene: Scene, instance: int) -> Alone | None:
    """The object without the rest of the home, made once; None for an object without faces of its own."""
    known = _ALONE.setdefault(scene, {})
    if instance not in known:
        known[instance] = _made_alone(scene, instance)
    return known[instance]


def _made_alone(scene: Scene, instance: int) -> Alone | None:
    from sim.render.raycast import Raycaster

    faces = scene.mesh.face_instance == instance
    if not faces.any():
        return None
    alone = scene.mesh.select(faces)
    used, faces_of_used = np.unique(alone.faces, return_inverse=True)
    colours = None if alone.vertex_rgb is None else alone.vertex_rgb[used]
    small = replace(
        alone,
        vertices=alone.vertices[used],
        faces=faces_of_used.reshape(-1, 3).astype(np.int32),
        vertex_rgb=colours,
        ids=None,
    )
    return Raycaster(small, texture_filter="nearest", threads=1), small.vertices.astype(np.float64)


def _corners(item: SceneObject) -> NDArray[np.float64]:
    """(8, 3) corners of an object's box."""
    signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
    return np.asarray(item.centre) + signs * np.asarray(item.size)


def _ray_grid(points: NDArray[np.float64], T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """(R, 2) pixel centres (u, v), evenly over the rectangle that holds the points, also beyond the picture."""
    (fx, fy, cx, cy), points_camera = camera.lens, (points - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    depth = points_camera[:, 2]
    low = np.array([-camera.width, -camera.height], float)
    high = np.array([2 * camera.width, 2 * camera.height], float)
    if depth.min() > _NEAR:
        uv = points_camera[:, :2] / depth[:, None] * (fx, fy) + (cx, cy)
        low, high = np.floor(uv.min(axis=0)), np.ceil(uv.max(axis=0))
    steps = np.maximum(1.0, (high - low) / _RAYS)
    u, v = (np.floor(np.arange(low[axis], high[axis], steps[axis])) + 0.5 for axis in (0, 1))
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _directions(uv: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """(R, 3) rays through pixels, camera axes, depth 1."""
    fx, fy, cx, cy = camera.lens
    return np.column_stack([(uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy, np.ones(len(uv))])


def _hits_box(
    uv: NDArray[np.float64], item: SceneObject, T_world_camera: NDArray[np.float64], camera: Camera
) -> NDArray[np.bool_]:
    """(R,) which rays meet an object's box, for objects that have no faces of their own."""
    directions = _directions(uv, camera) @ T_world_camera[:3, :3].T
    half, offset = np.asarray(item.size) / 2, np.asarray(item.centre) - T_world_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (offset - half) / directions, (offset + half) / directions
    enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return (enter < leave) & (leave > 0)

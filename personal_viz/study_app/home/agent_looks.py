"""The looks of a study's conditions for agents: the pictures that people see, or a walk instead of the 3-D model."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from grounding.agents.exploration import Exploration
from grounding.agents.explored_storeys import storey_explorations
from grounding.evaluation.home_maps import VIEWS_EVERY
from sim.frames import T_start_camera, T_world_camera, gps_from_poses, wrap_angle
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.tasks.looks import HomeLook, LookKind, StoreyPicture
from sim.types import Action, Camera, Observation, Pose
from sim.walk.storeys import nearest_storey

from .top_view import top_views


@dataclass(frozen=True, slots=True)
class StudyLook:
    """Makes the looks of one condition of a study; picklable, for worker processes."""

    kind: LookKind
    camera: Camera
    """The study's robot camera, for the views of walks."""
    explorations: Path
    """Folder of explorations; `ground --map explore` makes its maps from the same ones."""
    seed: int
    """Seed of the walks."""

    def __call__(self, scene: Scene, start: Pose) -> HomeLook:
        """The look at the home of an episode that starts here; only the storey and the frame depend on the start.

        Raises:
            SceneError: A storey has no faces, or no place to walk from.
            RunFileError: A file of an exploration is damaged or cannot be written.
        """
        if self.kind == "topdown":
            return HomeLook("topdown", pictures=_pictures(scene))
        storey = int(nearest_storey(start.position[1], scene.navigation.storey_heights))
        (walk,) = storey_explorations(scene, (storey,), folder=self.explorations, seed=self.seed)
        return HomeLook("glb", views=lambda: _views(scene, walk, start, self.camera))


def _pictures(scene: Scene) -> tuple[StoreyPicture, ...]:
    """Every storey as the page shows it: the pixels of the same JPEG file."""
    found = []
    for view in top_views(scene):
        rgb = np.asarray(Image.open(io.BytesIO(view.jpeg())).convert("RGB"))
        found.append(StoreyPicture(rgb, view.grid.cell))
    return tuple(found)


def _views(scene: Scene, walk: Exploration, start: Pose, camera: Camera) -> Iterator[Observation]:
    """The views of the walk's poses from which `ground --map explore` makes its maps, seen from the episode's start."""
    renderer = renderer_of(scene)
    is_stopped = bool(walk.steps) and walk.steps[-1].action is Action.STOP
    poses = walk.poses[:-1] if is_stopped else walk.poses
    for step, pose in enumerate(poses[::VIEWS_EVERY]):
        frame = renderer.render(T_world_camera(pose, camera), camera)
        yield Observation(
            rgb=frame.rgb,
            depth_m=frame.depth_m,
            gps=gps_from_poses(start, pose),
            compass=wrap_angle(pose.yaw - start.yaw),
            T_start_camera=T_start_camera(start, pose, camera),
            camera=camera,
            collided=False,
            step=step,
        )

"""The looks of a study's conditions for agents: the pictures that people see, or a walk instead of the 3-D model."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from grounding.agents.exploration import Exploration
from grounding.agents.explored_storeys import storey_explorations
from sim.frames import T_world_agent
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.tasks.looks import HomeLook, LookKind, StoreyPicture
from sim.tasks.pan import PanEnv
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
        T_views_start = np.linalg.inv(T_world_agent(walk.start)) @ T_world_agent(start)
        return HomeLook("glb", views=lambda: _views(scene, walk, self.camera), T_views_start=T_views_start)


def _pictures(scene: Scene) -> tuple[StoreyPicture, ...]:
    """Every storey as the page shows it: the pixels of the same JPEG file."""
    found = []
    for view in top_views(scene):
        rgb = np.asarray(Image.open(io.BytesIO(view.jpeg())).convert("RGB"))
        found.append(StoreyPicture(rgb, view.grid.cell))
    return tuple(found)


def _views(scene: Scene, walk: Exploration, camera: Camera) -> Iterator[Observation]:
    """The observations of a robot that repeats the walk."""
    env = PanEnv(walk.start, scene.navigation, renderer=renderer_of(scene), camera=camera, max_steps=len(walk.steps) + 1)
    yield env.reset()
    for step in walk.steps:
        if step.action is Action.STOP:
            return
        yield env.step(step.action)

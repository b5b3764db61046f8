"""The explorations from which a home's map is made: one for each storey that counts, kept in files.

All maps of a home come from the same walks, with every encoder and noise.
"""

import hashlib
import json
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np

from sim.episodes.dataset import PersonalDataset
from sim.mesh import Scene
from sim.types import Camera
from sim.walk.storeys import nearest_storey

from .exploration import load_exploration, save_exploration
from .explore import EXPLORER_VERSION, Exploration, OnStep, explore, start_on_storey
from .progress_notes import Say


def storey_explorations(
    scene: Scene,
    storeys: Sequence[int],
    *,
    folder: Path,
    seed: int,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    say: Say | None = None,
) -> list[Exploration]:
    """Explorations of storeys of a home, in their order; made where there is no file.

    Args:
        storeys: Their indices among the `storey_heights` of the scene's navigation; lowest first.
        seed: Seed of starts and agents.
        say: Gets a line about the progress; it changes nothing.

    Raises:
        RunFileError: A file of an exploration is damaged or cannot be written.
        SceneError: A storey has no place to start from.
    """
    heights = scene.navigation.storey_heights
    found = []
    for number, index in enumerate(storeys, start=1):
        path = folder / exploration_name(scene, storey=index, seed=seed, camera=camera)
        if not path.exists():
            start = start_on_storey(scene, heights[index], seed)
            told = None if say is None else _counted(say, f"exploring storey {number} of {len(storeys)}")
            save_exploration(path, explore(scene, start, seed=seed, camera=camera, on_step=told))
        found.append(load_exploration(path))
    return found


def storeys_of_starts(dataset: PersonalDataset, scene: Scene) -> tuple[int, ...]:
    """The storeys on which the scene's episodes start, lowest first; their goals are not used.

    Raises:
        DatasetError: A file of the dataset is damaged.
    """
    starts = [episode.start.position[1] for episode in dataset.episodes(scenes=(scene.name,))]
    return tuple(np.unique(nearest_storey(starts, scene.navigation.storey_heights)).tolist())


def _counted(say: Say, what: str) -> OnStep:
    """A callback that reports the number of steps after each step."""
    steps = count()
    return lambda step, insight: say(f"{what}, {next(steps)} steps")


def exploration_name(scene: Scene, *, storey: int, seed: int, camera: Camera) -> str:
    """File name of an exploration; it differs for another version of home or explorer, and for another camera."""
    made_of = json.dumps(
        [scene.digest, EXPLORER_VERSION, camera.width, camera.height, camera.hfov_deg, camera.mount_height]
    )
    short = hashlib.sha256(made_of.encode()).hexdigest()[:8]
    return f"{scene.name}-storey{storey}-seed{seed}-{short}.json"

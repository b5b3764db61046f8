"""Explorations of a few steps, stored where `ground --map explore` reads them, so that homes are mapped in seconds."""

from pathlib import Path

import numpy as np

from grounding.agents.exploration import save_exploration
from grounding.agents.explore import explore, start_on_storey
from grounding.agents.explored_storeys import exploration_name
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.types import Camera


def write_short_walks(dataset: PersonalDataset, out: Path, *, scenes_dir: Path | None = None, steps: int = 5) -> None:
    """Writes one exploration for every storey on which an episode starts, in the folder of runs `out`."""
    for name in dataset.scenes:
        scene = open_scene(dataset, name, scenes_dir=scenes_dir)
        heights = np.array(scene.navigation.storey_heights)
        starts = [episode.start.position[1] for episode in dataset.episodes(scenes=(name,))]
        for storey in sorted({int(np.abs(heights - y).argmin()) for y in starts}):
            start = start_on_storey(scene, float(heights[storey]), 0)
            file = exploration_name(scene, storey=storey, seed=0, camera=Camera())
            save_exploration(out / "explorations" / file, explore(scene, start, seed=0, max_steps=steps))

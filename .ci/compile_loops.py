"""Compiles our loops once, at the end of an installation for tests: each pytest process would compile them all.

Invents a home, recovers it from its episodes, looks about in it, and cuts a storey for browsers. What is left out is
compiled where it is first used; numba keeps everything on disk. Run it in the venv.
"""

import os
import tempfile
import time
from pathlib import Path

from grounding.agents.explore import explore, start_on_storey
from sim.authoring.generation import invent_dataset
from sim.cache import VARIABLE
from sim.copies.browser_glb import browser_glb
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.recovered.plans import recover_plan
from sim.types import Camera

NAME = "Loops"


def main():
    """Leaves nothing but compiled code."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = str(Path(folder) / "cache")
        invent_dataset(Path(folder), name=NAME, seed=3)
        dataset = PersonalDataset(Path(folder))
        scene = open_scene(dataset, NAME, clutter=1)
        floor_y = scene.navigation.storey_heights[0]
        camera = Camera(width=64, height=48)
        explore(scene, start_on_storey(scene, floor_y, 0), seed=0, max_steps=20, camera=camera)
        browser_glb(scene, floor_y)
        scene_from_plan(recover_plan(dataset, NAME))
    print(f"  our loops: compiled in {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()

"""The benchmark's figures of recovered homes: recovering a plan once, and building a home whose plan is kept."""

import time

import numpy as np

from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import scene_from_plan
from sim.homes.recovered.plans import recover_plan

from ..harness import empty_cache, episodes_at_hand


def home_figures() -> dict[str, float]:
    """CPU seconds over all homes of the released episodes, or of an invented home's where these are missing.

    Returns:
        `num_homes`; `plan_s`, the mean time to recover a plan from episodes; `build_s`, the mean time from a kept plan
        to the home with its navigation map; `build_most_s`, the longest.
    """
    with empty_cache(), episodes_at_hand() as (_, folder):
        dataset = PersonalDataset(folder)
        scene_from_plan(recover_plan(dataset, dataset.scenes[0]))  # compiled code is ready after this
    plans, builds = [], []
    with empty_cache(), episodes_at_hand() as (_, folder):
        dataset = PersonalDataset(folder)
        for scene in dataset.scenes:
            began = time.process_time()
            recover_plan(dataset, scene)
            recovered = time.process_time()
            scene_from_plan(recover_plan(dataset, scene))
            plans.append(recovered - began)
            builds.append(time.process_time() - recovered)
    return {
        "num_homes": len(builds),
        "plan_s": float(np.mean(plans)),
        "build_s": float(np.mean(builds)),
        "build_most_s": max(builds),
    }

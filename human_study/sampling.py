"""Which episodes a study uses: drawn from the dataset by the study's seed, as evenly over the homes as asked for."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from sim.errors import StudyError
from sim.types import EpisodeKey, Split

from .max_flow import flow_of
from .study import StudyConfig


def sample_episodes(config: StudyConfig, pool: Sequence[EpisodeKey]) -> tuple[EpisodeKey, ...]:
    """The study's episodes, sorted.

    Args:
        config: Says how many of each split, and how many of one home at most.
        pool: All episodes of the dataset; their order does not matter.

    Raises:
        StudyError: The pool has too few, names one twice, or the limit per home leaves too few.
    """
    wanted_scenes = set(config.dataset.scenes) or {key.scene for key in pool}
    left = sorted(key for key in set(pool) if key.scene in wanted_scenes)
    missing = wanted_scenes - {key.scene for key in left}
    if missing or len(set(pool)) != len(pool):
        found = f"no episode of {sorted(missing)}" if missing else "episodes that are named twice"
        raise StudyError(f"study {config.study}: found {found}; expected each home and each episode once. See stats.")
    rng = np.random.default_rng(config.dataset.seed)
    groups: dict[tuple[Split, str], list[EpisodeKey]] = defaultdict(list)
    for key in left:
        groups[key.split, key.scene].append(key)
    counts = _counts(config, groups, rng)
    drawn = []
    for group, count in counts.items():
        drawn += [groups[group][place] for place in rng.permutation(len(groups[group]))[:count]]
    return tuple(sorted(drawn))


def _counts(
    config: StudyConfig, groups: dict[tuple[Split, str], list[EpisodeKey]], rng: np.random.Generator
) -> dict[tuple[Split, str], int]:
    """How many episodes of each (split, home): the most even choice that the limits allow.

    The smallest bound per (split, home) under which a maximum flow fills all splits; raises StudyError when none does.
    """
    wanted = {
        split: sum(len(keys) for (of, _), keys in groups.items() if of == split) if count == "all" else count
        for split, count in config.dataset.splits.items()
    }
    names = sorted(groups)
    order = [names[place] for place in rng.permutation(len(names))]
    scenes = sorted({scene for _, scene in order})
    cap = config.dataset.max_per_scene or sum(wanted.values())
    largest = max((len(keys) for keys in groups.values()), default=0)
    bounds = range(1, largest + 1) if config.dataset.stratify == "scene" else (largest,)
    flow: dict[tuple[str, str], int] = {}
    for bound in bounds:
        edges = [("from", f"split {split}", count) for split, count in wanted.items()]
        for split, scene in order:
            edges.append((f"split {split}", f"scene {scene}", min(bound, len(groups[split, scene]))))
        edges += [(f"scene {scene}", "to", cap) for scene in scenes]
        flow = flow_of([edge for edge in edges if edge[2] > 0], source="from", sink="to")
        if sum(amount for (tail, _), amount in flow.items() if tail == "from") == sum(wanted.values()):
            return {(split, scene): flow.get((f"split {split}", f"scene {scene}"), 0) for split, scene in order}
    reached = {split: flow.get(("from", f"split {split}"), 0) for split in wanted}
    raise StudyError(
        f"study {config.study}: dataset.splits asks for {wanted}, the dataset with at most {cap} of one home gives "
        f"{reached}; expected enough episodes. Ask for fewer or raise dataset.max_per_scene."
    )

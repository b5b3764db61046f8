"""Two agents of one run each on the same episodes: McNemar's exact test."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.types import EpisodeKey, TaskKind

from .statistics import mcnemar_p
from .trial_groups import TrialGroup


class AgentPairRow(BaseModel):
    """On how many episodes only one of two agents succeeded."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    task: TaskKind
    scene_kind: str
    first: str
    second: str
    n: int
    """Episodes that both did."""
    num_only_first: int
    num_only_second: int
    p: float | None
    """Exact, two-sided; None where an agent has several runs, which are no single yes or no."""


def agent_pairs(agents: Sequence[TrialGroup], keys: set[EpisodeKey]) -> list[AgentPairRow]:
    """A row per pair of agents of the same task.

    Args:
        agents: With all their runs.
        keys: Episodes that people did.
    """
    rows = []
    for first, second in combinations(agents, 2):
        if first.task == second.task:
            rows.append(_pair(first, second, keys))
    return [row for row in rows if row.n]


def _pair(first: TrialGroup, second: TrialGroup, keys: set[EpisodeKey]) -> AgentPairRow:
    one, other = _by_key(first, keys), _by_key(second, keys)
    both = sorted(one.keys() & other.keys())
    is_single = all(len(found[key]) == 1 for found in (one, other) for key in both)
    hits = np.array([[one[key][0], other[key][0]] for key in both], bool).reshape(-1, 2) if is_single else None
    return AgentPairRow(
        task=first.task,
        scene_kind=first.scene_kind,
        first=_name(first),
        second=_name(second),
        n=len(both),
        num_only_first=0 if hits is None else int((hits[:, 0] & ~hits[:, 1]).sum()),
        num_only_second=0 if hits is None else int((~hits[:, 0] & hits[:, 1]).sum()),
        p=None if hits is None else mcnemar_p(hits[:, 0], hits[:, 1]),
    )


def _by_key(group: TrialGroup, keys: set[EpisodeKey]) -> dict[EpisodeKey, list[bool]]:
    found: dict[EpisodeKey, list[bool]] = {}
    for trial in group.trials:
        if trial.key in keys:
            found.setdefault(trial.key, []).append(trial.figures["sr"] == 100)
    return found


def _name(group: TrialGroup) -> str:
    return group.who if group.condition == "none" else f"{group.who} ({group.condition})"

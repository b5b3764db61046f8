"""Counted trials by row name, with the figures that a report averages."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import EpisodeKey, SuccessRule, TaskKind, WhoKind

STEP_LIMITS = (25, 50, 100, 200, 300, 400, 500)
"""Of the anytime success rate: success within so many steps."""


class LeftOut(BaseModel):
    """Trials that are in no number, and why."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    who: str
    task: TaskKind
    reason: str
    n: int


@dataclass(frozen=True, slots=True)
class CountedTrial:
    """One counted trial."""

    key: EpisodeKey
    participant: str
    figures: dict[str, float | None]
    """By measure; None = this trial has none."""
    item: EpisodeRun | Answer


@dataclass(frozen=True, slots=True)
class TrialGroup:
    """All trials of one row name."""

    task: TaskKind
    scene_kind: str
    who: str
    kind: WhoKind
    condition: str
    trials: tuple[CountedTrial, ...]

    @property
    def keys(self) -> set[EpisodeKey]:
        return {trial.key for trial in self.trials}

    @property
    def measures(self) -> list[str]:
        return list(dict.fromkeys(name for trial in self.trials for name in trial.figures))


def trial_groups(runs: Sequence[Run], rule: SuccessRule) -> tuple[list[TrialGroup], list[LeftOut]]:
    """Trials by row name, people first, and counts of those that are left out."""
    trials: dict[tuple[TaskKind, str, str, WhoKind, str], list[CountedTrial]] = defaultdict(list)
    left_out: Counter[tuple[str, TaskKind, str]] = Counter()
    for run in runs:
        info = run.info
        for item in (*run.episodes, *run.answers):
            task: TaskKind = "pan" if isinstance(item, EpisodeRun) else "pog"
            figures = _pan_figures(item, rule) if isinstance(item, EpisodeRun) else _pog_figures(item)
            if isinstance(figures, str):
                left_out[info.who, task, figures] += 1
                continue
            code = item.start.participant if isinstance(item, EpisodeRun) else item.participant
            name = (task, info.scene_kind, info.who, info.who_kind, info.condition)
            trials[name].append(CountedTrial(item.key, f"{info.run_id}/{code or ''}", figures, item))
    groups = [
        TrialGroup(task, kind, who, which, condition, tuple(found))
        for (task, kind, who, which, condition), found in trials.items()
    ]
    groups.sort(key=lambda group: (group.task, group.scene_kind, group.kind != "human", group.who, group.condition))
    return groups, [LeftOut(who=who, task=task, reason=why, n=n) for (who, task, why), n in sorted(left_out.items())]


def _pan_figures(run: EpisodeRun, rule: SuccessRule) -> dict[str, float | None] | str:
    """Figures by measure, or why the trial does not count."""
    if run.end.reason == "technical":
        return "technical failure"
    if run.end.measures is None:
        return "never scored"
    measures = run.end.measures.rules[rule]
    if measures is None:
        return f"no usable point under rule {rule}"
    num_steps = run.end.measures.num_steps
    figures: dict[str, float | None] = {
        "sr": 100.0 * measures.success,
        "spl": 100.0 * measures.spl,
        "soft_spl": 100.0 * measures.soft_spl,
        "dtg": measures.dtg,
        "steps": float(num_steps),
    }
    if run.start.participant is not None:
        figures["t_s"] = run.steps[-1].t_s if run.steps else None
    within = {f"sr_within_{limit}": 100.0 * (measures.success and num_steps <= limit) for limit in STEP_LIMITS}
    return figures | within


def _pog_figures(answer: Answer) -> dict[str, float | None] | str:
    if answer.reason == "technical":
        return "technical failure"
    if answer.measures is None:
        return "never scored"
    figures = {"sr": 100.0 * answer.measures.success, "distance": answer.measures.planar_distance}
    return figures | ({"t_s": answer.t_s} if answer.participant is not None else {})


def averaged_agent(agent: TrialGroup, keys: set[EpisodeKey]) -> TrialGroup:
    """One trial per episode of an agent: the mean of its runs."""
    by_key: dict[EpisodeKey, list[CountedTrial]] = defaultdict(list)
    for trial in agent.trials:
        if trial.key in keys:
            by_key[trial.key].append(trial)
    trials = []
    for key, found in sorted(by_key.items()):
        figures: dict[str, float | None] = {}
        for name in agent.measures:
            known = [value for trial in found if (value := trial.figures.get(name)) is not None]
            figures[name] = float(np.mean(known)) if known else None
        trials.append(CountedTrial(key, agent.who, figures, found[0].item))
    return TrialGroup(agent.task, agent.scene_kind, agent.who, agent.kind, agent.condition, tuple(trials))


def difference(people: TrialGroup, agent: TrialGroup) -> TrialGroup:
    """People minus the agent, trial by trial on the same episodes; only figures that both have.

    Args:
        people: Any group of people.
        agent: With one trial per episode, as `averaged_agent` gives.
    """
    beside = {trial.key: trial.figures for trial in agent.trials}
    trials = []
    for trial in people.trials:
        if trial.key in beside:
            theirs = beside[trial.key]
            apart: dict[str, float | None] = {}
            for name in (name for name in trial.figures if name in theirs):
                one, other = trial.figures[name], theirs[name]
                apart[name] = None if one is None or other is None else one - other
            trials.append(CountedTrial(trial.key, trial.participant, apart, trial.item))
    name = f"{people.who} - {agent.who}" + ("" if agent.condition == "none" else f" ({agent.condition})")
    return TrialGroup(people.task, people.scene_kind, name, people.kind, people.condition, tuple(trials))

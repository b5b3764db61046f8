"""Counted trials by row name, with the figures that a report averages."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import EpisodeKey, SuccessRule, TaskKind, WhoKind

from ..export.runs import run_condition
from ..export.trial_table import NOT_A_RESULT, TrialRow
from .row_labels import is_first_condition

STEP_LIMITS = (25, 50, 100, 200, 300, 400, 500)
"""Of the anytime success rate: success within so many steps."""
STRICT, FAR = "sr_strict", "far_from_view"
"""Success by rule `paper-strict`; and whether a success by `paper` ends far from every view point."""
Figures = dict[str, float | None]
NEVER_ENDED = "begun, never ended (taken as abandoned)"
"""Of who left in mid-trial, where nobody else could take the episode; and of trials that still run."""


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
    """Who it is, the same in all conditions of one study."""
    figures: Figures
    """By measure; None = this trial has none."""
    item: EpisodeRun | Answer | None = None
    """None where only the trial's row is at hand: an excluded trial, which still counts for intention to treat."""
    row: TrialRow | None = None
    """What the study's records say of it; None for agents, and where the runs came without them."""
    place: int | None = None
    """In the person's order of counted trials, from 1."""


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


def trial_groups(
    runs: Sequence[Run], rule: SuccessRule, rows: Sequence[TrialRow] = (), *, row_rule: SuccessRule = "paper"
) -> tuple[list[TrialGroup], list[LeftOut]]:
    """Trials by row name, people first, and counts of those that are left out.

    Args:
        runs: Of people and agents.
        rule: Success rule of PAN.
        rows: Of the people's study. Trials that a rule excludes have no run; they count here from their rows, if the
            rows are under the same success rule.
        row_rule: Success rule of the rows.
    """
    trials: dict[tuple[TaskKind, str, str, WhoKind, str], list[CountedTrial]] = defaultdict(list)
    left_out: Counter[tuple[str, TaskKind, str]] = Counter()
    results = _results(rows)
    places = _places(results.values())
    used = set()
    for run in runs:
        info = run.info
        for item in (*run.episodes, *run.answers):
            task: TaskKind = "pan" if isinstance(item, EpisodeRun) else "pog"
            code = item.start.participant if isinstance(item, EpisodeRun) else item.participant
            name = (task, info.scene_kind, info.who, info.who_kind, info.condition)
            at = (code or "", task, info.condition, item.key)
            row = results.get(at) if info.who_kind == "human" else None
            if row is not None:
                used.add(at)
            figures = _pan_figures(item, rule) if isinstance(item, EpisodeRun) else _pog_figures(item)
            if isinstance(figures, str):
                left_out[info.who, task, figures] += 1
                continue
            if row is not None:
                figures |= _row_times(row)
            trials[name].append(CountedTrial(item.key, _person(run, code), figures, item, row, places.get(at)))
    for at, row in results.items():
        if at not in used:
            figures = _row_figures(row, same_rule=row.task == "pog" or rule == row_rule)
            if isinstance(figures, str):
                left_out["human", row.task, figures] += 1
                continue
            name = (row.task, row.scene_kind, "human", "human", at[2])
            trials[name].append(CountedTrial(at[3], _person_of(runs, row), figures, None, row, places[at]))
    for row in rows:
        if row.phase == "main" and row.end_reason in NOT_A_RESULT:
            left_out["human", row.task, "technical failure" if row.end_reason == "technical" else "abandoned"] += 1
        elif row.is_never_ended:
            left_out["human", row.task, NEVER_ENDED] += 1
    groups = [
        TrialGroup(task, kind, who, which, condition, tuple(sorted(found, key=lambda t: (t.key, t.participant))))
        for (task, kind, who, which, condition), found in trials.items()
    ]
    groups.sort(key=_order_of_rows)
    return groups, [LeftOut(who=who, task=task, reason=why, n=n) for (who, task, why), n in sorted(left_out.items())]


def _order_of_rows(group: TrialGroup) -> tuple:
    """People first, without memory before with it."""
    is_later = not is_first_condition(group.condition)
    return (group.task, group.scene_kind, group.kind != "human", group.who, is_later, group.condition)


_At = tuple[str, TaskKind, str, EpisodeKey]


def row_key(row: TrialRow) -> EpisodeKey:
    """The row's episode."""
    return EpisodeKey(row.split, row.scene, row.episode_id)


def _results(rows: Sequence[TrialRow]) -> dict[_At, TrialRow]:
    """Rows of counted phases that ended with a result, by what also names a run's trial."""
    return {
        (row.participant, row.task, run_condition(row.condition), row_key(row)): row
        for row in sorted(rows, key=lambda row: (row.participant, row.order_no, row.attempt))
        if row.phase == "main" and row.end_reason is not None and row.end_reason not in NOT_A_RESULT
    }


def _places(rows: Iterable[TrialRow]) -> dict[_At, int]:
    """Place of each in its person's order of counted trials."""
    places: dict[_At, int] = {}
    done: Counter[str] = Counter()
    for row in sorted(rows, key=lambda row: (row.participant, row.order_no, row.attempt)):
        done[row.participant] += 1
        places[row.participant, row.task, run_condition(row.condition), row_key(row)] = done[row.participant]
    return places


def _person(run: Run, code: str | None) -> str:
    """One person has several runs: of each condition."""
    return f"{run.info.config.get('study') or run.info.run_id}/{code or ''}"


def _person_of(runs: Sequence[Run], row: TrialRow) -> str:
    studies = [run.info.config.get("study") for run in runs if run.info.who_kind == "human"]
    return f"{next((study for study in studies if study), 'study')}/{row.participant}"


def _row_figures(row: TrialRow, *, same_rule: bool) -> Figures | str:
    """Figures of a trial that has a row only, or why it does not count."""
    if not same_rule:
        return "excluded; its row is under another success rule"
    if row.success is None:
        return "never scored"
    figures: Figures = {"sr": 100.0 * row.success, **_row_times(row)}
    if row.task == "pog":
        return figures | {"distance": row.planar_distance}
    shares = {"spl": row.spl, "soft_spl": row.softspl}
    figures |= {name: None if share is None else 100.0 * share for name, share in shares.items()}
    steps = row.n_steps or 0
    figures |= {"dtg": row.dtg, "steps": float(steps), "path_m": row.path_m}
    return figures | {f"sr_within_{limit}": 100.0 * (row.success and steps <= limit) for limit in STEP_LIMITS}


def _row_times(row: TrialRow) -> Figures:
    """Time to decision, from the start of the task to the trial's end however it ended; and the look before it."""
    total_s = row.t_total_s
    times: Figures = {"t_s": None if total_s is None else total_s - (row.t_look_s or 0.0)}
    return times if row.t_look_s is None else times | {"t_look_s": row.t_look_s}


def _pan_figures(run: EpisodeRun, rule: SuccessRule) -> Figures | str:
    """Figures by measure, or why the trial does not count."""
    if run.end.reason == "technical":
        return "technical failure"
    if run.end.measures is None:
        return "never scored"
    measures = run.end.measures.rules[rule]
    if measures is None:
        return f"no usable point under rule {rule}"
    num_steps = run.end.measures.num_steps
    figures: Figures = {
        "sr": 100.0 * measures.success,
        "spl": 100.0 * measures.spl,
        "soft_spl": 100.0 * measures.soft_spl,
        "dtg": measures.dtg,
        "steps": float(num_steps),
        "path_m": run.end.measures.path_m,
    }
    if run.start.participant is not None:
        # run files have no time of the end but that of the last step, which ends no trial that was given up
        is_told = run.end.reason in ("stop", "steps") and run.steps
        figures["t_s"] = run.steps[-1].t_s if is_told else None
    figures |= {f"sr_within_{limit}": 100.0 * (measures.success and num_steps <= limit) for limit in STEP_LIMITS}
    strict, is_far = run.end.measures.rules["paper-strict"], run.end.measures.ends_far_from_view
    figures[STRICT] = None if strict is None else 100.0 * strict.success
    figures[FAR] = None if is_far is None else 100.0 * is_far
    return figures


def _pog_figures(answer: Answer) -> Figures | str:
    if answer.reason == "technical":
        return "technical failure"
    if answer.measures is None:
        return "never scored"
    figures: Figures = {"sr": 100.0 * answer.measures.success, "distance": answer.measures.planar_distance}
    return figures | ({"t_s": answer.t_s} if answer.participant is not None else {})


def averaged_agent(agent: TrialGroup, keys: set[EpisodeKey]) -> TrialGroup:
    """One trial per episode of an agent: the mean of its runs."""
    by_key: dict[EpisodeKey, list[CountedTrial]] = defaultdict(list)
    for trial in agent.trials:
        if trial.key in keys:
            by_key[trial.key].append(trial)
    trials = []
    for key, found in sorted(by_key.items()):
        figures: Figures = {}
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
            apart: Figures = {}
            for name in (name for name in trial.figures if name in theirs and name != FAR):
                one, other = trial.figures[name], theirs[name]
                apart[name] = None if one is None or other is None else one - other
            trials.append(replace(trial, figures=apart))
    name = f"{people.who} - {agent.who}" + ("" if agent.condition == "none" else f" ({agent.condition})")
    return TrialGroup(people.task, people.scene_kind, name, people.kind, people.condition, tuple(trials))

"""Counted trials of people and agents as one long frame, with their names and every measure that a report averages.

Input: runs and, if there are any, the study's rows. The frame's groups are the rows of the report's tables.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from pandas import DataFrame
from pydantic import BaseModel, ConfigDict

from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import EpisodeKey, SuccessRule, TaskKind, WhoKind

from ..export.runs import NO_EXPOSURE, run_condition
from ..export.trial_table import NOT_A_RESULT, TrialRow
from .measures import FAR, MEASURES, measures_of, row_figures, row_times, run_figures

Frame = Any
"""A pandas DataFrame; pandas has no types that tell a part of a frame from a column."""
_ALL_MEASURES = list(MEASURES)
_NAMES = ["task", "scene_kind", "who", "kind", "condition", "beside"]
_ROW_NUMBERS = ("place", "prior_visits", "secs_before")
_COLUMNS = (*_NAMES, "key", "participant", "end", "item", *_ROW_NUMBERS, "excluded", "verification", *_ALL_MEASURES)
GroupKind = Literal[WhoKind, "difference"]
NEVER_ENDED = "begun, never ended (taken as abandoned)"
"""Trials that a person left and nobody else could take, and trials that still run."""
PEOPLE = {
    "none": "Human",
    "memory": "Human with memory",
    "memory_topdown": "Human with memory (top-down map)",
    "memory_glb": "Human with memory (3-D model)",
    "map_first": "Human (home first, then text)",
    "map_open": "Human (home and text together)",
    "map_2d": "Human (agents' top-down map)",
    "history_visible": "Human (history visible)",
    "history_hidden": "Human (history hidden)",
}


class ReportValue(BaseModel):
    """Base of the values in a report's document."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PeopleRow(ReportValue):
    """A line of a list about the people of one condition, with their names."""

    task: TaskKind
    scene_kind: str
    condition: str


class GroupRow(ReportValue):
    """A line of a list about the trials of one row name."""

    task: TaskKind
    scene_kind: str
    who: str
    """`human`, an agent, or `human - AGENT`."""
    condition: str


class LeftOut(ReportValue):
    """Trials that are in no figure, and the reason."""

    who: str
    task: TaskKind
    reason: str
    n: int


class LeftOutRun(ReportValue):
    """A run of an agent that cannot stand beside the people, and the reason."""

    run: str
    reason: str


@dataclass(frozen=True, slots=True)
class TrialGroup:
    """All trials of one row name."""

    task: TaskKind
    scene_kind: str
    who: str
    kind: GroupKind
    condition: str
    trials: Frame
    """The trials, as `trial_frame` makes them."""
    beside: str = ""
    """Conditions of the people beside whom an agent stands that ran on their study, joined by commas; empty = any."""

    @property
    def names(self) -> dict[str, Any]:
        """The fields of a `GroupRow`."""
        return {**self.people_names, "who": self.who}

    @property
    def people_names(self) -> dict[str, Any]:
        """The fields of a `PeopleRow`."""
        return {"task": self.task, "scene_kind": self.scene_kind, "condition": self.condition}

    @property
    def measures(self) -> list[str]:
        """Measures that at least one of its trials has."""
        return [name for name in measures_of(self.task) if self.trials[name].notna().any()]


def is_first_condition(condition: str) -> bool:
    """Whether other conditions are compared with it and listed below it: no memory, or the paper's order in POG."""
    return condition in ("none", "map_first")


def row_label(who: str, condition: str) -> str:
    """A row's name for readers; `who` is as in the report's rows: `human`, an agent, or `human - AGENT`."""
    people, minus, agent = who.partition(" - ")
    if people != "human":
        return who if condition == "none" else f"{who} ({condition})"
    return PEOPLE.get(condition, f"Human ({condition})") + minus + agent


def trial_frame(trials: Iterable[Mapping[str, Any]]) -> Frame:
    """A frame with one line per trial, by episode and person; a number that a trial lacks is NaN.

    Each trial needs `key` (an `EpisodeKey`) and `participant` (the same text in all conditions of one study). `item` is
    its run or answer; None where there is only the study's row, for an excluded trial, which still counts for intention
    to treat. `place` is the place in the person's order of counted trials, from 1. `place`, `prior_visits`,
    `secs_before`, `excluded` (rules, joined by `;`) and `verification` come from the study's rows.
    """
    ordered = sorted(trials, key=lambda trial: (trial["key"], trial["participant"]))
    frame = DataFrame(ordered, columns=list(_COLUMNS))
    frame = frame.astype(dict.fromkeys([*_ROW_NUMBERS, *_ALL_MEASURES], float))
    keys: list[EpisodeKey] = [trial["key"] for trial in ordered]
    return frame.assign(
        episode=[str(key) for key in keys], split=[key.split for key in keys], scene=[key.scene for key in keys]
    )


def trial_groups(
    runs: Sequence[Run], rule: SuccessRule, rows: Sequence[TrialRow] = (), *, row_rule: SuccessRule = "paper"
) -> tuple[list[TrialGroup], list[LeftOut]]:
    """Trials by row name, people first, and counts of trials that are left out.

    Args:
        rows: Trials of the people's study. Trials that a rule excludes have no run; their rows count here, if these are
            under the same success rule.
        row_rule: Success rule of the rows.
    """
    trials: list[dict[str, Any]] = []
    left_out: Counter[tuple[str, TaskKind, str]] = Counter()

    def count(names: Mapping[str, Any], figures: Mapping[str, float | None] | str, told: Mapping[str, Any]) -> None:
        if isinstance(figures, str):
            left_out[names["who"], names["task"], figures] += 1
        else:
            trials.append({**names, **figures, **told})

    results = _results(rows)
    alone, study = dict(results), "study"
    for run in runs:
        is_human = run.info.who_kind == "human"
        study = str(run.info.config.get("study") or study) if is_human else study
        for item in (*run.episodes, *run.answers):
            at, names = _names_of(run, item)
            row, told = results.get(at, (None, {})) if is_human else (None, {})
            if row is not None:
                alone.pop(at, None)
            count(names, run_figures(item, rule), told)
    for (_, task, condition, key), (row, told) in alone.items():
        names = {"task": task, "scene_kind": row.scene_kind, "who": "human", "kind": "human", "condition": condition}
        names |= {"beside": ""}
        names |= {"key": key, "participant": f"{study}/{row.participant}", "end": row.end_reason}
        count(names, row_figures(row, same_rule=task == "pog" or rule == row_rule), told)
    for row in rows:
        if row.phase == "main" and row.end_reason in NOT_A_RESULT:
            left_out["human", row.task, "technical failure" if row.end_reason == "technical" else "abandoned"] += 1
        elif row.is_never_ended:
            left_out["human", row.task, NEVER_ENDED] += 1
    frame = trial_frame(trials)
    groups = [TrialGroup(**dict(zip(_NAMES, names, strict=True)), trials=cut) for names, cut in frame.groupby(_NAMES)]
    groups.sort(key=_order_of_rows)
    return groups, [LeftOut(who=who, task=task, reason=why, n=n) for (who, task, why), n in sorted(left_out.items())]


def averaged_agent(agent: TrialGroup, episodes: Iterable[str]) -> TrialGroup:
    """The agent's group with one trial per episode, the mean of its runs."""
    found = agent.trials[agent.trials["episode"].isin(list(episodes))]
    means = found.groupby("episode")[_ALL_MEASURES].mean()
    once = found.drop_duplicates("episode").assign(participant=agent.who)
    once[_ALL_MEASURES] = means.loc[once["episode"]].to_numpy()
    return replace(agent, trials=once)


def difference(people: TrialGroup, agent: TrialGroup) -> TrialGroup:
    """People minus an agent from `averaged_agent`, trial by trial on the same episodes; only figures that both have."""
    theirs = agent.trials.set_index("episode")[_ALL_MEASURES]
    apart = people.trials[people.trials["episode"].isin(theirs.index)].copy()
    apart[_ALL_MEASURES] -= theirs.loc[apart["episode"]].to_numpy()
    apart[FAR] = float("nan")
    told = [] if agent.condition == "none" else [agent.condition]
    has_seen = not agent.beside or people.task == "pog" or people.condition == "none"
    if not has_seen and not agent.condition.startswith((people.condition, NO_EXPOSURE)):
        told.append(NO_EXPOSURE)
    name = f"{people.who} - {agent.who}" + (f" ({', '.join(told)})" if told else "")
    return replace(people, who=name, kind="difference", trials=apart)


def _order_of_rows(group: TrialGroup) -> tuple:
    """Sort key of a group: people first, then conditions without memory before those with it."""
    is_later = not is_first_condition(group.condition)
    return (group.task, group.scene_kind, group.kind != "human", group.who, is_later, group.condition)


_At = tuple[str, TaskKind, str, EpisodeKey]
"""(code of the person, task, condition, episode) of a trial."""


def _results(rows: Sequence[TrialRow]) -> dict[_At, tuple[TrialRow, dict[str, Any]]]:
    """Rows of counted phases that ended with a result, and what each tells beside the figures of its run.

    Only the last attempt counts. `place` is the place among the person's counted trials.
    """
    in_order = sorted(
        (row for row in rows if row.is_result), key=lambda row: (row.participant, row.order_no, row.attempt)
    )
    last = {(row.participant, row.task, run_condition(row.condition), row.key): row for row in in_order}
    done: Counter[str] = Counter()
    found = {}
    for at, row in sorted(last.items(), key=lambda item: (item[1].participant, item[1].order_no, item[1].attempt)):
        done[row.participant] += 1
        told = {
            "place": done[row.participant],
            "prior_visits": row.prior_visits_scene,
            "secs_before": row.secs_in_scene_before,
            "excluded": ";".join(row.excluded),
            "verification": row.verification,
        }
        found[at] = (row, told | row_times(row))
    return found


def _names_of(run: Run, item: EpisodeRun | Answer) -> tuple[_At, dict[str, Any]]:
    """The names of a run's trial; one person has several runs, one for each condition."""
    info, is_walk = run.info, isinstance(item, EpisodeRun)
    code = (item.start.participant if isinstance(item, EpisodeRun) else item.participant) or ""
    task: TaskKind = "pan" if is_walk else "pog"
    names = {
        "task": task,
        "scene_kind": info.scene_kind,
        "who": info.who,
        "kind": info.who_kind,
        "condition": info.condition,
        "beside": "" if info.who_kind == "human" else str(info.config.get("study_conditions") or ""),
        "key": item.key,
        "participant": f"{info.config.get('study') or info.run_id}/{code}",
        "end": item.end.reason if isinstance(item, EpisodeRun) else item.reason,
        "item": item,
    }
    return (code, task, info.condition, item.key), names

"""The figures of a study: people and agents on the same episodes, each number with its interval (`study report`)."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError
from sim.tasks.metrics import metric_rows, require_comparable
from sim.tasks.run_files import Answer, Run
from sim.types import SPLITS, EpisodeKey, SuccessRule, TaskKind

from .agreement import common_place, counts_of, gwet_ac1, krippendorff_alpha
from .statistics import Estimate, Trials, mean, rate, trials_of
from .trial_groups import CountedTrial, LeftOut, TrialGroup, averaged_agent, difference, trial_groups

SUSPECT_SHARE = 0.8
"""An episode is suspect when so many of its people pointed at the same wrong place."""
SUSPECT_RADIUS = 1.0
"""Metres; how near to each other, on the floor plan, answers count as the same place."""
SUSPECT_PEOPLE = 3
"""Fewer people say nothing."""
TOTAL = "total"
_MODEL = ConfigDict(frozen=True, extra="forbid")


class ReportRow(BaseModel):
    """One number of one row of a table, with its intervals."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    who: str
    """A row's name; `human - AGENT` for differences on the same episodes."""
    kind: Literal["human", "agent", "difference"]
    condition: str
    split: str
    """A split, or `total` = the plain mean of the splits present."""
    measure: str
    """`sr`, `spl`, `soft_spl` and `sr_within_K` in percent, `dtg` and `distance` in metres, `steps`, `t_s`."""
    value: float
    low: float | None
    high: float | None
    method: str
    """Of the interval, or why there is none."""
    bootstrap_low: float | None
    bootstrap_high: float | None
    k: int | None
    """Successes; None for other measures."""
    n: int
    """Trials."""
    num_participants: int
    """People; runs of an agent are averaged before, so it counts as one."""
    num_episodes: int


class AgreementRow(BaseModel):
    """How far people agree whether an episode succeeds."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    condition: str
    num_episodes: int
    """With at least two people."""
    krippendorff_alpha: float | None
    gwet_ac1: float | None


class SuspectEpisode(BaseModel):
    """An episode at which people agree on a wrong place: perhaps its label is wrong."""

    model_config = _MODEL
    episode: str
    scene_kind: str
    condition: str
    num_people: int
    num_agreeing: int
    xz: tuple[float, float]
    """Where they pointed, world metres."""


class PersonOutcome(BaseModel):
    """Whether one person succeeded at one episode, or an agent, whose runs are averaged."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    who: str
    condition: str
    participant: str
    episode: str
    success: float
    """0 or 1; between them for an agent with several runs."""


class StudyReport(BaseModel):
    """What `study report --json` prints."""

    model_config = _MODEL
    rule: SuccessRule
    """Of the PAN rows."""
    scene_kinds: tuple[str, ...]
    """A human baseline for PersonAL is claimed on scans only."""
    rows: tuple[ReportRow, ...]
    agreement: tuple[AgreementRow, ...]
    suspects: tuple[SuspectEpisode, ...]
    left_out: tuple[LeftOut, ...]
    outcomes: tuple[PersonOutcome, ...]
    """Of every counted trial, agents on the people's episodes."""
    dataset_digest: str
    runs: tuple[str, ...]
    """Ids of the runs, in order."""


def study_report(runs: Sequence[Run], *, rule: SuccessRule = "paper") -> StudyReport:
    """Rows for people, for agents on the episodes that people did, and for people minus agents.

    Args:
        runs: Exported runs of people and, if wanted, runs of agents.
        rule: Success rule of the PAN rows.

    Raises:
        StudyError: No run is of people, or an agent did none of their episodes.
        RunFileError: Runs are on different episode files, or scans and other homes are mixed.
    """
    runs = sorted(runs, key=lambda run: run.info.run_id)
    require_comparable(run.info for run in runs)
    if not any(run.info.who_kind == "human" for run in runs):
        raise StudyError(
            f"found {len(runs)} runs of agents and none of people; expected at least one of people. "
            "Write them with personal-viz study export."
        )
    metric_rows(runs, rule=rule)  # refuses runs that were never scored, and trials that would count twice
    groups, left_out = trial_groups(runs, rule)
    people = [group for group in groups if group.kind == "human"]
    rows = [row for group in people for row in _rows(group)]
    shown = list(people)
    for agent in [group for group in groups if group.kind != "human"]:
        beside = [group for group in people if _may_stand_beside(group, agent)]
        same = _on_the_same_episodes(agent, beside)
        shown.append(same)
        rows += _rows(same, behind=agent)
        rows += [row for group in beside for row in _rows(difference(group, same), kind="difference")]
    require_totals(rows)
    return StudyReport(
        rule=rule,
        scene_kinds=tuple(sorted({run.info.scene_kind for run in runs})),
        rows=tuple(rows),
        agreement=tuple(_agreement(group) for group in people),
        suspects=tuple(suspect for group in people if group.task == "pog" for suspect in _suspects(group)),
        left_out=tuple(left_out),
        outcomes=tuple(outcome for group in shown for outcome in _outcomes(group)),
        dataset_digest=runs[0].info.dataset_digest,
        runs=tuple(run.info.run_id for run in runs),
    )


def require_totals(rows: Iterable[ReportRow]) -> None:
    """Raises StudyError where a total is not the plain mean of the splits beside it."""
    cells: dict[tuple, dict[str, float]] = defaultdict(dict)
    for row in rows:
        name = (row.task, row.scene_kind, row.who, row.condition, row.measure)
        cells[name][row.split] = row.value
    for name, found in cells.items():
        total = found.pop(TOTAL, None)
        expected = float(np.mean(list(found.values()))) if found else None
        if total is None or expected is None or abs(total - expected) > 1e-9 * max(1.0, abs(expected)):
            raise StudyError(
                f"report: total of {' '.join(map(str, name))} is {total}; expected {expected}, the mean of "
                f"{', '.join(found)}. Make the report again from the runs."
            )


def _may_stand_beside(people: TrialGroup, agent: TrialGroup) -> bool:
    """Answers on oracle maps (no home at all) may stand beside any people."""
    return people.task == agent.task and agent.scene_kind in (people.scene_kind, "oracle-map")


def _on_the_same_episodes(agent: TrialGroup, people: Sequence[TrialGroup]) -> TrialGroup:
    """The agent where people were, its runs averaged."""
    done = {key for group in people for key in group.keys}
    same = averaged_agent(agent, done)
    if not same.trials:
        raise StudyError(
            f"{agent.who} ({agent.task}): did none of the {len(done)} episodes that people did; expected the same "
            "episodes. Run it on them, or leave it out."
        )
    return same


def _rows(
    group: TrialGroup, *, kind: Literal["difference"] | None = None, behind: TrialGroup | None = None
) -> list[ReportRow]:
    """A row per measure and split, then its total; `behind` has the trials that were averaged, for k and n."""
    rows = []
    for measure in group.measures:
        known = [trial for trial in group.trials if trial.figures.get(measure) is not None]
        splits = [split for split in SPLITS if any(trial.key.split == split for trial in known)]
        for split in [*splits, TOTAL] if splits else []:
            found = [trial for trial in known if split in (trial.key.split, TOTAL)]
            keys = {trial.key for trial in found}
            counted = found if behind is None else [trial for trial in behind.trials if trial.key in keys]
            rows.append(_row(group, kind, measure, split, found, counted))
    return rows


def _row(
    group: TrialGroup,
    kind: Literal["difference"] | None,
    measure: str,
    split: str,
    found: Sequence[CountedTrial],
    counted: Sequence[CountedTrial],
) -> ReportRow:
    trials = _trials(found, measure)
    is_rate = measure.startswith("sr") and kind is None
    estimate = _in_percent(rate(_shares(trials))) if is_rate else mean(trials)
    hits = [figure for trial in counted if (figure := trial.figures.get(measure)) is not None]
    interval, bootstrap = estimate.interval, estimate.bootstrap
    return ReportRow(
        task=group.task,
        scene_kind=group.scene_kind,
        who=group.who,
        kind=kind or ("human" if group.kind == "human" else "agent"),
        condition=group.condition,
        split=split,
        measure=measure,
        value=estimate.value,
        low=interval.low if interval else None,
        high=interval.high if interval else None,
        method=interval.method if interval else "none: a single trial says nothing of others",
        bootstrap_low=bootstrap.low if bootstrap else None,
        bootstrap_high=bootstrap.high if bootstrap else None,
        k=sum(figure == 100 for figure in hits) if is_rate else None,
        n=len(hits),
        num_participants=estimate.num_participants,
        num_episodes=estimate.num_episodes,
    )


def _trials(found: Sequence[CountedTrial], measure: str) -> Trials:
    figures = [trial.figures[measure] for trial in found]
    return trials_of(
        [figure for figure in figures if figure is not None],
        [trial.participant for trial in found],
        [str(trial.key) for trial in found],
        [trial.key.split for trial in found],
    )


def _shares(trials: Trials) -> Trials:
    return Trials(trials.values / 100, trials.participant_index, trials.episode_index, trials.stratum_index)


def _in_percent(estimate: Estimate) -> Estimate:
    scaled = {
        name: found.model_copy(update={"low": 100 * found.low, "high": 100 * found.high})
        for name in ("interval", "bootstrap")
        if (found := getattr(estimate, name)) is not None
    }
    return estimate.model_copy(update={"value": 100 * estimate.value, **scaled})


def _agreement(group: TrialGroup) -> AgreementRow:
    trials = _trials(group.trials, "sr")
    counts = counts_of((trials.values == 100).astype(int).tolist(), trials.episode_index, num_categories=2)
    return AgreementRow(
        task=group.task,
        scene_kind=group.scene_kind,
        condition=group.condition,
        num_episodes=int((counts.sum(axis=1) >= 2).sum()),
        krippendorff_alpha=krippendorff_alpha(counts),
        gwet_ac1=gwet_ac1(counts),
    )


def _suspects(group: TrialGroup) -> list[SuspectEpisode]:
    """Episodes whose people mostly pointed at one wrong place."""
    by_key: dict[EpisodeKey, list[CountedTrial]] = defaultdict(list)
    for trial in group.trials:
        by_key[trial.key].append(trial)
    found = []
    for key, trials in sorted(by_key.items()):
        if len(trials) < SUSPECT_PEOPLE:
            continue
        answers = [trial.item for trial in trials if isinstance(trial.item, Answer) and trial.figures["sr"] == 0]
        points = np.array([answer.candidates[0] for answer in answers if answer.candidates]).reshape(-1, 3)[:, [0, 2]]
        needed = SUSPECT_SHARE * len(trials)
        place = common_place(points, radius=SUSPECT_RADIUS, share=needed / len(points)) if len(points) else None
        if place is not None:
            agreeing = int((np.linalg.norm(points - place, axis=1) <= SUSPECT_RADIUS).sum())
            found.append(
                SuspectEpisode(
                    episode=str(key),
                    scene_kind=group.scene_kind,
                    condition=group.condition,
                    num_people=len(trials),
                    num_agreeing=agreeing,
                    xz=(float(place[0]), float(place[1])),
                )
            )
    return found


def _outcomes(group: TrialGroup) -> list[PersonOutcome]:
    return [
        PersonOutcome(
            task=group.task,
            scene_kind=group.scene_kind,
            who=group.who,
            condition=group.condition,
            participant=trial.participant,
            episode=str(trial.key),
            success=(trial.figures["sr"] or 0.0) / 100,
        )
        for trial in group.trials
    ]

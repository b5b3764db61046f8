"""Whether the main figures hold when trials are counted otherwise (HUMAN_STUDY.md, section 8)."""

from collections.abc import Sequence
from dataclasses import replace

from pydantic import BaseModel, ConfigDict

from sim.types import EpisodeKey, TaskKind

from ..export.runs import run_condition
from ..export.trial_table import TrialRow
from .rows import Aggregate, counted_trials, estimate_of
from .statistics import mean_interval, numbered, rate_interval
from .trial_groups import CountedTrial, TrialGroup, row_key

FIRST_TRIALS = 10
"""Left out in one of the rows: people get used to the keys."""
MAIN = "intention to treat (as in the tables)"


class SensitivityRow(BaseModel):
    """The total success rate, counted in one way."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    task: TaskKind
    scene_kind: str
    who: str
    condition: str
    way: str
    value: float | None
    """Percent, or percent points for differences; None = no trial is left, `method` says why."""
    low: float | None
    high: float | None
    k: int | None
    n: int
    method: str


def sensitivity_rows(group: TrialGroup, rows: Sequence[TrialRow], aggregate: Aggregate) -> list[SensitivityRow]:
    """The group's total success rate in each way of counting; of people, or of people minus an agent.

    Args:
        group: People, or differences of people's trials.
        rows: Of the study; () = not at hand, and the ways that need them say so.
        aggregate: As in the tables.
    """
    trials = list(group.trials)
    found = [_counted(group, MAIN, trials, aggregate)]
    if rows:
        per_protocol = [trial for trial in trials if trial.row is not None and not trial.row.excluded]
        verified = [trial for trial in trials if trial.row is not None and trial.row.verification == "verified"]
        late = [trial for trial in trials if trial.place is not None and trial.place > FIRST_TRIALS]
        found += [
            _counted(group, "per protocol: without excluded trials and people", per_protocol, aggregate),
            _counted(group, f"without each person's first {FIRST_TRIALS} trials", late, aggregate),
            _counted(group, "verified trials only", verified, aggregate),
        ]
        if " - " not in group.who:
            found += [
                _counted(group, "technical failures as failures", _with_failures(group, rows, "technical"), aggregate),
                _counted(
                    group,
                    "abandoned and never ended trials as failures",
                    _with_failures(group, rows, "abandoned"),
                    aggregate,
                ),
            ]
    return [*found, _by_house(group, aggregate)]


def _with_failures(group: TrialGroup, rows: Sequence[TrialRow], reason: str) -> list[CountedTrial]:
    """Trials, and a failure for whoever ended one this way, in place of the same person's later attempt."""
    prefix = group.trials[0].participant.rpartition("/")[0] if group.trials else ""
    failed: dict[tuple[str, EpisodeKey], CountedTrial] = {}
    for row in rows:
        is_theirs = row.task == group.task and run_condition(row.condition) == group.condition
        is_such = row.end_reason == reason or (reason == "abandoned" and row.is_never_ended)
        if row.phase == "main" and is_such and is_theirs and row.scene_kind == group.scene_kind:
            person = f"{prefix}/{row.participant}"
            failed[person, row_key(row)] = CountedTrial(row_key(row), person, {"sr": 0.0}, None, row)
    kept = [trial for trial in group.trials if (trial.participant, trial.key) not in failed]
    return [*kept, *failed.values()]


def _counted(group: TrialGroup, way: str, trials: Sequence[CountedTrial], aggregate: Aggregate) -> SensitivityRow:
    values = [value for trial in trials if (value := trial.figures.get("sr")) is not None]
    if not values:
        return _row(group, way, None, (None, None), 0, values, "no such trials")
    is_share = " - " not in group.who
    estimate = estimate_of(trials, "sr", aggregate, is_share=is_share)
    interval = estimate.interval
    limits = (interval.low, interval.high) if interval else (None, None)
    return _row(group, way, estimate.value, limits, estimate.n, values, interval.method if interval else "no interval")


def _by_house(group: TrialGroup, aggregate: Aggregate) -> SensitivityRow:
    """Homes as a third random factor: episodes lie in homes, so people by homes is the three-way sum."""
    way = "homes random too (three-way)"
    trials = [trial for trial in group.trials if trial.figures.get("sr") is not None]
    if not trials:
        return _row(group, way, None, (None, None), 0, [], "no such trials")
    values = [value for trial in trials if (value := trial.figures["sr"]) is not None]
    found = counted_trials(trials, "sr", aggregate)
    houses = numbered([trial.key.scene for trial in trials])
    if int(houses.max()) == 0:
        return _row(group, way, found.mean, (None, None), len(trials), values, "no interval: a single home")
    is_share = " - " not in group.who
    scale = 100.0 if is_share else 1.0
    by_house = replace(found, values=found.values / scale, episode_index=houses)
    interval = rate_interval(by_house) if is_share else mean_interval(by_house)
    limits = (interval.low * scale, interval.high * scale) if interval else (None, None)
    return _row(group, way, found.mean, limits, len(trials), values, interval.method if interval else "no interval")


def _row(
    group: TrialGroup,
    way: str,
    value: float | None,
    limits: tuple[float | None, float | None],
    n: int,
    values: Sequence[float],
    method: str,
) -> SensitivityRow:
    return SensitivityRow(
        task=group.task,
        scene_kind=group.scene_kind,
        who=group.who,
        condition=group.condition,
        way=way,
        value=value,
        low=limits[0],
        high=limits[1],
        k=None if " - " in group.who else sum(found == 100 for found in values),
        n=n,
        method=method,
    )

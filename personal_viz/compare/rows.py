"""Trials -> sections of comparable rows: per episode the mean of people, of agents, and people minus agents."""

import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from sim.homes.kind import scene_label
from sim.tasks.metrics import MetricRow, metric_rows, reading_notes, rule_warnings
from sim.tasks.run_files import Run
from sim.types import SPLITS, EpisodeKey, TaskKind, WhoKind

from .gathered import Setting, Trial, setting_of

FigureName = Literal["sr", "spl", "steps", "distance_m", "time_s"]


@dataclass(frozen=True, slots=True)
class Figure:
    """One column of figures."""

    name: FigureName
    head: str
    digits: int
    more_is_better: bool


_SR = Figure("sr", "SR", 0, True)
_TIME = Figure("time_s", "time", 1, False)
FIGURES: Mapping[TaskKind, tuple[Figure, ...]] = {
    "pan": (_SR, Figure("spl", "SPL", 0, True), Figure("steps", "steps", 0, False), _TIME),
    "pog": (_SR, Figure("distance_m", "off", 2, False), _TIME),
}
"""Compared per episode; `distance_m` is that of the answer from the target."""
UNITS: Mapping[TaskKind, str] = {
    "pan": "SR and SPL in percent, time in seconds.",
    "pog": "SR in percent, off = metres between answer and target, time in seconds.",
}
"""Of the figures."""

Means = Mapping[FigureName, float | None]
"""Mean of each figure over the trials that have it; None where none has."""


@dataclass(frozen=True, slots=True)
class Row:
    """One episode of one section."""

    key: EpisodeKey
    query: str
    folder: str
    """Of its recording and sheet, relative to the page."""
    trials: tuple[Trial, ...]
    people: Means
    agents: Means
    difference: Means
    """People minus agents."""


@dataclass(frozen=True, slots=True)
class Section:
    """Rows that may stand in one table."""

    setting: Setting | None
    """None = answers on oracle maps."""
    task: TaskKind
    rows: tuple[Row, ...]
    metrics: tuple[MetricRow, ...]
    """The paper's figures, people first."""

    @property
    def figures(self) -> tuple[Figure, ...]:
        """What is compared."""
        return FIGURES[self.task]

    @property
    def title(self) -> str:
        """Task and kind of homes."""
        task = "PAN (find the object by walking)" if self.task == "pan" else "POG (point at the object)"
        return f"{task}, {_KINDS[self.setting.kind] if self.setting else 'oracle maps'}{_clutter(self.setting)}"

    @property
    def remark(self) -> str:
        """What the reader must know of these homes; empty for scans."""
        if self.setting is None:
            return (
                "The grounders read maps made from the data set's own annotations, not from pictures: no row here "
                "stands beside results in homes."
            )
        label = scene_label(self.setting.kind)
        return f"{label}." if label else ""

    @property
    def notes(self) -> list[str]:
        """For below the paper's figures: what the rule is, what it is worth, and runs made for another rule."""
        return [*reading_notes(self.metrics), *rule_warnings(self.metrics)]


_KINDS = {"scan": "scans", "schematic": "schematic homes", "invented": "invented homes"}


def sections(
    trials: Sequence[Trial],
    runs: Sequence[Run],
    *,
    queries: Mapping[EpisodeKey, str],
    folders: Mapping[tuple[Setting | None, EpisodeKey], str],
) -> list[Section]:
    """The tables of a comparison: scans before other homes, PAN before POG, oracle maps last.

    Args:
        trials: All of them.
        runs: The runs that they came from, without steps.
        queries: What is looked for, of each episode.
        folders: Where each episode's recording lies.

    Raises:
        RunFileError: A run was never scored, or a trial would count twice.
    """
    groups: dict[tuple[Setting | None, TaskKind], list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[(trial.setting, trial.task)].append(trial)
    found = []
    for (setting, task), members in sorted(groups.items(), key=lambda group: _place(*group[0])):
        metrics = metric_rows(_runs_of(runs, setting, task))
        kinds = {(trial.who, trial.condition): trial.who_kind for trial in members}
        ordered = sorted(metrics, key=lambda row: kinds[(row.who, row.condition)] != "human")
        found.append(Section(setting, task, tuple(_rows(members, task, queries, folders)), tuple(ordered)))
    return found


def _place(setting: Setting | None, task: TaskKind) -> tuple[int, int, str]:
    kinds = ("scan", "schematic", "invented")
    if setting is None:
        return len(kinds), 0, task
    return kinds.index(setting.kind), setting.clutter, task


def _runs_of(runs: Sequence[Run], setting: Setting | None, task: TaskKind) -> list[Run]:
    chosen = [run for run in runs if setting_of(run.info) == setting]
    left_out = "answers" if task == "pan" else "episodes"
    return [run.model_copy(update={left_out: ()}) for run in chosen]


def _rows(
    trials: Sequence[Trial],
    task: TaskKind,
    queries: Mapping[EpisodeKey, str],
    folders: Mapping[tuple[Setting | None, EpisodeKey], str],
) -> list[Row]:
    """Rows by difference of success, then of SPL (largest first), then by episode."""
    by_key: dict[EpisodeKey, list[Trial]] = defaultdict(list)
    for trial in trials:
        by_key[trial.key].append(trial)
    rows = []
    for key, members in by_key.items():
        members.sort(key=lambda trial: trial.who_kind != "human")
        people, agents = means(members, "human", task), means(members, "agent", task)
        folder = folders[(members[0].setting, key)]
        rows.append(Row(key, queries[key], folder, tuple(members), people, agents, difference(people, agents)))
    return sorted(rows, key=lambda row: (*_largest_first(row.difference), *_key_order(row.key)))


def means(trials: Iterable[Trial], who_kind: WhoKind, task: TaskKind) -> Means:
    """Mean of each figure of a task over the scored trials of people or of agents."""
    chosen = [trial for trial in trials if trial.who_kind == who_kind and trial.success is not None]
    found: dict[FigureName, float | None] = {}
    for figure in FIGURES[task]:
        values = [value for trial in chosen if (value := figure_of(trial, figure.name)) is not None]
        found[figure.name] = statistics.fmean(values) if values else None
    return found


def difference(people: Means, agents: Means) -> Means:
    """People minus agents; None where either has no figure."""
    return {
        name: None if value is None or (other := agents[name]) is None else value - other
        for name, value in people.items()
    }


def figure_of(trial: Trial, name: FigureName) -> float | None:
    """One figure of a trial; success and SPL in percent."""
    if name == "sr":
        return None if trial.success is None else 100.0 * trial.success
    if name == "spl":
        return None if trial.spl is None else 100.0 * trial.spl
    return getattr(trial, name)


def _largest_first(figures: Means) -> tuple[float, ...]:
    """Sort key: rows without a difference last."""
    chosen = [figures.get(name) for name in ("sr", "spl")]
    return tuple(1e9 if value is None else -value for value in chosen)


def _key_order(key: EpisodeKey) -> tuple[int, str, int, str]:
    """Easy before hard, then by scene, then by number."""
    number = int(key.episode_id) if key.episode_id.isdecimal() else 0
    return SPLITS.index(key.split), key.scene, number, key.episode_id


def _clutter(setting: Setting | None) -> str:
    return f", clutter {setting.clutter}" if setting and setting.clutter else ""

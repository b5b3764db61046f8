"""Trials -> sections of comparable rows: per episode the mean of people, of agents, and people minus agents."""

import statistics
from collections import defaultdict
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from human_study.export.runs import NO_EXPOSURE
from human_study.report.trials import is_first_condition, row_label
from sim.homes.kind import scene_label
from sim.tasks.metrics import MetricRow, metric_rows, reading_notes, rule_warnings
from sim.tasks.run_files import Run
from sim.types import SPLITS, EpisodeKey, TaskKind

from .gathered import Setting, Trial, setting_of

FigureName = Literal["sr", "spl", "steps", "distance_m", "time_s"]
Group = Literal["people", "agents", "difference"]
GROUPS: Mapping[Group, str] = {"people": "people", "agents": "agents", "difference": "people \u2212 agents"}
"""Groups of columns, and their heads."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One column of figures."""

    name: FigureName
    head: str
    digits: int


_SR = Figure("sr", "SR", 0)
_TIME = Figure("time_s", "time", 1)
FIGURES: Mapping[TaskKind, tuple[Figure, ...]] = {
    "pan": (_SR, Figure("spl", "SPL", 0), Figure("steps", "steps", 0), _TIME),
    "pog": (_SR, Figure("distance_m", "off", 2), _TIME),
}
"""The figures that are compared per episode."""
UNITS: Mapping[TaskKind, str] = {
    "pan": "SR and SPL in percent, time in seconds.",
    "pog": "SR in percent, off = metres between answer and target, time in seconds.",
}
_KINDS = {"scan": "scans", "schematic": "schematic homes", "invented": "invented homes"}
"""Kinds of homes in the order of their sections, with the words for them."""

_UNSEEN = f"Agents without {{}} in their name had {NO_EXPOSURE}: they did not see the home before."

Means = Mapping[FigureName, float | None]
"""Mean of each figure over the trials that have it; None where none has."""


@dataclass(frozen=True, slots=True)
class Row:
    """One episode of one section."""

    key: EpisodeKey
    query: str
    folder: str
    """Folder of its recording and sheet, relative to the page."""
    trials: tuple[Trial, ...]
    """People first."""
    means: Mapping[Group, Means]

    @property
    def share(self) -> float:
        """Share of the scored trials that succeeded; -1 without any."""
        scored = [trial.success for trial in self.trials if trial.success is not None]
        return sum(scored) / len(scored) if scored else -1

    @property
    def success_counts(self) -> str:
        """How many people and agents succeeded, in words."""
        words = []
        for kind, noun in (("human", "people"), ("agent", "agents")):
            found = [trial.success for trial in self.trials if trial.who_kind == kind and trial.success is not None]
            words += [f"{noun} {sum(found)} of {len(found)}"] if found else []
        return ", ".join(words) or "none scored"


@dataclass(frozen=True, slots=True)
class Section:
    """Rows that may stand in one table."""

    setting: Setting | None
    """None = answers on oracle maps."""
    task: TaskKind
    rows: tuple[Row, ...]
    metrics: tuple[MetricRow, ...]
    """The paper's figures, people first."""
    condition: str | None = None
    """The people's condition, where agents ran on their study; None = there are no such agents, or no such people."""

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The figures of its columns."""
        return FIGURES[self.task]

    @property
    def title(self) -> str:
        """Task and kind of homes."""
        task = "PAN (find the object by walking)" if self.task == "pan" else "POG (point at the object)"
        if self.setting is None:
            return f"{task}, oracle maps"
        clutter = f", clutter {self.setting.clutter}" if self.setting.clutter else ""
        labels = ", categories written on objects" if self.setting.labels else ""
        people = "" if self.condition is None else f": {row_label('human', self.condition)}"
        return f"{task}, {_KINDS[self.setting.kind]}{clutter}{labels}{people}"

    @property
    def remark(self) -> str:
        """The note on these homes that a reader needs; empty for scans."""
        if self.setting is None:
            return (
                "The grounders read maps made from the data set's own annotations, not from pictures: no row here "
                "stands beside results in homes."
            )
        label = scene_label(self.setting.kind)
        return f"{label}." if label else ""

    @property
    def notes(self) -> list[str]:
        """Notes on the paper's figures: the rule and its effect, and runs made for another rule."""
        seen = [] if self.task == "pog" or self.condition in (None, "none") else [_UNSEEN.format(self.condition)]
        return [*seen, *reading_notes(self.metrics), *rule_warnings(self.metrics)]

    @property
    def kinds(self) -> dict[tuple[str, str], str]:
        """`people` or `agent`, by name and condition."""
        trials = (trial for row in self.rows for trial in row.trials)
        return {(trial.who, trial.condition): "people" if trial.who_kind == "human" else "agent" for trial in trials}

    @property
    def groups(self) -> dict[Group, str]:
        """The groups of columns that have figures, with their heads; a difference needs people and agents."""
        kinds = set(self.kinds.values())
        has = {"people": "people" in kinds, "agents": "agent" in kinds, "difference": len(kinds) == 2}
        return {name: head for name, head in GROUPS.items() if has[name]}


def sections(
    trials: Sequence[Trial],
    runs: Sequence[Run],
    *,
    queries: Mapping[EpisodeKey, str],
    folders: Mapping[tuple[Setting | None, EpisodeKey], str],
) -> list[Section]:
    """The tables of a comparison: scans before other homes, PAN before POG, oracle maps last.

    Where agents ran on the people's study, each condition of the people has a table of its own, with the agents that
    stand beside it, on the episodes that people did. What agents did besides has a table without people.

    Raises:
        RunFileError: A run was never scored, or a trial would count twice.
    """
    groups: dict[tuple[Setting | None, TaskKind], list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[trial.setting, trial.task].append(trial)
    found = []
    for (setting, task), members in sorted(groups.items(), key=lambda group: _place(*group[0])):
        of_task = _runs_of(runs, setting, task)
        for condition, chosen in _by_condition(members).items():
            known = {(trial.run_id, trial.key) for trial in chosen}
            metrics = metric_rows([_with_trials(run, known) for run in of_task])
            kinds = {(trial.who, trial.condition): trial.who_kind for trial in chosen}
            ordered = sorted(
                (row for row in metrics if (row.who, row.condition) in kinds),
                key=lambda row: kinds[row.who, row.condition] != "human",
            )
            rows = tuple(_rows(chosen, task, queries, folders))
            found.append(Section(setting, task, rows, tuple(ordered), condition))
    return found


def _by_condition(members: Sequence[Trial]) -> dict[str | None, list[Trial]]:
    """The trials of each table of one task and setting, by the people's condition; one table without studies."""
    if not any(trial.beside for trial in members):
        return {None: list(members)}
    people = [trial for trial in members if trial.who_kind == "human"]
    conditions = sorted({trial.condition for trial in people}, key=lambda each: (not is_first_condition(each), each))
    done = {name: {trial.key for trial in people if trial.condition == name} for name in conditions}
    found: dict[str | None, list[Trial]] = {
        name: [trial for trial in members if _stands_in(trial, name, keys)] for name, keys in done.items()
    }
    left = [trial for trial in members if not any(_stands_in(trial, name, keys) for name, keys in done.items())]
    return found | ({None: left} if left else {})


def _stands_in(trial: Trial, condition: str, done: Container[EpisodeKey]) -> bool:
    """Whether a trial stands in the table of one condition of people, who did these episodes."""
    if trial.who_kind == "human":
        return trial.condition == condition
    return trial.key in done and condition in (trial.beside or (condition,))


def _with_trials(run: Run, known: Container[tuple[str, EpisodeKey]]) -> Run:
    """The run with these trials only, named by run and episode."""
    episodes = tuple(item for item in run.episodes if (run.info.run_id, item.key) in known)
    answers = tuple(item for item in run.answers if (run.info.run_id, item.key) in known)
    return run.model_copy(update={"episodes": episodes, "answers": answers})


def means_of(trials: Iterable[Trial], task: TaskKind) -> dict[Group, Means]:
    """Means over the scored trials of people and of agents, and people minus agents where both have the figure."""
    scored = [trial for trial in trials if trial.success is not None]
    people, agents, difference = {}, {}, {}
    for figure in FIGURES[task]:
        for found, kind in ((people, "human"), (agents, "agent")):
            values = [figure_of(trial, figure.name) for trial in scored if trial.who_kind == kind]
            known = [value for value in values if value is not None]
            found[figure.name] = statistics.fmean(known) if known else None
        of_people, of_agents = people[figure.name], agents[figure.name]
        difference[figure.name] = None if of_people is None or of_agents is None else of_people - of_agents
    return {"people": people, "agents": agents, "difference": difference}


def figure_of(trial: Trial, name: FigureName) -> float | None:
    """One figure of a trial; success and SPL in percent."""
    if name == "sr":
        return None if trial.success is None else 100.0 * trial.success
    if name == "spl":
        return None if trial.spl is None else 100.0 * trial.spl
    return getattr(trial, name)


def _place(setting: Setting | None, task: TaskKind) -> tuple[int, int, bool, str]:
    if setting is None:
        return len(_KINDS), 0, False, task
    return list(_KINDS).index(setting.kind), setting.clutter, setting.labels, task


def _runs_of(runs: Sequence[Run], setting: Setting | None, task: TaskKind) -> list[Run]:
    left_out = "answers" if task == "pan" else "episodes"
    return [run.model_copy(update={left_out: ()}) for run in runs if setting_of(run.info) == setting]


def _rows(
    trials: Sequence[Trial],
    task: TaskKind,
    queries: Mapping[EpisodeKey, str],
    folders: Mapping[tuple[Setting | None, EpisodeKey], str],
) -> list[Row]:
    """Rows by difference of success, then of SPL (largest first, none last), then by episode."""
    by_key: dict[EpisodeKey, list[Trial]] = defaultdict(list)
    for trial in sorted(trials, key=lambda trial: trial.who_kind != "human"):
        by_key[trial.key].append(trial)
    rows = [
        Row(key, queries[key], folders[members[0].setting, key], tuple(members), means_of(members, task))
        for key, members in by_key.items()
    ]

    def order(row: Row) -> tuple[tuple[float, ...], int, str, int, str]:
        number = int(row.key.episode_id) if row.key.episode_id.isdecimal() else 0
        leads = [row.means["difference"].get(name) for name in ("sr", "spl")]
        largest_first = tuple(1e9 if lead is None else -lead for lead in leads)
        return largest_first, SPLITS.index(row.key.split), row.key.scene, number, row.key.episode_id

    return sorted(rows, key=order)

"""Turns stored runs into tables; it only aggregates, because distances were computed when the runs ended."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.errors import RunFileError
from sim.types import RULE_NOTES, SPLITS, EpisodeKey, SuccessRule, TaskKind

from .run_files import FAR_FROM_VIEW, REPORTED, Answer, EpisodeRun, Measures, Reported, Run, RunInfo
from .run_folders import read_runs, with_controls

_Z_95 = 1.959963984540054
"""Half the width of a 95 % interval, in standard errors."""


class RuleFigures(BaseModel):
    """A row's figures under a different rule."""

    model_config = ConfigDict(frozen=True)
    n: int
    k: int
    sr: float | None
    spl: float | None
    dtg: float | None
    unreachable: int
    undefined: int
    """Trials measured by a program that did not know the rule; no figure of the rule includes them."""


class FarFromView(BaseModel):
    """Successes by rule `paper` with a wall, a table or a storey between robot and object."""

    model_config = ConfigDict(frozen=True)
    n: int
    """Successes by `paper` in episodes with a view point that counts."""
    k: int
    """Those that end more than 1 m of walking from every view point of a valid target."""
    share: float | None
    """Percent; in total rows over all splits together; None without any success."""


class MetricRow(BaseModel):
    """One cell group of the paper's tables: one row name, one split."""

    model_config = ConfigDict(frozen=True)
    who: str
    task: TaskKind
    condition: str
    scene_kind: str
    edition: str
    """Edition of the episodes."""
    split: str
    """A split, or `total` = the plain mean of the splits present, as in the paper's Total column."""
    rule: SuccessRule | Literal["planar", "reported"]
    """`planar` for POG (DESIGN.md); `reported` = figures that another program reported, by a rule of its own."""
    n: int
    """Counted trials; technical failures and undefined episodes are left out."""
    k: int
    """Successes among the counted trials."""
    sr: float | None
    """Success rate, percent."""
    spl: float | None = None
    """SPL in percent; PAN only."""
    dtg: float | None = None
    """Metres, mean over the trials whose goal could be reached from the last position; PAN only."""
    top3: float | None = None
    """Percent; POG only, None for people, who give one answer."""
    unreachable: int = 0
    """Trials whose start or end has no path to the goal region: failures in SR and SPL, left out of DTG."""
    undefined: int = 0
    """Trials whose episode has no usable point under the rule, or that were measured by a program without the rule."""
    made_for: tuple[SuccessRule, ...] = ()
    """Rules that the agents of the runs were made for, or that people were told; () = none, or not known."""
    paper_strict: RuleFigures | None = None
    """The same trials under rule `paper-strict`; PAN only."""
    far_from_view: FarFromView | None = None
    """Successes by rule `paper` that end far from every place that sees the object; PAN only."""


def metrics(folders: Sequence[Path | str], *, rule: SuccessRule = "paper") -> list[MetricRow]:
    """Rows per who, task, condition and split of run folders, or of the folders one level below, then a total row for
    each; `rule` is the success rule of the PAN rows.

    Raises:
        RunFileError: A folder holds no run, or runs are damaged or cannot be pooled (`metric_rows`).
    """
    found = read_runs(with_controls([Path(folder) for folder in folders]), with_reported=True)
    return metric_rows(found, rule=rule)


def metric_rows(runs: Sequence[Run], *, rule: SuccessRule = "paper") -> list[MetricRow]:
    """Rows per who, task, condition and split, then a total row for each.

    Args:
        runs: Folders in memory; runs of the same who, condition and scene kind are pooled, also several of one episode
            (participants, seeds).
        rule: Success rule of the PAN rows.

    Raises:
        RunFileError: A run was never scored, an episode stands twice in one run, runs of one task are on different
            episode files, or PAN runs in one kind of homes were made with and without labels.
    """
    _require_same_dataset(run.info for run in runs if run.episodes or run.reported)
    _require_same_dataset(run.info for run in runs if run.answers)
    for kind in {run.info.scene_kind for run in runs}:
        _require_same_labels(run.info for run in runs if run.episodes and run.info.scene_kind == kind)
    groups: dict[tuple[str, str, str, TaskKind], list[Run]] = defaultdict(list)
    for run in runs:
        _require_scored(run)
        who, condition, kind = run.info.who, run.info.condition, run.info.scene_kind
        if run.episodes or run.reported:
            groups[(who, condition, kind, "pan")].append(run)
        if run.answers:
            groups[(who, condition, kind, "pog")].append(run)
    rows = []
    for (who, condition, kind, task), pooled in groups.items():
        _require_no_trial_twice(pooled, task)
        items = [item for run in pooled for item in _trials(run, task)]
        names: dict[str, Any] = {"who": who, "condition": condition, "scene_kind": kind, "task": task}
        names["edition"] = pooled[0].info.edition
        made_for = {run.info.made_for for run in pooled if run.info.made_for is not None and task == "pan"}
        names["made_for"] = tuple(sorted(made_for))
        cells = [
            _row(names, split, [item for item in items if item.key.split == split], rule=rule)
            for split in SPLITS
            if any(item.key.split == split for item in items)
        ]
        rows += [*cells, _total(cells)]
    return rows


class PaperTable(NamedTuple):
    """Rows in the paper's layout: a line per row name, and for each split the same columns."""

    splits: tuple[str, ...]
    """Splits with figures, `total` last."""
    heads: tuple[str, ...]
    """Heads of the columns of one split."""
    lines: tuple["PaperLine", ...]
    """In the order of the rows."""


class PaperLine(NamedTuple):
    """The figures of one row name."""

    who: str
    condition: str
    cells: tuple[tuple[str, ...], ...]
    """For each split one text per head; all are empty where the split has no figures."""

    @property
    def name(self) -> str:
        """The row name, with its condition where it has one."""
        return self.who if self.condition == "none" else f"{self.who} ({self.condition})"


def paper_table(rows: Sequence[MetricRow]) -> PaperTable:
    """The rows of one task as texts; `-` for a figure that a row does not have.

    Totals of different splits do not stand side by side: a row that lacks a split of the others has no total, and
    `reading_notes` says so.
    """
    splits = tuple(split for split in (*SPLITS, "total") if any(row.split == split for row in rows))
    is_pan = all(row.task == "pan" for row in rows)
    heads = ("SR", "k/n", "SPL", "DTG") if is_pan else ("SR", "k/n", "top-3")
    found = {(row.who, row.condition, row.split): _cells(row) for row in rows}
    found |= {(*name, "total"): ("-",) * len(heads) for name in _without_total(rows)}
    names = dict.fromkeys((row.who, row.condition) for row in rows)
    blank = ("",) * len(heads)
    lines = (PaperLine(*name, tuple(found.get((*name, split), blank) for split in splits)) for name in names)
    return PaperTable(splits, heads, tuple(lines))


def _without_total(rows: Iterable[MetricRow]) -> dict[tuple[str, str], list[str]]:
    """Names of the rows that lack a split of the other rows, with the splits that they have."""
    splits: dict[tuple[str, str], list[str]] = defaultdict(list)
    for row in rows:
        if row.split != "total":
            splits[row.who, row.condition].append(row.split)
    whole = {split for found in splits.values() for split in found}
    return {name: found for name, found in splits.items() if set(found) != whole}


def rule_warnings(rows: Iterable[MetricRow]) -> list[str]:
    """One line for each row name whose runs were made for a different rule than the rows use."""
    found = {}
    for row in rows:
        others = [rule for rule in row.made_for if rule != row.rule]
        if others:
            found[row.who, row.condition] = made_for_warning(row.who, others, rule=row.rule)
    return list(found.values())


def made_for_warning(who: str, made_for: Sequence[str], *, rule: str) -> str:
    """One line that warns: these runs were made for other rules than the one that counts here."""
    advice = f" personal-viz run --agent shortest-path --rule {rule} walks for it." if "shortest-path" in who else ""
    verb = "was told" if who == "human" else "was made for"
    return f"Warning: {who} {verb} rule {', '.join(made_for)}, and is counted here by {rule}.{advice}"


def reading_notes(rows: Sequence[MetricRow]) -> list[str]:
    """Notes below a table: its rule, rows without a total, and in PAN the effect of our reading of the paper by row."""
    rules = dict.fromkeys(row.rule for row in rows)
    notes = [f"Rule {RULE_NOTES[rule]}." for rule in RULE_NOTES if rule in rules]
    if "reported" in rules:
        notes.append(
            f"Rows {REPORTED!r} hold figures that another program wrote, by its own rule and on its own homes."
        )
    for task, kind in dict.fromkeys((row.task, row.scene_kind) for row in rows):
        lacking = _without_total(row for row in rows if (row.task, row.scene_kind) == (task, kind))
        notes += [
            f"{PaperLine(*name, ()).name}: no total, because others did more than {' and '.join(splits)}."
            for name, splits in lacking.items()
        ]
    for row in rows:
        strict, far = row.paper_strict, row.far_from_view
        if row.split != "total" or strict is None or far is None:
            continue
        who = row.who if row.condition == "none" else f"{row.who} ({row.condition})"
        figure = "not known" if strict.sr is None else f"SR {strict.sr:.1f} ({strict.k}/{strict.n})"
        older = f", {strict.undefined} trials measured before this rule" if strict.undefined else ""
        share = "" if far.share is None else f" ({far.share:.1f} %)"
        notes.append(
            f"{who}: by paper-strict {figure}{older}; {far.k} of {far.n} successes by paper{share} end more than "
            f"{FAR_FROM_VIEW:g} m of walking from every view point."
        )
    return notes


def require_comparable(infos: Iterable[RunInfo]) -> None:
    """Raises RunFileError when results must not be compared: scans with other homes, or different episode files.

    Answers on oracle maps (no home at all) may be compared with any; tables still keep the kinds apart.
    """
    infos = list(infos)
    kinds = {info.scene_kind: info.run_id for info in infos if info.scene_kind != "oracle-map"}
    if len(kinds) > 1:
        found = ", ".join(f"{kind} ({run_id})" for kind, run_id in sorted(kinds.items()))
        raise RunFileError(f"runs: found scene kinds {found}; expected one kind per table. Give the kinds separately.")
    _require_same_dataset(infos)


def _require_same_dataset(infos: Iterable[RunInfo]) -> None:
    """Raises RunFileError when runs are on different episode files, or their homes on different evidence."""
    digests = {info.dataset_digest: info for info in infos}
    if len(digests) > 1:
        found = ", ".join(
            f"{key[:12]} ({digests[key].run_id}, edition {digests[key].edition})" for key in sorted(digests)
        )
        raise RunFileError(
            f"runs: found dataset_digest {found}; expected runs on the same episode files, with the same evidence. "
            "Give the runs of each dataset separately."
        )


def _require_same_labels(infos: Iterable[RunInfo]) -> None:
    """Raises RunFileError when only some of the runs had pictures that named the objects."""
    found = {info.labels: info.run_id for info in infos}
    if len(found) > 1:
        raise RunFileError(
            f"runs: found pictures with the categories of objects written on them ({found[True]}) and without "
            f"({found[False]}); expected one of the two per table. Give them separately, or run one again with the "
            "other value of --labels."
        )


def _require_scored(run: Run) -> None:
    for episode in run.episodes:
        if episode.end.measures is None and episode.end.reason != "technical":
            raise RunFileError(
                f"{run.info.run_id}: steps.jsonl holds no measures for {episode.key}; expected distances computed on "
                'its scene. Read the file with "personal-viz import" first.'
            )
    for answer in run.answers:
        if answer.measures is None and answer.reason != "technical":
            raise RunFileError(
                f"{run.info.run_id}: answers.jsonl holds no measures for {answer.key}; expected a scored answer. "
                "Write the run again with personal-viz ground or study export."
            )


def _require_no_trial_twice(runs: Sequence[Run], task: TaskKind) -> None:
    """Raises RunFileError when one trial would count twice: one episode, participant and seed, or one folder again."""
    seen: dict[tuple[EpisodeKey, str | None, int | str], str] = {}
    for run in runs:
        source = run.info.run_id if run.info.seed is None else run.info.seed
        for item in _trials(run, task):
            participant = item.start.participant if isinstance(item, EpisodeRun) else None
            participant = item.participant if isinstance(item, Answer) else participant
            trial = (item.key, participant, source)
            if trial in seen:
                raise RunFileError(
                    f"{run.info.run_id}: found {item.key} a second time (first in {seen[trial]}); expected each trial "
                    "once. Give each run once; runs of one agent need different seeds."
                )
            seen[trial] = run.info.run_id


def _trials(run: Run, task: TaskKind) -> tuple[EpisodeRun | Answer | Reported, ...]:
    return (*run.episodes, *run.reported) if task == "pan" else run.answers


def _row(
    names: dict[str, Any], split: str, items: Sequence[EpisodeRun | Answer | Reported], *, rule: SuccessRule
) -> MetricRow:
    if names["task"] == "pog":
        return _pog_row(names, split, [item for item in items if isinstance(item, Answer)])
    if reported := [item for item in items if isinstance(item, Reported)]:
        return _reported_row(names, split, reported)
    return _pan_row(names, split, [item for item in items if isinstance(item, EpisodeRun)], rule=rule)


def _pan_row(names: dict[str, Any], split: str, runs: Sequence[EpisodeRun], *, rule: SuccessRule) -> MetricRow:
    counted = [run.end.measures for run in runs if run.end.measures is not None and run.end.reason != "technical"]
    is_far = [far for measures in counted if (far := measures.ends_far_from_view) is not None]
    return MetricRow(
        **names,
        **_rule_figures(counted, rule).model_dump(),
        split=split,
        rule=rule,
        paper_strict=_rule_figures(counted, "paper-strict"),
        far_from_view=FarFromView(n=len(is_far), k=sum(is_far), share=_percent(sum(is_far), len(is_far))),
    )


def _rule_figures(counted: Sequence[Measures], rule: SuccessRule) -> RuleFigures:
    scored = [measures.rules[rule] for measures in counted]
    found = [measures for measures in scored if measures is not None]
    reached = [measures.dtg for measures in found if measures.dtg is not None]
    successes = sum(measures.success for measures in found)
    return RuleFigures(
        n=len(found),
        k=successes,
        sr=_percent(successes, len(found)),
        spl=_percent(sum(measures.spl for measures in found), len(found)),
        dtg=float(np.mean(reached)) if reached else None,
        unreachable=sum(measures.dtg is None or measures.start_distance is None for measures in found),
        undefined=len(scored) - len(found),
    )


def _reported_row(names: dict[str, Any], split: str, figures: Sequence[Reported]) -> MetricRow:
    """SPL only where every episode has one; DTG over the episodes that have one, as for our own runs."""
    spl = [item.spl for item in figures if item.spl is not None]
    reached = [item.dtg for item in figures if item.dtg is not None]
    successes = sum(item.success for item in figures)
    return MetricRow(
        **names,
        split=split,
        rule="reported",
        n=len(figures),
        k=successes,
        sr=_percent(successes, len(figures)),
        spl=_percent(sum(spl), len(figures)) if len(spl) == len(figures) else None,
        dtg=float(np.mean(reached)) if reached else None,
    )


def _pog_row(names: dict[str, Any], split: str, answers: Sequence[Answer]) -> MetricRow:
    scored = [answer for answer in answers if answer.measures is not None and answer.reason != "technical"]
    successes = sum(answer.measures.success for answer in scored if answer.measures)
    top3 = sum(answer.measures.top3_success for answer in scored if answer.measures)
    ranked = any(answer.scores for answer in scored)
    return MetricRow(
        **names,
        split=split,
        rule="planar",
        n=len(scored),
        k=successes,
        sr=_percent(successes, len(scored)),
        top3=_percent(top3, len(scored)) if ranked else None,
    )


def _cells(row: MetricRow) -> tuple[str, ...]:
    """The columns of `PaperTable.heads`."""
    more = ((row.spl, 1), (row.dtg, 2)) if row.task == "pan" else ((row.top3, 1),)
    sr, *others = ("-" if value is None else f"{value:.{digits}f}" for value, digits in ((row.sr, 1), *more))
    return sr, f"{row.k}/{row.n}", *others


def wilson(k: float, n: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share of n > 0 independent trials; k may be a sum of means over several seeds.

    At k = 0 and k = n, rounding may put the share 1e-16 outside the interval.
    """
    assert n > 0
    share = min(max(k / n, 0.0), 1.0)
    centre, denominator = share + _Z_95**2 / (2 * n), 1 + _Z_95**2 / n
    half = _Z_95 * math.sqrt(share * (1 - share) / n + _Z_95**2 / (4 * n**2))
    return (centre - half) / denominator, (centre + half) / denominator


def _total(cells: Sequence[MetricRow]) -> MetricRow:
    """Plain mean of the splits' figures; counts are added, and the share far from view is that of all their runs."""
    strict = [cell.paper_strict for cell in cells if cell.paper_strict is not None]
    far = [cell.far_from_view for cell in cells if cell.far_from_view is not None]
    n, k = sum(cell.n for cell in far), sum(cell.k for cell in far)
    return cells[0].model_copy(
        update={
            "split": "total",
            **_summed(cells),
            "top3": _mean([cell.top3 for cell in cells]),
            "paper_strict": strict[0].model_copy(update=_summed(strict)) if strict else None,
            "far_from_view": FarFromView(n=n, k=k, share=_percent(k, n)) if far else None,
        }
    )


def _summed(cells: Sequence[MetricRow] | Sequence[RuleFigures]) -> dict[str, Any]:
    return {
        **{name: sum(getattr(cell, name) for cell in cells) for name in ("n", "k", "unreachable", "undefined")},
        **{name: _mean([getattr(cell, name) for cell in cells]) for name in ("sr", "spl", "dtg")},
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known and len(known) == len(values) else None


def _percent(part: float, whole: int) -> float | None:
    return 100.0 * part / whole if whole else None

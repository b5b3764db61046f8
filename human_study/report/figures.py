"""A study's report as pictures (SVG): people beside agents, each outcome, effort, order, and the flow of people."""

import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from pandas import concat

from sim.homes.kind import scene_labels
from sim.plan_view.svg import drawn_svg
from sim.types import SPLITS, TaskKind

from .counts import FlowCount
from .report import StudyReport
from .trials import Frame, TrialGroup, row_label

_PERSON, _AGENT = "#1f5fa8", "#b5472f"
_ROW_INCHES, _COLUMN_INCHES = 0.22, 0.16
_LINES, _MARKERS = ("#1f5fa8", "#2e7d4f", "#7a4fa3", "#b5472f"), ("o", "s", "^", "D")
_ROW = ["who", "condition"]
"""Columns that name a row of trials."""
_MOST_LABELS = 60
"""Most episodes that are named in a picture."""


def person_dots_svg(groups: Sequence[TrialGroup], task: TaskKind) -> str:
    """Success rate of each person as a dot, one row per condition; rates of agents as dashed lines with their names.

    Agents that lack a split of the people's are not drawn: their rates are of other episodes.
    """
    trials = _trials_of(groups, task)
    is_person = trials["kind"] == "human"
    conditions = trials[is_person].groupby(_ROW, sort=False)
    figure = Figure(figsize=(7, 1.6 + 0.7 * conditions.ngroups), layout="constrained")
    axes = figure.subplots()
    for place, (_, own) in enumerate(conditions):
        rates = own.groupby("participant")["sr"].mean()
        for rate, number in zip(*np.unique(rates, return_counts=True), strict=True):
            heights = place + 0.09 * (np.arange(number) - (number - 1) / 2)
            axes.plot(np.full(number, rate), heights, "o", color=_PERSON, markersize=6, alpha=0.8)
    by_rate: dict[float, list[str]] = {}
    splits = set(trials["split"][is_person])
    for name, own in trials[~is_person].groupby(_ROW, sort=False):
        if splits <= set(own["split"]):
            by_rate.setdefault(own["sr"].mean(), []).append(row_label(*name))
    for rate, names in by_rate.items():
        axes.axvline(rate, color=_AGENT, linestyle="--", linewidth=1)
        axes.annotate(", ".join(names), (rate, -0.5), color=_AGENT, fontsize=8, rotation=20)
    axes.set_yticks(range(conditions.ngroups), [row_label(*name) for name, _ in conditions])
    axes.set_ylim(conditions.ngroups - 0.4, -0.9 - 0.02 * max((len(", ".join(n)) for n in by_rate.values()), default=0))
    axes.set_xlim(-3, 103)
    axes.set_xlabel(
        "success rate of a person (dot) or an agent (dashed) over all their trials, whatever their split (%)"
    )
    return _svg(figure, trials["scene_kind"])


def outcome_matrix_svg(groups: Sequence[TrialGroup], task: TaskKind) -> str:
    """People and agents by episodes: filled square = success, open = failure, nothing = not done."""
    trials = _trials_of(groups, task)
    episodes = [name for split in SPLITS for name in sorted(set(trials["episode"][trials["split"] == split]))]
    names = trials.groupby(_ROW, sort=False)
    rows = [(who, condition, code) for (who, condition), own in names for code in sorted(set(own["participant"]))]
    width = max(5.0, 2.5 + _COLUMN_INCHES * len(episodes))
    figure = Figure(figsize=(width, 1.8 + _ROW_INCHES * len(rows)), layout="constrained")
    axes = figure.subplots()
    place = {name: at for at, name in enumerate(episodes)}
    at = {name: number for number, name in enumerate(rows)}
    axes.scatter(
        trials["episode"].map(place),
        [at[name] for name in zip(*(trials[column] for column in (*_ROW, "participant")), strict=True)],
        s=49,
        marker="s",
        edgecolors="black",
        facecolors=[str(1 - percent / 100) for percent in trials["sr"]],
    )
    axes.set_yticks(range(len(rows)), [_row_name(*row) for row in rows], fontsize=7)
    shown = episodes if len(episodes) <= _MOST_LABELS else []
    axes.set_xticks(range(len(shown)), shown, rotation=90, fontsize=6)
    axes.set_xlim(-0.7, len(episodes) - 0.3)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_title("filled: success", fontsize=8, loc="left")
    return _svg(figure, trials["scene_kind"])


def effort_svg(groups: Sequence[TrialGroup], task: TaskKind) -> str:
    """Steps and time to decision of every trial, a line of dots per row: filled = success, open = failure."""
    shown = [group for group in groups if group.task == task]
    measures = ("steps", "t_s") if task == "pan" else ("t_s",)
    figure = Figure(figsize=(4.6 * len(measures), 1.4 + 0.5 * len(shown)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(measures), sharey=True))
    for axes, measure in zip(panels, measures, strict=True):
        for place, group in enumerate(shown):
            color = _PERSON if group.kind == "human" else _AGENT
            for is_success in (True, False):
                known = group.trials[measure][(group.trials["sr"] == 100) == is_success].dropna().tolist()
                spread = 0.22 * np.sin(2.4 * np.arange(len(known)))  # dots beside each other, the same every time
                face = color if is_success else "none"
                axes.plot(known, place + spread, "o", markersize=4, color=color, markerfacecolor=face, alpha=0.6)
        axes.set_xlabel("steps to decision" if measure == "steps" else "time to decision (s)")
        axes.set_xlim(left=0)
        axes.set_ylim(len(shown) - 0.4, -0.6)
    panels[0].set_yticks(range(len(shown)), [row_label(group.who, group.condition) for group in shown], fontsize=8)
    panels[0].set_title("filled: success", fontsize=8, loc="left")
    return _svg(figure, [group.scene_kind for group in shown])


def order_svg(report: StudyReport, task: TaskKind) -> str:
    """Success rate by place in the order and by earlier visits, with intervals; a line per condition."""
    rows = [row for row in report.blocks if row.task == task and row.measure == "sr"]
    conditions = list(dict.fromkeys(row.condition for row in rows))
    figure = Figure(figsize=(8, 3), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True, width_ratios=(3, 1))
    for axes, by in zip(panels, ("order", "visits"), strict=True):
        blocks = list(dict.fromkeys(row.block for row in rows if row.by == by))
        for number, condition in enumerate(conditions):
            found = [row for row in rows if row.by == by and row.condition == condition]
            places = [blocks.index(row.block) + 0.12 * number for row in found]
            low = [row.value - (row.value if row.low is None else row.low) for row in found]
            high = [(row.value if row.high is None else row.high) - row.value for row in found]
            label = row_label("human", condition) if by == "order" else None
            style = {"color": _LINES[number % len(_LINES)], "marker": _MARKERS[number % len(_MARKERS)]}
            axes.errorbar(places, [row.value for row in found], (low, high), capsize=2, label=label, **style)
        axes.set_xticks(range(len(blocks)), blocks, fontsize=8)
        axes.set_ylim(-3, 103)
    panels[0].set_xlabel("place in the person's order")
    panels[1].set_xlabel("home")
    panels[0].set_ylabel("success (%)")
    panels[0].legend(fontsize=7)
    return _svg(figure, [row.scene_kind for row in report.rows if row.task == task])


def flow_svg(report: StudyReport) -> str:
    """The flow of people: boxes from top to bottom for those who go on, with ways out and detours beside them."""
    steps: list[tuple[FlowCount, list[FlowCount]]] = []
    for count in report.flow:
        if count.is_aside:
            steps[-1][1].append(count)
        else:
            steps.append((count, []))
    template = Path(__file__).parent / "templates" / "flow.svg.j2"
    return drawn_svg(template, steps=steps, labels=report.scene_labels, person=_PERSON, agent=_AGENT)


def _trials_of(groups: Sequence[TrialGroup], task: TaskKind) -> Frame:
    """The trials of one task as one frame, in the order of the groups."""
    return concat([group.trials for group in groups if group.task == task])


def _row_name(who: str, condition: str, participant: str) -> str:
    code = participant.rpartition("/")[2]
    if who != "human":
        return row_label(who, condition)
    return code if condition == "none" else f"{code}, {condition.replace('_', ' ')}"


def _svg(figure: Figure, kinds: Iterable[str]) -> str:
    """The figure as SVG text, with the labels of these kinds of homes above it; the same figure gives the same text."""
    labels = scene_labels(kinds)
    if labels:
        figure.set_figheight(figure.get_figheight() + 0.25 * len(labels))
        figure.suptitle("\n".join(labels), fontsize=8)
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "personal-viz", "svg.fonttype": "none"}):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()

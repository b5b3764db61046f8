"""A study's report as pictures (SVG): each person beside the agents, and who succeeded at which episode."""

import io
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from sim.types import TaskKind

from .report import PersonOutcome, StudyReport

_PERSON, _AGENT = "#1f5fa8", "#b5472f"
_ROW_INCHES, _COLUMN_INCHES = 0.22, 0.16
_MOST_LABELS = 60
"""More episodes than this are not named."""


def person_dots_svg(report: StudyReport, task: TaskKind) -> str:
    """Success rate of each person as a dot, conditions as rows; agents' as dashed lines with their names."""
    outcomes = [outcome for outcome in report.outcomes if outcome.task == task]
    people = {row.who for row in report.rows if row.kind == "human" and row.task == task}
    conditions = list(dict.fromkeys((o.who, o.condition) for o in outcomes if o.who in people))
    agents = list(dict.fromkeys((o.who, o.condition) for o in outcomes if o.who not in people))
    figure = Figure(figsize=(7, 1.6 + 0.7 * len(conditions)), layout="constrained")
    axes = figure.subplots()
    for place, name in enumerate(conditions):
        rates = _rates([o for o in outcomes if (o.who, o.condition) == name])
        for rate, number in zip(*np.unique(rates, return_counts=True), strict=True):
            heights = place + 0.09 * (np.arange(number) - (number - 1) / 2)
            axes.plot(np.full(number, rate), heights, "o", color=_PERSON, markersize=6, alpha=0.8)
    for who, condition in agents:
        rate = float(np.mean([o.success for o in outcomes if (o.who, o.condition) == (who, condition)])) * 100
        axes.axvline(rate, color=_AGENT, linestyle="--", linewidth=1)
        axes.annotate(who, (rate, len(conditions) - 0.45), color=_AGENT, fontsize=8, rotation=20)
    axes.set_yticks(range(len(conditions)), [who if c == "none" else f"{who} ({c})" for who, c in conditions])
    axes.set_ylim(-0.6, len(conditions) + 0.1)
    axes.set_xlim(-3, 103)
    axes.set_xlabel("success rate of a person over their trials (%)")
    return _svg(figure)


def outcome_matrix_svg(report: StudyReport, task: TaskKind) -> str:
    """People and agents by episodes: filled square = success, open = failure, nothing = not done."""
    outcomes = [outcome for outcome in report.outcomes if outcome.task == task]
    episodes = sorted({outcome.episode for outcome in outcomes})
    rows = list(dict.fromkeys((o.who, o.condition, o.participant) for o in outcomes))
    width = max(5.0, 2.5 + _COLUMN_INCHES * len(episodes))
    figure = Figure(figsize=(width, 1.2 + _ROW_INCHES * len(rows)), layout="constrained")
    axes = figure.subplots()
    place = {name: at for at, name in enumerate(episodes)}
    for at, name in enumerate(rows):
        for outcome in (o for o in outcomes if (o.who, o.condition, o.participant) == name):
            face = str(1 - outcome.success)
            axes.plot(place[outcome.episode], at, "s", markersize=7, markeredgecolor="black", markerfacecolor=face)
    labels = [participant.rpartition("/")[2] or who for who, _, participant in rows]
    axes.set_yticks(range(len(rows)), labels, fontsize=7)
    shown = episodes if len(episodes) <= _MOST_LABELS else []
    axes.set_xticks(range(len(shown)), shown, rotation=90, fontsize=6)
    axes.set_xlim(-0.7, len(episodes) - 0.3)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_title("filled: success", fontsize=8, loc="left")
    return _svg(figure)


def _rates(outcomes: Sequence[PersonOutcome]) -> list[float]:
    """Percent per person."""
    people = dict.fromkeys(outcome.participant for outcome in outcomes)
    return [100 * float(np.mean([o.success for o in outcomes if o.participant == name])) for name in people]


def _svg(figure: Figure) -> str:
    """The same figure gives the same text."""
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "personal-viz", "svg.fonttype": "none"}):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()

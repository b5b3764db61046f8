"""The page as one HTML file: sections of rows with style and script inside, nothing from outside the folder."""

import base64
import hashlib
import re
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files

from sim.types import SPLITS

from .gathered import Trial
from .made import RECORDING, SHEET, THUMBNAIL
from .rows import UNITS, Figure, FigureName, Means, Row, Section, figure_of
from .wording import (
    Page,
    agent_name,
    facts,
    groups_of,
    metric_cells,
    metric_heads,
    metric_table,
    success_counts,
    trial_name,
    written,
)

FIRST = 100
"""Rows that are laid out at once; a template holds the others for the script."""
MANY = 8
"""Runs of an episode from which they are folded up."""


def page_html(page: Page) -> str:
    """The whole page; every text of runs and episodes is escaped."""
    style, script = _file("page.css"), _file("page.js")
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src 'self' file: data:; "
        "base-uri 'none'; form-action 'none'"
    )
    parts = {
        "POLICY": policy,
        "STYLE": style,
        "SCRIPT": script,
        "COUNTS": escape(page.counts),
        "NOTES": "".join(f'<p class="note">{escape(note)}</p>' for note in page.notes),
        "SECTIONS": "\n".join(_section(section, number) for number, section in enumerate(page.sections)),
    }
    return re.sub("@@([A-Z]+)@@", lambda found: parts[found[1]], _file("page.html"))


def _section(section: Section, number: int) -> str:
    remark = f'<p class="remark">{escape(section.remark)}</p>' if section.remark else ""
    return (
        f'<section aria-labelledby="section-{number}" data-task="{section.task}">'
        f'<h2 id="section-{number}">{escape(section.title)}</h2>{remark}'
        f"{_summary(section)}<h3>Episodes</h3>{_tools(section)}{_episodes(section)}"
        '<button type="button" class="more" hidden>Show more</button></section>'
    )


def _summary(section: Section) -> str:
    splits, lines = metric_table(section)
    heads = metric_heads(section)
    top = "".join(f'<th scope="colgroup" colspan="{len(heads)}" class="num first">{escape(s)}</th>' for s in splits)
    below = "".join(
        f'<th scope="col" class="num{" first" if index == 0 else ""}">{escape(head)}</th>'
        for _ in splits
        for index, head in enumerate(heads)
    )
    body = ""
    for who, kind, rows in lines:
        cells = "".join(
            f'<td class="num{" first" if index == 0 else ""}">{escape(cell)}</td>'
            for row in rows
            for index, cell in enumerate(metric_cells(row, section))
        )
        body += f'<tr><th scope="row">{escape(who)}</th><td>{kind}</td>{cells}</tr>'
    rule = "Rule paper; SR and SPL in percent, DTG in metres" if section.task == "pan" else "Planar distance; percent"
    return (
        '<h3>Who, in total</h3><div class="wide"><table class="summary"><thead><tr>'
        '<th rowspan="2" scope="col">Who</th>'
        f'<th rowspan="2" scope="col">Kind</th>{top}</tr><tr>{below}</tr></thead><tbody>{body}</tbody></table></div>'
        f"<p>{rule}. Total = plain mean of the splits. Technical failures are left out.</p>"
        + "".join(f"<p>{escape(note)}</p>" for note in section.notes)
    )


def _tools(section: Section) -> str:
    splits = [split for split in SPLITS if any(row.key.split == split for row in section.rows)]
    scenes = sorted({row.key.scene for row in section.rows})
    fields = [
        _choice("Split", 'data-filter="split"', [("", "all"), *((split, split) for split in splits)]),
        _choice("Home", 'data-filter="scene"', [("", "all"), *((scene, scene) for scene in scenes)]),
    ]
    names = [name for name, _ in groups_of(section)]
    if "difference" in names:
        outcomes = (("", "all"), ("people", "people ahead"), ("agents", "agents ahead"), ("equal", "equal"))
        fields.append(_choice("Success", 'data-filter="outcome"', outcomes))
    agents = sorted({agent_name(t) for row in section.rows for t in row.trials if t.who_kind == "agent"})
    if len(agents) > 1:
        chosen = [("", "all agents"), *((name, name) for name in agents)]
        fields.append(_choice("Agents in the means", "data-agents", chosen))
    fields.append('<label>Text<input type="search" data-filter="text" placeholder="who, query, id"></label>')
    fields.append('<label class="sort-by">Sort by<select data-sort></select></label>')
    return f'<div class="tools" hidden>{"".join(fields)}<span class="count" role="status"></span></div>'


def _choice(label: str, attribute: str, values: Iterable[tuple[str, str]]) -> str:
    options = "".join(f'<option value="{escape(value)}">{escape(words)}</option>' for value, words in values)
    return f"<label>{label}<select {attribute}>{options}</select></label>"


def _episodes(section: Section) -> str:
    groups = groups_of(section)
    figures = section.figures
    is_sorted = any(name == "difference" for name, _ in groups)
    top = "".join(
        f'<th scope="colgroup" colspan="{len(figures)}" class="group first">{head}</th>' for _, head in groups
    )
    heads = "".join(_figure_head(group, figure, is_sorted=is_sorted) for group in groups for figure in figures)
    keys = " ".join(
        f'<button type="button" data-key="{key}" data-label="{key}">{key}</button>'
        for key in ("split", "scene", "episode")
    )
    rows = [_row(row, section, groups) for row in section.rows]
    rest = f'<template class="rest">{"".join(rows[FIRST:])}</template>' if len(rows) > FIRST else ""
    legend = f"<p>{UNITS[section.task]}"
    if is_sorted:
        legend += (
            ' People \u2212 agents: <span class="swatch better-people">people did better</span> '
            '<span class="swatch better-agents">agents did better</span>.'
        )
    return (
        f'{legend}</p><table class="episodes figures-{len(figures)}"><thead><tr><th rowspan="2" scope="col">'
        f'<span class="hidden">Contact sheet</span></th><th rowspan="2" scope="col">{keys}</th><th rowspan="2" '
        f'scope="col"><button type="button" data-key="who" data-label="share that succeeded">'
        f"who succeeded</button></th>"
        f"{top}</tr><tr>{heads}</tr></thead><tbody>{''.join(rows[:FIRST])}</tbody></table>{rest}"
    )


def _figure_head(group: tuple[str, str], figure: Figure, *, is_sorted: bool) -> str:
    name, head = group
    is_first = is_sorted and name == "difference" and figure.name == "sr"
    sort = ' aria-sort="descending"' if is_first else ""
    return (
        f'<th scope="col" class="num{_first(figure)}"{sort}><button type="button" data-key="{name}-{figure.name}" '
        f'data-digits="{figure.digits}" data-better="{"more" if figure.more_is_better else "less"}" '
        f'data-label="{head} {escape(figure.head)}"{" class=down" if is_first else ""}>'
        f"{escape(figure.head)}</button></th>"
    )


def _first(figure: Figure) -> str:
    """Class of the first column of a group."""
    return " first" if figure.name == "sr" else ""


def _row(row: Row, section: Section, groups: Sequence[tuple[str, str]]) -> str:
    key, folder = row.key, escape(row.folder)
    scored = [trial.success for trial in row.trials if trial.success is not None]
    share = sum(scored) / len(scored) if scored else -1
    values: dict[str, Means] = {"people": row.people, "agents": row.agents, "difference": row.difference}
    cells = "".join(
        _cell(name, head, figure, values[name][figure.name]) for name, head in groups for figure in section.figures
    )
    return (
        f'<tr data-split="{key.split}" data-order="{SPLITS.index(key.split)}" data-scene="{escape(key.scene)}" '
        f'data-episode="{escape(key.episode_id)}" data-share="{share:.4f}">'
        f'<td class="picture"><a href="{folder}/{SHEET}"><img loading="lazy" width="100" height="75" '
        f'src="{folder}/{THUMBNAIL}" alt="Map of {escape(str(key))} with all runs"></a></td>'
        f'<th scope="row" class="episode"><b>{escape(" / ".join(key))}</b>'
        f'<span class="query">{escape(row.query)}</span>'
        f'<span class="links"><a class="replay" href="{folder}/{RECORDING}">Replay</a>'
        f'<a href="{folder}/{SHEET}">Sheet</a></span></th>'
        f'<td class="who">{_trials(row)}</td>{cells}</tr>'
    )


def _cell(name: str, head: str, figure: Figure, value: float | None) -> str:
    is_signed = name == "difference"
    good = 0.0 if value is None or not is_signed else value if figure.more_is_better else -value
    tint = " better-people" if good > 0 else " better-agents" if good < 0 else ""
    exact = "" if value is None else f"{value:.6g}"
    return (
        f'<td class="num{_first(figure)}{tint}" data-key="{name}-{figure.name}" data-value="{exact}" '
        f'data-label="{head} {escape(figure.head)}">{written(value, figure.digits, is_signed=is_signed)}</td>'
    )


def _trials(row: Row) -> str:
    items = "".join(map(_trial, row.trials))
    if len(row.trials) <= MANY:
        return f"<ul>{items}</ul>"
    return f"<details><summary>{escape(success_counts(row))}</summary><ul>{items}</ul></details>"


def _trial(trial: Trial) -> str:
    mark, words, style = {
        True: ("\u2713", "success", "yes"),
        False: ("\u2717", "no success", "no"),
        None: ("?", "not scored", "unscored"),
    }[trial.success]
    data = ""
    if trial.success is not None:
        names: tuple[FigureName, ...] = ("sr", "spl", "steps", "distance_m", "time_s")
        exact = ((name, figure_of(trial, name)) for name in names)
        data = " data-scored" + "".join(f' data-{n}="{"" if v is None else format(v, ".6g")}"' for n, v in exact)
    return (
        f'<li data-kind="{trial.who_kind}" data-name="{escape(agent_name(trial))}"{data}><span class="mark {style}" '
        f'title="{words}"><span aria-hidden="true">{mark}</span><span class="hidden">{words}:</span></span>'
        f'<span class="name" title="{escape(trial.run_id)}">{escape(trial_name(trial))}</span>'
        f'<span class="facts">{escape(facts(trial))}</span></li>'
    )


def _file(name: str) -> str:
    return files("personal_viz.compare").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """How a content security policy names one inline script or style."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"

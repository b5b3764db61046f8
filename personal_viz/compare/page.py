"""The page as one HTML file: sections of rows with style and script inside, nothing from outside the folder."""

import base64
import hashlib
from pathlib import Path

import jinja2

from sim.tasks.metrics import paper_table
from sim.types import SPLITS

from .made import RECORDING, SHEET, THUMBNAIL
from .rows import UNITS, Row, Section, figure_of
from .wording import (
    Page,
    agent_name,
    facts,
    groups_of,
    success_counts,
    trial_name,
    who_kinds,
    written,
)

FIRST = 100
"""Rows that are laid out at once; a template holds the others for the script."""
MANY = 8
"""Runs of an episode from which they are folded up."""
_MARKS = {
    True: ("\u2713", "success", "yes"),
    False: ("\u2717", "no success", "no"),
    None: ("?", "not scored", "unscored"),
}
"""Sign, words and class of a run, by its success."""
_HERE = Path(__file__).parent


def page_html(page: Page) -> str:
    """The whole page; every text of runs and episodes is escaped."""
    style, script = ((_HERE / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src 'self' file: data:; "
        "base-uri 'none'; form-action 'none'"
    )
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    said = (agent_name, facts, figure_of, groups_of, paper_table, success_counts, who_kinds)
    environment.globals |= {tell.__name__: tell for tell in (*said, trial_name, written)}
    environment.globals |= {"SPLITS": SPLITS, "UNITS": UNITS, "FIRST": FIRST, "MANY": MANY, "MARKS": _MARKS}
    environment.globals |= {"RECORDING": RECORDING, "SHEET": SHEET, "THUMBNAIL": THUMBNAIL}
    environment.globals |= {"choices": _choices, "share": _share, "exact": _exact}
    return environment.get_template("page.html.j2").render(page=page, style=style, script=script, policy=policy)


def _choices(section: Section) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """(label, attribute, (value, words) of each option) of the fields above a section's episodes."""
    splits = [split for split in SPLITS if any(row.key.split == split for row in section.rows)]
    scenes = sorted({row.key.scene for row in section.rows})
    fields = [
        ("Split", 'data-filter="split"', [("", "all"), *((split, split) for split in splits)]),
        ("Home", 'data-filter="scene"', [("", "all"), *((scene, scene) for scene in scenes)]),
    ]
    if any(name == "difference" for name, _ in groups_of(section)):
        outcomes = [("", "all"), ("people", "people ahead"), ("agents", "agents ahead"), ("equal", "equal")]
        fields.append(("Success", 'data-filter="outcome"', outcomes))
    agents = sorted({agent_name(t) for row in section.rows for t in row.trials if t.who_kind == "agent"})
    if len(agents) > 1:
        fields.append(("Agents in the means", "data-agents", [("", "all agents"), *((name, name) for name in agents)]))
    return fields


def _share(row: Row) -> float:
    """Of the scored trials, how many succeeded; -1 without any."""
    scored = [trial.success for trial in row.trials if trial.success is not None]
    return sum(scored) / len(scored) if scored else -1


def _exact(value: float | None) -> str:
    """A number for the script."""
    return "" if value is None else f"{value:.6g}"


def _hash(text: str) -> str:
    """How a content security policy names one inline script or style."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"

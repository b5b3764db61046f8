"""The page in two forms: one HTML file that needs nothing from outside its folder, and the same rows as Markdown."""

import base64
import hashlib
from dataclasses import dataclass
from pathlib import Path

import jinja2

from recordings.texts import NOTICE
from sim.page_style import tokens_css
from sim.tasks.metrics import paper_table
from sim.types import SPLITS
from sim.words.english import how_many

from .episode_folder import RECORDING, SHEET, THUMBNAIL
from .rows import UNITS, Section, figure_of

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
_ESCAPED = frozenset("\\`*_{}[]<>#|~&$")
"""Punctuation that Markdown may read as more than itself; a backslash before it keeps it."""
_HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Page:
    """Everything that the page says."""

    sections: tuple[Section, ...]
    edition: str
    """Edition of the episodes."""
    has_scan_pixels: bool
    """Whether maps and pictures of scans are in the folder."""
    has_left_out_pixels: bool
    """Whether they were left out."""

    @property
    def notes(self) -> list[str]:
        """Notes on the whole folder."""
        left_out = "Maps, geometry and pictures of the scans are left out; --with-pixels writes them."
        notice = NOTICE.replace("This recording holds", "This folder holds")
        return [*([notice] if self.has_scan_pixels else []), *([left_out] if self.has_left_out_pixels else [])]

    @property
    def counts(self) -> str:
        """How many episodes, homes, runs, people and agents there are."""
        trials = {trial for section in self.sections for row in section.rows for trial in row.trials}
        num_people = len({(trial.who, trial.participant) for trial in trials if trial.who_kind == "human"})
        num_agents = len({(trial.who, trial.condition) for trial in trials if trial.who_kind == "agent"})
        keys = {row.key for section in self.sections for row in section.rows}
        return (
            f"{how_many(len(keys), 'episode')} (edition {self.edition}) in "
            f"{how_many(len({key.scene for key in keys}), 'home')}, "
            f"{how_many(len(trials), 'run')} of {how_many(num_people, 'person', 'people')} and "
            f"{how_many(num_agents, 'agent')}."
        )


def page_html(page: Page) -> str:
    """The page as HTML; every text of runs and episodes is escaped."""
    style, script = ((_HERE / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    style = tokens_css() + style
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src 'self' file: data:; "
        "base-uri 'none'; form-action 'none'"
    )
    return _template("page.html.j2", is_html=True).render(page=page, style=style, script=script, policy=policy)


def page_markdown(page: Page) -> str:
    """The page as Markdown, for repositories, chats and readers without a browser; links are relative."""
    return _template("page.md.j2", is_html=False).render(page=page)


def plain(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    return "".join("\\" + char if char in _ESCAPED else char for char in " ".join(text.split()))


def written(value: float | None, digits: int, *, is_signed: bool = False) -> str:
    """A figure as tables show it: `-` for none, a true minus sign, `+` before differences."""
    if value is None:
        return "-"
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0 else ("\u2212" if value < 0 else "+" if is_signed else "") + text


def _template(name: str, *, is_html: bool) -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE),
        autoescape=is_html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not is_html,
    )
    environment.filters |= {"plain": plain, "exact": _exact}
    environment.globals |= {
        "choices": _choices, "figure_of": figure_of, "paper_table": paper_table, "written": written,
        "SPLITS": SPLITS, "UNITS": UNITS, "FIRST": FIRST, "MANY": MANY, "MARKS": _MARKS,
        "RECORDING": RECORDING, "SHEET": SHEET, "THUMBNAIL": THUMBNAIL,
    }  # fmt: skip
    return environment.get_template(name)


def _choices(section: Section) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """(label, attribute, (value, words) of each option) of the fields above a section's episodes."""
    splits = [split for split in SPLITS if any(row.key.split == split for row in section.rows)]
    scenes = sorted({row.key.scene for row in section.rows})
    fields = [
        ("Split", 'data-filter="split"', [("", "all"), *((split, split) for split in splits)]),
        ("Home", 'data-filter="scene"', [("", "all"), *((scene, scene) for scene in scenes)]),
    ]
    if "difference" in section.groups:
        outcomes = [("", "all"), ("people", "people ahead"), ("agents", "agents ahead"), ("equal", "equal")]
        fields.append(("Success", 'data-filter="outcome"', outcomes))
    agents = sorted({trial.row_name for row in section.rows for trial in row.trials if trial.who_kind == "agent"})
    if len(agents) > 1:
        fields.append(("Agents in the means", "data-agents", [("", "all agents"), *((name, name) for name in agents)]))
    return fields


def _exact(value: float | None) -> str:
    """A number for the script."""
    return "" if value is None else f"{value:.6g}"


def _hash(text: str) -> str:
    """The name of one inline script or style in a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"

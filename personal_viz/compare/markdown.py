"""The same rows as the page, as Markdown: for repositories, chats and readers without a browser."""

from human_study.export.text_tables import markdown_table
from sim.tasks.metrics import paper_table

from .made import RECORDING, SHEET, THUMBNAIL
from .rows import UNITS, Means, Row, Section
from .wording import Page, facts, groups_of, trial_name, who_kinds, written

_ESCAPED = frozenset("\\`*_{}[]<>#|~&$")
"""Punctuation that Markdown may read as more than itself; a backslash before it keeps it."""


def page_markdown(page: Page) -> str:
    """The page as one Markdown document; links are relative."""
    parts = ["# People and agents, episode by episode", page.counts, *(f"> {note}" for note in page.notes)]
    for section in page.sections:
        parts += [f"## {section.title}"]
        parts += [f"> {section.remark}"] if section.remark else []
        parts += [_summary(section), *(plain(note) for note in section.notes), UNITS[section.task], _episodes(section)]
    parts.append(f"Open a recording with `rerun FILE/{RECORDING}`.")
    return "\n\n".join(parts) + "\n"


def plain(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    return "".join("\\" + char if char in _ESCAPED else char for char in " ".join(text.split()))


def _summary(section: Section) -> str:
    table, kinds = paper_table(section.metrics), who_kinds(section)
    heads = ["who", "kind", *(f"{split} {head}" for split in table.splits for head in table.heads)]
    rows = [
        [plain(line.name), kinds[line.who, line.condition], *(cell for cells in line.cells for cell in cells)]
        for line in table.lines
    ]
    return markdown_table(heads, rows, num_text=2)


def _episodes(section: Section) -> str:
    groups = groups_of(section)
    heads = ["map", "episode", "query", "succeeded", "not", "recording"]
    heads += [f"{head} {figure.head}" for _, head in groups for figure in section.figures]
    rows = []
    for row in section.rows:
        values: dict[str, Means] = {"people": row.people, "agents": row.agents, "difference": row.difference}
        figures = [
            written(values[name][figure.name], figure.digits, is_signed=name == "difference")
            for name, _ in groups
            for figure in section.figures
        ]
        links = f"[{RECORDING}]({row.folder}/{RECORDING}), [{SHEET}]({row.folder}/{SHEET})"
        picture = f"![map]({row.folder}/{THUMBNAIL})"
        rows.append(
            [picture, plain(str(row.key)), plain(row.query), _names(row, True), _names(row, False), links, *figures]
        )
    return markdown_table(heads, rows, num_text=6)


def _names(row: Row, success: bool) -> str:
    """Who did (not) succeed, with figures; trials that were not scored are among those that did not."""
    chosen = [trial for trial in row.trials if bool(trial.success) is success]
    return "; ".join(
        plain(f"{trial_name(trial)}"
              f"{'' if trial.success is not None else ' not scored'}: {facts(trial)}")
        for trial in chosen
    )  # fmt: skip

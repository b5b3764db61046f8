"""Verb `study status`: shows participants' progress, even while the study is served, but never outcomes."""

import dataclasses
import json as json_module
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from human_study.store.progress import PersonProgress, State, StudyProgress, study_progress
from human_study.store.records import read_study
from personal_viz.study_app.operator.progress_view import PersonWords, ShownStudy, shown_study

from ..output import print_json, table_console, table_of

EVERY_S = 2.0
"""Seconds between two snapshots of `--watch`."""
MIN_WIDTH = 128
"""Columns that the tables need; narrower terminals wrap them, but files and pipes do not."""
_ORDER: tuple[State, ...] = ("stuck", "active", "away", "refused", "finished", "out", "not_arrived")
_COLOURS = {"active": "green", "stuck": "bold yellow", "away": "yellow", "finished": "cyan"}


@dataclass
class StudyStatus:
    """Places of participants, and who is stuck or finished; never results. Works while the study is served."""

    study: Positional[Path]
    json: bool = False
    watch: Annotated[bool, arg(help="Stay, and show changes.")] = False

    def run(self) -> int:
        if not self.watch:
            found = progress_now(self.study)
            if self.json:
                print_json(dataclasses.asdict(found))
            else:
                table_console(MIN_WIDTH, folds=True).print(page(found))
            return 0
        try:
            _watch(self.study, json=self.json)
        except KeyboardInterrupt:
            return 0
        return 0


def progress_now(study: Path) -> StudyProgress:
    """One snapshot of the progress. Raises StudyError if there is no study."""
    with read_study(study) as reader:
        return study_progress(reader, now_ns=time.time_ns())


def page(found: StudyProgress) -> RenderableType:
    """Everything for one screen, in the words of the dashboard."""
    shown = shown_study(found)
    parts: list[RenderableType] = [_head(shown), _slots(shown), _people(shown)]
    if shown.is_nearly_full:
        parts.append(Text(f"The disk has {shown.free} free: free some space.", style="bold red"))
    return Group(*parts)


def _watch(study: Path, *, json: bool) -> None:
    pause = threading.Event()  # never set: it only provides a wait that Ctrl-C ends
    found = progress_now(study)
    if json:
        while True:
            print(json_module.dumps(dataclasses.asdict(found)), flush=True)
            pause.wait(EVERY_S)
            found = progress_now(study)
    with Live(
        page(found), console=table_console(MIN_WIDTH, folds=True), auto_refresh=False, screen=sys.stdout.isatty()
    ) as live:
        while not pause.wait(EVERY_S):
            live.update(page(progress_now(study)), refresh=True)


def _head(shown: ShownStudy) -> RenderableType:
    found = shown.progress
    title = Text(found.study, style="bold")
    if found.is_pilot:
        title.append("  PILOT", style="bold magenta")
    counts = ", ".join(f"{number} {words}" for state, words, number in shown.counts if number or state == "active")
    line = Table.grid(padding=(0, 2))
    line.add_row(
        ProgressBar(total=max(1, found.num_all), completed=found.num_done, width=40),
        f"{found.num_done} of {found.num_all} counted trials",
    )
    disk = f"{shown.free} free; backups: {shown.backups}"
    return Group(title, line, Text(counts), Text(disk, style="dim"), Text())


def _slots(shown: ShownStudy) -> Table:
    rows = []
    for slot in shown.progress.slots:
        numbers = (slot.num_done, slot.num_held, slot.num_free, slot.num_failed, slot.num_all)
        rows.append((slot.task.upper(), slot.condition, slot.split, *map(str, numbers)))
    names = ("Task", "Condition", "Split")
    return table_of((*names, "Done", "Held", "Free", "Failed", "All"), rows, texts=names)


def _people(shown: ShownStudy) -> RenderableType:
    """A table of the participants; people who may need help come first, because a short terminal cuts off the end."""
    people = sorted(zip(shown.progress.people, shown.people, strict=True), key=lambda row: _ORDER.index(row[0].state))
    rows = [_cells(person, words) for person, words in people if person.state != "not_arrived"]
    names = ("Person", "Task", "State", "Where", "Trial")
    table = table_of((*names, "Done", "Last heard", "Reconnects", "Technical", "Abandoned"), rows, texts=names)
    missing = [person.code for person, _ in people if person.state == "not_arrived"]
    return Group(table, Text(f"Not arrived: {', '.join(missing)}" if missing else "", style="dim"))


def _cells(person: PersonProgress, words: PersonWords) -> list[str | Text]:
    return [
        person.code,
        person.task.upper(),
        Text(words.state, style=_COLOURS.get(person.state, "dim")),
        words.where,
        words.trial,
        f"{person.num_done}/{person.num_planned}",
        words.heard,
        *(str(n) if n else "·" for n in (person.num_reconnects, person.num_technical, person.num_abandoned)),
    ]

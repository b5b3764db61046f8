"""Verb `study status`: who is where and how much is done, also while the study is served; never outcomes."""

from __future__ import annotations

import dataclasses
import json as json_module
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from human_study.store.progress import StudyProgress
    from human_study.store.progress_people import PersonProgress, State
    from personal_viz.printed import Console

EVERY_S = 2.0
"""Between two looks of `--watch`."""
MIN_WIDTH = 128
"""Columns that the tables need; narrower terminals wrap them, files and pipes do not."""
_ORDER: tuple[State, ...] = ("stuck", "active", "away", "finished", "out")
_COLOURS = {"active": "green", "stuck": "bold yellow", "away": "yellow", "finished": "cyan"}


@dataclass
class StudyStatus:
    """Who is where, stuck or finished; never how well somebody does. Works while the study is served."""

    study: Positional[Path]
    json: bool = False
    watch: Annotated[bool, arg(help="Stay, and show changes.")] = False

    def work(self) -> int:
        if not self.watch:
            found = progress_now(self.study)
            if self.json:
                print(json_module.dumps(dataclasses.asdict(found), indent=2))
            else:
                _console().print(page(found))
            return 0
        try:
            _watch(self.study, json=self.json)
        except KeyboardInterrupt:
            return 0
        return 0


def progress_now(study: Path) -> StudyProgress:
    """One snapshot. Raises StudyError where there is no study."""
    from human_study.store.progress import study_progress
    from human_study.store.records import read_study

    with read_study(study) as reader:
        return study_progress(reader, now_ns=time.time_ns())


def page(found: StudyProgress) -> RenderableType:
    """Everything for one screen."""
    from rich.console import Group
    from rich.text import Text

    from human_study.store.database import MIN_FREE_MB
    from personal_viz.study_app.progress_words import disk_words

    parts: list[RenderableType] = [_head(found), _slots(found), _people(found)]
    if found.disk.free_mb < MIN_FREE_MB:
        parts.append(Text(f"The disk has {disk_words(found.disk.free_mb)} free: free some space.", style="bold red"))
    return Group(*parts)


def _watch(study: Path, *, json: bool) -> None:
    from rich.live import Live

    pause = threading.Event()  # nobody sets it: a wait that Ctrl-C ends
    found = progress_now(study)
    if json:
        while True:
            print(json_module.dumps(dataclasses.asdict(found)), flush=True)
            pause.wait(EVERY_S)
            found = progress_now(study)
    with Live(page(found), console=_console(), auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while not pause.wait(EVERY_S):
            live.update(page(progress_now(study)), refresh=True)


def _console() -> Console:
    from personal_viz.printed import Console

    return Console() if sys.stdout.isatty() else Console(width=max(MIN_WIDTH, Console().width))


def _head(found: StudyProgress) -> RenderableType:
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    from personal_viz.study_app.progress_words import STATES, age_words, disk_words

    title = Text(found.study, style="bold")
    if found.is_pilot:
        title.append("  PILOT", style="bold magenta")
    copied = age_words(found.disk.last_backup_s)
    backups = (
        f"{found.disk.num_backups} backups, the newest {copied} ago" if found.disk.num_backups else "no backup yet"
    )
    counts = ", ".join(
        f"{count} {words}" for state, words in STATES.items() if (count := found.num_in(state)) or state == "active"
    )
    line = Table.grid(padding=(0, 2))
    line.add_row(
        ProgressBar(total=max(1, found.num_all), completed=found.num_done, width=40),
        f"{found.num_done} of {found.num_all} counted trials",
    )
    disk = f"{disk_words(found.disk.free_mb)} free; {backups}"
    return Group(title, line, Text(counts), Text(disk, style="dim"), Text())


def _slots(found: StudyProgress) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("Task", "Condition", "Split"):
        table.add_column(name)
    for name in ("Done", "Held", "Free", "Failed", "All"):
        table.add_column(name, justify="right")
    for slot in found.slots:
        numbers = (slot.num_done, slot.num_held, slot.num_free, slot.num_failed, slot.num_all)
        table.add_row(slot.task.upper(), slot.condition, slot.split, *map(str, numbers))
    return table


def _people(found: StudyProgress) -> RenderableType:
    """Whoever may need somebody comes first: a short terminal cuts off the end."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("Person", "Task", "State", "Where", "Trial"):
        table.add_column(name, no_wrap=True)
    for name in ("Done", "Last heard", "Reconnects", "Technical", "Abandoned"):
        table.add_column(name, justify="right")
    came = [person for person in found.people if person.state != "not_arrived"]
    for person in sorted(came, key=lambda person: _ORDER.index(person.state)):
        table.add_row(*_cells(person))
    missing = [person.code for person in found.people if person.state == "not_arrived"]
    return Group(table, Text(f"Not arrived: {', '.join(missing)}" if missing else "", style="dim"))


def _cells(person: PersonProgress) -> list[RenderableType]:
    from rich.text import Text

    from personal_viz.study_app.progress_words import STATES, age_words, place_words

    numbers = (person.num_reconnects, person.num_technical, person.num_abandoned)
    return [
        person.code,
        person.task.upper(),
        Text(STATES[person.state], style=_COLOURS.get(person.state, "dim")),
        place_words(person),
        f"{person.code}/{person.order_no}" if person.order_no is not None else "",
        f"{person.num_done}/{person.num_planned}",
        age_words(person.last_activity_s),
        *(str(number) if number else "·" for number in numbers),
    ]

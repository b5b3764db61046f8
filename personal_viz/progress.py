"""Progress of long commands: a bar on a terminal, elsewhere a line every 30 s, so that a log shows signs of life."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from grounding.agents.progress_notes import read_notes

from .printed import Console

EVERY_S = 30.0
"""Seconds between two lines if there is no terminal."""


class Counted(Progress):
    """One bar with its count, and the notes of worker processes in lines below."""

    def __init__(self, title: str, total: int | None, *, console: Console) -> None:
        """Starts at 0 of `total`; None = not known yet."""
        self.notes: Path | None = None
        """Folder of the worker processes' notes on their work (`scene_note`); None if there is no terminal."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        super().__init__(*columns, console=console, refresh_per_second=4, disable=not console.is_terminal)
        self._bar = self.add_task(title, total=total)

    def add(self, number: int = 1) -> None:
        """Counts `number` more as done."""
        self.update(self._bar, advance=number)

    def expect(self, total: int) -> None:
        """Sets the total."""
        self.update(self._bar, total=total)

    @property
    def line(self) -> str:
        """Title and count, for logs."""
        task = self.tasks[0]
        return f"{task.description}: {task.completed:.0f} of {'?' if task.total is None else f'{task.total:.0f}'}"

    def get_renderables(self) -> Iterator[RenderableType]:
        """The bar, and a line per note."""
        yield from super().get_renderables()
        for line in read_notes(self.notes) if self.notes else ():
            yield Text(f"  {line}", style="dim", no_wrap=True, overflow="ellipsis")


@contextmanager
def counted(
    title: str, total: int | None = None, *, console: Console | None = None, every_s: float = EVERY_S
) -> Iterator[Counted]:
    """Shows on stderr how many of `total` are done, until the block ends.

    Args:
        title: Name of the things that are counted.
        total: How many there are; None = `Counted.expect` sets it later.
        console: Console for the output; None = stderr.
        every_s: Seconds between two lines if the console is not a terminal.
    """
    console = console or Console(stderr=True)
    with Counted(title, total, console=console) as progress:
        if console.is_terminal:
            with TemporaryDirectory(prefix="personal-viz-notes-") as folder:
                progress.notes = Path(folder)
                yield progress
            return
        ended = threading.Event()
        teller = threading.Thread(target=_tell, args=(progress, console, ended, every_s), daemon=True, name="progress")
        teller.start()
        try:
            yield progress
        finally:
            ended.set()
            teller.join()


def _tell(progress: Counted, console: Console, ended: threading.Event, every_s: float) -> None:
    """Prints the count every `every_s` seconds until the work has ended."""
    began_s = time.monotonic()
    while not ended.wait(every_s):
        console.print(f"{progress.line}, {time.monotonic() - began_s:.0f} s", soft_wrap=True, highlight=False)

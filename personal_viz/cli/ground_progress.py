"""The progress of `ground`: a bar of answers, and below it what is being done in each scene that is not yet mapped."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import RenderableType
from rich.progress import Progress
from rich.text import Text

from grounding.agents.progress_notes import read_notes
from personal_viz.printed import Console


class _WithNotes(Progress):
    """Bars, and the notes of worker processes in lines below."""

    notes: Path | None = None
    """Folder of the notes."""

    def get_renderables(self) -> Iterator[RenderableType]:
        yield from super().get_renderables()
        for line in read_notes(self.notes) if self.notes else ():
            yield Text(f"  {line}", style="dim", no_wrap=True, overflow="ellipsis")


@contextmanager
def ground_progress(console: Console | None = None) -> Iterator[tuple[Progress, Path | None]]:
    """The bars, and the folder where scenes say what is being done (`scene_note`); None where nobody looks."""
    console = console or Console(stderr=True)
    if not console.is_terminal:
        yield Progress(console=console, disable=True), None
        return
    with (
        TemporaryDirectory(prefix="personal-viz-ground-") as folder,
        _WithNotes(console=console, refresh_per_second=4) as progress,
    ):
        progress.notes = Path(folder)
        yield progress, progress.notes

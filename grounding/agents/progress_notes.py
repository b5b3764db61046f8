"""The current work in each scene, for a progress bar: each worker process keeps a line in a small file."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

Say = Callable[[str], None]


@contextlib.contextmanager
def scene_note(folder: Path | None, scene: str) -> Iterator[Say]:
    """Yields a function that notes the current work in the scene in a few words; the note is removed at the end.

    Without a folder, or where it cannot be written, there are no notes.
    """
    if folder is None:
        yield lambda text: None
        return
    path = folder / scene

    def say(text: str) -> None:
        with contextlib.suppress(OSError):
            path.write_text(text)

    try:
        yield say
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def read_notes(folder: Path) -> list[str]:
    """Lines `scene: current work`, sorted by scene."""
    found = []
    with contextlib.suppress(OSError):
        for path in sorted(folder.iterdir()):
            with contextlib.suppress(OSError):  # the work on this scene has just ended
                if text := path.read_text():  # empty while it is written
                    found.append(f"{path.name}: {text}")
    return found

"""Progress of the work in each scene, for a progress bar: worker processes leave a line in a small file."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

Say = Callable[[str], None]


@contextlib.contextmanager
def scene_note(folder: Path | None, scene: str) -> Iterator[Say]:
    """Gives a function that notes the present work in the scene in a few words; at the end the note is removed.

    Args:
        folder: Folder of the notes; None = no notes. A note that cannot be written is left out.
        scene: Name of the scene.
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
    """Lines `scene: present work`, sorted by scene."""
    found = []
    with contextlib.suppress(OSError):
        for path in sorted(folder.iterdir()):
            with contextlib.suppress(OSError):  # its work has just ended
                if text := path.read_text():  # empty while it is written
                    found.append(f"{path.name}: {text}")
    return found

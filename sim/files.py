"""Files that are never half-written: whole new ones, and text added to the end of one."""

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file beside, then rename: readers see the old file or the whole new one. Makes the folder.

    Raises:
        OSError: The folder or the file cannot be written; the file is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def append_whole(path: Path, text: str) -> None:
    """Append to a text file; it is on disk when this returns, and where that fails the file is cut back.

    Raises:
        OSError: The file cannot be written, e.g. because the disk is full; it is as it was.
    """
    with path.open("ab", buffering=0) as file:  # a buffer would be written again when the file is closed
        size = file.tell()
        left = memoryview(text.encode())
        try:
            while left:
                left = left[file.write(left) :]
            os.fsync(file.fileno())
        except OSError:
            os.truncate(path, size)
            raise

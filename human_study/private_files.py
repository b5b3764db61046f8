"""Files of a study that only their owner can read."""

import errno
import os
from pathlib import Path

from sim.errors import StudyError

PRIVATE_FILE, PRIVATE_FOLDER = 0o600, 0o700


def make_private(path: Path) -> None:
    """Closes a file or folder to everybody but its owner; one that is missing or somebody else's is left alone.

    Raises:
        StudyError: Its mode cannot be changed for another reason.
    """
    try:
        path.chmod(PRIVATE_FOLDER if path.is_dir() else PRIVATE_FILE)
    except (FileNotFoundError, PermissionError):
        return
    except OSError as error:
        if error.errno != errno.EROFS:  # a copy on a read-only disk can be read as it is
            raise StudyError(
                f"{path}: its mode cannot be changed ({error.strerror}); expected a file of your own. "
                "Put the study on a disk that keeps modes."
            ) from None


def private_folder(folder: Path) -> None:
    """Makes a folder that only its owner can enter; an existing one is closed to others. Raises OSError."""
    folder.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    make_private(folder)


def write_private(path: Path, text: str) -> None:
    """Writes a small file that only its owner can read, whole or not at all; it is on disk when this returns.

    The file's folder, which is a study's, is made if necessary and closed to others.

    Raises:
        StudyError: It cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    try:
        private_folder(path.parent)
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE_FILE), "w") as file:
            os.fchmod(file.fileno(), PRIVATE_FILE)  # for any umask, and where a file of this name was left
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written ({error.strerror}); expected a folder that you can write. Free some space."
        ) from None

"""Files of a study that only their owner can read."""

import errno
import os
from pathlib import Path

from sim.errors import StudyError

PRIVATE_FILE, PRIVATE_FOLDER = 0o600, 0o700


def make_private(path: Path) -> None:
    """Give a file or folder to its owner alone, if it is there; what belongs to somebody else stays as it is.

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
    """Make a folder that only its owner can enter; one that is there is closed to others.

    Raises:
        OSError: It cannot be made.
    """
    folder.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    make_private(folder)


def write_private(path: Path, text: str) -> None:
    """Write a small file that only its owner can read, whole or not at all, on disk when this returns.

    Its folder, a study's, is made where there is none, and closed to others.

    Raises:
        StudyError: It cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    try:
        private_folder(path.parent)
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE_FILE), "w") as file:
            os.fchmod(file.fileno(), PRIVATE_FILE)  # whatever the umask is, and whoever left a file of this name
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

"""Reads HM3D's `.semantic.txt`: the colour, category and region of each object of a scan."""

import re
from pathlib import Path
from typing import NamedTuple

from sim.errors import SceneError, short

from .scene_files import mapped

MAX_ID = 0xFFFF
HEADER = "HM3D Semantic Annotations"
_MAX_BYTES = 1 << 24
_LINE = re.compile(r'([0-9]{1,9}),([0-9A-Fa-f]{6}),"(.*)",(-?[0-9]{1,9})')


class SemanticLabel(NamedTuple):
    """One line of the file: one object."""

    id: int
    """1 to 65535; 0 means no object."""
    rgb: int
    """Colour in the `.semantic.glb`, 0xRRGGBB."""
    category: str
    """Raw name, which may hold commas."""
    region: int
    """Number of the room; -1 where it is not known."""

    @property
    def name(self) -> str:
        """`<category>_<id>`, the object's key in PersONAL's episodes."""
        return f"{self.category}_{self.id}"


def read_semantic_txt(path: Path) -> tuple[SemanticLabel, ...]:
    """The objects in the order of the file.

    Raises:
        SceneError: The file is missing, too large, not UTF-8, or a line is not `id,RRGGBB,"category",region` with an id
            of its own; the line's number is in the message.
    """
    data = mapped(path, what="HM3D's semantic text")
    if len(data) > _MAX_BYTES:
        raise _refused(path, 1, f"the file has {len(data)} bytes", f"at most {_MAX_BYTES}")
    try:
        lines = bytes(data).decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        line = bytes(data[: error.start]).count(b"\n") + 1
        raise _refused(path, line, f"byte {error.start} is not UTF-8", "UTF-8 text") from None
    if HEADER not in lines[0]:
        raise _refused(path, 1, short(lines[0]), repr(HEADER))
    labels: list[SemanticLabel] = []
    line_of_id: dict[int, int] = {}
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise _refused(path, number, short(line), '`id,RRGGBB,"category",region`')
        label = SemanticLabel(int(match[1]), int(match[2], 16), match[3].strip(), int(match[4]))
        if not 0 < label.id <= MAX_ID:
            raise _refused(path, number, f"the id {label.id}", f"1 to {MAX_ID}")
        if line_of_id.setdefault(label.id, number) != number:
            raise _refused(path, number, f"the id of line {line_of_id[label.id]} again", "another id per object")
        labels.append(label)
    return tuple(labels)


def _refused(path: Path, line: int, found: str, expected: str) -> SceneError:
    return SceneError(f"{path}, line {line}: found {found}; expected {expected}. Copy the file again from its source.")

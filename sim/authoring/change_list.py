"""The list of an edition's changes: `changes.jsonl` for programs and `changes.md` for people."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from .annotations import AnnotatedObject, Change

JSONL, MARKDOWN = "changes.jsonl", "changes.md"


class ChangeLine(BaseModel):
    """A line of `changes.jsonl`: one object whose words, place or existence changed."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    scene: str
    id: int
    who: tuple[str, ...]
    """The annotators, each once."""
    before: AnnotatedObject | None
    """None = the object is new."""
    after: AnnotatedObject | None
    """None = the object was removed."""


def change_files(changes: Mapping[str, Iterable[Change]]) -> dict[str, bytes]:
    """Both files, by name; `changes` are those of each scene."""
    lines = [
        ChangeLine(scene=scene, id=change.id, who=change.who, before=change.before, after=change.after)
        for scene, found in changes.items()
        for change in found
    ]
    jsonl = "".join(f"{line.model_dump_json()}\n" for line in lines)
    return {JSONL: jsonl.encode(), MARKDOWN: _markdown(lines).encode()}


def read_changes(path: Path) -> tuple[ChangeLine, ...]:
    """The lines of a `changes.jsonl`."""
    return tuple(ChangeLine.model_validate_json(line) for line in path.read_bytes().splitlines())


def _markdown(lines: list[ChangeLine]) -> str:
    if not lines:
        return "# Changes\n\nNo object has changed.\n"
    rows = [
        f"| {line.scene} | {line.id} | {_cell(', '.join(line.who))} | {_said(line.before, 'new')} | "
        f"{_said(line.after, 'removed')} |"
        for line in lines
    ]
    head = ["| scene | object | who | before | after |", "|---|---|---|---|---|"]
    return "\n".join([f"# Changes\n\nObjects that changed: {len(lines)}.\n", *head, *rows]) + "\n"


def _said(item: AnnotatedObject | None, without: str) -> str:
    """An object in words."""
    if item is None:
        return without
    captions = "; ".join(f'"{caption}"' for caption in item.captions) or "no caption"
    facts = [item.category, captions, item.room or "no room", *(["flagged"] if item.flagged else [])]
    if item.box is not None:
        x, y, z = item.box.centre
        facts.append(f"at {x:g}, {y:g}, {z:g} m")
    return _cell(", ".join(facts))


def _cell(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|")

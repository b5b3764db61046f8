"""Makes a set of home sequences from annotated scans or from the captioned objects of an edition.

Homes -> their sequences (homes.py) -> files, checked before anything is written; `personal-viz generate
--sequences` is its verb, docs/home-sequences.md its description.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.errors import DatasetError

from ...episodes.dataset import PersonalDataset
from ...episodes.sequence_files import SequenceFile
from ..content import packed, write_files
from ..edition import opened_home
from ..searches import Starts
from .checks import validate_sequences
from .homes import HomeSequences, SetSoFar


@dataclass(frozen=True, slots=True)
class SequenceDraw:
    """A drawn set."""

    files: Mapping[str, SequenceFile]
    """By scene; only those with sequences."""
    total: SetSoFar
    """Its figures, and what was refused."""


def require_free_set(out: Path, scenes: Sequence[str], *, replace: bool) -> None:
    """Refuses to write a set of sequences among episodes, or where files of another set stand or would stay.

    Raises:
        DatasetError: It would.
    """
    if any((out / split / "content").is_dir() for split in ("easy", "medium", "hard")):
        raise DatasetError(f"{out}: found episodes; expected a folder of its own for sequences. Give another --out.")
    for path in sorted((out / "content").glob("*.json*")):
        if not replace or path.name.split(".")[0] not in scenes:
            raise DatasetError(
                f"{path}: found sequences; expected none, or --replace and the same scenes, because sets are never "
                "mixed. Give another --out, or remove the file."
            )


def draw_sequences(
    dataset: Path,
    scenes: Sequence[str],
    *,
    scenes_dir: Path | None,
    count: int,
    seed: int,
    starts: Starts,
    refined: Path | None = None,
    on_scene: Callable[[str], None] = lambda scene: None,
) -> SequenceDraw:
    """Draws a set, home by home; the sequences that a home cannot carry are left to the homes after it.

    Args:
        dataset: As in `draw_edition`.
        scenes: Names of the scenes.
        scenes_dir: As in `draw_edition`.
        count: Number of sequences.
        seed: The seed.
        starts: Rule of the starts.
        refined: As in `draw_edition`.
        on_scene: Called after each scene.

    Raises:
        DatasetError: A scene is unknown, or its annotations or episodes are damaged.
        SceneError: A scene cannot be opened.
    """
    total = SetSoFar()
    files: dict[str, SequenceFile] = {}
    for number, scene in enumerate(scenes):
        opened = opened_home(dataset, scene, scenes_dir, refined=refined)
        episodes = PersonalDataset(dataset) if opened.source.num_edits is None else None
        share = -(-(count - total.splits.total()) // (len(scenes) - number))
        content = HomeSequences(opened, episodes, total, starts=starts, seed=seed).draw(share)
        if content.sequences:
            files[scene] = content
        on_scene(scene)
    return SequenceDraw(files, total)


def write_sequences(out: Path, drawn: SequenceDraw) -> None:
    """Writes a set in which `validate` finds nothing wrong, in place of one before; otherwise writes nothing.

    Raises:
        DatasetError: The set is empty, `validate` finds something, or a file cannot be written.
    """
    if not drawn.files:
        why = drawn.total.lines[0] if drawn.total.lines else "Ask for some."
        raise DatasetError(f"{out}: 0 sequences were made, so nothing was written. {why}")
    files = {f"content/{scene}.json.gz": packed(content) for scene, content in drawn.files.items()}
    with tempfile.TemporaryDirectory() as beside:
        write_files(Path(beside), files)
        report = validate_sequences(Path(beside))
    for line in (*report.problems, *report.broken):
        raise DatasetError(f"{out}: validate finds {line}; nothing was written. Take another --seed, and report this.")
    write_files(out, files)
    for path in set((out / "content").glob("*.json*")) - {out / name for name in files}:
        path.unlink()

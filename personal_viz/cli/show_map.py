"""Verb `show-map`: a map file as a Rerun recording, in its home where the episodes are at hand."""

from pathlib import Path

from grounding.maps.files import load_memory, read_map_header
from recordings.memory_recording import record_memory
from recordings.viewer import open_file
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError

from .same_home import open_same_home


def show_map(
    *,
    file: Path,
    out: Path,
    dataset: Path | None = None,
    scenes_dir: Path | None = None,
    with_pixels: bool = False,
    open: bool = False,
) -> int:
    """Writes the map's layers into a recording, prints where.

    Args:
        file: A map, FILE.npz.
        out: The .rrd file.
        dataset: Folder of the episodes: the map is shown in its home; None = alone.
        scenes_dir: Folder of the scans.
        with_pixels: Write maps of scans too (their terms of use hold for the file).
        open: Show it until its window is closed or until Ctrl-C.

    Returns:
        0; problems are raised as one-line errors.
    """
    if out.suffix != ".rrd":
        raise RecordingError(f"--out: found {str(out)!r}; expected a file that ends in .rrd. Give another name.")
    source = read_map_header(file).source
    if source.kind == "scan" and not with_pixels:
        raise RecordingError(
            f"{file}: is a map of the licensed scan {source.scene}; expected leave to write it. Give --with-pixels if "
            "you may keep such a file."
        )
    if source.kind == "robot" and dataset is not None:
        raise RecordingError(f"{file}: is a robot's map; expected no --dataset, it has no home there. Leave it out.")
    scene = None
    if dataset is not None:
        digest, episodes = source.digest, PersonalDataset(dataset)
        scene = open_same_home(episodes, source.scene, digest=digest, scenes_dir=scenes_dir, where=str(file))
    name = source.scene
    record_memory(load_memory(file), name=name, out=out, scene=scene, with_pixels=with_pixels)
    home = "without its home (--dataset shows it)" if scene is None else f"in {scene.label}"
    print(f"{out}: map of {name} {home}, made by {source.builder or 'an unknown builder'}. See it with: rerun {out}")
    if open:
        open_file(out)
    return 0

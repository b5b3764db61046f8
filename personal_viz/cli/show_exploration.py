"""Verb `show-exploration`: a stored exploration done again in its home, as a Rerun recording."""

from pathlib import Path

from grounding.agents.exploration_files import load_exploration
from recordings.live import LiveSink
from recordings.observer_explore import ExplorationObserver
from recordings.replay_exploration import EXPLORER, explorer_of, replay_exploration
from recordings.viewer import open_file
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.homes.labels import renderer_of

from .same_home import open_same_home


def show_exploration(
    *,
    file: Path,
    out: Path,
    dataset: Path | None = None,
    scenes_dir: Path | None = None,
    with_pixels: bool = False,
    open: bool = False,
) -> int:
    """Walks the exploration again and writes what the robot saw, knew and meant, prints where.

    Args:
        file: An exploration, FILE.json.
        out: The .rrd file.
        dataset: Folder of the home's episodes; None for homes of `explore --homes`, which are made again.
        scenes_dir: Folder of the scans.
        with_pixels: Write geometry, maps and pictures of scans too (their terms of use hold for the file).
        open: Show it until its window is closed or until Ctrl-C.

    Returns:
        0; problems are raised as one-line errors.
    """
    if out.suffix != ".rrd":
        raise RecordingError(f"--out: found {str(out)!r}; expected a file that ends in .rrd. Give another name.")
    found = load_exploration(file)
    episodes = None if dataset is None else PersonalDataset(dataset)
    scene = open_same_home(episodes, found.scene, digest=found.scene_digest, scenes_dir=scenes_dir, where=str(file))
    has_pictures = scene.kind != "scan" or with_pixels
    observer = ExplorationObserver(
        scene,
        LiveSink("file", str(out)),
        who=EXPLORER,
        seed=found.seed,
        with_pixels=with_pixels,
        camera=found.camera,
    )
    renderer = renderer_of(scene) if has_pictures else None
    same = replay_exploration(found, observer, scene=scene, renderer=renderer, agent=explorer_of(found))
    print(f"{out}: {len(found.steps)} steps in {scene.label}. See it with: rerun {out}")
    if not has_pictures:
        print("Geometry, maps and pictures of the scan are left out; --with-pixels writes them.")
    elif same < len(found.steps):
        print(f"The explorer chooses another action now at step {same + 1}: what it knew is shown up to there.")
    if open:
        open_file(out)
    return 0

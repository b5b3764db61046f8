"""All that every browser of one `personal-viz browse` shares: episodes, runs, texts of scenes, open homes."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from personal_viz.study_app.home.scene_view import StoreyCopies
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError
from sim.homes.labels import renderer_of
from sim.homes.open_home import open_scene
from sim.tasks.run_files import read_run
from sim.types import ClutterLevel

from .catalogue import Catalogue
from .homes import Homes, OpenHome
from .object_links import SceneTexts
from .shown_runs import RunIndex


@dataclass(frozen=True)
class Library:
    """What is looked through; only read."""

    catalogue: Catalogue
    runs: RunIndex
    texts: dict[str, SceneTexts]
    """By scene."""
    homes: Homes


def open_library(
    dataset: Path,
    *,
    runs: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    scenes: tuple[str, ...] = (),
    clutter: ClutterLevel = 0,
) -> Library:
    """Reads all episodes and runs; homes are opened when somebody looks at them.

    Args:
        dataset: Folder of the episodes.
        runs: Run folders to show beside the episodes.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        scenes: Which scenes are listed; none named = all.
        clutter: Level for homes without a scan.

    Raises:
        DatasetError: An episode file is damaged, a scene is unknown, or there is no episode.
        RunFileError: A run folder is damaged.
    """
    found = PersonalDataset(dataset)
    index = RunIndex([read_run(folder) for folder in runs])
    episodes = tuple(found.episodes(scenes=scenes or None))
    if not episodes:
        raise DatasetError(f"{dataset}: found files without episodes; expected at least one. Give another --dataset.")
    by_scene: dict[str, list[Episode]] = defaultdict(list)
    for episode in episodes:
        by_scene[episode.key.scene].append(episode)
    texts = {scene: SceneTexts.from_episodes(found.goals(scene), there) for scene, there in by_scene.items()}

    def open_home(name: str) -> OpenHome:
        scene = open_scene(found, name, scenes_dir=scenes_dir, clutter=clutter)
        return OpenHome(scene, StoreyCopies(scene), renderer_of(scene))

    catalogue = Catalogue(episodes, num_runs=[index.count(episode.key) for episode in episodes])
    return Library(catalogue, index, texts, Homes(open_home))

"""Opens the home that a stored file was made in; another version of it is refused."""

from pathlib import Path

from grounding.agents.exploration_jobs import invented_home
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError, SceneError
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.types import ClutterLevel


def open_same_home(
    dataset: PersonalDataset | None, name: str, *, digest: str, scenes_dir: Path | None, where: str
) -> Scene:
    """The home with this digest; homes without a scan are tried with each level of clutter.

    Args:
        dataset: Dataset of the home's episodes; None for homes that `personal-viz explore --homes` invents.
        name: Name of the scene.
        digest: The `Scene.digest`; "" = any version will do.
        scenes_dir: Folder of scans; None = invented or schematic homes.
        where: The file that needs the home, for the error.

    Raises:
        SceneError: The home cannot be opened.
        RecordingError: The home found is another version.
    """
    if dataset is None:
        return _invented_again(name, digest=digest, where=where)
    levels: tuple[ClutterLevel, ...] = (0,) if scenes_dir is not None else (0, 1, 2)
    found = []
    for clutter in levels:
        scene = open_scene(dataset, name, scenes_dir=scenes_dir, clutter=clutter)
        if digest in ("", scene.digest):
            return scene
        found.append(scene.digest[:12])
    raise RecordingError(
        f"{where}: was made in {name} with scene_digest {digest[:12]!r}, the home opened now has {' or '.join(found)}; "
        "expected the same version of the home. Give its --dataset and --evidence, or --scenes-dir."
    )


def _invented_again(name: str, *, digest: str, where: str) -> Scene:
    """A home of `personal-viz explore --homes`, made from its name alone."""
    try:
        scene, _ = invented_home(name)
    except SceneError as error:
        raise RecordingError(f"{where}: {error}") from None
    if digest not in ("", scene.digest):
        raise RecordingError(
            f"{where}: was made in {name} with scene_digest {digest[:12]!r}, the home invented now has "
            f"{scene.digest[:12]}; expected the same version of the home. Give its --dataset, or explore it again."
        )
    return scene

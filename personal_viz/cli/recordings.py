"""Worker of `personal-viz replay`: run folders become one Rerun recording of one episode."""

from collections.abc import Sequence
from pathlib import Path

from recordings.replay import common_episode, log_comparison
from recordings.viewer import open_file
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.homes.labels import renderer_of
from sim.homes.open_home import open_scene
from sim.tasks.run_files import Run, read_run
from sim.types import ClutterLevel

from ..study_app.checked_options import key_from_text


def replay(
    *,
    runs: tuple[Path, ...],
    out: Path,
    dataset: Path,
    scenes_dir: Path | None,
    episode: str | None = None,
    with_pixels: bool = False,
    open: bool = False,
) -> int:
    """Writes the runs of one episode side by side, prints where.

    Args:
        runs: Run folders of people, agents, grounders and imports.
        out: The .rrd file.
        dataset: Folder of the episodes.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        episode: `SPLIT/SCENE/ID`; None = the only episode that all runs hold.
        with_pixels: Write geometry and pictures of scans too (their terms of use hold for the file).
        open: Show it until its window is closed or until Ctrl-C.

    Returns:
        0; problems are raised as one-line errors.
    """
    read = [read_run(folder) for folder in runs]
    key = common_episode(read) if episode is None else key_from_text(episode)
    episodes = PersonalDataset(dataset)
    found = episodes.episode(key)
    scene = open_scene(episodes, key.scene, scenes_dir=scenes_dir, clutter=_common_clutter(read))
    has_pictures = scene.kind != "scan" or with_pixels
    log_comparison(
        read,
        episode=found,
        scene=scene,
        out=out,
        renderer=renderer_of(scene) if has_pictures else None,
        with_pixels=with_pixels,
        dataset=episodes,
        beside=[folder.resolve().parent for folder in runs],
    )
    print(f"{out}: {key} in {scene.label}. Open it with --open, or: rerun {out}")
    if not has_pictures:
        print(
            "Geometry and pictures of the scan are left out; --with-pixels writes them, under the scan's terms of use."
        )
    if open:
        open_file(out)
    return 0


def _common_clutter(runs: Sequence[Run]) -> ClutterLevel:
    """The clutter level on which all runs were made; answers on oracle maps have none.

    Raises:
        RecordingError: They were made on several levels.
    """
    levels: dict[str, str] = {}
    for run in runs:
        if run.info.scene_kind != "oracle-map":
            levels.setdefault(str(run.info.config.get("clutter", 0)), run.info.run_id)
    if len(levels) > 1:
        found = ", ".join(f"{level} ({run_id})" for level, run_id in sorted(levels.items()))
        raise RecordingError(f"runs: found clutter levels {found}; expected one in a recording. Leave the others out.")
    level = next(iter(levels), "0")
    return 1 if level == "1" else 2 if level == "2" else 0

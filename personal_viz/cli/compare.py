"""Worker of `personal-viz compare`: run folders become one page with a row per episode."""

import sys
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from personal_viz.compare.app import PICTURE_WIDTH, write_comparison
from personal_viz.printed import Console
from sim.errors import PersonalVizError

from ..study_app.checked_options import check_options


def compare(
    *,
    runs: tuple[Path, ...],
    dataset: Path,
    out: Path,
    scenes_dir: Path | None = None,
    with_pixels: bool = False,
    picture_width: int = PICTURE_WIDTH,
    jobs: int = 1,
    open: bool = False,
) -> int:
    """Writes a page with a row per episode, its recordings and contact sheets; prints where. A second call goes on.

    Args:
        runs: Run folders of people, agents, grounders and imports, or folders of them.
        dataset: Folder of the episodes.
        out: Folder of the page.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        with_pixels: Write maps, geometry and pictures of scans too (their terms of use hold for the folder).
        picture_width: Of the robots' pictures in recordings; 0 leaves them out.
        jobs: Worker processes, one home each.
        open: Serve the page with Rerun's viewer on this machine until Ctrl-C.

    Returns:
        0; problems are raised as one-line errors.
    """
    check_options(run_id=None, jobs=jobs)
    if picture_width and not 32 <= picture_width <= 640:
        raise PersonalVizError(
            f"--picture-width is {picture_width}; expected 32 to 640, or 0 for no pictures. Leave it out for the "
            f"default, {PICTURE_WIDTH}."
        )
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("episodes", total=None)
        written = write_comparison(
            runs,
            dataset=dataset,
            out=out,
            scenes_dir=scenes_dir,
            with_pixels=with_pixels,
            picture_width=picture_width,
            jobs=jobs,
            on_plan=lambda left: progress.update(bar, total=left),
            on_episode=lambda: progress.update(bar, advance=1),
        )
    kept = written.num_episodes - written.num_made
    left_out = "; maps and pictures of the scans are left out (--with-pixels)" if written.has_left_out_pixels else ""
    print(f"{written.page}: {written.num_episodes} episodes of {written.num_runs} runs, {kept} made before{left_out}")
    if open:
        from recordings.viewer import open_folder

        open_folder(out)
    return 0

"""Verb `compare`: makes one page with a row per episode from run folders. A second call continues the first."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError

from ...compare import PICTURE_WIDTH
from ...progress import counted
from ..options import Dataset, Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import check_options


@dataclass
class Compare:
    """Write a page with one row per episode of all runs, each with its recording and its contact sheet."""

    runs: Positional[tuple[Path, ...]]
    dataset: Dataset
    out: Annotated[Path, arg(help="Folder of index.html, index.md, recordings and contact sheets.")]
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    picture_width: Annotated[int, arg(help="Width of what robots saw in the recordings, in pixels; 0 = none.")] = (
        PICTURE_WIDTH
    )
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    open: OpenIt = False

    def run(self) -> int:
        from personal_viz.compare.app import write_comparison

        check_options(self)
        if self.picture_width and not 32 <= self.picture_width <= 640:
            raise PersonalVizError(
                f"--picture-width is {self.picture_width}; expected 32 to 640, or 0 for no pictures. Leave it out "
                f"for the default, {PICTURE_WIDTH}."
            )
        with counted("episodes") as progress:
            written = write_comparison(
                self.runs,
                dataset=self.dataset,
                out=self.out,
                evidence=self.evidence,
                scenes_dir=self.scenes_dir,
                with_pixels=self.with_pixels,
                picture_width=self.picture_width,
                jobs=self.jobs,
                on_plan=progress.expect,
                on_episode=progress.add,
            )
        kept = written.num_episodes - written.num_made
        left_out = (
            "; maps and pictures of the scans are left out (--with-pixels)" if written.has_left_out_pixels else ""
        )
        print(
            f"{written.page}: {written.num_episodes} episodes of {written.num_runs} runs, {kept} made before{left_out}"
        )
        if self.open:
            from recordings.viewer.window import open_folder

            open_folder(self.out)
        return 0

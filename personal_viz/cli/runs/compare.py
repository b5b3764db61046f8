"""Verb `compare`: makes one page with a row per episode from run folders. A second call continues the first."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from human_study.store.records import DATABASE_FILE
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.tasks.run_files import run_texts

from ...compare import PICTURE_WIDTH
from ...progress import counted
from ..options import DatasetOrStudy, Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import check_options, require_dataset


@dataclass
class Compare:
    """Write a page with one row per episode of all runs, each with its recording and its contact sheet."""

    runs: Positional[tuple[Path, ...]]
    """Run folders, folders that hold them, or a study's folder with its people and their agents."""
    out: Annotated[Path, arg(help="Folder of index.html, index.md, recordings and contact sheets.")]
    dataset: DatasetOrStudy = None
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
        study = next((folder for folder in self.runs if (folder / DATABASE_FILE).is_file()), None)
        if study is not None:
            from human_study.report.source import own_agents

            with _people_of(study) as people:
                others = [folder for folder in self.runs if folder != study]
                agents = own_agents(study, others)
                runs = (people, *others, *([agents] if agents else []))
                return replace(self, runs=runs, **self._places(study)).run()
        if self.picture_width and not 32 <= self.picture_width <= 640:
            raise PersonalVizError(
                f"--picture-width is {self.picture_width}; expected 32 to 640, or 0 for no pictures. Leave it out "
                f"for the default, {PICTURE_WIDTH}."
            )
        with counted("episodes") as progress:
            written = write_comparison(
                self.runs,
                dataset=require_dataset(self.dataset),
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

    def _places(self, study: Path) -> dict[str, Any]:
        """Where the study's dataset is, unless the options say it.

        Raises:
            StudyError: The study does not tell it.
        """
        if self.dataset is not None:
            return {}
        from ...study_app.study_files import places_of

        found = places_of(study)
        return {
            "dataset": found.dataset,
            "evidence": found.evidence,
            "scenes_dir": self.scenes_dir or found.scenes_dir,
        }


@contextmanager
def _people_of(study: Path) -> Iterator[Path]:
    """A folder with the runs of a study's people, under the codes that an export gives them, for a block.

    Raises:
        StudyError: The study's records are damaged, or nobody has finished a trial.
    """
    from human_study.report.source import people_of_study

    with tempfile.TemporaryDirectory(prefix="personal-people-") as aside:
        for run in people_of_study(study):
            for name, text in run_texts(run).items():
                write_whole(Path(aside) / run.info.run_id / name, text)
        yield Path(aside)

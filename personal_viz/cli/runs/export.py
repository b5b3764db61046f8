"""Verb `export`: writes runs in other formats."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError
from sim.exchange.export_runs import export_runs
from sim.tasks.run_files import Run
from sim.tasks.run_folders import read_runs


@dataclass
class Export:
    """Write runs in other formats: JSONL as ours, TUM trajectories, or an episode folder that Minari opens."""

    runs: Annotated[Positional[tuple[Path, ...]], arg(help="Run folders, or recordings (.rrd) of ours.")]
    out: Annotated[Path, arg(help="Folder.")]
    format: Literal["jsonl", "tum", "minari"] = "jsonl"

    def run(self) -> int:
        for written in export_runs(_read(self.runs), format=self.format, out=self.out):
            answers = f", {written.num_answers} answers" if written.num_answers else ""
            left = f" {written.num_left_out} POG answers left out: {self.format} has no place for them."
            print(f"{written.folder}: {written.num_episodes} episodes{answers}.{left if written.num_left_out else ''}")
            if self.format == "minari":
                name = written.folder.relative_to(self.out).as_posix()
                out = self.out.resolve()
                print(f'MINARI_DATASETS_PATH={out} python -c "import minari; minari.load_dataset({name!r})"')
        return 0


def _read(paths: tuple[Path, ...]) -> list[Run]:
    """The runs of folders and recordings, in the order given."""
    if not paths:
        raise PersonalVizError("export: found no run; expected run folders or .rrd files. Give at least one.")
    found: list[Run] = []
    for path in paths:
        if path.suffix.lower() == ".rrd":
            from recordings.read import read_rrd

            found += read_rrd(path)
        else:
            found += read_runs([path])
    return found

"""Runs every agent that searches over the same episodes, with oracle perception at three levels of faults.

    python -m personal_viz.bench.search.compare --dataset data/split --out runs/search --json docs/figures/search.json

Episodes of recovered and of invented homes -> run folders, continued where they stopped -> one JSON document. It takes
hours; `--jobs` shares them. `personal_viz.bench.search.page` writes the table and the curves of the document.
"""

import io
import shutil
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from sim.files import write_whole
from sim.tasks.run_files import Run as RunFiles
from sim.tasks.run_files import read_run

from ...cli.invent import Invent
from ...cli.runs.run import Run
from .figures import GEOMETRY, GroupFigures, Outcome, Search, group_figures, search_document

LEVELS = ("oracle:clean", "oracle:mild", "oracle:strong")
SEEING = ("vlfm", "onemap", GEOMETRY, "nearest-frontier")
"""Agents that see: two methods, VLFM's loop with distance in the place of what pictures mean, the nearest frontier."""
BLIND = "random-frontier"
Homes = Literal["schematic", "invented"]
SPLIT_SIZES: dict[Homes, int] = {"schematic": 31, "invented": 14}
"""Episodes of each split: one for each recovered home, and 42 of the invented ones."""
NUM_INVENTED = 14
_SEED = 0


@dataclass
class Compare:
    """Run agents that search over the same episodes, and write what they found as JSON."""

    dataset: Path
    """Folder with easy/, medium/, hard/ (data/split in the authors' repository)."""
    out: Path = Path("runs/search")
    """Folder of the run folders, in which an interrupted comparison goes on."""
    json: Path = Path("docs/figures/search.json")
    """File of the figures."""
    jobs: int = 1
    """Worker processes."""

    def run(self) -> None:
        """Makes what is missing, then writes the document."""
        invented = self.out / "invented-homes"
        if not invented.is_dir():
            part = invented.with_name(f"{invented.name}.part")
            shutil.rmtree(part, ignore_errors=True)
            _quietly(Invent(out=part, homes=NUM_INVENTED, seed=_SEED).run)
            part.rename(invented)
        groups, commits = list[GroupFigures](), list[str | None]()
        roots: dict[Homes, Path] = {"schematic": self.dataset, "invented": invented}
        for homes, root in roots.items():
            runs = {name: read_run(run) for name, run in self._runs(homes, root)}
            groups.append(group_figures(homes, {name: _outcomes(run) for name, run in runs.items()}))
            commits += [run.info.git_commit for run in runs.values()]
        write_whole(self.json, search_document(groups, git_commits=commits).model_dump_json(indent=1) + "\n")
        print(f"Written to {self.json}")

    def _runs(self, homes: Homes, root: Path) -> Iterator[tuple[Search, Path]]:
        """Each agent at each level with the folder of its run, which is complete."""
        for name in (Search(BLIND, ""), *(Search(agent, level) for level in LEVELS for agent in SEEING)):
            run_id = f"{homes}-{name.agent}{name.level.replace(':', '-').replace('oracle', '')}"
            run = Run(
                dataset=root,
                agent=name.agent,
                perception=name.level or None,
                limit=SPLIT_SIZES[homes],
                seed=_SEED,
                out=self.out,
                run_id=run_id,
                jobs=self.jobs,
            )
            _quietly(run.run)
            yield name, self.out / run_id


def _outcomes(run: RunFiles) -> list[Outcome]:
    """How each episode of a run ended."""
    found = []
    for episode in run.episodes:
        measures = episode.end.measures
        assert measures is not None, "the runner measures every episode"
        found.append(Outcome.of(episode.key, measures))
    return found


def _quietly(work: Callable[[], object]) -> None:
    """Does the work of a verb; its progress goes to stderr, its words nowhere."""
    with redirect_stdout(io.StringIO()):
        work()


def main() -> None:
    """Parses the options."""
    tyro.cli(Compare).run()


if __name__ == "__main__":
    main()

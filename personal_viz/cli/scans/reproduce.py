"""Verb `reproduce`: the paper's tables from nothing to a page, on scans or on homes without one."""

import io
import json
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, NamedTuple

from tyro.conf import arg

from grounding.encoders.blip2 import DEFAULT_MODEL
from grounding.encoders.by_name import is_model, make_encoder, require_no_model_options
from grounding.encoders.protocol import ModelOptions
from personal_viz.reproduce.page import document_of, page_of, rows_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.kind import common_kind
from sim.tasks.metrics import require_comparable
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import read_run_info
from sim.tasks.run_folders import read_runs, with_controls
from sim.tasks.shards import SHARDS, shard_from_text
from sim.tasks.workers import Workers, run_jobs
from sim.types import SceneKind
from sim.words.english import how_many

from ...progress import counted
from ..grounding.ground import EXPLORATIONS, Ground
from ..options import (
    Address,
    Dataset,
    Evidence,
    Jobs,
    Json,
    Limit,
    ModelAutocast,
    ModelBatch,
    On,
    SampleSeed,
    Scenes,
    ScenesDir,
    Shard,
    Splits,
    workers_of,
)
from ..output import print_json, print_table, say, write_report
from ..refusals import check_options, require_folder, sampled
from ..runs.episode_walks import keys_by_scene
from ..runs.metrics import Metrics
from ..runs.run import Run

PAGE, FIGURES = "index.html", "reproduce.json"
"""Names of the files below --out."""


class Step(NamedTuple):
    """A part of the work; done again, it continues."""

    name: str
    work: Callable[[], object]
    per: Literal["home", "episode"]
    """What its time grows with."""
    processes: int
    """Most processes that share the whole work."""
    check: Callable[[], object] = lambda: None
    """Refuses unknown names before any work."""


class Cost(NamedTuple):
    """The measured cost of a step, and how often it comes."""

    step: str
    seconds: float
    """With one process."""
    gigabytes: float
    """Files that it left."""
    times: float
    processes: int

    @property
    def hours(self) -> float:
        """Hours of the whole step."""
        return self.seconds * self.times / self.processes / 3600


@dataclass(frozen=True, slots=True)
class _ExploreJob:
    """Everything that a worker process needs to explore one home."""

    dataset_root: Path
    evidence: tuple[Path, ...]
    scene: str
    scenes_dir: Path | None
    folder: Path
    seed: int


@dataclass
class Reproduce:
    """Compute the paper's tables: explore, map, ground and walk, then write one page. A second call continues."""

    dataset: Dataset
    out: Annotated[Path, arg(help="Folder of the page, the runs, the maps and the explorations.")] = Path(
        "runs/reproduce"
    )
    scenes_dir: ScenesDir = None
    evidence: Evidence = ()
    encoder: Annotated[str, arg(help="Encoder of the maps, as in ground.")] = f"blip2-itc256:{DEFAULT_MODEL}"
    method: Annotated[tuple[str, ...], arg(help="Methods of POG, as in ground.")] = (
        *("random", "center", "qs", "rpg"),
        *("phrase", "dual", "joint"),
    )
    agent: Annotated[tuple[str, ...], arg(help="Agents of PAN, as in run.")] = ("random-frontier",)
    runs: Annotated[
        tuple[Path, ...], arg(help="Further runs for the tables: exports of studies, imported or reported runs.")
    ] = ()
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    sample_seed: SampleSeed = 0
    seed: int = 0
    jobs: Jobs = 1
    on: On = "processes"
    address: Address = None
    shard: Shard = None
    device: Annotated[
        Literal["auto", "cpu", "cuda"], arg(help="Where a real encoder runs; auto = on a GPU if there is one.")
    ] = "auto"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    dry_run: Annotated[bool, arg(help="Do one home in a temporary folder and say what all of them will take.")] = False
    json: Json = False

    def run(self) -> int:
        check_options(self)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        chosen = sampled(episodes, splits=self.split, scenes=self.scene, limit=self.limit, seed=self.sample_seed)
        by_home = keys_by_scene([item.key for item in chosen], self.scenes_dir)
        shard = shard_from_text(self.shard)
        homes = tuple(shard.part(by_home))
        chosen = [item for item in chosen if item.key.scene in homes]
        self._workers()
        kind = common_kind(episodes, homes, self.scenes_dir)
        self._require_fitting_runs(kind, episodes.digest())
        steps = list(self._steps(self.out, homes, scene=self.scene, limit=self.limit))
        for step in steps:
            step.check()
        self._require_encoder()
        say(f"{how_many(len(chosen), 'episode')} in {how_many(len(homes), 'home')} ({kind}).")
        if self.dry_run:
            return self._estimate(chosen, homes)
        require_folder(self.out)
        for step in steps:
            say(f"{step.name} ...")
            _done_quietly(step)
        if shard.of > 1:
            say(
                f"Shard {shard} is done. When all {shard.of} are: personal-viz merge {self.out} {self.out / SHARDS}, "
                "then the same command without --shard, which writes the page."
            )
            return 0
        return self._report()

    def _workers(self) -> Workers:
        """The workers of explorations and agents; raises PersonalVizError for options that do not fit together."""
        return workers_of(self.on, jobs=self.jobs, address=self.address)

    def _require_fitting_runs(self, kind: SceneKind, digest: str) -> None:
        """Refuses runs in `--out` and `--runs` that cannot stand in these tables, before hours of work."""
        others = [run.info for run in read_runs(self.runs, with_reported=True)] if self.runs else []
        before = [read_run_info(path.parent) for path in sorted(self.out.glob("*/run.json"))]
        own = make_run_info("reproduce", who="reproduce", who_kind="agent", scene_kind=kind, dataset_digest=digest)
        require_comparable([*before, *others, own])

    def _require_encoder(self) -> None:
        """Loads a real encoder once, so that a missing package, model or GPU shows before the homes are explored."""
        if not self.method:
            return
        options = ModelOptions(self._device(), self.batch, self.autocast)
        if is_model(self.encoder):
            make_encoder(self.encoder, options=options)
        else:
            require_no_model_options(f"--encoder {self.encoder}", options)

    def _report(self) -> int:
        """Writes the page and prints the tables."""
        runs = read_runs(with_controls([self.out, *self.runs]), with_reported=True)
        rows = rows_of(runs)
        document = document_of(runs, rows)
        write_report(self.out, {PAGE: page_of(runs, rows), FIGURES: json.dumps(document, indent=1) + "\n"}, earlier=())
        if self.json:
            print_json(document)
        else:
            Metrics((self.out, *self.runs)).run()
        say(f"Written to {self.out / PAGE}; {self.out / FIGURES} holds the figures.")
        return 0

    def _steps(
        self,
        out: Path,
        homes: Sequence[str],
        *,
        scene: tuple[str, ...],
        limit: int | None,
        agents_limit: int | None = None,
        is_measured: bool = False,
    ) -> Iterator[Step]:
        """The work on these homes, in order; the agents' episodes may be fewer.

        One process does what is measured, whose time and memory are then its own.
        """
        device = self._device()
        many = {} if is_measured else {"on": self.on, "address": self.address, "shard": self.shard}
        every: dict[str, Any] = {
            **{name: getattr(self, name) for name in ("evidence", "scenes_dir", "split", "sample_seed", "seed")},
            **{"out": out, "scene": scene, **many},
        }
        models = 1 if device == "cuda" else self.jobs  # one GPU holds one model
        unexplored = [
            _ExploreJob(self.dataset, self.evidence, name, self.scenes_dir, out / EXPLORATIONS, self.seed)
            for name in homes
        ]
        if self.method:
            yield Step(
                "Exploring", lambda: _explore(unexplored, 1 if is_measured else self._workers()), "home", self.jobs
            )
        for method in dict.fromkeys(self.method):
            ground = Ground(
                self.dataset,
                method,
                map="explore",
                encoder=self.encoder,
                device=device,
                autocast=self.autocast,
                batch=self.batch,
                limit=limit,
                jobs=1 if is_measured else models,
                **every,
            )
            yield Step(f"POG, {method}", ground.run, "home", models, ground.check)
        for agent in dict.fromkeys(self.agent):
            walk = Run(
                self.dataset,
                agent,
                limit=limit if agents_limit is None else agents_limit,
                jobs=1 if is_measured else self.jobs,
                **every,
            )
            yield Step(f"PAN, {agent}", walk.run, "episode", self.jobs, walk.check)

    def _device(self) -> Literal["cpu", "cuda"]:
        if self.device != "auto":
            return self.device
        if not is_model(self.encoder):
            return "cpu"
        import torch

        return "cuda" if torch.cuda.is_available() else "cpu"

    def _estimate(self, chosen: Sequence[Episode], homes: Sequence[str]) -> int:
        """Does one home, measures it, and says what all of them will take."""
        counts = Counter(episode.key.scene for episode in chosen)
        home = sorted(homes, key=lambda name: counts[name])[len(homes) // 2]
        limit = max(Counter(episode.key.split for episode in chosen if episode.key.scene == home).values())
        costs: list[Cost] = []
        with TemporaryDirectory(prefix="reproduce-") as folder:
            out = Path(folder)
            walked = 0
            for step in self._steps(out, [home], scene=(home,), limit=limit, agents_limit=1, is_measured=True):
                before_s, before = time.monotonic(), _gigabytes(out)
                _done_quietly(step)
                seconds, times = time.monotonic() - before_s, float(len(homes))
                if step.per == "episode":
                    earlier, walked = walked, sum(len(run.episodes) for run in read_runs([out]))
                    times = len(chosen) / (walked - earlier)
                processes = min(step.processes, len(homes)) if step.per == "home" else step.processes
                costs.append(Cost(step.name, seconds, _gigabytes(out) - before, times, processes))
        return self._say_costs(costs, home)

    def _say_costs(self, costs: Sequence[Cost], home: str) -> int:
        hours = sum(cost.hours for cost in costs)
        alone = sum(cost.seconds * cost.times for cost in costs) / 3600
        gigabytes = sum(cost.gigabytes * cost.times for cost in costs)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        document = {
            "home": home,
            "device": self._device(),
            "jobs": self.jobs,
            "steps": [cost._asdict() for cost in costs],
            "hours_one_process": alone,
            "hours": hours,
            "gigabytes_on_disk": gigabytes,
            "gigabytes_of_memory_per_process": memory,
        }
        if self.json:
            print_json(document)
            return 0
        lines = [
            (cost.step, f"{cost.seconds:.1f}", f"{cost.times:.0f}", f"{cost.processes}", f"{cost.hours:.2f}")
            for cost in costs
        ]
        print_table(f"Measured on {home}, {self._device()}", ("Step", "s", "times", "processes", "hours"), lines)
        print(
            f"About {hours:.2f} hours with --jobs {self.jobs} ({alone:.2f} with one process), "
            f"{gigabytes:.2f} GB of files in {self.out}, {memory:.1f} GB of memory per process. "
            "An upper bound where a model is loaded: it was loaded for this one home."
        )
        return 0


def _done_quietly(step: Step) -> None:
    """Does a step without the tables of its verb, since the page has them all; progress still shows."""
    with redirect_stdout(io.StringIO()):
        step.work()


def _explore(jobs: Sequence[_ExploreJob], processes: Workers) -> None:
    with counted("explore", len(jobs)) as progress:
        kept = "finished explorations are kept"
        for _ in run_jobs(_explored, jobs, processes=processes, kept=kept, name_of=attrgetter("scene")):
            progress.add()


def _explored(job: _ExploreJob) -> None:
    """Explores the storeys of a home on which episodes start, where there is no file yet."""
    from grounding.agents.explored_storeys import storey_explorations, storeys_of_starts
    from sim.homes.open_home import open_scene

    episodes = PersonalDataset(job.dataset_root, evidence=job.evidence)
    scene = open_scene(episodes, job.scene, scenes_dir=job.scenes_dir)
    storey_explorations(scene, storeys_of_starts(episodes, scene), folder=job.folder, seed=job.seed)


def _gigabytes(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e9

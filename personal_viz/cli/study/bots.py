"""Verb `study bots`: simulated participants take part in a study through its real gateway."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import Positional, arg

from human_study.design.study import load_study
from human_study.store.records import read_study
from personal_viz.bots.figures import BotFigures
from personal_viz.bots.server import Server
from personal_viz.bots.site import Site, copy_plan, make_bot_study, running
from sim.errors import StudyError
from sim.types import TaskKind

from ..options import Evidence, ScenesDir
from ..output import say
from ..refusals import check_options

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]


@dataclass
class StudyBots:
    """Simulated participants through the real gateway: how fast it answers, and whether anything was lost."""

    study: Positional[Path | None] = None
    """A planned study, of which a copy is served; an invented one without."""
    dataset: Annotated[Path | None, arg(help="Folder of the study's episodes.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    participants: int = 10
    seconds: float = 60.0
    rate: Annotated[float, arg(help="Actions per second of each bot.")] = 2.0
    task: Annotated[
        Literal["pan", "pog", "both"] | None, arg(help="Whom bots stand for; otherwise all of the study, or PAN.")
    ] = None
    kinds: Annotated[tuple[BotKind, ...], arg(help="How bots behave; the kinds are dealt out in turns.")] = get_args(
        BotKind
    )
    seed: int = 0
    url: Annotated[str | None, arg(help="Address of a server on a pilot study, whose records will hold the bots.")] = (
        None
    )
    json: bool = False

    def run(self) -> int:
        from personal_viz.bots.crowd import run_bots

        self._require_possible()
        tasks = self._tasks()
        with self._site(tasks) as site:
            figures = run_bots(
                site,
                participants=self.participants,
                seconds=self.seconds,
                rate=self.rate,
                kinds=tuple(self.kinds),
                seed=self.seed,
                tasks=tasks,
                progress=say,
            )
        print(figures.model_dump_json(indent=2) if self.json else "\n".join(lines(figures)))
        return 1 if figures.lost or figures.duplicated else 0

    @contextmanager
    def _site(self, tasks: tuple[TaskKind, ...]) -> Iterator[Site]:
        """Yields the server that is already running, or our own until the end of the block."""
        dataset = self.dataset
        if self.url is not None and self.study is not None and dataset is not None:
            yield running(self.study, dataset, self.scenes_dir, self.url, evidence=self.evidence)
            return
        with tempfile.TemporaryDirectory(prefix="personal-bots-") as name:
            folder = Path(name)
            if self.study is None:
                say("making a study")
                dataset = make_bot_study(
                    folder,
                    participants=self.participants,
                    seed=self.seed,
                    dataset=dataset,
                    evidence=self.evidence,
                    task=tasks,
                )
            else:
                copy_plan(self.study, folder / "study")
            assert dataset is not None
            say("starting to serve")
            with Server(folder / "study", dataset, evidence=self.evidence, scenes_dir=self.scenes_dir) as server:
                yield server.start()

    def _tasks(self) -> tuple[TaskKind, ...]:
        if self.task is None:
            return ("pan",) if self.study is None else load_study(self.study).task
        return ("pan", "pog") if self.task == "both" else (self.task,)

    def _require_possible(self) -> None:
        check_options(self)
        if self.participants < 1 or not self.seconds > 0 or not 0 < self.rate <= 3:
            raise StudyError(
                f"--participants {self.participants} --seconds {self.seconds:g} --rate {self.rate:g}: expected "
                "at least 1, more than 0, and more than 0 up to 3, because the gateway drops what is faster. "
                "Correct them."
            )
        if self.study is not None and self.dataset is None:
            raise StudyError(f"{self.study}: found no --dataset; expected the folder of the study's dataset. Add it.")
        if self.url is not None and self.study is None:
            raise StudyError(
                f"--url {self.url}: found no study folder; expected it, because the tokens are in it. Name it."
            )
        if self.url is not None and self.study is not None and not _is_pilot(self.study):
            raise StudyError(
                f"--url {self.url}: {self.study} is a study with people; expected a pilot, because its records will "
                "hold the bots. Leave --url out: bots then have a copy of the plan to themselves."
            )


def lines(figures: BotFigures) -> list[str]:
    """The figures as lines for people to read."""

    def ms(value: float | None) -> str:
        return "-" if value is None else f"{value:.1f} ms"

    people = ", ".join(f"{count} {task.upper()}" for task, count in figures.tasks.items())
    dropped = ", ".join(f"{count} {reason}" for reason, count in figures.dropped.items()) or "none"
    cpu = figures.server_cpu_ms_per_action
    clicked = (
        f"  clicks {figures.clicks}, answers {figures.answers}; click -> mark, which follows the commit: median "
        f"{ms(figures.click_to_mark_p50_ms)}, p95 {ms(figures.click_to_mark_p95_ms)}, "
        f"longest {ms(figures.click_to_mark_max_ms)}"
    )
    return [
        f"{people} bots ({', '.join(figures.kinds)}), {figures.seconds:.0f} s, "
        f"{figures.actions} keys and clicks ({figures.actions_per_s:.1f}/s), {figures.frames} pictures, "
        f"{figures.connections} connections, {figures.finished} finished, {figures.resting} sent to rest",
        *([clicked] if figures.clicks else []),
        f"  stored (key sent -> counter that follows the commit): median {ms(figures.ack_p50_ms)}, "
        f"p95 {ms(figures.ack_p95_ms)}, longest {ms(figures.ack_max_ms)}",
        f"  key -> picture, on the websocket: median {ms(figures.key_to_frame_p50_ms)}, "
        f"p95 {ms(figures.key_to_frame_p95_ms)}",
        f"  lost {figures.lost}, duplicated {figures.duplicated}, unknown {figures.unknown}, "
        f"cut off by hanging up {figures.cut_off}, unanswered {figures.unanswered}; without effect: {dropped}",
        f"  CPU per key or click: server {ms(cpu)}, bots {ms(figures.bots_cpu_ms_per_action)}; "
        f"{figures.actions_per_s_per_core:.1f}/s per core on {figures.cores} cores, "
        f"load before {figures.load_before:.1f}",
        *(f"  {problem}" for problem in figures.problems),
    ]


def _is_pilot(study: Path) -> bool:
    with read_study(study) as reader:
        return reader.is_pilot

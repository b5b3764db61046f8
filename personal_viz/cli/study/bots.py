"""Verb `study bots`: simulated participants take part in a study through its real gateway."""

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from human_study.design.study import load_study
from human_study.store.records import read_study
from personal_viz.bots.log import KINDS, BotKind
from personal_viz.bots.run import BotFigures, run_bots
from personal_viz.bots.site import Site, copy_plan, make_bot_study, running, served
from sim.errors import StudyError
from sim.types import TaskKind


def bots(
    *,
    study: Path | None = None,
    dataset: Path | None = None,
    scenes_dir: Path | None = None,
    participants: int = 10,
    seconds: float = 60.0,
    rate: float = 2.0,
    task: Literal["pan", "pog", "both"] | None = None,
    kinds: Sequence[BotKind] = KINDS,
    seed: int = 0,
    json: bool = False,
    url: str | None = None,
) -> int:
    """Prints what came of it; exit code 1 when a key, click or answer was lost or is there twice.

    Args:
        study: A planned study. Its plan is copied and the copy is served, so that bots never stand among people; None =
            a study of this many participants on an invented home.
        dataset: Of the study.
        scenes_dir: Of licensed scans.
        participants: How many take part.
        seconds: How long they act.
        rate: Actions per second of each.
        task: Whom bots stand for; None = all that the study has, of an invented one `pan`.
        kinds: How they behave, dealt out in turns.
        seed: Of what they do.
        json: Print `BotFigures` as JSON alone.
        url: Of a server that runs already on `study` itself: its records will hold what the bots do.

    Raises:
        StudyError: The study cannot be served, has too few participants of the task, or a bot is not let in.
    """
    _require_possible(study, dataset, participants=participants, seconds=seconds, rate=rate, url=url)

    tasks = _tasks(study, task)
    with _site(study, dataset, scenes_dir, participants=participants, seed=seed, tasks=tasks, url=url) as site:
        figures = run_bots(
            site,
            participants=participants,
            seconds=seconds,
            rate=rate,
            kinds=tuple(kinds),
            seed=seed,
            tasks=tasks,
            progress=_progress,
        )
    print(figures.model_dump_json(indent=2) if json else "\n".join(lines(figures)))
    return 1 if figures.lost or figures.duplicated else 0


@contextmanager
def _site(
    study: Path | None,
    dataset: Path | None,
    scenes_dir: Path | None,
    *,
    participants: int,
    seed: int,
    tasks: tuple[TaskKind, ...],
    url: str | None,
) -> Iterator[Site]:
    """The server that runs already, or one of our own until the end of the block."""
    if url is not None and study is not None and dataset is not None:
        yield running(study, dataset, scenes_dir, url)
        return
    with tempfile.TemporaryDirectory(prefix="personal-bots-") as name:
        folder = Path(name)
        if study is None:
            _progress("making a study")
            dataset = make_bot_study(folder, participants=participants, seed=seed, dataset=dataset, task=tasks)
        else:
            copy_plan(study, folder / "study")
        assert dataset is not None
        _progress("starting to serve")
        with served(folder / "study", dataset, scenes_dir) as site:
            yield site


def _progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def lines(figures: BotFigures) -> list[str]:
    """The figures for people."""

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


def _tasks(study: Path | None, task: Literal["pan", "pog", "both"] | None) -> tuple[TaskKind, ...]:
    if task is None:
        return ("pan",) if study is None else load_study(study).task
    return ("pan", "pog") if task == "both" else (task,)


def _require_possible(
    study: Path | None, dataset: Path | None, *, participants: int, seconds: float, rate: float, url: str | None
) -> None:
    if participants < 1 or not seconds > 0 or not 0 < rate <= 3:
        raise StudyError(
            f"--participants {participants} --seconds {seconds:g} --rate {rate:g}: expected at least 1, more than 0, "
            "and more than 0 up to 3, because the gateway drops what is faster. Correct them."
        )
    if study is not None and dataset is None:
        raise StudyError(f"{study}: found no --dataset; expected the folder of the study's dataset. Add it.")
    if url is not None and study is None:
        raise StudyError(f"--url {url}: found no study folder; expected it, because the tokens are in it. Name it.")
    if url is not None and study is not None and not _is_pilot(study):
        raise StudyError(
            f"--url {url}: {study} is a study with people; expected a pilot, because its records will hold the bots. "
            "Leave --url out: bots then have a copy of the plan to themselves."
        )


def _is_pilot(study: Path) -> bool:
    with read_study(study) as reader:
        return reader.is_pilot

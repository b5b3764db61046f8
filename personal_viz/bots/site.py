"""Where bots take part: a study made for them, served by a child process as a person at a terminal would serve it."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from human_study.design.plan import PLAN_FILE, PRACTICE_FOLDER, StudyPlan, load_plan
from human_study.design.secrets import load_secrets
from human_study.design.study import (
    STUDY_FILE,
    FlowStep,
    PogCondition,
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyPog,
    StudyPractice,
    load_study,
    save_study,
)
from human_study.texts.participants import TEXT_FILES, TOLD_FOLDER
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.types import SPLITS, TaskKind

HOME = "BotHome"
START_S = 120.0
_READY = "Everything is written to"
_LINK = re.compile(r"(PAN|POG)\s+(p\d+)\s+(\S+)")


@dataclass(frozen=True, slots=True)
class Site:
    """A study that is being served."""

    folder: Path
    dataset: Path
    scenes_dir: Path | None
    links: dict[str, str]
    """Personal link of each PAN participant, by code."""
    pid: int | None
    """Of the serving process; None when somebody else started it."""
    pog_links: dict[str, str] = field(default_factory=dict)
    """Personal link of each POG participant, by code."""

    def people(self, tasks: Sequence[TaskKind]) -> list[tuple[str, TaskKind, str]]:
        """(code, task, personal link) of everybody who does one of the tasks, in the plan's order."""
        links: dict[TaskKind, dict[str, str]] = {"pan": self.links, "pog": self.pog_links}
        found: list[tuple[str, TaskKind, str]] = []
        for task in tasks:
            for code, link in links[task].items():
                found.append((code, task, link))
        return sorted(found, key=lambda person: (len(person[0]), person[0]))


def make_bot_study(
    folder: Path,
    *,
    participants: int,
    seed: int,
    dataset: Path | None = None,
    scenes: tuple[str, ...] = (),
    flow: tuple[FlowStep, ...] = ("device", "consent", "instructions", "quiz"),
    task: tuple[TaskKind, ...] = ("pan",),
    pog_conditions: tuple[PogCondition, ...] = ("map_first",),
    practice: int = 0,
    breaks_every: int | None = None,
    confidence: bool = False,
) -> Path:
    """Plans a study for bots, in which everybody does every episode; returns its dataset's folder.

    Args:
        folder: A new one.
        participants: How many for each task, and in POG for each condition.
        seed: Of the home and of the plan.
        dataset: None = a home is invented in `folder`.
        scenes: Only these homes of the dataset; () = all.
        flow: The pages before the first trial.
        task: What people do, each one of them.
        pog_conditions: Of POG.
        practice: Practice trials of everybody.
        breaks_every: A break after so many trials; None = none.
        confidence: Whether people are asked how sure they are.
    """
    from personal_viz.study_app.study_files import plan_study
    from sim.authoring.generation import invent_dataset

    if dataset is None:
        dataset = folder / "dataset"
        invent_dataset(dataset, name=HOME, seed=seed)
    config = StudyConfig(
        study="bots",
        dataset=StudyDataset(
            sha256=PersonalDataset(dataset).digest(),
            splits=dict.fromkeys(SPLITS, "all"),
            scenes=scenes,
            stratify="none",
            max_per_scene=None,
            seed=seed,
        ),
        task=task,
        design=StudyDesign(kind="crossed", raters_per_episode=participants),
        flow=flow,
        pog=StudyPog(conditions=pog_conditions),
        practice=StudyPractice(pan=practice, pog=practice),
        checks=StudyChecks(every=None),
        breaks=StudyBreaks(every=breaks_every, sitting_max=None),
        confidence=confidence,
    )
    save_study(folder / "study", config)
    plan_study(folder / "study", dataset, None, pilot=True)
    return dataset


def copy_plan(study: Path, folder: Path) -> None:
    """A planned study without any of its records, for bots: what they do must not stand beside what people do.

    Raises:
        StudyError: The study has no plan.
    """
    load_plan(study, load_study(study))
    folder.mkdir(parents=True)
    for name in (STUDY_FILE, PLAN_FILE, *TEXT_FILES):
        if (study / name).is_file():
            shutil.copy(study / name, folder / name)
    for name in (PRACTICE_FOLDER, TOLD_FOLDER):
        if (study / name).is_dir():
            shutil.copytree(study / name, folder / name)


@contextmanager
def served(folder: Path, dataset: Path, scenes_dir: Path | None = None) -> Iterator[Site]:
    """`study serve` on a free port until the end of the block.

    Raises:
        StudyError: The program ended instead; its own message is above.
    """
    program = [sys.executable, "-m", "personal_viz", "study", "serve", str(folder), "--dataset", str(dataset)]
    program += ["--scenes-dir", str(scenes_dir)] if scenes_dir else []
    program += ["--port", "0", "--pilot"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, process_group=0, preexec_fn=hear_ctrl_c)
    try:
        assert process.stdout is not None
        links: dict[str, dict[str, str]] = {"PAN": {}, "POG": {}}
        for line in process.stdout:
            if found := _LINK.search(line):
                label, code, link = found.groups()
                links[label][code] = link
            if _READY in line:
                break
        if not any(links.values()):
            raise StudyError(
                f"{' '.join(program[2:6])}: printed no personal link; expected at least one. Its own message is above."
            )
        yield Site(folder, dataset, scenes_dir, links["PAN"], process.pid, links["POG"])
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def running(folder: Path, dataset: Path, scenes_dir: Path | None, url: str) -> Site:
    """A study that is being served already, on this machine or by way of a proxy.

    Args:
        folder: Of the study; its tokens are read.
        dataset: Of the study.
        scenes_dir: Of licensed scans.
        url: As browsers reach it, `http://127.0.0.1:8080`.
    """
    plan: StudyPlan = load_plan(folder, load_study(folder))
    tokens = load_secrets(folder).tokens
    links: dict[TaskKind, dict[str, str]] = {"pan": {}, "pog": {}}
    for person in plan.participants:
        if person.code in tokens:
            links[person.task][person.code] = f"{url.rstrip('/')}/#{tokens[person.code]}"
    return Site(folder, dataset, scenes_dir, links["pan"], None, links["pog"])


def hear_ctrl_c() -> None:
    """In the child: Ctrl-C ends it, also where the shell that started us ignores it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def cpu_seconds(pid: int) -> float:
    """CPU seconds of a process and its children so far (Linux; 0 elsewhere)."""
    total = 0.0
    for one in (pid, *_children(pid)):
        fields = _stat_fields(one)
        if fields:
            total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


def _children(pid: int) -> list[int]:
    folder = Path("/proc")
    found = [int(path.name) for path in folder.iterdir() if path.name.isdigit()] if folder.is_dir() else []
    return [one for one in found if (fields := _stat_fields(one)) and int(fields[1]) == pid]


def _stat_fields(pid: int) -> list[str]:
    """Fields of /proc/PID/stat behind the name; empty when there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []

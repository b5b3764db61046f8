"""Small planned studies, served by a child process as a researcher would, and a line to them that can be cut."""

import contextlib
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from human_study.design.plan import PRACTICE_FOLDER, load_plan
from human_study.design.study import (
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
from personal_viz.bots.crowd import run_bots
from personal_viz.bots.server import Server
from personal_viz.bots.site import make_pilot
from personal_viz.study_app.operator.served import serve_command
from personal_viz.study_app.operator.served import served as served_by
from personal_viz.study_app.study_files import PRACTICE_HOME, plan_study
from sim.episodes.dataset import PersonalDataset
from sim.types import TaskKind

from .invented import invented_dataset
from .program import personal_viz

HOME = "FlowHome"


@dataclass(slots=True)
class PlannedStudy:
    """A study folder, its episodes, and the personal links while it is served."""

    folder: Path
    dataset: Path
    links: dict[str, str]
    """Participant to personal link."""
    process: subprocess.Popen[str]
    said: str
    """The output up to the links and including them."""
    visited: set[str] = field(default_factory=set)
    """Participants whom `newcomer` has named."""

    def newcomer(self, task: TaskKind) -> str:
        """The code of a participant of this task whom no test has used yet, for tests that share a study."""
        plan = load_plan(self.folder, load_study(self.folder))
        free = [person.code for person in plan.participants if person.task == task and person.code not in self.visited]
        self.visited.add(free[0])
        return free[0]


def plan_small(root: Path, **choices: Any) -> Path:
    """A planned pilot on one invented home with all pages, one practice trial and a break after each trial.

    Args:
        root: Folder that gets `dataset` and `study`.
        choices: Fields of StudyConfig.
    """
    dataset = root / "dataset"
    invented_dataset(dataset, name=HOME, seed=5)
    usual = {
        "task": ("pan",),
        "dataset": StudyDataset(
            sha256=PersonalDataset(dataset).digest(), splits={"easy": 2}, stratify="none", max_per_scene=None, seed=3
        ),
        "design": StudyDesign(kind="crossed", raters_per_episode=4),
        "practice": StudyPractice(pan=1, pog=1),
        "checks": StudyChecks(every=None),
        "breaks": StudyBreaks(every=1),
    }
    config = StudyConfig(study="flow", **{**usual, **choices})
    if any({"pan": config.practice.pan, "pog": config.practice.pog}[task] for task in config.task):
        invented_dataset(root / "study" / PRACTICE_FOLDER, name=PRACTICE_HOME, seed=config.dataset.seed + 1)
    save_study(root / "study", config)
    plan_study(root / "study", dataset, None, pilot=True)
    return root / "study"


@contextlib.contextmanager
def served(
    folder: Path, dataset: Path, *more: str, port: int = 0, ended_by: signal.Signals = signal.SIGINT
) -> Iterator[PlannedStudy]:
    """Serves a planned study for a block; at its end the program gets a signal if it still runs.

    Args:
        folder: The study's folder.
        dataset: The dataset of its episodes.
        more: Further options; without `--workers` there is one worker.
        port: Port to listen on; 0 takes a free one.
        ended_by: The signal at the end.
    """
    with served_by(serve_command(folder, dataset, *more, port=port, workers=None if "--workers" in more else 1)) as one:
        assert one.links, one.said
        yield PlannedStudy(folder, dataset, one.links, one.process, one.said)
        if one.process.poll() is None:
            assert one.end(ended_by) == 0


def children(pid: int) -> list[int]:
    """Processes that a process has started: the workers of a served study."""
    return [child.pid for child in psutil.Process(pid).children()]


class Line:
    """A connection to a server through this process, like a browser's network: it can be cut and mended."""

    def __init__(self, port: int) -> None:
        """Listens on a free loopback port and passes everything on to `port`."""
        self._server_port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._is_cut = False
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Ends all connections and refuses new ones."""
        with self._lock:
            self._is_cut = True
            ended, self._open = self._open, set()
        for end in ended:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def mend(self) -> None:
        """Accepts connections again."""
        with self._lock:
            self._is_cut = False

    def close(self) -> None:
        """Ends everything."""
        self.cut()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                browser, _ = self._listener.accept()
            except OSError:
                return
            with self._lock:
                is_cut = self._is_cut
            if is_cut:
                browser.close()
                continue
            server = socket.create_connection(("127.0.0.1", self._server_port))
            with self._lock:
                self._open |= {browser, server}
            for here, there in ((browser, server), (server, browser)):
                threading.Thread(target=_pass_on, args=(here, there), daemon=True).start()


def _pass_on(here: socket.socket, there: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := here.recv(65536):
            there.sendall(data)
    for end in (here, there):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def assert_people_take_part(folder: Path, data: Path, scans: Path) -> None:
    """Bots walk and point on a scan in a study whose homes the server draws; every stored step is verified."""
    make_pilot(
        folder,
        data,
        participants=1,
        scenes_dir=scans,
        task=("pan", "pog"),
        splits={"easy": 3},
        pog=StudyPog(conditions=("map_open",)),
        pog_view="server",
    )
    with Server(folder, data, scenes_dir=scans) as server:
        figures = run_bots(
            server.start(), participants=2, seconds=120, rate=10, kinds=["shortest"], seed=1, tasks=("pan", "pog")
        )
    assert (figures.finished, figures.problems) == (2, ())
    assert (figures.lost, figures.duplicated, figures.unknown) == (0, 0, 0)
    done = personal_viz("study", "verify", folder, "--dataset", data, "--scenes-dir", scans)
    assert done.returncode == 0, done.stdout + done.stderr

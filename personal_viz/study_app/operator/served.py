"""Serves a study in a child process, as from a terminal: for bots, benchmarks, screenshots and tests."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

from sim.errors import StudyError
from sim.types import TaskKind

END_S = 60.0
"""Longest wait for the end of a program that was told to end; then it is killed."""
_PERSON = re.compile(r"(PAN|POG)\s+(p\d+)\s+(https?://\S+)")
_READY = "Everything is written to"


class Person(NamedTuple):
    """A participant as `study serve` prints them."""

    code: str
    task: TaskKind
    link: str
    """Personal link."""


class ServedStudy:
    """A program that serves a study: `study serve` or `demo`."""

    def __init__(
        self, command: list[str], *, stderr: IO[str] | None = None, environment: Mapping[str, str] | None = None
    ) -> None:
        """Starts the program and does not wait for it.

        Args:
            command: The arguments after `personal-viz`, or a whole program whose first part is `sys.executable`.
            stderr: File for the program's standard error; None = our own standard error.
            environment: Variables that differ from ours.
        """
        self._command = command if command[0] == sys.executable else [sys.executable, "-m", "personal_viz", *command]
        self.process = subprocess.Popen(
            self._command,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            env={**os.environ, **(environment or {})},
            process_group=0,
            preexec_fn=hear_ctrl_c,
        )
        self.said = ""
        """The program's output up to the links and including them."""
        self.people: tuple[Person, ...] = ()
        """The participants whose personal links it printed, in its order."""

    @property
    def pid(self) -> int:
        """Id of the serving process."""
        return self.process.pid

    @property
    def links(self) -> dict[str, str]:
        """Personal link by participant."""
        return {person.code: person.link for person in self.people}

    def link(self, task: TaskKind) -> str:
        """Personal link of the first participant of a task."""
        return next(person.link for person in self.people if person.task == task)

    def await_ready(self) -> None:
        """Waits until people can come.

        Raises:
            StudyError: The program ended instead; its own message is on stderr.
        """
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line
            if _READY in line:
                break
        else:
            code = self.process.wait()
            raise StudyError(
                f"{' '.join(self._command[2:])}: ended with exit code {code}; expected a served study. "
                "Its own message is above."
            )
        found = _PERSON.findall(self.said)
        self.people = tuple(Person(code, "pan" if task == "PAN" else "pog", link) for task, code, link in found)

    def end(self, number: signal.Signals = signal.SIGINT) -> int:
        """Sends one signal, as a host or Ctrl-C does, if the program still runs; returns its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            self.process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self.kill()
        return self.process.returncode

    def kill(self) -> None:
        """Kills the serving process and its group (kill -9); the workers notice it by themselves, as after a crash."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self.process.communicate()


def serve_command(
    folder: Path,
    dataset: Path,
    *more: str,
    port: int = 0,
    workers: int | None = None,
    evidence: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
) -> list[str]:
    """The command line of `study serve` for a planned pilot, for `ServedStudy`.

    Args:
        folder: The study's folder.
        dataset: The dataset of its episodes.
        more: Further options.
        port: Port to listen on; 0 takes a free one.
        workers: Number of viser workers; None = the usual number.
        evidence: Folders of the dataset's evidence.
        scenes_dir: The folder of scans.
    """
    command = ["study", "serve", str(folder), "--dataset", str(dataset), "--port", str(port), "--pilot", *more]
    command += [] if workers is None else ["--workers", str(workers)]
    command += ["--evidence", *map(str, evidence)] if evidence else []
    return command + ([] if scenes_dir is None else ["--scenes-dir", str(scenes_dir)])


@contextmanager
def served(
    command: list[str], *, stderr: IO[str] | None = None, ended_by: signal.Signals = signal.SIGINT
) -> Iterator[ServedStudy]:
    """Runs the program for a block; at its end the program gets a signal, or is killed if the block fails.

    Args:
        command: As for `ServedStudy`.
        stderr: As for `ServedStudy`.
        ended_by: The signal at the end of the block.

    Raises:
        StudyError: The program ended before it served.
    """
    study = ServedStudy(command, stderr=stderr)
    try:
        study.await_ready()
        yield study
        study.end(ended_by)
    finally:
        if study.process.poll() is None:
            study.kill()


def hear_ctrl_c() -> None:
    """Makes Ctrl-C end this child process, even where the shell that started us ignores Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def free_port() -> int:
    """A port of this machine that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]

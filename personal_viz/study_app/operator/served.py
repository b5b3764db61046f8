"""A study served by a child process, as a person at a terminal would start it: for screenshots and browser tests."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sim.errors import StudyError


@dataclass(frozen=True, slots=True)
class ServedStudy:
    """A running `personal-viz demo` or `study serve`."""

    folder: Path
    """Of the study."""
    links: dict[str, str]
    """Task (`pan`, `pog`) to personal link."""
    process: subprocess.Popen[str]

    def end(self) -> int:
        """Exit code after one Ctrl-C."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(timeout=30)


def start_study(folder: Path, *command: str) -> ServedStudy:
    """Starts `personal-viz <command> --out <folder>` on a free port and returns when it has printed its links.

    Raises:
        StudyError: The program ended instead.
    """
    program = [sys.executable, "-m", "personal_viz", *command, "--out", str(folder), "--port", "0"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, process_group=0)
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if "Everything is written to" in line:
            break
    links = re.findall(r"(PAN|POG)\s+p\d+\s+(http://\S+)", "".join(lines))
    if not links:
        raise StudyError(f"{' '.join(program[2:])}: ended with exit code {process.wait()}; expected personal links.")
    return ServedStudy(folder, {task.lower(): link for task, link in links}, process)


@contextmanager
def served_demo(out: Path) -> Iterator[ServedStudy]:
    """The demo until the end of the block; its episodes are in `out/dataset`."""
    study = start_study(out, "demo", "--seed", "5")
    study = ServedStudy(out / "study", study.links, study.process)
    try:
        yield study
    finally:
        if study.process.poll() is None:
            study.end()

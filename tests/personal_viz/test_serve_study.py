"""`study serve` as a program: what it prints and refuses, and that SIGTERM leaves nothing running."""

import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from websockets.exceptions import ConnectionClosed

from human_study.store.records import read_study
from human_study.trial.events import Act
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.operator.served import served as served_by
from personal_viz.study_app.operator.service import ended_by_sigterm, serve_study, shown_live
from sim.errors import StudyError
from tests.human_study.small_world import study
from tests.human_study.stores import filled

from .flow_studies import children
from .gateways import KEY
from .program import assert_one_line, personal_viz
from .wire import enter


@contextmanager
def served(folder: Path, dataset: Path, *, workers: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The home Small served by some workers, and what was printed; standard error goes to `errors.txt`."""
    command = ["study", "serve", "--dataset", str(dataset), "--scene", "Small", "--out", str(folder / "study")]
    command += ["--port", "0", "--workers", str(workers)]
    with (folder / "errors.txt").open("a") as errors, served_by(command, stderr=errors) as program:
        yield program.process, program.said


def stored_steps(folder: Path) -> int:
    """Number of everybody's stored steps, after a check of the hash chains."""
    with read_study(folder) as reader:
        reader.check()
        trials = [trial.trial_id for code in reader.codes() for trial in reader.trials(code) if trial.trial_id]
        return sum(isinstance(line.event, Act) for trial_id in trials for line in reader.events(trial_id))


@pytest.mark.slow
def test_a_study_ends_by_either_signal_and_keeps_what_was_acknowledged_even_if_its_log_was_taken_away(
    tmp_path: Path, invented_root: Path
) -> None:
    tokens: set[str] = set()
    for number, first, num_workers in ((signal.SIGTERM, 0, 2), (signal.SIGINT, 3, 1)):
        with served(tmp_path, invented_root, workers=num_workers) as (process, said):
            lines = said.splitlines()
            found = [
                re.fullmatch(r"  (PAN|POG)  (p\d\d)  (http://127\.0\.0\.1:\d+/#[\w-]{22})", line) for line in lines
            ]
            links = {link.group(1): link.group(3) for link in found if link is not None}
            assert set(links) == {"PAN", "POG"}
            tokens |= {link.partition("#")[2] for link in links.values()}
            assert said.splitlines()[-1] == f"Everything is written to {tmp_path / 'study'}. Ctrl-C ends the study."
            workers = children(process.pid)
            assert len(workers) == num_workers
            with enter(links["PAN"]) as walker, enter(links["POG"]) as pointer:
                pointer.receive_until(lambda message: "Gui" in message["type"])
                walker.see_step(first)  # the second time it goes on where it was
                serve = ("study", "serve", "--dataset", invented_root, "--scene", "Small", "--port", "0")
                assert_one_line(
                    personal_viz(*serve, "--out", tmp_path / "study"), f"is in use by process {process.pid}; expected"
                )
                (tmp_path / "study" / "study.db-wal").unlink()
                for step in range(first, first + 3):
                    walker.press("Turn left (A or Left)")
                    walker.see_step(step + 1)  # only what is stored is shown
                process.send_signal(number)
                rest, _ = process.communicate(timeout=120)
                with pytest.raises(ConnectionClosed):
                    walker.receive_until(lambda _: False)
            assert process.returncode == 0
            assert rest.startswith(f"Stopped. Everything is in {tmp_path / 'study'}")
            assert not any(psutil.pid_exists(worker) for worker in workers)
        assert stored_steps(tmp_path / "study") == first + 3
    assert len(tokens) == 2, "links outlive the program"
    errors = (tmp_path / "errors.txt").read_text()
    assert errors.count("study.db-wal: was taken away while the study is served") == 2
    assert "127.0.0.1" not in errors
    assert not any(token in errors for token in tokens)


def test_sigterm_is_heard_as_ctrl_c_and_the_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), ended_by_sigterm():
        signal.raise_signal(signal.SIGTERM)
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


def test_prolific_without_codes_is_refused_before_anything_starts(tmp_path: Path) -> None:
    options = {"scenes_dir": None, "links": [], "platform_key": KEY, "options": ServeOptions(port=0, pilot=True)}
    with (
        filled(tmp_path, study(recruit={"kind": "prolific"})) as store,
        pytest.raises(StudyError, match=r"secrets\.toml: holds no \[prolific\] codes; expected them"),
    ):
        serve_study(store, folder=tmp_path, dataset=tmp_path, **options)


def test_one_recording_for_many_trials_is_refused(tmp_path: Path) -> None:
    with (
        filled(tmp_path) as store,
        pytest.raises(StudyError, match=r"--rerun x\.rrd: this study has \d+ trials; expected one"),
        shown_live("x.rrd", store.plan),
    ):
        pass

"""A killed run of the verb `ground` on oracle maps of two homes continues where it stopped."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from grounding.evaluation.evaluate import SceneGrounder
from personal_viz.cli.verbs import parse
from sim.episodes.schema import Episode
from sim.tasks.run_files import Answer

KILLED_AFTER = """
import os, signal, sys
from grounding.evaluation import evaluate
from personal_viz.cli.verbs import parse
from sim.tasks.run_writer import RunWriter

evaluate._WRITE_EVERY_S = 0.0
write, number = RunWriter.add_answers, int(sys.argv[1])

def write_and_die(self, answers, *, chat):
    write(self, answers, chat=chat)
    if len(self.done) >= number:
        os.kill(os.getpid(), signal.SIGKILL)

RunWriter.add_answers = write_and_die
parse(sys.argv[2:]).run()
"""


@pytest.mark.slow
def test_a_killed_run_keeps_its_answers_and_a_second_call_gives_the_rest(
    small_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["ground", "--dataset", str(small_root), "--method", "rpg", "--phrases", "rules", "--run-id", "run"]
    command = [sys.executable, "-c", KILLED_AFTER, "6", *options, "--out", str(tmp_path / "killed")]
    died = subprocess.run(command, capture_output=True, text=True, check=False)
    assert died.returncode == -signal.SIGKILL, died.stderr
    killed, whole = tmp_path / "killed" / "run", tmp_path / "whole" / "run"
    before, info = (killed / "answers.jsonl").read_bytes(), (killed / "run.json").read_bytes()
    assert before.count(b"\n") == 6, "five of HomeOne, one of HomeTwo"

    asked = []
    answer = SceneGrounder.answer

    def counted(self: SceneGrounder, episode: Episode) -> Answer:
        asked.append(episode.key)
        return answer(self, episode)

    monkeypatch.setattr(SceneGrounder, "answer", counted)
    assert parse([*options, "--out", str(tmp_path / "killed")]).run() == 0
    assert len(asked) == 5, "11 answers in all, and no episode is answered twice"
    after = (killed / "answers.jsonl").read_bytes()
    assert after.startswith(before)
    assert (killed / "run.json").read_bytes() == info
    assert parse([*options, "--out", str(tmp_path / "whole")]).run() == 0
    assert (whole / "answers.jsonl").read_bytes() == after

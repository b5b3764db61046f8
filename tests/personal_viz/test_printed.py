"""No name of a file or in a file reaches the terminal as a control sequence."""

import io
import json
import os
import re
import sys
from pathlib import Path

import pytest
from rich.table import Table

from personal_viz.printed import Console, one_line, printable, printable_streams
from sim.tasks.run_writer import RunWriter
from tests.grounding.pog_runs import answer_to, keys, run_of

from .program import personal_viz

CONTROL = "\x1b]0;owned\x07\x1b[2J\u202egnp\x85\x9b31m\x00"
REFUSED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]")


def test_controls_are_shown_as_json_would_and_the_rest_stays() -> None:
    assert printable("a\x1b[31mb\u202e\ud800") == "a\\u001b[31mb\\u202e\\ud800"
    assert printable("Größe\t1 m²\n→ 家") == "Größe\t1 m²\n→ 家"
    assert one_line("a\nb\r\n c\x07") == "a b c\\u0007"
    assert json.loads(printable(json.dumps({"x": CONTROL}, ensure_ascii=False))) == {"x": CONTROL}


def test_prints_and_tables_are_filtered_and_tables_keep_their_own_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    out = Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setenv("TERM", "xterm-256color")
    with printable_streams():
        print(f"Written to {CONTROL}")
        table = Table(title=CONTROL)
        table.add_column(CONTROL)
        table.add_row(f"[bold]{CONTROL}")
        Console(file=sys.stdout, force_terminal=True, width=200).print(table, CONTROL)
    assert sys.stdout is out
    assert "\x1b[" in out.getvalue()  # Rich's own
    assert not REFUSED.search(re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue()))
    assert "owned" in out.getvalue()


def test_names_of_files_and_names_in_files_are_printed_without_control_characters(tmp_path: Path) -> None:
    def call(*arguments: str) -> str:
        done = personal_viz(*arguments)
        assert not REFUSED.search(done.stdout + done.stderr)
        return done.stdout + done.stderr

    odd = CONTROL.replace("\x00", "") + os.fsdecode(b"\xff")
    folder = tmp_path / odd
    folder.mkdir()
    assert "\\u001b" in call("metrics", str(folder))
    assert "\\udcff" in call("validate", "--dataset", str(folder))
    assert "\\u001b" in call("show-map", str(folder / "map.npz"), "--out", str(tmp_path / "x.rrd"))
    run = tmp_path / "run"
    write_run(run, who="somebody")
    for name, said in ((CONTROL.replace("\x00", ""), "who is"), ("two\nlines", "who is"), ("\u202etfel", "\\u202e")):
        text = (run / "run.json").read_text()
        (run / "run.json").write_text(text.replace('"who": "somebody"', f'"who": {json.dumps(name)}'))
        for verb in (["metrics", str(run)], ["pog-report", str(run), "--out", str(folder / "report")]):
            assert said in call(*verb)
        (run / "run.json").write_text(text)


def test_no_module_draws_tables_past_the_filter() -> None:
    package = Path(__file__).parents[2] / "personal_viz"
    past = [path.name for path in package.rglob("*.py") if "from rich.console import Console" in path.read_text()]
    assert past == []


def write_run(folder: Path, *, who: str) -> None:
    """A run folder with answers; `who` is the name that a hostile file gives."""
    run = run_of(who, [answer_to(key, 0.5) for key in keys("easy", 1, 2)], run_id="run")
    writer = RunWriter(folder, run.info)
    writer.add_answers(run.answers)

"""The parts that all benchmarks share: figures beside targets and references, one table, one JSON, one command."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from personal_viz.bench import recordings
from personal_viz.bench.harness import (
    Findings,
    Machine,
    Plan,
    Report,
    Target,
    interleaved,
    markdown,
    run_benchmark,
    tables,
)
from personal_viz.bench.page import rewritten
from personal_viz.cli.bench import Bench
from sim.errors import PersonalVizError

MACHINE = Machine(cpu="Abacus", cores=2, load=0.1, python="3.11", versions={"numpy": "2"})
PLAN = Plan(
    targets={
        "b1.ours_ms": Target(10.0),
        "b1.ours_over_theirs": Target(2.0, at_least=True, goal="3"),
        "b64.ours_ms": Target(10.0),
        "cold_s.big": Target(60.0),
        "left_out.ours_ms": Target(10.0),
    },
    references={"ours_ms": "theirs_ms"},
    units={"rays": "rays/s"},
)


def case(ours_ms: float, theirs_ms: float) -> dict[str, float]:
    return {"ours_ms": ours_ms, "theirs_ms": theirs_ms, "ours_over_theirs": theirs_ms / ours_ms}


def made_up() -> Report:
    values = {"b1": case(10.0, 20.0), "b64": case(10.01, 20.0), "rays": 1234.5, "kind": "synthetic", "cold_s": {}}
    found = Findings(values, notes=("By hand.",), problems=("x",), seconds=3.0)
    return run_benchmark("test", lambda: found, PLAN, quick=True).model_copy(update={"machine": MACHINE})


def test_a_figure_on_its_limit_meets_the_target_and_one_beyond_does_not() -> None:
    report = made_up()
    met = {figure.name: figure.met for figure in report.figures if figure.target}
    assert met == {"b1.ours_ms": True, "b1.ours_over_theirs": True, "b64.ours_ms": False, "cold_s.big": None}
    assert report.missed() == ["b64.ours_ms"]


def test_figures_have_units_and_stand_beside_the_reference_of_the_same_case() -> None:
    found = {figure.name: figure for figure in made_up().figures}
    assert (found["b64.ours_ms"].unit, found["b64.ours_ms"].reference) == ("ms", 20.0)
    assert found["b64.ours_ms"].reference_name == "b64.theirs_ms"
    assert (found["rays"].unit, found["rays"].reference) == ("rays/s", None)
    assert "kind" not in found


def test_cases_with_the_same_figures_share_a_table() -> None:
    (title, targets), *others = tables(made_up())
    assert title == "Targets"
    assert targets[2] == ["b1.ours_over_theirs", ">= 2 (goal 3)", "2", "yes"]
    assert targets[-1] == ["cold_s.big", "<= 60", "-", "not measured"]
    heads = [rows[0] for _, rows in others]
    assert ["figure", "unit", "b1", "b64"] in heads
    assert ["figure", "unit", "found"] in heads
    text = markdown(made_up())
    assert "| rays | rays/s | 1,234 |" in text
    assert "Abacus, 2 cores, load 0.1" in text
    assert "- By hand." in text
    assert text.endswith("## Problems\n\n- x\n")


def test_the_command_prints_json_or_writes_it_where_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(recordings, "PLAN", PLAN)
    monkeypatch.setattr(
        recordings, "measure", lambda settings, progress: Findings({"b64": case(10.01, 20.0), "cold_s": {}})
    )
    out, file = tmp_path / "out", tmp_path / "figures" / "recordings.json"
    assert Bench("recordings", out=out, quick=True, json=()).run() == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["b64"]["theirs_ms"] == 20.0
    assert [figure["name"] for figure in printed["figures"] if figure["met"] is False] == ["b64.ours_ms"]
    assert printed == json.loads((out / "bench-recordings.json").read_text())
    assert (out / "bench-recordings.md").read_text().startswith("# Benchmark recordings (quick)\n")
    assert Bench("recordings", out=out, json=(file,)).run() == 0
    assert "not measured" in capsys.readouterr().out
    assert set(json.loads(file.read_text())) == set(printed)


def test_a_place_that_cannot_be_written_is_found_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(PersonalVizError, match=r"file/bench: cannot be written \(Not a directory\); expected"):
        Bench("sim", out=tmp_path / "file" / "bench").run()
    with pytest.raises(PersonalVizError, match="cannot be written"):
        Bench("sim", out=tmp_path / "out", json=(tmp_path / "file" / "x.json",)).run()
    with pytest.raises(PersonalVizError, match="found 2 files; expected at most one"):
        Bench("sim", out=tmp_path, json=(tmp_path / "a", tmp_path / "b")).run()


def test_functions_are_called_in_turn_after_a_warm_up() -> None:
    called: list[str] = []
    work = {"a": lambda k: called.append(f"a{k}"), "b": lambda k: called.append(f"b{k}")}
    found = interleaved(work, calls=2, rounds=2, warm_ups=1)
    assert called == ["a0", "b0", "a0", "b0", "a1", "b1", "a0", "b0", "a1", "b1"]
    assert set(found) == {"a", "b"}


def test_a_process_knows_for_how_long_it_has_run() -> None:
    code = "import time; from personal_viz.bench.harness import *; print(time.time() - since_process_start_s())"
    before = time.time()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert before - 1.5 <= float(done.stdout) <= time.time()  # systems tell a start to about a second


def test_the_page_of_figures_is_rewritten_where_it_has_a_place_for_them(tmp_path: Path) -> None:
    (tmp_path / "test.json").write_text(json.dumps(made_up().document()))
    page = (
        "# Figures\n<!-- figures: test -->\nold\n<!-- end -->\nkept\n<!-- figures: other -->\nkept too\n<!-- end -->\n"
    )
    text = rewritten(page, tmp_path)
    assert "| b64.ours_ms | 10 | ms | theirs_ms 20 | <= 10 | no |" in text
    assert "a quick run: Abacus, 2 cores" in text
    assert "old" not in text
    assert text.endswith("<!-- end -->\nkept\n<!-- figures: other -->\nkept too\n<!-- end -->\n")
    assert rewritten(text, tmp_path) == text

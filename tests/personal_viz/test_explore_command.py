"""The verb `explore`: files, figures, going on, and options that are refused; `run --agent random-frontier`."""

import json
from pathlib import Path

import pytest

from grounding.exploration_files import load_exploration
from personal_viz.cli import parse
from personal_viz.commands import explore as verb
from personal_viz.commands.runs import SHORT_NAMES
from sim.errors import AgentError, PersonalVizError, RunFileError
from sim.tasks.agents import load_agent

OPTIONS = ["explore", "--homes", "1", "--width", "48", "--height", "36", "--max-steps", "30"]


def test_one_home_gives_a_file_a_plot_and_figures_and_a_second_call_reads_them(tmp_path: Path, capsys) -> None:
    options = [*OPTIONS, "--out", str(tmp_path), "--json"]
    assert parse(options).work() == 0
    document = json.loads(capsys.readouterr().out)
    (row,) = document["homes"]
    assert {"steps", "coverage", "doors_passed", "stop_reason", "rooms_missed"} <= set(row)
    assert (row["scene"], row["steps"], row["stop_reason"]) == ("Invented0", 30, "steps")
    assert (document["scene_kind"], document["n"]) == ("invented", 1)
    assert document["coverage"]["min"] == row["coverage"] == document["coverage"]["mean"]
    assert (tmp_path / "coverage.png").read_bytes()[:4] == b"\x89PNG"
    (path,) = tmp_path.glob("Invented0*.json")
    written = path.stat().st_mtime_ns
    assert len(load_exploration(path).steps) == 30
    assert parse([*OPTIONS, "--out", str(tmp_path)]).work() == 0
    assert path.stat().st_mtime_ns == written
    assert "Mean coverage" in capsys.readouterr().out
    with pytest.raises(RunFileError, match="expected seed 1"):
        parse([*OPTIONS, "--seed", "1", "--out", str(tmp_path)]).work()


def test_a_dataset_or_a_number_of_homes_is_needed(tmp_path: Path) -> None:
    fields = {"scene": (), "scenes_dir": None, "storeys": "start", "seed": 0, "max_steps": 5, "width": 8, "height": 6}
    with pytest.raises(PersonalVizError, match="expected one"):
        verb.explore(dataset=None, homes=None, jobs=1, out=tmp_path, json=False, **fields)
    with pytest.raises(PersonalVizError, match="whole numbers from 1"):
        verb.explore(dataset=None, homes=1, jobs=1, out=tmp_path, json=False, **{**fields, "width": 0})


def test_random_frontier_is_a_name_of_run_and_others_are_refused(tmp_path: Path) -> None:
    assert type(load_agent(SHORT_NAMES["random-frontier"])).__name__ == "RandomFrontierAgent"
    from personal_viz.commands.runs import _require_agent

    _require_agent("random-frontier")
    with pytest.raises(AgentError, match="random-frontier"):
        _require_agent("frontier")

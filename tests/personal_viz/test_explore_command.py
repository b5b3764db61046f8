"""The verb `explore`: files, figures, going on, and options that are refused; `run --agent random-frontier`."""

import json
import os
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import get_type_hints

import pytest

from grounding.agents import exploration_jobs as jobs_module
from grounding.agents.exploration import load_exploration
from grounding.agents.explore import EXPLORER_VERSION
from personal_viz.__main__ import main
from personal_viz.cli.grounding.explore import Explore
from personal_viz.cli.runs.named_agents import RANDOM_FRONTIER
from personal_viz.cli.verbs import parse
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError, RunFileError
from sim.tasks.agents import load_agent
from sim.tasks.provenance import git_commit, package_versions
from sim.types import Split

from ..grounding.small_homes import write_small_dataset
from ..grounding.two_rooms import two_room_scene
from ..sim.synthetic import Content, example_content, example_goal, lattice, write_dataset
from .program import assert_one_line, personal_viz

OPTIONS = ["explore", "--homes", "1", "--width", "48", "--height", "36", "--max-steps", "30"]


@pytest.mark.slow
def test_one_home_gives_a_file_a_plot_and_figures_and_a_second_call_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(
        jobs_module, "invented_home", lru_cache(jobs_module.invented_home)
    )  # made once, not three times
    options = [*OPTIONS, "--out", str(tmp_path), "--json"]
    assert parse(options).run() == 0
    document = json.loads(capsys.readouterr().out)
    (row,) = document["homes"]
    assert {"steps", "coverage", "doors_passed", "stop_reason", "rooms_missed"} <= set(row)
    assert (row["scene"], row["steps"], row["stop_reason"]) == ("Invented0", 30, "steps")
    assert (document["scene_kind"], document["n"]) == ("invented", 1)
    assert document["coverage"]["min"] == row["coverage"] == document["coverage"]["mean"]
    assert (tmp_path / "coverage.png").read_bytes()[:4] == b"\x89PNG"
    assert document["config"] == {"max_steps": 30, "storeys": "start", "homes": 1}
    assert document["dataset_digest"] is None, "an invented home comes from its seed"
    assert document["git_commit"] == git_commit()
    assert document["versions"] == package_versions()
    assert document["created_utc"].endswith("+00:00")
    assert json.loads((tmp_path / "explore.json").read_text()) == document
    (path,) = tmp_path.glob("Invented0*.json")
    assert (row["scene_digest"], document["policy"]) == (load_exploration(path).scene_digest, EXPLORER_VERSION)
    written = path.stat().st_mtime_ns
    assert len(load_exploration(path).steps) == 30
    assert parse([*OPTIONS, "--out", str(tmp_path)]).run() == 0
    assert path.stat().st_mtime_ns == written
    assert "Mean coverage" in capsys.readouterr().out
    with pytest.raises(RunFileError, match="expected seed 1"):
        parse([*OPTIONS, "--seed", "1", "--out", str(tmp_path)]).run()


@pytest.mark.slow
def test_shards_leave_to_the_command_without_them_the_figures_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(jobs_module, "invented_home", lru_cache(jobs_module.invented_home))
    options = ["explore", "--homes", "2", *OPTIONS[3:]]
    for number, found in ((2, "Invented1"), (1, "Invented0")):
        assert parse([*options, "--out", str(tmp_path / "parts"), "--shard", f"{number}/2"]).run() == 0
        assert list((tmp_path / "parts").glob(f"{found}*.json"))
        assert not (tmp_path / "parts" / "explore.json").exists()
    written = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    for out in ("parts", "whole"):
        assert parse([*options, "--out", str(tmp_path / out)]).run() == 0
    assert {name: (tmp_path / "parts" / name).stat().st_mtime_ns for name in written} == written
    assert figures(tmp_path / "parts") == figures(tmp_path / "whole")


def test_a_dataset_or_a_number_of_homes_is_needed(tmp_path: Path) -> None:
    with pytest.raises(PersonalVizError, match="expected one"):
        Explore(out=tmp_path).run()
    with pytest.raises(PersonalVizError, match=r"--homes is 0; expected a whole number from 1"):
        Explore(homes=0, out=tmp_path).run()
    with pytest.raises(PersonalVizError, match=r"--width is 0; expected a whole number from 1"):
        Explore(homes=1, width=0, out=tmp_path).run()


def test_every_option_of_the_verb_says_what_it_is() -> None:
    hints = get_type_hints(Explore, include_extras=True)
    assert [name for name, hint in hints.items() if not getattr(hint, "__metadata__", ())] == []


def test_random_frontier_is_a_name_of_run_and_others_are_refused() -> None:
    assert type(load_agent(RANDOM_FRONTIER.name)).__name__ == "RandomFrontierAgent"
    done = personal_viz("run", "--dataset", "none", "--agent", "frontier")
    assert_one_line(done, "--agent is 'frontier'; expected random, random-frontier, vlfm, onemap, vlfm-geometry")


def figures(out: Path) -> dict:
    """`explore.json` without the fields that differ between two calls."""
    return {**json.loads((out / "explore.json").read_text()), "created_utc": None, "out": None}


def write_three_storeys(root: Path) -> None:
    """HomeOne has floors at 0 and 3 m, HomeTwo one at 0 m, each with enough places to be a storey."""
    contents: dict[tuple[Split, str], Content] = {}
    for scene, floors in (("HomeOne", (0.0, 3.0)), ("HomeTwo", (0.0,))):
        table = example_goal(view_points=[point for y in floors for point in lattice(1.0, y=y)])
        goals = {f"{scene}.basis.glb_coffee table": [table]}
        contents["easy", scene] = example_content(scene=scene, goals_by_category=goals)
    write_dataset(root, contents)


@pytest.mark.slow
def test_two_worker_processes_give_the_documents_that_one_gives(tmp_path: Path, monkeypatch, capsys) -> None:
    write_three_storeys(tmp_path / "dataset")
    monkeypatch.setattr("personal_viz.cli.grounding.explore.coverage_png", lambda found, *, title, label: b"")
    options = ["explore", "--dataset", str(tmp_path / "dataset"), "--storeys", "all", "--max-steps", "6"]
    for jobs in ("1", "2"):
        small = [*options, "--width", "32", "--height", "24", "--jobs", jobs, "--out", str(tmp_path / jobs)]
        assert parse(small).run() == 0
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / jobs).glob("Home*")} for jobs in ("1", "2"))
    assert sorted(name.split(".")[0] for name in one) == ["HomeOne-0", "HomeOne-3", "HomeTwo-0"]
    assert two == one
    assert figures(tmp_path / "2") == figures(tmp_path / "1")


class DiesOnArrival:
    """Ends the worker process that receives it."""

    def __reduce__(self) -> tuple:
        return os._exit, (1,)


@pytest.mark.slow
def test_a_worker_process_that_is_ended_from_outside_gives_one_line(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(Explore, "_jobs", lambda options, names: [DiesOnArrival() for _ in names])
    monkeypatch.setattr(sys, "argv", ["personal-viz", "explore", "--homes", "2", "--jobs", "2", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "--jobs 2: a worker process was ended from outside; expected all to finish. " in line
    assert "run again with fewer --jobs" in line
    assert not (tmp_path / "explore.json").exists()


def test_a_datasets_digest_stands_with_the_figures(tmp_path: Path, monkeypatch, capsys) -> None:
    write_small_dataset(tmp_path / "dataset")
    home = replace(two_room_scene(), name="HomeTwo")
    monkeypatch.setattr(jobs_module, "_opened", lambda job: (home, None))
    options = [*OPTIONS[3:-1], "4", "--dataset", str(tmp_path / "dataset"), "--scene", "HomeTwo", "--json"]
    assert parse(["explore", *options, "--out", str(tmp_path / "out")]).run() == 0
    document = json.loads(capsys.readouterr().out)
    assert document["dataset_digest"] == PersonalDataset(tmp_path / "dataset").digest()
    assert (document["scene_kind"], document["rooms_missed"], document["config"]["homes"]) == ("schematic", None, None)

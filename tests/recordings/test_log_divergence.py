"""Marks where runs leave the shortest path and where the best person and the best agent part."""

import re

import numpy as np
import pytest

from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.run_files import Run

from .conftest import info
from .reading import Tables, record

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


@pytest.fixture(scope="module")
def found(
    tmp_path_factory: pytest.TempPathFactory,
    home: Scene,
    episode: Episode,
    renderer: Raycaster,
    agent_run: Run,
    human_run: Run,
) -> Tables:
    """The recording of a person who walks 2.25 m towards the bed, an agent, and a copy of the agent, not shown."""
    copy = agent_run.model_copy(update={"info": info("copy")})
    out = tmp_path_factory.mktemp("rrd") / "a.rrd"
    return record(out, [agent_run, human_run, copy], episode, home, renderer=renderer)


def test_a_cross_marks_the_place_and_step_at_which_a_run_leaves_the_path(found: Tables, human_run: Run) -> None:
    columns = found[("/runs/study-P07/departure", False)]
    (row,) = columns["step"]
    strokes = np.array(columns["LineStrips3D:strips"][0])
    feet = np.array(human_run.episodes[0].poses[row].position)
    assert strokes.shape == (2, 2, 3)
    assert strokes.mean(axis=(0, 1)) == pytest.approx(feet + np.array([0, 0.15, 0]), abs=1e-5)
    assert columns["LineStrips3D:labels"][0][0] == "human-P07 leaves the shortest path"
    strayed = [value[0] for value in found[("/runs/study-P07/path_deviation", False)]["Scalars:scalars"]]
    assert strayed[0] == pytest.approx(0, abs=1e-6)
    assert strayed[row - 1] <= 1.0 < strayed[row]
    assert columns["time_s"][0] / 1e9 == pytest.approx(row / 2)
    text = found[("/task", True)]["TextDocument:text"][0][0]
    walked = columns["path_m"][0] / 1e9
    line = f"| human-P07 | after {walked:.1f} m (step {row}) | {max(strayed):.1f} m |"
    figures = text[text.index(line) + len(line) :].split("\n")[0]
    dtw, ndtw, end = re.fullmatch(r" (\d\.\d\d) m \| (0\.\d\d) \| (\d\.\d\d) m \|", figures).groups()  # type: ignore
    assert 0 < float(dtw) < float(end)
    assert 0 < float(ndtw) < 1


def test_a_diamond_on_each_of_two_paths_marks_where_they_part(found: Tables, agent_run: Run, human_run: Run) -> None:
    places = {}
    titles = ["human-P07", "straight.agent"]
    for label, run, (title, other) in (("study-P07", human_run, titles), ("straight.agent", agent_run, titles[::-1])):
        columns = found[(f"/runs/{label}/parting", False)]
        (row,) = columns["step"]
        (outline,) = np.array(columns["LineStrips3D:strips"][0])
        assert columns["LineStrips3D:labels"][0] == [f"{title} parts from {other}"]
        feet = np.array(run.episodes[0].poses[row].position)
        assert outline[:-1].mean(axis=0) == pytest.approx(feet + np.array([0, 0.15, 0]), abs=1e-5)
        places[label] = row
        flat = found[(f"/runs/{label}/map/storey_0/parting", False)]
        assert flat["step"] == [row]
    text = found[("/task", True)]["TextDocument:text"][0][0]
    assert "The ways of human-P07 and straight.agent part: human-P07 after" in text
    assert f"(step {places['study-P07']}), straight.agent after" in text
    taken = [[step.action for step in run.episodes[0].steps] for run in (human_run, agent_run)]
    number = next(number for number, (one, other) in enumerate(zip(*taken, strict=False), start=1) if one != other)
    assert f"Their first different decision is number {number}." in text


def test_every_straying_run_has_a_cross_and_only_the_shown_pair_has_diamonds_and_large_pictures(found: Tables) -> None:
    crosses = [found[(f"/runs/{label}/departure", False)] for label in ("straight.agent", "copy")]
    assert crosses[0]["step"] == crosses[1]["step"]
    assert [columns["LineStrips3D:show_labels"] for columns in crosses] == [[[False]]] * 2
    assert ("/runs/copy/parting", False) not in found
    sizes = {
        label: found[(f"/runs/{label}/camera", True)]["Pinhole:resolution"][0][0]
        for label in ("straight.agent", "study-P07", "copy")
    }
    assert sizes == {"straight.agent": [64, 48], "study-P07": [64, 48], "copy": [32, 24]}


def test_the_last_picture_shows_the_end_of_the_run_and_a_run_without_times_has_a_note(found: Tables) -> None:
    ended = found[("/runs/study-P07/camera/ended", False)]
    assert ended["step"] == [14]
    assert ended["Boxes2D:labels"] == [["gave up after 14 steps: no success"]]
    assert ended["Boxes2D:half_sizes"] == [[[32.0, 24.0]]]
    ended = found[("/runs/straight.agent/camera/ended", False)]
    assert (ended["step"], ended["Boxes2D:labels"]) == ([40], [["stopped after 40 steps: success"]])
    note = found[("/runs/straight.agent/camera/no_clock", False)]
    assert "step" not in note
    assert (note["time_s"], note["Boxes2D:labels"][0]) == (
        [0],
        ["measured no time: choose the timeline step or path_m"],
    )
    assert ("/runs/study-P07/camera/no_clock", False) not in found

"""The examples run, and do what they say."""

from pathlib import Path

import numpy as np
import pytest

from personal_viz.examples.example_1_explaining_agent import GRID, ExplainingAgent, make
from sim.checks import check_agent, check_home
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.observers import FREE, OCCUPIED, Insight
from sim.tasks.pan import PanEnv
from sim.types import Action, Pose, Task

from .invented import invented_dataset

EXAMPLES = Path(__file__).resolve().parents[2] / "personal_viz" / "examples"


@pytest.fixture(scope="module")
def home() -> Scene:
    return check_home()


def explore(home: Scene, steps: int) -> tuple[list[Action], list[Insight]]:
    """What the agent does in a small home, and why."""
    x, y, z = home.navigation.random_point(np.random.default_rng(0), storey_y=home.navigation.storey_heights[0])
    env = PanEnv(Pose((x, y, z), 0.3), home.navigation, renderer=Raycaster(home.mesh), max_steps=steps)
    agent = make()
    agent.reset(Task("pan", "", ("Find it",)), env.camera, seed=0)
    observation, insights = env.reset(), []
    while not env.is_over:
        observation = env.step(agent.act(observation))
        insight = agent.insight()
        assert insight is not None
        insights.append(insight)
    return [step.action for step in env.steps], insights


def known(insight: Insight) -> float:
    assert insight.occupancy is not None
    return float((insight.occupancy == FREE).sum()) * GRID.cell**2


def test_no_example_is_longer_than_100_lines() -> None:
    lengths = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.glob("example_*.py")}
    assert lengths
    assert not {name: length for name, length in lengths.items() if length > 100}


@pytest.mark.slow
def test_the_explaining_agent_looks_around_then_walks_to_frontiers(home: Scene) -> None:
    actions, insights = explore(home, 60)
    assert actions[:12] == [Action.LEFT] * 12
    assert actions.count(Action.FORWARD) > 10
    assert insights[0].note == "looking around"
    assert insights[20].note.startswith("nearest frontier, ")
    assert insights[20].goal is not None
    assert known(insights[0]) < known(insights[11]) < known(insights[-1])
    last = insights[-1].occupancy
    assert last is not None
    assert (last == OCCUPIED).any()


@pytest.mark.slow
def test_the_explaining_agent_keeps_the_contract() -> None:
    assert check_agent(ExplainingAgent) == []


@pytest.mark.slow
def test_the_explaining_agent_is_shown_with_all_that_it_explains(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    from personal_viz.cli.run import Run

    invented_dataset(tmp_path / "homes", name="Demo", seed=1)
    Run(
        agent="personal_viz.examples.example_1_explaining_agent:make",
        dataset=tmp_path / "homes",
        out=tmp_path / "runs",
        scenes_dir=None,
        scene=(),
        split=("easy",),
        limit=1,
        seed=0,
        jobs=1,
        run_id="explorer",
        rerun=str(tmp_path / "live"),
    ).work()
    (rrd,) = (tmp_path / "live").iterdir()
    reader = RrdReader(str(rrd))
    shown = {chunk.entity_path for chunk in reader.stream(store=reader.recordings()[0])}
    names = {"camera", "depth", "note", "chosen", "frontiers", "map/storey_0/seen", "map/storey_0/occupancy"}
    assert {f"/runs/explorer/{name}" for name in names} <= shown

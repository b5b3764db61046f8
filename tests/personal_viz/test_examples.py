"""The examples run, and do what they say."""

from pathlib import Path

import numpy as np
import pytest

from grounding import check_encoder
from personal_viz.cli.runs.run import Run
from personal_viz.examples.example_1_look_at_an_episode import look
from personal_viz.examples.example_2_your_own_agent import GRID, ExplainingAgent
from personal_viz.examples.example_3_your_own_encoder import nearest
from personal_viz.examples.example_4_a_study_in_code import plan, show
from personal_viz.examples.example_5_agent_beside_people import beside
from sim.checks import check_agent, check_home
from sim.episodes.dataset import PersonalDataset
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
    """The agent's actions in a small home, and its reasons."""
    x, y, z = home.navigation.random_point(np.random.default_rng(0), storey_y=home.navigation.storey_heights[0])
    env = PanEnv(Pose((x, y, z), 0.3), home.navigation, renderer=Raycaster(home.mesh), max_steps=steps)
    agent = ExplainingAgent()
    agent.reset(Task("pan", "", ("Find it",)), env.camera, seed=0)
    observation, insights = env.reset(), []
    while not env.is_over:
        observation = env.step(agent.act(observation))
        insight = agent.insight()
        assert insight is not None
        insights.append(insight)
    return [step.action for step in env.steps], insights


def known(insight: Insight) -> float:
    return float((insight.occupancy == FREE).sum()) * GRID.cell**2


def test_an_episode_is_looked_at(small_home_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key = str(next(PersonalDataset(small_home_root).episodes()).key)
    assert look(small_home_root, key, out=tmp_path) > 0.5
    assert capsys.readouterr().out.startswith(key)
    assert all((tmp_path / name).stat().st_size > 2000 for name in ("first_view.png", "from_above.png"))


@pytest.mark.slow
def test_the_encoder_keeps_the_contract_and_finds_things(small_home_root: Path) -> None:
    name = "personal_viz.examples.example_3_your_own_encoder:make"
    assert check_encoder(name) == []
    assert nearest(small_home_root, name) < 15


def test_a_study_is_planned_in_code(small_home_root: Path, tmp_path: Path) -> None:
    plan(small_home_root, tmp_path / "study")
    lines = show(tmp_path / "study")
    assert len(lines) >= 2
    assert lines[0].startswith("p01 (PAN): ")


@pytest.mark.slow
def test_an_agent_stands_beside_people(small_home_root: Path, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    Run(dataset=small_home_root, agent="random", out=tmp_path, limit=1, split=("easy",), run_id="person").run()
    beside(small_home_root, [tmp_path / "person"], tmp_path / "pair.rrd")
    reader = RrdReader(str(tmp_path / "pair.rrd"))
    shown = {chunk.entity_path for chunk in reader.stream(store=reader.recordings()[0])}
    assert {"/runs/person/camera", "/runs/explainer/camera"} <= shown


def test_no_example_is_longer_than_100_lines() -> None:
    lengths = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.glob("example_*.py")}
    assert len(lengths) == 5
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
    assert (last == OCCUPIED).any()


@pytest.mark.slow
def test_the_explaining_agent_keeps_the_contract() -> None:
    assert check_agent(ExplainingAgent) == []


@pytest.mark.slow
def test_the_explaining_agent_is_shown_with_all_that_it_explains(tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    invented_dataset(tmp_path / "homes", name="Demo", seed=1)
    Run(
        agent="personal_viz.examples.example_2_your_own_agent:ExplainingAgent",
        dataset=tmp_path / "homes",
        out=tmp_path / "runs",
        split=("easy",),
        limit=1,
        run_id="explorer",
        rerun=str(tmp_path / "live"),
    ).run()
    (rrd,) = (tmp_path / "live").iterdir()
    reader = RrdReader(str(rrd))
    shown = {chunk.entity_path for chunk in reader.stream(store=reader.recordings()[0])}
    names = {"camera", "depth", "note", "chosen", "frontiers", "map/storey_0/seen", "map/storey_0/occupancy"}
    assert {f"/runs/explorer/{name}" for name in names} <= shown

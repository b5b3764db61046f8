"""Measures a step of VLFM and OneMap without their models, beside the same maps in their literal forms.

Replayed walks (agent_walks.py) -> CPU time of `act`, of the planner alone, of the maps alone and of the literal forms
(literal_maps.py), which must give the same maps.
"""

import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from pydantic import BaseModel, ConfigDict

from grounding.agents.onemap.agent import OneMapAgent
from grounding.agents.onemap.feature_grid import FeatureGrid
from grounding.agents.seeking import Seeker
from grounding.agents.vlfm.agent import VlfmAgent
from grounding.agents.vlfm.explored import ExploredArea
from grounding.agents.vlfm.value_map import ValueMap
from grounding.perception.protocol import Perception
from sim.frames import planar_distance
from sim.mesh import Scene
from sim.tasks.agents import Agent
from sim.types import Camera, Pose

from .agent_walks import PATCHES, SEED, Walk, bench_home, walked
from .harness import Findings, Plan, Progress, Target
from .literal_maps import LiteralFeatures, LiteralValues

PLAN = Plan(
    targets={
        "vlfm_ms": Target(10.0),
        "onemap_ms": Target(60.0),
        "literal_over_vlfm": Target(4.0, at_least=True),
        "literal_over_onemap": Target(4.0, at_least=True),
        "mb": Target(400.0),
    },
    units={"vlfm_ms": "core-ms", "onemap_ms": "core-ms", "planner_ms": "core-ms"},
)
"""Targets of issue 19, section 2."""
REACHES, SAME_GOAL = (0.25, 0.75), 0.1
"""How near to a goal a way may end, and how near to the last goal one counts as the same; metres, as VLFM plans."""


class AgentSettings(BaseModel):
    """Sizes and numbers of the measured steps."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    width: int = 640
    height: int = 480
    steps: int = 120
    """Steps of each walk at most that are measured."""
    memory_steps: int = 500
    """Steps at most of the walks in which memory is measured: a whole episode."""
    rounds: int = 5
    """How many times each walk is replayed; each step counts with its median."""
    literal_views: int = 12
    """Number of views, spread over the walk, that the literal forms add."""


FULL = AgentSettings()
QUICK = AgentSettings(steps=40, memory_steps=40, rounds=2, literal_views=4)
_ABSENT = "red piano"
"""What the agents look for first: the home has none, so they explore. Then they look for the thing farthest away."""


def measure(settings: AgentSettings, progress: Progress) -> Findings:
    """Measures everything in one run.

    Returns:
        Values: `vlfm_ms` and `onemap_ms`, mean CPU milliseconds of a step without the model, on the dearer of two
        walks: with a target in the home and without; `literal_over_vlfm` and
        `literal_over_onemap`, how many times the CPU time of our maps their literal forms take on the same views;
        `planner_ms` of a step of the planner alone, which is part of both agents; `mb` of memory that the agent with
        the larger maps holds at most during its walk.

    Raises:
        AssertionError: A literal form gives another map.
    """
    scene, start = bench_home()
    camera = Camera(settings.width, settings.height)
    walks, step_ms, mb = {}, {}, 0.0
    for name, make in _AGENTS.items():
        progress(f"{name} walks")
        explored = walked(make, scene, start, _ABSENT, camera=camera, steps=settings.memory_steps)
        mb = max(mb, _peak_mb(make, explored))
        walks[name] = explored._replace(observations=explored.observations[: settings.steps])
        found = walked(make, scene, start, _farthest(scene, start), camera=camera, steps=settings.steps)
        step_ms[name] = max(_step_ms(make, walk, settings.rounds) for walk in (walks[name], found))
    progress("walks again")
    planner_ms = _planner_ms(walks["vlfm"], settings.rounds)
    progress("literal forms")
    values = {
        "vlfm_ms": step_ms["vlfm"],
        "onemap_ms": step_ms["onemap"],
        "literal_over_vlfm": _literal_over_vlfm(walks["vlfm"], settings.literal_views),
        "literal_over_onemap": _literal_over_onemap(walks["onemap"], settings.literal_views),
        "planner_ms": planner_ms,
        "mb": mb,
    }
    lengths = " and ".join(f"{len(walk.observations)} of {name}" for name, walk in walks.items())
    return Findings(values, (_note(settings, lengths),))


def _farthest(scene: Scene, start: Pose) -> str:
    """The category of the object farthest from the start."""
    return max(scene.objects, key=lambda item: planar_distance(item.centre, start.position)).category


def _note(settings: AgentSettings, lengths: str) -> str:
    return (
        f"Steps at {settings.width} x {settings.height} on walks through an invented home ({lengths}), replayed with "
        "the answers of perception at hand, with the target in the home and without: the dearer counts; medians of "
        f"{settings.rounds} CPU times, means over the steps. Patches: {' x '.join(map(str, PATCHES))}. Literal forms: "
        "numpy (OneMap's vectors of pixels: torch) over whole grids and whole pictures, their maps compared with ours "
        "in the same run. mb: peak of what the agent allocates through Python in an episode of "
        f"{settings.memory_steps} steps at most."
    )


def _vlfm(perception: Perception) -> Agent:
    return VlfmAgent(perception, lambda task: task.description)


def _onemap(perception: Perception) -> Agent:
    return OneMapAgent(perception, lambda task: task.description)


_AGENTS: dict[str, Callable[[Perception], Agent]] = {"vlfm": _vlfm, "onemap": _onemap}


def _begun(make: Callable[[Perception], Agent], walk: Walk) -> Agent:
    agent = make(walk.eyes.perception())
    agent.reset(walk.task, walk.camera, seed=SEED)
    return agent


def _step_ms(make: Callable[[Perception], Agent], walk: Walk, rounds: int) -> float:
    """Mean over the steps of the medians of each one's CPU time, milliseconds."""

    def replayed() -> list[float]:
        agent = _begun(make, walk)
        return [_core_s(lambda seen=seen: agent.act(seen)) for seen in walk.observations]

    return 1e3 * float(np.median([replayed() for _ in range(rounds)], axis=0).mean())


def _planner_ms(walk: Walk, rounds: int) -> float:
    """The same of the planner: it sees every observation, and heads for the place where the walk ended."""
    end = walk.observations[-1].gps

    def replayed() -> list[float]:
        seeker = Seeker(walk.camera, can_look=False)

        def step(k: int) -> None:
            seeker.see(walk.observations[k])
            if seeker.head_for((end[1], -end[0]), reaches=REACHES, same=SAME_GOAL):
                seeker.walk()

        return [_core_s(lambda k=k: step(k)) for k in range(len(walk.observations))]

    return 1e3 * float(np.median([replayed() for _ in range(rounds)], axis=0).mean())


def _peak_mb(make: Callable[[Perception], Agent], walk: Walk) -> float:
    """Largest memory that numpy and Python allocated for an agent on its walk, MB of 10^6 bytes."""
    tracemalloc.start()
    try:
        agent = _begun(make, walk)
        for seen in walk.observations:
            agent.act(seen)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def _literal_over_vlfm(walk: Walk, num_views: int) -> float:
    """Median over views of the ratio of CPU times: obstacles, explored area, frontiers, value map, values."""
    grid = Seeker(walk.camera).memory.grid
    area, values, literal = ExploredArea(grid), ValueMap(grid), LiteralValues(grid)
    ratios = []
    for k in _spread(len(walk.observations), num_views):
        frame = walk.eyes.frame_of(walk.observations[k])
        score = walk.eyes.score(frame, ())

        def ours(frame=frame, score=score) -> None:
            area.see(frame.depth_m, frame.T_world_camera, frame.camera, floor_y=0.0)
            values.add(frame.depth_m, frame.T_world_camera, frame.camera, score)
            values.values_at(area.frontiers())

        def theirs(frame=frame, score=score) -> None:
            literal.add(frame, float(score[0]))

        ratios.append(_core_s(theirs) / _core_s(ours))
        assert np.array_equal(area.blocked, literal.blocked), "obstacles differ"
        assert np.allclose(values.values[..., 0], literal.values, atol=1e-6), "values differ"
        assert np.allclose(values.confidence, literal.confidence, atol=1e-6), "confidence differs"
        assert np.array_equal(area.explored, literal.explored), "explored areas differ"
        assert area.frontiers().shape == literal.frontiers.shape, "numbers of frontiers differ"
        assert np.allclose(area.frontiers(), literal.frontiers), "frontiers differ"
    return float(np.median(ratios[1:] or ratios))


def _literal_over_onemap(walk: Walk, num_views: int) -> float:
    """Median over views of the ratio of CPU times: confidence, projection, fusion, similarity."""
    ours = FeatureGrid()
    literal = LiteralFeatures(ours.grid, dim=PATCHES[2])
    ours.set_query(walk.eyes.encode_texts(("",))[0])
    ratios, num_compared = [], 0
    for k in _spread(len(walk.observations), num_views):
        frame = walk.eyes.frame_of(walk.observations[k])
        patches = walk.eyes.encode_patches([frame])[0]
        literal_s = _core_s(lambda frame=frame, patches=patches: literal.add(frame, patches))
        own_s = _core_s(
            lambda frame=frame, patches=patches: ours.add(frame.depth_m, frame.T_world_camera, frame.camera, patches)
        )
        ratios.append(literal_s / own_s)
        for cell in np.flatnonzero(literal.confidence)[::50].tolist():
            found = ours.feature_at(divmod(cell, ours.grid.shape[1]))
            num_compared += found is not None
            assert found is None or np.allclose(found, literal.features[cell], atol=1e-4), "features differ"
    assert num_compared > 0, "ours kept no feature"
    return float(np.median(ratios[1:] or ratios))


def _spread(count: int, num: int) -> list[int]:
    return np.unique(np.linspace(0, count - 1, num).astype(int)).tolist()


def _core_s(work: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    began = time.process_time()
    work()
    return time.process_time() - began

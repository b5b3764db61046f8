"""The recordings' benchmark: its walkers and figures are what they say; costs are judged only when asked for."""

import pytest

import personal_viz.bench.recordings as bench
from personal_viz.bench.harness import Values, run_benchmark
from personal_viz.bench.recordings import RecordedHome, RecordingSettings, recorded_home, walked
from sim.types import Action

TINY = RecordingSettings(agent_steps=12, person_steps=5, num_people=2, num_agents=1, repeats=1)
KEYS = {"steps_per_s", "encode_only_steps_per_s", "mb_with_pixels", "mb_without", "compare_build_s", "compare_open_s"}
"""Figures that the issue asks for."""


@pytest.fixture(scope="module")
def home() -> RecordedHome:
    return recorded_home()


@pytest.fixture(scope="module")
def figures() -> Values:
    return bench.measure(TINY, lambda _: None).values


@pytest.mark.release
def test_a_walker_takes_the_steps_asked_for_and_stops(home: RecordedHome) -> None:
    agent = walked(home, "agent", who_kind="agent", num_steps=60, seed=3)
    (run,) = agent.episodes
    assert len(run.steps) == 60
    assert [index for index, step in enumerate(run.steps) if step.action is Action.STOP] == [59]
    assert run.end.measures.path_m > 4
    assert all(step.t_s == 0 for step in run.steps)
    again = walked(home, "agent", who_kind="agent", num_steps=60, seed=3).episodes
    assert again == agent.episodes


@pytest.mark.release
def test_people_take_time_and_have_a_code(home: RecordedHome) -> None:
    (run,) = walked(home, "person", who_kind="human", num_steps=4, seed=1).episodes
    assert run.start.participant == "P01"
    assert [step.t_s for step in run.steps] == pytest.approx([0.8, 1.6, 2.4, 3.2])


@pytest.mark.release
def test_figures_belong_together(figures: Values) -> None:
    fast, plain = figures["encode_only_fast_steps_per_s"], figures["encode_only_steps_per_s"]
    assert figures["cost_over_encoding"] == pytest.approx(plain / figures["steps_per_s"])
    assert figures["cost_over_fast_encoding"] == pytest.approx(fast / figures["steps_per_s"])
    assert 0 < figures["mb_without"] < figures["mb_with_pixels"]
    assert figures["compare_pictures"] == 2 * 6 + 13
    assert figures["compare_mb"] > 0
    assert set(figures) >= KEYS


@pytest.mark.bench
def test_recordings_keep_their_targets() -> None:
    report = run_benchmark("recordings", lambda: bench.measure(bench.FULL, print), bench.PLAN, quick=False)
    assert [figure for figure in report.figures if figure.target and not figure.met] == []

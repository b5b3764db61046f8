"""`bench scale`: the same episodes by one process, two processes and Ray, and hours that follow from two processes."""

import pytest

from personal_viz.bench.scale import EPISODES, Settings, measure


@pytest.mark.release
@pytest.mark.timeout(900)  # three runs that share two cores with the other tests
def test_it_prints_three_rates_and_hours_for_more_cores() -> None:
    pytest.importorskip("ray", reason="the extra ray is not installed: pip install 'personal-viz[ray]'")
    said: list[str] = []
    values = measure(Settings(homes=1, episodes=1), said.append).values
    assert {"jobs1_eps_per_s", "jobs2", "ray2", "hours"} == values.keys()
    assert min(values["jobs1_eps_per_s"], values["jobs2"], values["ray2"]) > 0
    assert values["hours"]["cores_2"] == pytest.approx(EPISODES / values["jobs2"] / 3600)
    assert values["hours"]["cores_64"] == pytest.approx(values["hours"]["cores_2"] / 32)
    assert said == ["homes ...", "jobs1_eps_per_s ...", "jobs2 ...", "ray2 ..."]

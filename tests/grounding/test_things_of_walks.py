"""Object maps of one simulated walk: most objects are found, and few things are nobody's."""

import pytest

from personal_viz.bench.robot.things import ThingsSettings, measure_things


@pytest.mark.slow
def test_a_walk_becomes_about_one_thing_per_object() -> None:
    found = measure_things(ThingsSettings(seeds=(101,), frames=100), lambda line: None)
    assert set(found) == {"mild", "strong", "depth"}
    assert found["mild"]["things_per_object"] <= 1.5
    assert found["mild"]["found_share"] >= 0.8
    assert found["strong"]["things_per_object"] <= 1.8
    assert found["strong"]["found_share"] >= 0.6
    assert found["depth"]["found_share"] >= 0.4

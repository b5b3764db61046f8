"""The parts of the human study's benchmark in small: real processes, a real websocket, no judgement of speed."""

from pathlib import Path

import pytest

from personal_viz.bench.study.big_home import BigHomeSettings, measure_big_home
from personal_viz.bench.study.kills import KillSettings, measure_kills
from personal_viz.bench.study.load import LoadSettings, measure_load
from personal_viz.bench.study.pog_view import PogViewSettings, measure_pog_view
from personal_viz.bench.study.restart import RestartSettings, measure_restarts
from personal_viz.bench.study.soak import SoakSettings, drift_percent, measure_soak
from personal_viz.bots.site import HOME

from .invented import invented_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench") / "dataset"
    invented_dataset(folder, name=HOME, seed=5)
    return folder


@pytest.mark.release
def test_after_kills_everything_acknowledged_is_there_and_people_are_where_they_were(
    tmp_path: Path, dataset: Path
) -> None:
    settings = KillSettings(kills=2, bots=3, most_keys=5, seed=18, workers=1)
    found = measure_kills(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["problems"] == ()
    assert 0 < found["gateway_kills"] < found["kills"] == 2  # both kinds
    assert (found["lost_after_kill"], found["duplicated_after_kill"], found["unknown_after_kill"]) == (0, 0, 0)
    assert (found["chain_failures"], found["resumed_elsewhere"]) == (0, 0)
    assert found["resumes"] >= 3
    assert found["acked_keys"] >= 6
    assert found["steps_done_again"] >= found["acked_keys"] / 2


@pytest.mark.release
def test_people_come_back_after_a_restart(tmp_path: Path, dataset: Path) -> None:
    settings = RestartSettings(restarts=1, bots=3, acted_keys=5)
    found = measure_restarts(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["problems"] == ()
    assert (found["lost"], found["duplicated"], found["resumed_elsewhere"], found["processes_left"]) == (0, 0, 0, 0)
    assert found["resumes"] == found["participants"] == 3


@pytest.mark.release
def test_nothing_is_left_of_people_who_left(tmp_path: Path, dataset: Path) -> None:
    settings = SoakSettings(seconds=5.0, bots=4)
    found = measure_soak(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["problems"] == ()
    assert (found["lost"], found["duplicated"], found["leases_left"]) == (0, 0, 0)
    assert found["actions"] > 10
    assert found["gateway_mb"] + found["workers_mb"] <= found["peak_mb"]
    assert min(found["gateway_mb"], found["workers_mb"]) > 1
    assert 0 <= found["gateway_drift_percent"] < 100
    assert (found["at_start"]["clients"], found["clients_growth"], found["clients_left"]) == (4, 0, 0)


@pytest.mark.parametrize(
    ("later", "percent"), [([130, 100], 30.0), ([100, 80], 20.0), ([110, 95], 10.0), ([100, 100], 0.0)]
)
def test_memory_drifts_by_its_largest_change_after_the_third_minute(later: list[float], percent: float) -> None:
    assert drift_percent([40, 60, 90, 100, *later]) == pytest.approx(percent)


@pytest.mark.slow
def test_a_home_that_the_server_draws_is_timed(tmp_path: Path, dataset: Path) -> None:
    settings = PogViewSettings(faces=30_000, seconds=1.0, moves=3, clicks=2_000)
    found = measure_pog_view(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["faces"] >= 30_000
    assert found["fps"] > 0
    assert 0 < found["p50_ms"] <= found["p95_ms"]
    assert found["click_mm_p99"] < 20


@pytest.mark.bench
def test_a_crowds_keys_are_looked_for_in_the_records(tmp_path: Path, dataset: Path) -> None:
    settings = LoadSettings(bots=6, seconds=3.0, kinds=("random",), rate=4.0)
    found = measure_load(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["problems"] == ()
    assert (found["participants"], found["lost"], found["duplicated"]) == (6, 0, 0)
    assert found["actions"] >= 12
    assert found["ack_p50_ms"] is not None


@pytest.mark.bench
def test_somebody_opens_a_large_home_while_others_walk(tmp_path: Path, dataset: Path) -> None:
    settings = BigHomeSettings(faces=30_000, bots=2, before_s=2.0)
    found = measure_big_home(settings, folder=tmp_path, dataset=dataset, progress=print)
    assert found["problems"] == ()
    assert found["faces"] >= 30_000
    assert found["browser_mb"] > 0.1
    assert found["while_ack_p99_ms"] is not None
    assert (found["lost"], found["duplicated"]) == (0, 0)

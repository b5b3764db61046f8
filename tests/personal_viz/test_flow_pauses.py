"""A pause lasts as long as it should, whatever anybody does to the server's wall clock."""

import time
from types import SimpleNamespace

import pytest

from human_study.journey import StageEntry
from personal_viz.study_app.gateway import pauses as flow_pauses
from personal_viz.study_app.gateway.pauses import machine_time, pause_left_s, steady_detail
from tests.human_study.clocks import HOUR_S, Clocks, S

DAY_S = 24 * HOUR_S
GAP_S = 3600.0


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    found = Clocks()

    def boot_id() -> str:
        """The content of the system's file with the boot's name."""
        if found.boot is None:
            raise FileNotFoundError
        return found.boot + "\n"

    monkeypatch.setattr("time.time_ns", lambda: found.wall_ns)
    monkeypatch.setattr("time.clock_gettime_ns", lambda clock: found.steady_ns)
    monkeypatch.setattr(flow_pauses, "_BOOT_ID", SimpleNamespace(read_text=boot_id))
    return found


def began() -> StageEntry:
    """A pause that begins now, as the page stores it."""
    detail = {"done": 1, "sitting": True, **steady_detail(machine_time())}
    return StageEntry("break_started", detail, time.time_ns())


def left_s(entry: StageEntry) -> float:
    """How long this pause still lasts."""
    return pause_left_s(entry, GAP_S, machine_time())


@pytest.mark.parametrize("jump_s", [0, HOUR_S, -HOUR_S, 3 * DAY_S, -50 * 365 * DAY_S])
@pytest.mark.parametrize(("passed_s", "expected_s"), [(0.0, 3600.0), (600.0, 3000.0), (3599.0, 1.0), (3601.0, 0.0)])
def test_a_jump_of_the_wall_clock_neither_skips_nor_lengthens_a_pause(
    clocks: Clocks, jump_s: int, passed_s: float, expected_s: float
) -> None:
    entry = began()
    clocks.pass_s(passed_s / 2)
    clocks.wall_ns += jump_s * S
    clocks.pass_s(passed_s / 2)
    assert left_s(entry) == expected_s


def test_over_a_restart_of_the_machine_the_wall_clock_counts(clocks: Clocks) -> None:
    entry = began()
    clocks.pass_s(600.0)
    clocks.reboot(steady_s=20.0)
    assert left_s(entry) == 3000.0
    clocks.pass_s(3000.0)
    assert left_s(entry) == 0.0


@pytest.mark.parametrize("jump_s", [HOUR_S, 30 * DAY_S])
def test_a_wall_clock_that_went_back_over_a_restart_makes_nobody_wait_longer_than_a_whole_pause(
    clocks: Clocks, jump_s: int
) -> None:
    entry = began()
    clocks.pass_s(600.0)
    clocks.reboot(steady_s=0.0)
    clocks.wall_ns -= jump_s * S
    assert left_s(entry) == GAP_S
    clocks.pass_s(900.0)
    assert left_s(entry) == 2700.0  # it began before the boot, so it has lasted at least since then
    clocks.pass_s(2700.0)
    assert left_s(entry) == 0.0


def test_where_boots_have_no_name_the_wall_clock_counts_and_no_pause_exceeds_its_full_length(clocks: Clocks) -> None:
    clocks.boot = None
    entry = began()
    assert entry.detail == {"done": 1, "sitting": True}
    clocks.pass_s(600.0)
    assert left_s(entry) == 3000.0
    clocks.wall_ns -= 5 * HOUR_S * S
    assert left_s(entry) == GAP_S


def test_a_pause_that_an_earlier_version_stored_goes_by_the_wall_clock(clocks: Clocks) -> None:
    entry = StageEntry("break_started", {"done": 1, "sitting": True}, clocks.wall_ns)
    clocks.pass_s(1000.0)
    assert left_s(entry) == 2600.0


def test_the_real_clocks_go_on(tmp_path: object) -> None:
    first, second = machine_time(), machine_time()
    assert second.since_boot_ns >= first.since_boot_ns > 0
    assert second.boot_id == first.boot_id
    assert 0 < pause_left_s(began(), GAP_S, machine_time()) <= GAP_S

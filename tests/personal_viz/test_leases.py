"""Who has been away for too long, by a steady clock."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from personal_viz.study_app.gateway.lease_keeper import Leases


def test_who_stays_away_longer_than_the_lease_is_expired() -> None:
    leases = Leases(900.0)
    leases.here("p01", 0.0)
    leases.left("p01", 100.0)
    assert leases.expired(1000.0) == ()
    assert leases.expired(1000.1) == ("p01",)
    assert leases.away_s("p01", 1000.0) == 900.0


def test_nobody_expires_while_a_tab_is_alive() -> None:
    leases = Leases(900.0)
    leases.here("p01", 0.0)
    leases.here("p01", 5.0)
    leases.left("p01", 10.0)
    assert leases.is_here("p01")
    assert leases.expired(1e6) == ()
    leases.left("p01", 1e6)
    assert not leases.is_here("p01")
    assert leases.expired(1e6 + 900.0) == ()
    assert leases.expired(1e6 + 901.0) == ("p01",)


def test_coming_back_ends_the_absence() -> None:
    leases = Leases(900.0)
    leases.here("p01", 0.0)
    leases.left("p01", 0.0)
    leases.here("p01", 5000.0)
    assert leases.expired(9000.0) == ()
    leases.left("p01", 9000.0)
    assert leases.away_s("p01", 9001.0) == 1.0


def test_who_had_begun_before_a_restart_is_counted_from_the_restart() -> None:
    leases = Leases(900.0)
    leases.expect("p02", 50.0)
    leases.expect("p02", 700.0)
    assert leases.expired(950.0) == ()
    assert leases.expired(951.0) == ("p02",)
    leases.here("p02", 951.0)
    leases.expect("p02", 960.0)
    assert leases.expired(1e6) == ()


def test_who_has_finished_is_forgotten_but_not_while_connected() -> None:
    leases = Leases(10.0)
    leases.here("p01", 0.0)
    leases.forget("p01")
    assert leases.present() == {"p01"}
    leases.left("p01", 1.0)
    leases.forget("p01")
    assert leases.expired(1e6) == ()


def test_a_connection_that_ends_unheard_of_changes_nothing_for_the_next() -> None:
    leases = Leases(10.0)
    leases.left("p01", 0.0)
    leases.here("p01", 1.0)
    assert leases.is_here("p01")


STEPS = st.lists(
    st.tuples(st.sampled_from(["here", "left"]), st.sampled_from(["p01", "p02"]), st.floats(0, 500)), max_size=40
)


@given(STEPS, st.floats(0, 2000))
def test_only_who_has_no_tab_and_left_long_ago_expires(steps: list[tuple[str, str, float]], later_s: float) -> None:
    leases, tabs, left_s, now_s = Leases(900.0), Counter[str](), {}, 0.0
    for what, code, passed_s in steps:
        now_s += passed_s
        if what == "here":
            leases.here(code, now_s)
            tabs[code] += 1
        elif tabs[code]:
            leases.left(code, now_s)
            tabs[code] -= 1
            left_s[code] = now_s
    end_s = now_s + later_s
    expected = sorted(code for code, left in left_s.items() if not tabs[code] and end_s - left > 900.0)
    assert list(leases.expired(end_s)) == expected

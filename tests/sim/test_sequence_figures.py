"""Measures of home sequences computed by hand, and their intervals."""

import pytest

from sim.episodes.sequences import SubtaskKind
from sim.sequences.figures import csr, difference_over_homes, interval_over_homes, memory_gain, sequence_figures
from sim.sequences.rows import rows_of_runs
from sim.sequences.runs import SearchEnd, SequenceEnd, SequenceRun, SequenceStart
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import Measures, RuleMeasures, Step
from sim.types import SUCCESS_RULES, Action, TaskKind


@pytest.mark.parametrize(
    ("right", "wanted"), [((1, 1, 0), 6 / 9), ((1, 0, 1), 4 / 9), ((0, 1, 1), 4 / 9), ((1,), 1.0), ((0, 0), 0.0)]
)
def test_conditional_success_has_its_known_values(right: tuple[int, ...], wanted: float) -> None:
    assert csr([bool(one) for one in right]) == pytest.approx(wanted)
    assert csr([bool(one) for one in right], [1.0] * len(right)) == pytest.approx(wanted)


def told_run(*searches: tuple[SubtaskKind, bool, float, float, float, int], task: TaskKind = "pan") -> SequenceRun:
    """A run without a home; each search is (kind, right, leg, shortest walk, walk, steps), and a wrong one ends 3 m
    from where it succeeds."""
    ends, steps = [], []
    for kind, is_right, leg_m, start_distance, path_m, num_steps in searches:
        rule = RuleMeasures(
            success=is_right, spl=0.0, soft_spl=0.0, dtg=3.0 * (not is_right), start_distance=start_distance
        )
        measures = Measures(
            rules=dict.fromkeys(SUCCESS_RULES, rule),
            centre_distance=0.0,
            path_m=path_m,
            num_steps=num_steps,
            collisions=0,
            stored_geodesic=1.0,
            scene_digest="0" * 64,
        )
        end = {"kind": kind, "reason": "found", "message": 0, "is_after_news": False, "is_at_old": None}
        ends.append(SearchEnd(**end, leg_m=leg_m, measures=measures))
        steps += num_steps * [Step(action=Action.LEFT, position=(0.0, 0.0, 0.0), yaw=0.0)]
    start = SequenceStart(task=task, split="hard", scene="A", sequence_id="told", position=(0.0, 0.0, 0.0), yaw=0.0)
    return SequenceRun(start=start, steps=tuple(steps), end=SequenceEnd(reason="stop", searches=tuple(ends)))


def test_measures_of_walks_are_those_computed_by_hand() -> None:
    run = told_run(("fresh", True, 2, 2, 4, 4), ("fresh", False, 6, 5, 5, 6), ("revisit", True, 2, 3, 4, 2))
    found = sequence_figures([run])
    assert found.cgt == pytest.approx((2 * 1 + 6 * 0 + 2 * 1 / 3) / 10)
    assert found.csr == pytest.approx((1 + 0 + 1 / 3) / 3)
    assert found.ppl == pytest.approx(1 / 3 * 2 / 4)
    assert found.spl == pytest.approx((2 / 4 + 0 + 3 / 4) / 3)
    assert (found.dtg, found.steps) == ((0 + 3 + 0) / 3, (4 + 6 + 2) / 3)
    forgets = told_run(("fresh", True, 2, 2, 4, 4), ("fresh", False, 6, 5, 5, 6), ("revisit", False, 2, 3, 9, 5))
    gain = memory_gain([(run, forgets)])
    assert (gain.n, gain.sr, gain.spl, gain.steps) == (1, 1, 3 / 4, 2 - 5)
    assert gain.sr_all == pytest.approx(1 / 3)


def test_a_folder_with_both_tasks_gives_each_row_its_own_runs() -> None:
    info = make_run_info("one", who="x", who_kind="agent", scene_kind="invented", dataset_digest="0", seed=0, config={})
    walks, points = (told_run(("fresh", task == "pan", 2, 2, 4, 4), task=task) for task in ("pan", "pog"))
    rows = rows_of_runs([(info, (walks, points))])
    measures = [row.sequence_measures for row in rows]
    assert [(row.task, found.n, found.sr) for row, found in zip(rows, measures, strict=True)] == [
        ("pan", 1, 1),
        ("pog", 1, 0),
    ]


def test_intervals_grow_where_values_follow_their_homes() -> None:
    values = [0.0, 0.1, 0.9, 1.0, 0.0, 0.1, 0.9, 1.0]
    mixed, sorted_ = list("abababab"), list("aabbaabb")
    narrow, wide = interval_over_homes(values, mixed), interval_over_homes(values, sorted_)
    assert narrow is not None
    assert wide is not None
    assert wide[1] - wide[0] > 3 * (narrow[1] - narrow[0])
    assert sum(wide) / 2 == pytest.approx(0.5)
    assert interval_over_homes(values, ["a"] * 8) is None


def test_a_difference_over_homes_is_that_of_paired_homes_where_each_home_has_one_value_of_both() -> None:
    value, interval = difference_over_homes([(1, "a"), (1, "b"), (0, "c")], [(0, "a"), (1, "b"), (0, "c")])
    assert value == pytest.approx(1 / 3)
    assert interval == pytest.approx((1 / 3 - 4.3027 / 3, 1 / 3 + 4.3027 / 3), abs=1e-4)  # t of 2 degrees, error 1/3
    same = difference_over_homes([(1, "a"), (0, "b"), (0, "b")], [(0, "b"), (1, "a"), (0, "b")])
    assert same == (0, (0, 0)), "homes that differ alike in both say nothing of the difference"
    assert difference_over_homes([(1, "a"), (0, "a")], [(0, "a")]) == (0.5, None)

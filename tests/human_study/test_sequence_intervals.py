"""Intervals of people's figures in home sequences, in a case whose variance is computed by hand."""

import math

import pytest

from human_study.sequence_report.intervals import agent_difference, people_difference, people_figures
from sim.sequences.figures import sequence_figures, sr_difference
from sim.sequences.runs import SearchEnd, SequenceEnd, SequenceRun, SequenceStart
from sim.tasks.run_files import AnswerMeasures


def answers(person: str | None, home: str, *, num_right: int) -> SequenceRun:
    """A sequence of four searches in POG, of which the first ones are right."""
    searches = [
        SearchEnd(
            kind="fresh",
            reason="found",
            message=0,
            is_after_news=False,
            leg_m=None,
            measures=None,
            is_at_old=None,
            answer=AnswerMeasures(
                success=number < num_right, top3_success=number < num_right, planar_distance=1.0, distance_3d=1.0
            ),
        )
        for number in range(4)
    ]
    start = {"task": "pog", "split": "hard", "scene": home, "sequence_id": "0", "position": (0, 0, 0), "yaw": 0}
    end = SequenceEnd(reason="click", searches=tuple(searches))
    return SequenceRun(start=SequenceStart.model_validate(start | {"participant": person}), steps=(), end=end)


def test_intervals_of_people_and_of_differences_are_wide_where_people_differ_and_homes_do_not() -> None:
    people = [answers(f"p{n}", home, num_right=n) for n in (1, 2, 3, 4) for home in "ABCD"]
    found = people_figures(people, "paper")
    assert sequence_figures(people).intervals["sr"] == (0.625, 0.625), "over homes alone, which are alike"
    # variance of the mean: (9 + 1 + 1 + 9) / 1024 between people, times 4/3; t of 3 degrees, on the logit scale
    spread = 3.18245 * (20 / 1024 * 4 / 3) ** 0.5
    low, high = (1 / (1 + math.exp(-0.510826 - end)) for end in (-spread / 0.234375, spread / 0.234375))
    for measure in ("sr", "sr_fresh", "partial"):
        assert found.intervals[measure] == pytest.approx((low, high), abs=1e-4)
    agent = [answers(None, home, num_right=number) for home in "ABCD" for number in (0, 4)]
    less = agent_difference(people, agent, rule="paper", kind=None)
    assert less is not None
    assert (less.value, less.num_first, less.num_second) == (0.125, 64, 32)
    assert less.interval == pytest.approx((0.125 - spread, 0.125 + spread), abs=1e-4)
    others = [answers(f"q{n}", home, num_right=2) for n in range(4) for home in "ABCD"]
    less, over_homes = people_difference(people, others, rule="paper", kind="fresh"), sr_difference(people, others)
    assert less is not None
    assert less.interval is not None
    assert over_homes is not None
    assert (less.value, over_homes.value, over_homes.interval) == (0.125, 0.125, (0.125, 0.125))
    assert less.interval[0] < -0.2 < 0.45 < less.interval[1]
    assert people_difference(people, others, rule="paper", kind="stale") is None

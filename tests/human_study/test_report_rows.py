"""Totals as the study declares them, by hand, and the guard that refuses others."""

from dataclasses import replace

import pytest

from human_study.report.rows import Aggregate, ReportRow, require_totals, rows_of
from human_study.report.statistics import trials_of, variance_of_mean
from human_study.report.trials import TrialGroup, trial_frame
from sim.errors import StudyError
from sim.types import EpisodeKey, Split

HITS: list[tuple[str, Split, int]] = [
    *(("ann", "easy", 1), ("ann", "easy", 1), ("ann", "easy", 1), ("bob", "easy", 0)),
    *(("ann", "hard", 0), ("bob", "hard", 1), ("bob", "hard", 0), ("bob", "hard", 0)),
    *(("bob", "hard", 0), ("bob", "hard", 0)),
]
"""Easy: 3 of 4 by trials, 1/2 by people. Hard: 1 of 6 by trials, (0 + 1/5) / 2 = 1/10 by people."""


def group() -> TrialGroup:
    trials = [
        {"key": EpisodeKey(split, "Home", str(n)), "participant": who, "sr": 100.0 * hit}
        for n, (who, split, hit) in enumerate(HITS)
    ]
    return TrialGroup("pan", "scan", "human", "human", "none", trial_frame(trials))


def values(aggregate: Aggregate) -> tuple[float, float, float]:
    rows = {row.split: row for row in rows_of(group(), aggregate)}
    require_totals(rows.values())
    return rows["easy"].value, rows["hard"].value, rows["total"].value


def test_a_total_is_the_mean_of_splits_every_trial_the_same_or_splits_by_their_size() -> None:
    assert values(Aggregate()) == pytest.approx((75, 100 / 6, (75 + 100 / 6) / 2))
    assert values(Aggregate("pooled")) == pytest.approx((75, 100 / 6, 40))
    sizes = {"easy": 600, "medium": 700, "hard": 200}  # nobody did medium, so it has no weight
    assert values(Aggregate("dataset_weighted", split_sizes=sizes)) == pytest.approx(
        (75, 100 / 6, 0.75 * 75 + 0.25 * 100 / 6)
    )
    with pytest.raises(StudyError, match="Give --dataset"):
        Aggregate("dataset_weighted").require_sizes()


def test_participants_count_the_same_where_the_study_says_so() -> None:
    assert values(Aggregate(weight="participants")) == pytest.approx((50, 10, 30))
    pooled = {row.split: row for row in rows_of(group(), Aggregate("pooled", "participants"))}
    assert pooled["total"].value == pytest.approx(100 * (3 / 4 + 1 / 6) / 2)
    assert pooled["easy"].share is None
    require_totals(pooled.values())  # no mean of its cells, and none is declared


def test_a_total_with_other_shares_is_refused() -> None:
    rows = rows_of(group(), Aggregate())
    wrong_value = [row.model_copy(update={"value": row.value + (row.split == "total")}) for row in rows]
    with pytest.raises(StudyError, match="the mean of easy, hard with shares"):
        require_totals(wrong_value)
    wrong_share = [row.model_copy(update={"share": 0.4 if row.split == "easy" else row.share}) for row in rows]
    with pytest.raises(StudyError, match="Make the report again"):
        require_totals(wrong_share)
    without_total: list[ReportRow] = [row for row in rows if row.split != "total"]
    with pytest.raises(StudyError, match="total of pan scan human none sr is None"):
        require_totals(without_total)


def test_a_difference_of_two_strata_has_the_variance_of_their_sum() -> None:
    first = trials_of([1, 0, 1, 1], list("abcd"), list("wxyz"))
    both = trials_of([1, 0, 1, 1, 0, 0, 1, 0], list("abcdefgh"), list("wxyzstuv"), ["one"] * 4 + ["two"] * 4)
    apart = replace(both, stratum_shares=(1.0, -1.0))
    assert apart.mean == pytest.approx(0.75 - 0.25)
    alone, _ = variance_of_mean(first)
    variance, _ = variance_of_mean(apart)
    assert variance == pytest.approx(2 * alone * (8 / 7) / (4 / 3))  # small sample factors of 8 and of 4 clusters

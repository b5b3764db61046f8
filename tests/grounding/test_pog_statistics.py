"""Intervals by episode and by home, compared with published values and values computed by hand."""

import numpy as np
import pytest

from grounding.report.statistics import FEWEST_HOMES, HomeDraws, Range, mean_of_shares, wilson


def test_intervals_are_wilsons_by_episode_and_bootstrapped_by_home_except_for_few_homes_or_equal_values() -> None:
    # Newcombe 1998, table I, has 81/263 and 0/20
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(20, 20) == pytest.approx((0.8389, 1.0), abs=1e-4)
    one = Range(0.4, 0.6)
    low, high = mean_of_shares([0.5, 0.5], [one, one])
    assert (low, high) == pytest.approx((0.5 - 0.1 / 2**0.5, 0.5 + 0.1 / 2**0.5))
    homes = [f"h{index // 10}" for index in range(200)]
    values = np.array([float(index // 10 % 2) for index in range(200)])
    found = HomeDraws(homes, seed=0).interval(values, homes, ["easy"] * 200)
    assert found is not None
    # 20 homes, half of them at 1: 50 +- 196 sqrt(0.25 / 20) percent
    assert found == pytest.approx((28, 72), abs=3)
    assert found.high - found.low > 200 * (wilson(100, 200).high - wilson(100, 200).low)
    few = [f"h{index % (FEWEST_HOMES - 1)}" for index in range(40)]
    assert HomeDraws(few, seed=0).interval(np.arange(40.0), few, ["easy"] * 40) is None
    homes = [f"h{index % 9}" for index in range(40)]
    assert HomeDraws(homes, seed=0).interval(np.zeros(40), homes, ["easy"] * 40) is None


def test_the_same_seed_gives_the_same_interval_in_any_order() -> None:
    homes = [f"h{index % 7}" for index in range(70)]
    values = np.sin(np.arange(70.0))
    splits = ["easy" if index % 3 else "hard" for index in range(70)]
    first = HomeDraws(homes, seed=3).interval(values, homes, splits)
    second = HomeDraws(homes[::-1], seed=3).interval(values[::-1], homes[::-1], splits[::-1])
    assert first is not None
    assert second == pytest.approx(first)
    assert HomeDraws(homes, seed=4).interval(values, homes, splits) != first

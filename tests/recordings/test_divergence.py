"""Which runs of an episode have a divergence, on ways that are small enough to measure by hand."""

import math

import numpy as np
import pytest

from recordings.divergence import divergence_of
from sim.walk.ways import Departure

CORNER = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 3.0]])
"""A path of 4 m along x, then 3 m along z."""


def test_runs_that_do_not_walk_and_goals_out_of_reach_have_no_divergence() -> None:
    straight = np.array([(x / 2, 0.0, 0.0) for x in range(13)])
    turned = np.array([(min(step, 4) / 2, 0.0, -max(step - 4, 0) / 2) for step in range(11)])
    found = divergence_of([straight, None, turned], CORNER, pair=(0, 2))
    assert [stray is None for stray in found.strays] == [False, True, False]
    assert found.strays[0] is not None
    assert found.strays[0].departure == Departure(11, 5.5)
    assert found.strays[0].apart.end_m == pytest.approx(math.hypot(2, 3))
    assert found.parted == (Departure(7, 3.5), Departure(7, 3.5))
    without = divergence_of([straight, turned], None, pair=None)
    assert without.strays == (None, None)
    assert without.parted is None

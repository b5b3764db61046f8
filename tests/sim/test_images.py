"""Boolean images of a home's cells against scipy's slower filters."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from sim.homes.images import widened


@pytest.mark.parametrize("shape", [(40, 60), (3, 3), (1, 9), (2, 1)])
@pytest.mark.parametrize("cells", [0, 1, 2, 4])
def test_a_widened_mask_is_what_a_square_filter_gives_also_where_it_is_smaller_than_the_square(shape, cells):
    mask = np.random.default_rng(0).random(shape) < 0.1
    mask[0, 0] = True
    before = mask.copy()

    wide = widened(mask, cells)

    assert np.array_equal(wide, maximum_filter(mask, size=2 * cells + 1, mode="constant", cval=False))
    assert np.array_equal(mask, before)

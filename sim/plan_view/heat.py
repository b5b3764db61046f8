"""Colours of values on a plan, from the least (dark blue) to the greatest (yellow)."""

import numpy as np
from numpy.typing import NDArray

_VIRIDIS = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], float)
"""At 0, 1/4, ..., 1."""


def heat_shares(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """(...) place of each value between the least (0) and the greatest (1) finite one; all 1 where these are equal."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    return (values - low) / (high - low) if high > low else np.ones_like(values)


def heat_colours(shares: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., 3) red, green and blue, 0-255, of shares (...)."""
    at = np.linspace(0, 1, len(_VIRIDIS))
    return np.stack([np.interp(shares, at, channel) for channel in _VIRIDIS.T], axis=-1)

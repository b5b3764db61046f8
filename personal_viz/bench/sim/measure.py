"""Times functions side by side: medians of process CPU time ("core") and of wall time."""

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np


class Timing(NamedTuple):
    """Medians over the measured calls of one function."""

    core_s: float
    """CPU seconds of all threads of this process."""
    wall_s: float
    """Elapsed seconds."""


def interleaved(
    work: Mapping[str, Callable[[int], object]], *, calls: int, rounds: int = 1, warm_ups: int = 2
) -> dict[str, Timing]:
    """Median time per call of each function, called in turn, so that a slow moment of the machine meets all of them.

    Args:
        work: Functions of a call's number k in [0, calls); the same k means the same input for all.
        calls: Different inputs.
        rounds: How often all inputs are gone through.
        warm_ups: Calls of each function before, which are not measured.
    """
    for k in range(min(warm_ups, calls)):
        for function in work.values():
            function(k)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for _ in range(rounds):
        for k in range(calls):
            for name, function in work.items():
                wall, core = time.perf_counter(), time.process_time()
                function(k)
                found[name].append((time.process_time() - core, time.perf_counter() - wall))
    return {name: Timing(*(float(value) for value in np.median(times, axis=0))) for name, times in found.items()}

"""How much time a run has left, counted from the start of its process: imports and compiling are included."""

import math
import os
import time
from pathlib import Path

_STAT = Path("/proc/self/stat")
_START_FIELD = 19
"""Of /proc/PID/stat behind the name's bracket: clock ticks between the machine's start and the process's (proc(5))."""


def since_process_start_s() -> float:
    """Elapsed seconds since this process began; where the system does not tell (no Linux), its CPU seconds."""
    if not _STAT.exists():
        return time.process_time()
    ticks = int(_STAT.read_text().rpartition(")")[2].split()[_START_FIELD])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")


class Budget:
    """Time until the last part of a run must have ended."""

    def __init__(self, limit_s: float | None) -> None:
        """Counts from the process's start.

        Args:
            limit_s: Elapsed seconds; None = no limit.
        """
        self._end = math.inf if limit_s is None else time.perf_counter() + limit_s - since_process_start_s()

    @property
    def left_s(self) -> float:
        """Seconds left, inf without a limit; never below 0."""
        return max(self._end - time.perf_counter(), 0.0)

    def has(self, need_s: float) -> bool:
        """Whether a part of so many seconds can begin and end in time; without a limit always."""
        return 0 < self.left_s >= need_s

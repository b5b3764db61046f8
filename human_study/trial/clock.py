"""Time inside one trial."""

import math
from dataclasses import dataclass

from sim.errors import TaskStateError

SHORTEST_PRESS_S = 0.05
"""Presses and clicks sooner than this after an accepted one, or after a search of a home sequence began, are dropped
(HUMAN_STUDY.md, section 4)."""
SHOWN_STEPS_S = (60, 10)
"""The remaining time is shown in steps of the first value, and in steps of the second in the last minute (seconds)."""


class TrialClock:
    """Seconds since the trial's start, on the caller's steady clock; it stands still while the participant is away."""

    def __init__(self, *, already_s: float | None = None) -> None:
        """A clock of a new trial, or of one that has run for `already_s`."""
        self._has_begun = already_s is not None
        self._last_s = already_s or 0.0
        self._offset_s = self._last_s
        self._origin_s: float | None = None
        self._accepted_s = -math.inf

    def begin(self, now_s: float, *, is_start: bool) -> None:
        """Starts the clock; raises TaskStateError where Start and Resume are mixed up."""
        if is_start == self._has_begun:
            found, expected = ("Start", "Resume") if is_start else ("Resume", "Start")
            raise TaskStateError(
                f"trial: found {found}; expected {expected}: a trial starts once and resumes after that."
            )
        self._has_begun = True
        self._offset_s, self._origin_s = self._last_s, now_s

    def read(self, now_s: float) -> float:
        """Seconds since the trial's start; raises TaskStateError before `begin`."""
        if self._origin_s is None:
            raise TaskStateError("trial: found a command before Start or Resume; expected one of these first.")
        self._last_s = max(self._last_s, self._offset_s + now_s - self._origin_s)
        return self._last_s

    def too_soon(self, t_s: float) -> bool:
        """Whether a press at `t_s` follows the last accepted one, or the start of a search, too fast for a person."""
        return t_s - self._accepted_s < SHORTEST_PRESS_S

    def accept(self, t_s: float) -> None:
        """Stores the time of an accepted press, or at which a search began."""
        self._accepted_s = t_s


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """A limit of time."""

    began_s: float
    limit_s: float

    def is_up(self, t_s: float) -> bool:
        """Whether the time is up."""
        return t_s - self.began_s >= self.limit_s

    def shown_s(self, t_s: float) -> int:
        """Remaining seconds for display: rounded up to SHOWN_STEPS_S."""
        left = max(0.0, self.began_s + self.limit_s - t_s)
        step = _step_of(left)
        return step * math.ceil(left / step)

    def moments(self, t_s: float) -> list[float]:
        """Times at which the limit is reached or the displayed seconds change."""
        end_s, shown = self.began_s + self.limit_s, self.shown_s(t_s)
        return [end_s, end_s - (shown - _step_of(shown))]


def _step_of(left: float) -> int:
    return SHOWN_STEPS_S[0] if left > SHOWN_STEPS_S[0] else SHOWN_STEPS_S[1]

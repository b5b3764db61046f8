"""Time inside one trial."""

import math

from sim.errors import TaskStateError

SHORTEST_PRESS_S = 0.05
"""Presses and clicks that follow an accepted one sooner than this are dropped (HUMAN_STUDY.md, section 4)."""


class TrialClock:
    """Seconds since the trial's start, on whatever steady clock the caller uses; stands still while nobody is there."""

    def __init__(self, *, already_s: float | None = None) -> None:
        """A clock of a new trial, or of one that has run for `already_s`."""
        self._has_begun = already_s is not None
        self._last_s = already_s or 0.0
        self._offset_s = self._last_s
        self._origin_s: float | None = None
        self._accepted_s = -math.inf

    def begin(self, now_s: float, *, is_start: bool) -> None:
        """Run from here on; raises TaskStateError where Start and Resume are mixed up."""
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
        """Whether a press at `t_s` follows the last accepted one too fast for a person."""
        return t_s - self._accepted_s < SHORTEST_PRESS_S

    def accept(self, t_s: float) -> None:
        """Note an accepted press."""
        self._accepted_s = t_s

"""Estimates how long taking part lasts, from the number of trials and set seconds per part. A planning figure."""

import math
from dataclasses import dataclass

from sim.types import TaskKind

from ..design.plan import Phase, StudyPlan
from ..design.study import StudyConfig
from ..trial.terms import terms_of

TRIAL_S: dict[TaskKind, float] = {"pan": 120.0, "pog": 60.0}
"""Seconds from the text to the answer, assumed before the pilot; the pilot's own times replace them."""
SEARCHES: dict[Phase, int] = {"main": 7, "check": 1, "practice": 3}
"""Searches of a home sequence: the mean of those that `personal-viz generate` makes, those of an attention trial, and
those of practice."""
LOOK_S = 30.0
"""Seconds of looking at a map or home before a trial, unless the study file sets a lower limit."""
READING_S = 480.0
"""Seconds for the device check, consent, instructions and quiz together."""
SURVEY_S = 10.0
"""Seconds for each question after the last search."""
BREAK_S = 120.0
"""Seconds of one break."""
ROUND_TO_MIN = 5


@dataclass(frozen=True, slots=True)
class TimeEstimate:
    """How long one participant takes, in seconds by part."""

    num_trials: int
    """Number of counted trials."""
    num_practice: int
    num_checks: int
    num_breaks: int
    trials_s: float
    """Time of counted trials and attention checks, with the looks before them."""
    practice_s: float
    reading_s: float
    """Time of the pages before the trials and of the questions after them."""
    breaks_s: float

    @property
    def total_s(self) -> float:
        """Seconds of all parts together."""
        return self.trials_s + self.practice_s + self.reading_s + self.breaks_s

    @property
    def minutes(self) -> int:
        """The total in minutes, rounded up to a multiple of 5."""
        return ROUND_TO_MIN * math.ceil(self.total_s / 60 / ROUND_TO_MIN)


def estimate_time(config: StudyConfig, *, num_trials: int, task: TaskKind) -> TimeEstimate:
    """The estimate for one participant with this many counted trials of a task."""
    look_s, is_one = _mean_look_s(config, task), config.sequences is None
    per_trial = {phase: TRIAL_S[task] * (1 if is_one else count) + look_s for phase, count in SEARCHES.items()}
    num_checks = num_trials // config.checks.every if config.checks.every is not None else 0
    num_breaks = max(0, (num_trials - 1) // config.breaks.every) if config.breaks.every is not None else 0
    num_practice = config.practice.pan if task == "pan" else config.practice.pog
    return TimeEstimate(
        num_trials=num_trials,
        num_practice=num_practice,
        num_checks=num_checks,
        num_breaks=num_breaks,
        trials_s=num_trials * per_trial["main"] + num_checks * per_trial["check"],
        practice_s=num_practice * per_trial["practice"],
        reading_s=(READING_S if config.flow else 0.0) + SURVEY_S * len(config.survey.questions),
        breaks_s=num_breaks * BREAK_S,
    )


def announced_minutes(config: StudyConfig, plan: StudyPlan | None = None) -> int | None:
    """Minutes that people are told: `ethics.duration_min`, else the estimate of the longest share; None = unknown.

    Without a plan the share is `design.trials_per_person`; where that is not set, there is no estimate before the plan.
    """
    if config.ethics.duration_min is not None:
        return config.ethics.duration_min
    shares: list[tuple[TaskKind, int]]
    if plan is not None:
        shares = [(person.task, sum(trial.phase == "main" for trial in person.trials)) for person in plan.participants]
    elif config.design.trials_per_person is not None:
        shares = [(task, config.design.trials_per_person) for task in config.task]
    else:
        return None
    return max(estimate_time(config, num_trials=count, task=task).minutes for task, count in shares)


def _mean_look_s(config: StudyConfig, task: TaskKind) -> float:
    """Seconds of looking before a trial, averaged over the conditions of the task."""
    looks = [terms_of(config, condition, task=task).look for condition in config.conditions(task)]
    seconds = [0.0 if look is None else max(look.min_s, min(LOOK_S, look.max_s or LOOK_S)) for look in looks]
    return sum(seconds) / len(seconds)

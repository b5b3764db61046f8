"""The terms of one trial besides the task: the look before it, its length, and the time limits."""

from dataclasses import dataclass

from ..design.study import Condition, StudyConfig
from .events import MapKind

RESUME_WITHIN_S = 600.0
"""Default of StudyConfig.resume_within_s."""


@dataclass(frozen=True, slots=True)
class Look:
    """A look at a home before the task."""

    what: MapKind
    min_s: float = 0.0
    """Shortest look."""
    max_s: float | None = None
    """Longest look; None = it ends only when the participant begins the task."""


@dataclass(frozen=True, slots=True)
class TrialTerms:
    """The limits of one trial."""

    condition: Condition | None = None
    """The trial's condition; None in records of the first version of studies."""
    look: Look | None = None
    """The look before the task; None = there is none."""
    task_max_s: float | None = None
    """Longest walk, from the first picture, or longest answer, from the texts; None = no limit."""
    resume_within_s: float = RESUME_WITHIN_S
    """A longer absence ends the trial as `abandoned`."""
    asks_confidence: bool = False
    """Whether participants rate their confidence after an answer (STOP, a confirmed mark)."""


def terms_of(config: StudyConfig, condition: Condition) -> TrialTerms:
    """The terms of a study's trials in one condition."""
    is_pan = condition in ("none", "topdown", "glb")
    look = None
    if condition == "topdown" or condition == "glb":
        look = Look(condition, config.memory.min_s, config.memory.max_s)
    elif condition == "map_first":
        look = Look("home", config.pog.look_min_s, config.pog.look_max_s)
    return TrialTerms(
        condition=condition,
        look=look,
        task_max_s=config.pan_max_s if is_pan else config.pog.answer_max_s,
        resume_within_s=config.resume_within_s,
        asks_confidence=config.confidence,
    )

"""A study's progress in words that terminal and dashboard share."""

from human_study.journey import Place
from human_study.store.progress_people import PersonProgress, State

_PLACES: dict[Place, str] = {
    "not_arrived": "not arrived",
    "device": "device check",
    "consent": "consent",
    "instructions": "instructions",
    "quiz": "questions",
    "practice": "practice",
    "trial": "trials",
    "break": "break",
    "pause": "between two sittings",
    "ending": "last page",
    "finished": "finished",
    "dropped_out": "dropped out",
    "declined": "declined",
    "withdrawn": "withdrawn",
    "screened_out": "screened out",
    "full": "came to a full study",
}
STATES: dict[State, str] = {
    "active": "active",
    "stuck": "stuck?",
    "away": "away",
    "finished": "finished",
    "out": "out",
    "not_arrived": "not arrived",
}
"""Those that may need somebody first."""


def place_words(person: PersonProgress) -> str:
    """Where a participant is: `trial 3 of 10`."""
    if person.place == "trial" and person.trial_no is not None:
        words = f"trial {person.trial_no} of {person.num_planned}"
        return words if person.is_in_trial else f"before {words}"
    return _PLACES[person.place]


def age_words(seconds: float | None) -> str:
    """A short time ago, in its largest unit; a dash for never."""
    if seconds is None:
        return "–"
    for unit, length_s in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"


def disk_words(free_mb: int) -> str:
    """Free room."""
    return f"{free_mb / 1024:.1f} GB" if free_mb >= 1024 else f"{free_mb} MB"

"""The parts of the way through a study, as participants read them above each page."""

from human_study.design.study import StudyConfig
from human_study.journey import Person

PARTS: dict[str, str] = {
    "device": "Check",
    "consent": "Consent",
    "instructions": "Instructions",
    "quiz": "Questions",
    "practice": "Practice",
    "trial": "Study",
    "finished": "End",
}
"""By the place at which they begin."""


def parts_of(config: StudyConfig, person: Person) -> tuple[str, ...]:
    """Names of the parts of this participant's way; () where the way is only one page and the trials."""
    if config.flow == ("instructions",):
        return ()
    has_practice = any(trial.phase == "practice" for trial in person.trials)
    steps = [*config.flow, *(["practice"] if has_practice else []), "trial", "finished"]
    return tuple(PARTS[step] for step in steps)

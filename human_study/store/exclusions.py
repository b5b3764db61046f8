"""Rules that leave trials or people out of the figures: a layer over the records, in which nothing is deleted."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from sim.errors import StudyError

from ..design.study import StudyConfig
from .records import StoredTrial, StudyReader

STANDARD_RULES: dict[str, str] = {
    "technical": "A failure of the program or the server stopped the trial; it is given out once more.",
    "abandoned": "The person left the trial and did not come back in time; the episode is given to somebody else, or "
    "once more to the same person where nobody else can take it.",
    "attention": "The person failed more than one attention trial: all trials of the person are left out.",
    "misunderstood": "The person reported not having understood the task.",
    "disturbed": "The person reported having been disturbed or helped during the trial.",
    "unverified": "Doing the trial again does not give the stored steps or outcome.",
}
"""Rules that every study writes down before its first trial (preregistration), by id; `attention` only in studies with
attention trials. `technical` and `abandoned` apply by themselves, the others through `personal-viz study exclude`."""
_RULE_ID = re.compile(r"[a-z][a-z0-9_-]{0,39}")
_TRIAL = re.compile(r"(p[0-9]{2,})/([0-9]+)")


@dataclass(frozen=True, slots=True)
class ExclusionTarget:
    """The subject of `study exclude`: every attempt at one assigned trial, or a person."""

    code: str
    trial_ids: tuple[str, ...]
    """Ids of the attempts; () for a person."""


def rules_before_data(config: StudyConfig) -> dict[str, str]:
    """The rules that were written down before the first trial, by rule id."""
    has_checks = config.checks.every is not None
    standard = {name: text for name, text in STANDARD_RULES.items() if name != "attention" or has_checks}
    return standard | config.exclusions


def require_rule_id(rule_id: str) -> str:
    """The rule id, checked for its form.

    Raises:
        StudyError: It has other characters than small letters, digits, - and _, or is too long.
    """
    if not _RULE_ID.fullmatch(rule_id):
        known = ", ".join(STANDARD_RULES)
        raise StudyError(
            f"--rule {rule_id}: expected small letters, digits, - and _, beginning with a letter, at most 40. "
            f"Take one of those written down before data ({known}), or name a new one."
        )
    return rule_id


def find_target(reader: StudyReader, name: str) -> ExclusionTarget:
    """The person named `p03`, or the attempts at a trial named `p03/12` (code and place in the order).

    Raises:
        StudyError: The name has another form, or the trial or participant does not exist.
    """
    if "/" not in name:
        return ExclusionTarget(reader.participant(name).code, ())
    found = _TRIAL.fullmatch(name)
    if found is None:
        raise StudyError(
            f"{name}: expected a participant's code, such as p03, or with a place in the order, such as p03/12. "
            "See study status."
        )
    code, order_no = found[1], int(found[2])
    attempts = [status for status in reader.trials(code) if status.order_no == order_no]
    return ExclusionTarget(code, _opened(attempts, name))


def _opened(attempts: Sequence[StoredTrial], trial: str) -> tuple[str, ...]:
    ids = tuple(status.trial_id for status in attempts if status.trial_id is not None)
    if not ids:
        found = "never opened" if attempts else "not assigned"
        raise StudyError(f"trial {trial}: was {found}; expected a trial that has begun. See study status.")
    return ids

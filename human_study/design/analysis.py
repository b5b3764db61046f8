"""The parts of the analysis that are fixed before anybody takes part; the report and the preregistration read them."""

import re

LEVEL = 0.95
"""Level of all intervals."""
ALPHA = 0.05
"""Error rate of all hypotheses together (family-wise)."""

HYPOTHESIS_NAME = re.compile(
    r"^(?:(?P<task>pan|pog)_)?(?:human(?:_(?P<condition>[a-z0-9_]+?))?_minus_(?P<agent>[^,]+)|(?P<memory>[a-z0-9_]+)_effect)"
    r"_(?P<measure>SR|SPL|SoftSPL|DTG|steps|time)$"
)
"""Pattern of the hypotheses' names in `primary` of the study file.

`human_minus_agent_SR` (or an agent's name), `human_memory_topdown_minus_agent_SR`, `memory_effect_SR`, `pog_...`.
"""


def require_hypothesis(name: str) -> str:
    """The name itself.

    Raises:
        ValueError: The report cannot test such a hypothesis.
    """
    if HYPOTHESIS_NAME.match(name) is None:
        raise ValueError(
            "a name that the report can test: human_minus_AGENT_MEASURE or memory_effect_MEASURE, with one of SR, SPL, "
            "SoftSPL, DTG, steps, time as MEASURE, and pan_ or pog_ in front where there are both tasks"
        )
    return name

"""The measures of a report, each described once: its name, its task, and how it is shown and tested."""

from dataclasses import dataclass

from sim.tasks.run_files import FAR_FROM_VIEW
from sim.types import TaskKind

STEP_LIMITS = (25, 50, 100, 200, 300, 400, 500)
"""Steps of the anytime success rate: success within each of these."""
STRICT, FAR = "sr_strict", "far_from_view"
"""Columns: success by rule `paper-strict`, and whether a success by `paper` ends far from every view point."""
_BOTH: tuple[TaskKind, ...] = ("pan", "pog")
_PAN: tuple[TaskKind, ...] = ("pan",)


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure of a trial: percent, metres, steps or seconds."""

    head: str
    """Heading of its table; empty for measures that share one table."""
    tasks: tuple[TaskKind, ...] = _BOTH
    claim: str = ""
    """Its name in hypotheses of a study file; empty where they cannot name it."""
    digits: int = 1
    """Decimals that a reader needs."""
    is_rate: bool = False
    """Whether each trial has 100 or 0, so that k of n can be given."""
    is_share: bool = False
    """Whether it is a percentage; its intervals stay within 0 and 100."""
    has_bootstrap: bool = True
    has_spread: bool = False
    """Whether its quartiles are shown."""
    has_effect: bool = False
    """Whether effects of conditions and of the order are looked for."""


WITHIN = {
    f"sr_within_{limit}": Measure("", _PAN, is_rate=True, is_share=True, has_bootstrap=False) for limit in STEP_LIMITS
}
"""The anytime success rate, by name."""
MEASURES: dict[str, Measure] = {
    "sr": Measure("SR (%)", claim="SR", is_rate=True, is_share=True, has_effect=True),
    "spl": Measure("SPL (%)", _PAN, claim="SPL", is_share=True, has_effect=True),
    "soft_spl": Measure("soft SPL (%)", _PAN, claim="SoftSPL", is_share=True),
    "dtg": Measure("DTG (m)", _PAN, claim="DTG", digits=2, has_spread=True),
    "distance": Measure("distance to the goal's centre (m)", ("pog",), digits=2, has_spread=True, has_effect=True),
    "steps": Measure("steps to decision", _PAN, claim="steps", has_spread=True, has_effect=True),
    "path_m": Measure("path (m)", _PAN, digits=2, has_spread=True),
    "t_s": Measure("time to decision (s)", claim="time", has_spread=True, has_effect=True),
    **WITHIN,
    STRICT: Measure("SR by rule paper-strict (%)", _PAN, is_rate=True, is_share=True, has_bootstrap=False),
    FAR: Measure(
        f"successes by rule paper that end more than {FAR_FROM_VIEW:g} m of walking from every view point (%)",
        _PAN,
        is_rate=True,
        has_bootstrap=False,
    ),
    "t_look_s": Measure("look at the home or its map before (s)", has_spread=True),
}
"""Measures by the name of their column, in the order of the report."""


def measures_of(task: TaskKind) -> tuple[str, ...]:
    """Names of a task's measures, in the order of the report."""
    return tuple(name for name, measure in MEASURES.items() if task in measure.tasks)

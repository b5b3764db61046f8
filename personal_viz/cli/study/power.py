"""Verb `study plan --power`: how precise a study will be, beside other ways to spend as many trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from sim.errors import StudyError

if TYPE_CHECKING:
    from human_study.report.power import PowerAssumptions

_OPTIONS = {"agent_gap": "gap", "person_sds": "person_sd", "num_simulations": "simulations"}
"""Fields of the assumptions that have another name on the command line."""


def power(
    *,
    study: Path | None = None,
    people: int = 25,
    episodes: int = 50,
    raters: int = 5,
    conditions: int = 1,
    base_rate: float = 0.65,
    gap: float = 0.15,
    split_gap: float = 0.10,
    memory_gap: float = 0.10,
    person_sd: Sequence[float] = (0.3, 0.9),
    episode_sd: float = 1.3,
    simulations: int = 150,
    seed: int = 0,
    json: bool = False,
) -> int:
    """Prints the precision of a design and of others like it; the same options print the same.

    Args:
        study: Folder with a study file, and a plan if there is one already; None = the design below.
        people: Of the whole study; this and the next three are ignored beside `study`.
        episodes: Of each of three splits.
        raters: People per episode and condition.
        conditions: Such as 2: without and with memory.
        base_rate: Success rate of people.
        gap: By which an agent is worse than people.
        split_gap: Between two splits.
        memory_gap: By which people are better with memory.
        person_sd: Spreads of people on the logit scale; each has its part of the table.
        episode_sd: Spread of episodes on the logit scale.
        simulations: Studies drawn per number.
        seed: Of the draws.
        json: Print JSON instead of a table.

    Raises:
        StudyError: The folder holds no study, or an option is out of its range.
    """
    from human_study.design.plan import PLAN_FILE, load_plan
    from human_study.design.study import load_study
    from human_study.report.power import PowerDesign, design_of, power_report
    from human_study.report.power_tables import power_markdown

    if study is not None:
        config = load_study(study)
        design = design_of(config, load_plan(study, config) if (study / PLAN_FILE).is_file() else None)
    else:
        _require_counts(people=people, episodes=episodes, raters=raters, conditions=conditions)
        design = PowerDesign(f"{people} people", people, episodes, raters, num_conditions=conditions)
    gaps = {"agent_gap": gap, "split_gap": split_gap, "memory_gap": memory_gap}
    spreads = {"person_sds": tuple(dict.fromkeys(person_sd)), "episode_sd": episode_sd}
    assumptions = _assumptions(**gaps, **spreads, base_rate=base_rate, num_simulations=simulations, seed=seed)
    found = power_report(design, assumptions=assumptions)
    print(found.model_dump_json(indent=2) if json else power_markdown(found), end="\n" if json else "")
    return 0


def _assumptions(**fields: float | tuple[float, ...]) -> PowerAssumptions:
    from human_study.report.power import PowerAssumptions

    try:
        return PowerAssumptions.model_validate(fields)
    except ValidationError as error:
        first = error.errors()[0]
        field = str(first["loc"][0])
        option = _OPTIONS.get(field, field).replace("_", "-")
        raise StudyError(
            f"study plan --power: --{option} is {_words(first['input'])}; expected {_expected(field)}. Change it."
        ) from None


def _words(value: object) -> str:
    """As somebody typed it."""
    return " ".join(map(str, value)) or "nothing" if isinstance(value, tuple) else str(value)


def _expected(field: str) -> str:
    from human_study.report.power import MOST_SD

    ranges = {
        "person_sds": f"one number or more, each from 0 to {MOST_SD:g}",
        "episode_sd": f"0 to {MOST_SD:g}",
        "num_simulations": "20 to 20000",
        "seed": "0 or more",
    }
    return ranges.get(field, "a number between 0 and 1, without them")


def _require_counts(*, people: int, episodes: int, raters: int, conditions: int) -> None:
    if min(people, episodes, raters, conditions) < 1 or raters * conditions > people:
        raise StudyError(
            f"study plan --power: found {people} people, {episodes} episodes, {raters} raters and {conditions} "
            "conditions; expected each at least 1, and at least raters times conditions people. Change one of them."
        )

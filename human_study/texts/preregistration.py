"""Preregistration text: hypotheses, design, sample, exclusions and analysis, as the report will do them."""

from collections.abc import Mapping
from typing import Any

from ..design.analysis import ALPHA, HYPOTHESIS_NAME, LEVEL, NUM_RESAMPLES
from ..design.study import StudyConfig
from ..store.exclusions import rules_before_data
from .words import filled, open_place

MEASURE_NAMES = {
    "SR": "success rate",
    "SPL": "success weighted by path length",
    "SoftSPL": "soft success weighted by path length",
    "DTG": "distance left to the goal",
    "steps": "number of steps",
    "time": "time to the answer",
}
TOTALS = {
    "mean_of_splits": "the plain mean of the splits",
    "pooled": "the mean over all trials, whatever their split",
    "dataset_weighted": "the mean of the splits, weighted by their size in the dataset",
}
WEIGHTS = {
    "trials": "every trial counts the same",
    "participants": "every participant counts the same",
}
INFORMATION = {
    "rgb": "the camera's picture",
    "compass": "a compass",
    "depth": "depth",
    "map": "the map explored so far",
}


def preregistration_text(config: StudyConfig, words: Mapping[str, Any]) -> str:
    """The document, complete but for fields that the study file leaves empty.

    Args:
        config: The study.
        words: Of the study and its plan (`documents.board_words`).
    """
    more = {
        "hypotheses": _hypotheses(config),
        "rules": rules_before_data(config),
        "level": f"{LEVEL:.0%}",
        "alpha": f"{ALPHA:.0%}",
        "resamples": f"{NUM_RESAMPLES:,}".replace(",", " "),
        "total": TOTALS[config.aggregate.total],
        "weight": WEIGHTS[config.aggregate.weight],
        "information": " and ".join(INFORMATION[name] for name in config.information),
    }
    return filled("preregistration.md", {**words, **more})


def _hypotheses(config: StudyConfig) -> str:
    """One sentence for each primary hypothesis."""
    if not config.primary:
        return (
            f"No primary hypothesis is named ({open_place('primary')}); then everything in the report is exploratory."
        )
    lines = [f"{number}. {hypothesis_sentence(name)}" for number, name in enumerate(config.primary, start=1)]
    return "\n".join(lines)


def hypothesis_sentence(name: str) -> str:
    """What a name of `primary` claims; the name itself where the report does not know it."""
    match = HYPOTHESIS_NAME.match(name)
    if match is None:
        return f"`{name}`: to be stated in words; the report does not test it by itself."
    measure, task = (
        MEASURE_NAMES[match["measure"]],
        {"pan": " in steering", "pog": " in pointing"}.get(match["task"], ""),
    )
    if match["memory"] == "memory":
        return f"`{name}`: the {measure}{task} of people differs between having been shown the home before and not."
    if match["memory"] is not None:
        return f"`{name}`: the {measure}{task} of people differs between condition `{match['memory']}` and the other."
    agent = "the agent" if match["agent"] == "agent" else f"the agent `{match['agent']}`"
    seen = f" in condition `{match['condition']}`" if match["condition"] else ""
    return f"`{name}`: the {measure}{task} of people{seen} differs from that of {agent} on the same episodes."

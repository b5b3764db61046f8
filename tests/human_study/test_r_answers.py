"""Our statistics against R's: its answers are stored beside the script that asked for them (HUMAN_STUDY.md, 10.23)."""

import csv
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from human_study.report.agreement import counts_of, gwet_ac1, krippendorff_alpha
from human_study.report.effects import WithinDesign, holm
from human_study.report.statistics import (
    Trials,
    mcnemar_p,
    mean_interval,
    numbered,
    rate_interval,
    trials_of,
    variance_of_mean,
    wilson_interval,
)

from .r_program import lacks, told_by

HERE = Path(__file__).parent
SCRIPT = HERE / "r_answers.R"


def numbers(text: str) -> dict[str, list[float]]:
    """All values by name, in their order."""
    found: dict[str, list[float]] = defaultdict(list)
    for line in text.splitlines():
        name, value = line.split()
        found[name].append(float(value))
    return dict(found)


R = numbers((HERE / "r_answers.txt").read_text())
with (HERE / "r_trials.csv").open(newline="") as file:
    ROWS = list(csv.DictReader(file))


def column(name: str) -> list[float]:
    return [float(row[name]) for row in ROWS]


def trials(name: str, *, by_split: bool = False) -> Trials:
    people, episodes = ([row[key] for row in ROWS] for key in ("participant", "episode"))
    return trials_of(column(name), people, episodes, [row["split"] for row in ROWS] if by_split else None)


def close(*values: float | None) -> object:
    return pytest.approx(list(values), rel=1e-9, abs=1e-11)


@pytest.mark.parametrize(("k", "n"), [(8, 10), (0, 7), (29, 36), (1, 250)])
def test_wilsons_interval_is_that_of_prop_test(k: int, n: int) -> None:
    found = wilson_interval(k, n)
    assert R[f"wilson_{k}_{n}"] == close(found.low, found.high)


@pytest.mark.parametrize(("first", "second"), [(9, 1), (5, 5), (0, 4), (3, 12)])
def test_mcnemars_p_is_that_of_binom_test(first: int, second: int) -> None:
    one = np.array([True] * first + [False] * second + [True] * 3)
    other = np.array([False] * first + [True] * second + [True] * 3)
    assert R[f"mcnemar_{first}_{second}"] == close(mcnemar_p(one, other))
    assert mcnemar_p(one, one) == 1


def test_where_all_succeed_the_interval_is_clopper_and_pearsons_of_the_people() -> None:
    alike = trials_of([1.0] * 10, [f"p{k // 2}" for k in range(10)], [f"e{k}" for k in range(10)])
    found = rate_interval(alike)
    assert R["all_alike_5"] == close(found.low, found.high)


@pytest.mark.parametrize("name", ["rate", "spl", "total"])
def test_the_two_way_variance_and_interval_are_those_of_sandwich(name: str) -> None:
    found = trials("spl" if name == "spl" else "success", by_split=name == "total")
    variance, df = variance_of_mean(found)
    assert R[f"{name}_variance"] == close(variance)
    assert R[f"{name}_df"] == close(df)
    interval = mean_interval(found) if name == "spl" else rate_interval(found)
    assert R[name] == close(interval.low, interval.high)


@pytest.mark.parametrize("name", ["success", "spl"])
def test_the_effect_within_people_and_episodes_is_that_of_a_linear_model_with_both(name: str) -> None:
    people, episodes = (numbered([row[key] for row in ROWS]) for key in ("participant", "episode"))
    effect = WithinDesign(np.array(column("memory")), people, episodes).effect(np.array(column(name)))
    assert R[f"memory_{name}"] == close(effect.value, effect.low, effect.high, effect.p)


def test_holms_p_values_are_those_of_p_adjust_and_agreement_is_that_of_all_pairs() -> None:
    assert R["holm"] == close(*holm([0.03, 0.004, 0.2, 0.011]))
    counts = counts_of([row["label"] for row in ROWS], [row["episode"] for row in ROWS])
    assert R["krippendorff"] == close(krippendorff_alpha(counts))
    assert R["gwet"] == close(gwet_ac1(counts))


@pytest.mark.slow
def test_r_still_gives_the_stored_answers() -> None:
    if reason := lacks("sandwich"):
        pytest.skip(reason)
    printed, _ = told_by(SCRIPT)
    now = numbers(printed)
    assert now.keys() == R.keys()
    for name, values in now.items():
        assert values == pytest.approx(R[name], rel=1e-9, abs=1e-11), name

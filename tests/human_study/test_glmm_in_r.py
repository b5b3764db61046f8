"""The report's script for R runs as it is written, and agrees with the report on the same trials."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from human_study.report.effects import memory_effects
from human_study.report.glmm import glmm_csv, glmm_script
from human_study.report.trials import TrialGroup, trial_frame
from sim.types import SPLITS, EpisodeKey, TaskKind

from .r_program import lacks, told_by

pytestmark = pytest.mark.slow
KEYS = [EpisodeKey(split, f"Home{n % 5}", str(n)) for split in SPLITS for n in range(10)]


@pytest.fixture(autouse=True)
def has_r() -> None:
    if reason := lacks("lme4"):
        pytest.skip(reason)


def people(
    task: TaskKind,
    conditions: tuple[str, ...],
    *,
    helps: float,
    num_people: int = 16,
    once: bool = False,
    seed: int = 4,
) -> list[TrialGroup]:
    """Invented people who differ, at episodes that differ; the second condition helps by `helps`.

    Args:
        task: Task of all trials.
        conditions: Everybody meets half of the episodes in each.
        helps: Effect of the second condition, log odds.
        num_people: Number of people.
        once: Each episode is done by one person only, and nobody does two.
        seed: Seed of the random draws.
    """
    rng = np.random.default_rng(seed)
    skill, ease = rng.normal(size=num_people), 1.2 * rng.normal(size=len(KEYS))
    trials: dict[str, list[dict[str, object]]] = {condition: [] for condition in conditions}
    for who in range(num_people):
        episodes = [who] if once else rng.permutation(len(KEYS))
        for place, at in enumerate(episodes, start=1):
            number = (who if once else int(at) + who) % len(conditions)
            chance = 1 / (1 + np.exp(-(skill[who] + ease[at] + helps * number)))
            code, condition, hit = f"p{who + 1:02d}", conditions[number], bool(rng.random() < chance)
            visits = int(rng.integers(3))
            trial = {"key": KEYS[at], "participant": f"study/{code}", "sr": 100.0 * hit, "t_s": 30.0}
            told = {"place": place, "prior_visits": visits, "secs_before": 10.0, "excluded": ""}
            trials[condition].append(trial | told)
    return [TrialGroup(task, "scan", "human", "human", name, trial_frame(found)) for name, found in trials.items()]


def fitted(folder: Path, groups: list[TrialGroup], task: TaskKind) -> tuple[str, str]:
    """What R prints, run from another folder."""
    (folder / f"{task}-trials.csv").write_text(glmm_csv(groups, task))
    script = folder / f"{task}-glmm.R"
    script.write_text(glmm_script(groups, task))
    return told_by(script)


def points(printed: str, what: str) -> float:
    found = re.search(rf"^{what}: (-?[\d.]+) points$", printed, re.MULTILINE)
    assert found is not None, printed
    return float(found[1])


def wald(printed: str, term: str) -> tuple[float, float]:
    found = re.search(rf"^{term} +(-?[\d.]+) +(-?[\d.]+)$", printed, re.MULTILINE)
    assert found is not None, printed
    return float(found[1]), float(found[2])


def of_report(groups: list[TrialGroup]) -> tuple[float, float, float]:
    """(value, low, high) of the effect on success in percent points, over all splits."""
    (row,) = [row for row in memory_effects(groups) if (row.measure, row.split) == ("sr", "all")]
    return row.effect.value, row.effect.low, row.effect.high


@pytest.mark.parametrize("helps", [1.6, -1.6])
@pytest.mark.parametrize(
    ("task", "conditions"), [("pan", ("none", "memory_topdown")), ("pog", ("map_first", "map_2d"))], ids=["pan", "pog"]
)
def test_the_effect_of_a_condition_is_that_of_the_report(
    tmp_path: Path, task: TaskKind, conditions: tuple[str, str], helps: float
) -> None:
    groups = people(task, conditions, helps=helps)
    printed, complaints = fitted(tmp_path, groups, task)
    ours, low, high = of_report(groups)
    assert ours * helps > 0
    assert low > 0 or high < 0
    assert points(printed, f"{conditions[1]} - {conditions[0]}") == pytest.approx(ours, abs=2.5)
    least, most = wald(printed, f"condition{conditions[1]}")
    assert (least > 0, most < 0) == (helps > 0, helps < 0)
    assert least < helps < most
    assert "480 of 480 trials are used" in printed
    assert "Warning" not in complaints + printed
    assert "failed to converge" not in complaints + printed


def test_without_an_effect_neither_r_nor_the_report_finds_one(tmp_path: Path) -> None:
    groups = people("pan", ("none", "memory_topdown"), helps=0.0)
    printed, _ = fitted(tmp_path, groups, "pan")
    ours, low, high = of_report(groups)
    assert low < 0 < high
    assert points(printed, "memory_topdown - none") == pytest.approx(ours, abs=2.5)
    least, most = wald(printed, "conditionmemory_topdown")
    assert least < 0 < most


def test_without_the_usual_first_condition_r_compares_the_same_two_as_the_report(tmp_path: Path) -> None:
    groups = people("pog", ("map_2d", "map_open"), helps=1.6)
    printed, _ = fitted(tmp_path, groups, "pog")
    assert points(printed, "map_open - map_2d") == pytest.approx(of_report(groups)[0], abs=2.5)


def test_trials_without_records_and_of_one_condition_are_fitted_with_the_remaining_terms(tmp_path: Path) -> None:
    (group,) = people("pan", ("none",), helps=0.0, num_people=6)
    bare = replace(group, trials=trial_frame(group.trials[["key", "participant", "sr"]].to_dict("records")))
    printed, complaints = fitted(tmp_path, [bare], "pan")
    assert "split + (1 | participant) + (1 | episode) + (1 | house)" in " ".join(printed.split())
    assert "points" not in printed
    assert "Warning" not in complaints + printed


def test_trials_that_share_neither_people_nor_episodes_are_fitted_without_these_terms(tmp_path: Path) -> None:
    groups = people("pan", ("none", "memory_topdown"), helps=1.0, num_people=30, once=True, seed=2)
    printed, complaints = fitted(tmp_path, groups, "pan")
    assert "(1 | participant)" not in printed
    assert "(1 | house)" in printed
    assert points(printed, "memory_topdown - none") != 0
    assert "Error" not in complaints

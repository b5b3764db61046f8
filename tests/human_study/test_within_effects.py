"""Effects within people: computed by hand, and the same for better people and easier episodes."""

import numpy as np
import pytest

from human_study.report.effects import WithinDesign

PEOPLE = np.repeat(np.arange(4), 4)
EPISODES = np.tile(np.arange(4), 4)
WITH = ((PEOPLE + EPISODES) % 2).astype(float)


def test_the_effect_is_the_difference_within_people_in_a_balanced_design() -> None:
    """Everybody has each condition twice, each episode too: the plain difference of the means, 6/8 - 1/8."""
    values = np.array([0, 1, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0], float)
    assert (values[WITH == 1].sum(), values[WITH == 0].sum()) == (6, 1)
    found = WithinDesign(WITH, PEOPLE, EPISODES).effect(values)
    assert found.value == pytest.approx(5 / 8)
    assert (found.n, found.num_participants, found.num_episodes) == (16, 4, 4)
    assert found.value == pytest.approx((found.low + found.high) / 2)


def test_better_people_and_easier_episodes_change_nothing() -> None:
    rng = np.random.default_rng(1)
    values = rng.random(16)
    design = WithinDesign(WITH, PEOPLE, EPISODES)
    once = design.effect(values)
    shifted = design.effect(values + 10 * PEOPLE - 7 * EPISODES)
    assert (shifted.value, shifted.low, shifted.high) == pytest.approx((once.value, once.low, once.high))


def test_a_known_slope_is_recovered() -> None:
    rng = np.random.default_rng(2)
    order = np.concatenate([rng.permutation(20) for _ in range(6)]).astype(float)
    people, episodes = np.repeat(np.arange(6), 20), np.tile(np.arange(20), 6)
    found = WithinDesign(order, people, episodes).effect(3 * order + people + rng.normal(size=120))
    assert found.value == pytest.approx(3, abs=0.05)
    assert found.p < 0.001


def test_a_condition_that_does_not_vary_within_people_has_no_effect() -> None:
    found = WithinDesign(PEOPLE.astype(float), PEOPLE, EPISODES).effect(np.arange(16.0))
    assert (found.value, found.p) == (None, None)
    assert "does not vary within people and episodes" in found.method
    alone = WithinDesign(np.array([0.0, 1.0]), np.array([0, 0]), np.array([0, 1])).effect(np.array([0.0, 1.0]))
    assert alone.value is None


def test_trials_without_other_variation_have_no_interval() -> None:
    found = WithinDesign(WITH, PEOPLE, EPISODES).effect(2 * WITH)
    assert found.value == pytest.approx(2)
    assert (found.low, found.p) == (None, None)


@pytest.mark.release
def test_false_alarms_are_at_most_as_frequent_as_promised() -> None:
    rng = np.random.default_rng(5)
    people, episodes = np.repeat(np.arange(10), 30), np.concatenate([rng.permutation(60)[:30] for _ in range(10)])
    covariate = np.tile(np.arange(30.0), 10)
    design = WithinDesign(covariate, people, episodes)
    alarms = 0
    for _ in range(300):
        chance = 1 / (1 + np.exp(-(0.5 + rng.normal(size=10)[people] + rng.normal(size=60)[episodes])))
        found = design.effect((rng.random(300) < chance).astype(float))
        alarms += found.p is not None and found.p < 0.05
    assert alarms <= 0.08 * 300

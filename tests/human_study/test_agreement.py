"""Agreement against published answers; spread and chosen objects computed by hand."""

import numpy as np
import pytest

from human_study.report.agreement import (
    chosen_place,
    common_place,
    counts_of,
    gwet_ac1,
    krippendorff_alpha,
    nearest_object,
    place_row,
    suspect_episodes,
)
from human_study.report.trials import TrialGroup, trial_frame
from sim.tasks.run_files import Answer
from sim.types import EpisodeKey

from .report_examples import pan_episode

FOUR_CODERS = ("123321412...", "1233224125.3", ".3332342251.", "12332441251.")
"""Krippendorff, "Computing Krippendorff's alpha-reliability" (2011), section C: 12 units, 5 categories, gaps."""
SOFA, BED = ("sofa_1", (0.0, 0.0)), ("bed_2", (5.0, 0.0))
OBJECTS = {"Home": [SOFA, BED]}


def pointed(episode: str, who: str, xz: tuple[float, float] | None, *, hit: bool) -> dict[str, object]:
    candidates = () if xz is None else ((xz[0], 0.4, xz[1]),)
    key = EpisodeKey("easy", "Home", episode)
    item = Answer(split="easy", scene="Home", episode_id=episode, candidates=candidates, participant=who, t_s=3.0)
    return {"key": key, "participant": who, "sr": 100.0 * hit, "item": item}


def group(*trials: dict[str, object]) -> TrialGroup:
    return TrialGroup("pog", "scan", "human", "human", "map_first", trial_frame(trials))


def test_the_spread_is_the_mean_distance_from_the_middle() -> None:
    """Two points 2 m apart: each 1 m from their middle. Three at one place: 0. One alone tells nothing."""
    found = place_row(
        group(
            pointed("a", "p1", (0.0, 0.0), hit=True),
            pointed("a", "p2", (2.0, 0.0), hit=False),
            *(pointed("b", who, (5.0, 0.0), hit=True) for who in ("p1", "p2", "p3")),
            pointed("c", "p1", (9.0, 9.0), hit=False),
            pointed("c", "p2", None, hit=False),
        )
    )
    assert (found.num_episodes, found.num_choices) == (2, 6)
    assert found.spread_median == pytest.approx(0.5)
    assert (found.object_alpha, found.object_ac1) == (None, None)


def test_objects_and_places_agree_as_people_do() -> None:
    """Half a metre apart is one place and one object; across the room is another of each."""
    near = [pointed(str(n), who, (x, 0.0), hit=True) for n in range(4) for who, x in (("p1", 0.0), ("p2", 0.5))]
    alike = place_row(group(*near), OBJECTS)
    assert alike.place_alpha == pytest.approx(1)
    assert alike.object_ac1 == pytest.approx(1)
    far = [pointed(str(n), who, (x, 0.0), hit=True) for n in range(4) for who, x in (("p1", 0.0), ("p2", 5.0))]
    apart = place_row(group(*far), OBJECTS)
    assert apart.object_alpha < 0


def test_an_object_is_chosen_within_a_metre() -> None:
    assert nearest_object(np.array([0.6, 0.8]), [SOFA, BED]) == "sofa_1"
    assert nearest_object(np.array([0.7, 0.8]), [SOFA, BED]) == "elsewhere"
    assert nearest_object(np.array([0.0, 0.0]), []) == "elsewhere"


def test_a_walk_chooses_where_it_stopped_and_nothing_without_stop() -> None:
    key = EpisodeKey("easy", "Home", "1")
    walk = pan_episode(key, success=False, steps=5, code="p01", path=4)
    place = chosen_place(walk)
    assert place is not None
    assert place == pytest.approx([0.0, 1.0])
    given_up = walk.model_copy(update={"end": walk.end.model_copy(update={"reason": "giveup"})})
    assert chosen_place(given_up) is None
    assert chosen_place(None) is None


def test_a_suspect_names_the_object_that_people_took() -> None:
    wrong = [pointed("7", f"p{n}", (5.0, 0.1 * n), hit=False) for n in range(4)]
    (suspect,) = suspect_episodes(group(*wrong, pointed("7", "p9", (0.0, 0.0), hit=True)), OBJECTS)
    assert (suspect.object, suspect.num_agreeing, suspect.num_people) == ("bed_2", 4, 5)
    assert not suspect_episodes(group(*wrong[:3], pointed("7", "p9", None, hit=False)), OBJECTS)  # three of four


def example() -> np.ndarray:
    labels = [(unit, int(value) - 1) for coder in FOUR_CODERS for unit, value in enumerate(coder) if value != "."]
    return counts_of([label for _, label in labels], [unit for unit, _ in labels])


def test_the_published_example() -> None:
    assert krippendorff_alpha(example()) == pytest.approx(0.743, abs=5e-4)
    assert gwet_ac1(example()) == pytest.approx(0.775, abs=1e-3)


def test_perfect_agreement_is_one_and_is_undefined_without_comparisons() -> None:
    alike = np.array([[3, 0], [0, 3], [3, 0]])
    assert krippendorff_alpha(alike) == pytest.approx(1)
    assert gwet_ac1(alike) == pytest.approx(1)
    assert krippendorff_alpha(np.array([[3, 0], [3, 0]])) is None  # nobody ever differs: chance cannot be told
    assert gwet_ac1(np.array([[3, 0], [3, 0]])) == pytest.approx(1)
    assert krippendorff_alpha(np.array([[1, 0], [0, 1]])) is None
    assert gwet_ac1(np.array([[1, 0], [0, 1]])) is None


def test_a_common_place_needs_the_given_share_of_points() -> None:
    points = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.6], [7.0, 7.0]])
    place = common_place(points, radius=1.0, share=0.75)
    assert place is not None
    assert np.linalg.norm(place) <= 0.6
    assert common_place(points, radius=1.0, share=0.8) is None

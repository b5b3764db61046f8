"""Oracle detection: exact without faults; faults have the stated size and depend on seed, home, object and view."""

import math
from dataclasses import replace

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.perception.oracle_detector import DetectorFaults, OracleDetector, Ramp, oracle_level
from grounding.perception.oracle_perception import OraclePerception, PerceptionOptions
from sim.errors import AgentError
from sim.types import Camera, Frame

CAPTIONS = {1: "white plastic chair", 2: "carved wooden chair", 3: "oval mirror", 9: "white plastic chair"}
CATEGORIES = {1: "chair", 2: "chair", 3: "mirror", 9: "chair"}


def frame(*, x: float = 0.0, depth: float = 2.0, side: int = 20) -> Frame:
    """A picture of 100 x 80 pixels with squares of `side` pixels: id 1 at (10, 5), 2 at (40, 30), 3 at (70, 50)."""
    ids = np.zeros((80, 100), np.int32)
    for number, (left, top) in {1: (10, 5), 2: (40, 30), 3: (70, 50)}.items():
        ids[top : top + side, left : left + side] = number
    pose = np.eye(4)
    pose[0, 3] = x
    lens = Camera.of_lens(100, 80, fx=90.0, fy=90.0, cx=50.0, cy=40.0)
    return Frame(np.zeros((80, 100, 3), np.uint8), np.full((80, 100), depth, np.float32), pose, lens, ids)


VIEWS = [frame(x=index / 100) for index in range(500)]


def detector(*, confusion: float = 0.0, seed: int = 0, home: str = "", seen_share=None, **faults) -> OracleDetector:
    perception = OraclePerception(
        HashedWords(), CAPTIONS, options=PerceptionOptions(confusion=confusion, seed=seed), home=home
    )
    return OracleDetector(perception, categories=CATEGORIES, faults=DetectorFaults(**faults), seen_share=seen_share)


def answers(query: str, views: list[Frame] = VIEWS, **options) -> list[list]:
    eye = detector(**options)
    eye.set_query(query)
    return [eye.detect(view) for view in views]


def test_without_faults_every_matching_object_in_view_has_the_box_of_its_ids() -> None:
    (found,) = answers("oval mirror", [frame()])
    assert [(item.label, item.box) for item in found] == [("oval mirror", (70.0, 50.0, 90.0, 70.0))]
    assert found[0].score == pytest.approx(1, abs=1e-6)
    (found,) = answers("a chair", [frame()])  # a category alone; the third chair is not in view
    assert sorted(item.box for item in found) == [(10.0, 5.0, 30.0, 25.0), (40.0, 30.0, 60.0, 50.0)]
    assert answers("copper lamp", [frame()]) == [[]]


def test_a_caption_matches_what_sounds_alike_with_a_lower_score() -> None:
    # words and pairs: white, plastic, chair, 2 pairs; the query shares 3 of its 3 terms: cosine 3 / sqrt(3 * 5)
    (found,) = answers("white plastic", [frame()])
    assert [item.box[0] for item in found] == [10.0]
    assert found[0].score == pytest.approx(3 / math.sqrt(15), abs=1e-5)
    assert answers("white plastic", [frame()], least_similarity=0.8) == [[]]
    # carved chair: carved, chair, and a pair; "carved wooden chair" shares carved and chair: 2 / sqrt(3 * 5) = 0.516
    (found,) = answers("carved chair", [frame()])
    assert [item.box[0] for item in found] == [40.0]


def test_a_detector_of_classes_finds_all_things_that_the_head_noun_names() -> None:
    (found,) = answers("green seats in the hall", [frame()], match="category")
    assert found == []
    (found,) = answers("carved wooden chair by the oval mirror", [frame()], match="category")
    assert sorted(item.box[0] for item in found) == [10.0, 40.0]
    assert [item.score for item in found] == [1.0, 1.0]


def test_a_sure_miss_finds_nothing_and_rates_are_as_stated() -> None:
    assert not any(answers("oval mirror", miss=1.0))
    assert sum(map(len, answers("oval mirror", miss=0.3))) == pytest.approx(350, abs=31)  # 3 sigma
    assert sum(map(len, answers("copper lamp", false_rate=0.5))) == pytest.approx(250, abs=48)


def test_finding_fades_with_distance_size_and_occlusion() -> None:
    far = Ramp(never=8, always=3)
    assert [far(metres) for metres in (1, 3, 5.5, 8, 9)] == [1, 1, 0.5, 0, 0]
    for depth, expected in ((2.0, 500), (5.5, 250), (8.0, 0)):
        views = [frame(x=view.T_world_camera[0, 3], depth=depth) for view in VIEWS]
        assert sum(map(len, answers("oval mirror", views, far=far))) == pytest.approx(expected, abs=34 * (depth == 5.5))
    small = Ramp(never=10, always=30)
    assert sum(map(len, answers("oval mirror", small=small))) == pytest.approx(250, abs=34)  # squares of 20 pixels
    hidden = Ramp(never=0.2, always=0.6)
    half = answers("oval mirror", hidden=hidden, seen_share=lambda view, number: 0.4)
    assert sum(map(len, half)) == pytest.approx(250, abs=34)
    both = DetectorFaults(far=far, small=small, hidden=hidden)
    assert both.clearness(distance=5.5, side=20, seen=0.4) == pytest.approx(0.125)


def test_boxes_and_scores_spread_as_stated_and_more_where_the_view_is_poor() -> None:
    found = [items[0] for items in answers("oval mirror", box_jitter=0.1)]
    left = np.array([item.box[0] for item in found])
    assert left.mean() == pytest.approx(70, abs=0.3)
    assert left.std() == pytest.approx(2, abs=0.25)  # a tenth of 20 pixels
    scores = np.array([items[0].score for items in answers("white plastic", score_noise=0.02)])
    assert scores.mean() == pytest.approx(3 / math.sqrt(15), abs=0.004)
    assert scores.std() == pytest.approx(0.02, abs=0.002)
    poor = answers("oval mirror", box_jitter=0.1, small=Ramp(never=10, always=30))
    left = np.array([items[0].box[0] for items in poor if items])
    assert left.std() == pytest.approx(3, abs=0.6)  # clearness 0.5 makes 1.5 times the error


def test_a_confused_object_keeps_its_other_name_in_all_views() -> None:
    eye = detector(confusion=1.0, seed=4)
    eye.set_query("oval mirror")
    assert 3 not in eye.matches
    lefts = {tuple(item.box[0] for item in eye.detect(view)) for view in VIEWS[:20]}
    assert len(lefts) == 1
    assert 70.0 not in next(iter(lefts))


FAULTY = {"confusion": 0.3, "miss": 0.4, "false_rate": 0.5, "box_jitter": 0.1, "score_noise": 0.1}


def test_answers_depend_on_seed_home_and_view_and_not_on_the_order_of_calls() -> None:
    views = VIEWS[:40]
    first = answers("white plastic chair", views, **FAULTY)
    assert first == answers("white plastic chair", views, **FAULTY)
    assert first == answers("white plastic chair", views[::-1], **FAULTY)[::-1]
    eye = detector(**FAULTY)
    for query in ("oval mirror", "white plastic chair"):
        eye.set_query(query)
        for view in views[::3]:
            eye.detect(view)
    assert [eye.detect(view) for view in views] == first
    assert first != answers("white plastic chair", views, **FAULTY, seed=1)
    assert first != answers("white plastic chair", views, **FAULTY, home="Other")


def test_raising_one_fault_keeps_the_draws_of_the_others() -> None:
    few, many = answers("oval mirror", miss=0.3), answers("oval mirror", miss=0.6)
    assert all(found or not later for found, later in zip(few, many, strict=True))  # what 0.3 misses, 0.6 misses too
    noisy = answers("oval mirror", miss=0.3, score_noise=0.1)
    assert [bool(found) for found in noisy] == [bool(found) for found in few]


def test_levels_say_their_settings() -> None:
    assert oracle_level("clean").settings == "no faults"
    assert oracle_level("mild", seed=7).settings == (
        "view_noise=0.05, object_noise=0.05, confusion=0.1, background=clutter, miss=0.2, far=8..3, small=8..40, "
        "hidden=0.1..0.6, false_rate=0.02, box_jitter=0.05, score_noise=0.05"
    )
    strong = oracle_level("strong", seed=7)
    assert strong.perception.seed == 7
    assert replace(strong.detector, miss=0.2).miss == 0.2


def test_bad_settings_and_questions_are_refused() -> None:
    with pytest.raises(AgentError, match=r"miss is 1\.5; expected 0 to 1"):
        DetectorFaults(miss=1.5)
    with pytest.raises(AgentError, match=r"false_rate is -1; expected 0 or more"):
        DetectorFaults(false_rate=-1)
    with pytest.raises(AgentError, match=r"from 3 to 3; expected two different numbers"):
        Ramp(3, 3)
    with pytest.raises(AgentError, match=r"oracle level is 'wild'; expected one of clean, mild, strong"):
        oracle_level("wild")
    with pytest.raises(AgentError, match="has no query; expected set_query"):
        detector().detect(frame())
    with pytest.raises(AgentError, match=r"query is ' \. '; expected words"):
        detector().set_query(" . ")
    eye = detector()
    eye.set_query("mirror")
    with pytest.raises(AgentError, match="a frame has no instance ids"):
        eye.detect(replace(frame(), ids=None))

"""Names of perception, users' own parts, the scorer of an encoder without pictures, and what a query names."""

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.perception.boxes import boxes_of_ids, cut_box, overlap, pixels_in_box, without_overlaps
from grounding.perception.by_name import check_perception_name, is_oracle, make_detector, make_perception, own_parts
from grounding.perception.encoder_scorer import EncoderScorer
from grounding.perception.named_things import COCO, coco_class, is_category, names_category
from grounding.perception.oracle_perception import OraclePerception
from grounding.perception.protocol import Perception
from grounding.perception.segmenters import DepthRegion
from sim.errors import AgentError

from .tiny_models import picture


@pytest.mark.parametrize(
    "name",
    [
        *("oracle", "oracle:mild", "oracle:strong,encoder=minilm", "my.eyes:make"),
        *("encoder=clip:ID,detector=owlv2:ID", "encoder=clip:ID,detector=owlv2:ID,scorer=my.eyes:judge"),
    ],
)
def test_known_names_pass_without_loading_anything(name: str) -> None:
    check_perception_name(name)
    assert is_oracle(name) == name.startswith("oracle")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("oracle:wild", r"oracle level is 'wild'; expected one of clean, mild, strong"),
        ("perfect", r"--perception is 'perfect'; expected oracle, oracle:mild"),
        ("encoder=clip:ID", r"--perception is 'encoder=clip:ID'; expected oracle"),
        ("encoder=clip:ID,detector=yolov7:x-e6", r"detector 'yolov7:x-e6': is not known; expected owlv2:, grounding-"),
        ("encoder=clip:ID,detector=owlv2:", r"detector 'owlv2:': is not known"),
        ("encoder=clip:A,encoder=clip:B,detector=owlv2:ID", r"--perception is 'encoder=clip:A"),
        ("oracle,eyes=two", r"--perception is 'oracle,eyes=two'; expected oracle"),
        (
            "oracle,scorer=my.eyes:judge",
            r"judge': found \['scorer'\]; expected encoder= alone",
        ),
    ],
)
def test_unknown_names_are_refused_with_those_that_are_known(name: str, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        check_perception_name(name)


def test_an_oracle_without_a_home_says_what_it_needs() -> None:
    with pytest.raises(
        AgentError, match="got no home and no start; expected them, because it reads the simulator's ids"
    ):
        make_perception("oracle:mild")
    with pytest.raises(AgentError, match=r"found \['detector'\]; expected encoder= alone"):
        make_perception("oracle,detector=owlv2:ID")


def own_perception() -> Perception:
    eye = OraclePerception(HashedWords(), {})
    detector = make_detector("tests.grounding.test_perception_names:Blind")
    return Perception("own eyes", lambda observation: None, EncoderScorer(eye), eye, detector, DepthRegion())  # type: ignore[arg-type,return-value]


class Blind:
    """A detector that never finds anything."""

    def set_query(self, text: str) -> None:
        pass

    def detect(self, frame):
        return []


def test_users_own_perception_and_parts_are_taken_by_name() -> None:
    assert make_perception("tests.grounding.test_perception_names:own_perception").name == "own eyes"
    with pytest.raises(AgentError, match=r"made Blind; expected grounding\.perception\.protocol\.Perception"):
        make_perception("tests.grounding.test_perception_names:Blind")
    with pytest.raises(AgentError, match=r"found no method set_query"):
        make_detector("builtins:dict")


class PatchesOnly:
    """An encoder of 2 x 1 patches along two axes, without whole pictures."""

    name, dim = "patches", 2

    def encode_texts(self, texts):
        return np.array([[1, 0] if text == "left" else [0.6, 0.8] for text in texts], np.float32).reshape(-1, 2)

    def encode_patches(self, frames):
        return np.array([[[[1, 0]], [[0, 1]]]] * len(frames), np.float32)


def test_an_encoder_of_patches_alone_scores_with_their_mean() -> None:
    scorer = EncoderScorer(PatchesOnly())  # type: ignore[arg-type]
    scores = scorer.score(picture(30, 220), ["left", "other", "left"])
    assert np.allclose(scores, [0.5, 0.7, 0.5])
    assert scorer.score(picture(30, 220), []).shape == (0,)
    assert scores.dtype == np.float32


class LeftOnly(PatchesOnly):
    """The same encoder, to which every whole picture looks like the left patch."""

    def encode_images(self, frames):
        return np.array([[1, 0]] * len(frames), np.float32)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("oracle:mild,encoder=minilm", {}),
        ("oracle,encoder=my.words:make", {"encoder": "my.words:make"}),
        ("my.eyes:make", {"perception": "my.eyes:make"}),
        ("encoder=clip:ID,detector=yolox:FILE", {}),
        (
            "encoder=my.words:make,detector=my.eyes:make,scorer=my.eyes:judge",
            {"encoder": "my.words:make", "detector": "my.eyes:make", "scorer": "my.eyes:judge"},
        ),
    ],
)
def test_users_own_code_in_a_name_is_known_by_its_part(name: str, expected: dict[str, str]) -> None:
    assert own_parts(name) == expected


class Sure:
    """A scorer for which every picture fits every text equally well."""

    name = "sure"

    def score(self, frame, texts):
        return np.full(len(texts), 0.25, np.float32)


def test_a_scorer_of_ones_own_takes_the_place_of_the_encoders_cosine() -> None:
    name = f"encoder={__name__}:LeftOnly,detector={__name__}:Blind"
    frame = picture(30, 220)
    assert make_perception(name).scorer.score(frame, ["left", "other"]) == pytest.approx([1.0, 0.6])
    own = make_perception(f"{name},scorer={__name__}:Sure")
    assert own.scorer.score(frame, ["left", "other"]).tolist() == [0.25, 0.25]
    assert own.name.endswith(" + sure")
    with pytest.raises(AgentError, match="found no method score"):
        make_perception(f"{name},scorer=builtins:dict")


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("red wooden chair beside the window", "chair"), ("grey sofas", "couch"), ("a television", "tv"),
        ("low oak table with a green bowl", "dining table"), ("Dee's armchair", "chair"), ("the plant", "potted plant"),
        ("potted plant on the desk", "potted plant"), ("fridge", "refrigerator"), ("copper lamp", None),
        ("teddy bear", "teddy bear"), ("glasses", "wine glass"), ("bookshelf", None), ("", None),
    ],
)  # fmt: skip
def test_the_head_noun_of_a_query_names_a_class_of_coco(query: str, expected: str | None) -> None:
    assert coco_class(query) == expected


def test_coco_has_80_classes_and_each_names_itself() -> None:
    assert len(set(COCO)) == 80
    assert all(coco_class(f"a {name}") == name for name in COCO)


def test_a_category_is_named_by_its_noun_or_a_synonym() -> None:
    assert names_category("grey sofa near the wall", "couch")
    assert names_category("two dining tables", "table")
    assert not names_category("sofa", "sofa_bed")
    assert not names_category("lamp on the table", "table")
    assert is_category("a couch", "couch")
    assert not is_category("red couch", "couch")


def test_boxes_are_cut_overlap_and_hold_whole_pixels() -> None:
    assert cut_box((-5, 2, 20, 300), (100, 50)) == (0, 2, 20, 100)
    assert cut_box((49.5, 0, 80, 10), (100, 50)) is None  # half a pixel is left
    assert overlap((0, 0, 10, 10), (5, 0, 15, 10)) == pytest.approx(1 / 3)
    assert overlap((0, 0, 10, 10), (10, 0, 20, 10)) == 0
    assert pixels_in_box((1.2, -3, 4.0, 2.5), (10, 10)) == (slice(0, 3), slice(1, 4))
    ids = np.zeros((6, 8), np.int32)
    ids[1:3, 2:5], ids[4, 7] = 3, 9
    assert boxes_of_ids(ids) == {3: (2, 1, 5, 3), 9: (7, 4, 8, 5)}
    boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [20, 0, 30, 10], [0, 6, 10, 16]], float)
    assert without_overlaps(boxes, np.array([0.5, 0.9, 0.2, 0.8]), most=0.45) == [1, 3, 2]

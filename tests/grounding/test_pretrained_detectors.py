"""OWLv2 and GroundingDINO through the real loading code, offline, with tiny models of random weights."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
import transformers

from grounding.checks import check_detector
from grounding.encoders.packed_bert import one_thread
from grounding.encoders.protocol import ModelOptions
from grounding.perception.by_name import make_detector, make_perception
from grounding.perception.grounding_dino import GroundingDino
from grounding.perception.owlv2 import Owlv2
from sim.errors import AgentError
from sim.tasks.observers import Detection
from sim.types import Frame

from .tiny_models import picture, save_clip, save_grounding_dino, save_owlv2


@pytest.fixture(scope="module", autouse=True)
def few_threads() -> Iterator[None]:
    with one_thread():
        yield


@pytest.fixture(scope="module")
def owlv2_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_owlv2(tmp_path_factory.mktemp("owlv2"))


@pytest.fixture(scope="module")
def dino_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_grounding_dino(tmp_path_factory.mktemp("dino"))


def table(found: list[Detection]) -> np.ndarray:
    """(N, 5) boxes and scores."""
    return np.array([[*item.box, item.score] for item in found])


def expected_table(result: dict, frame: Frame) -> np.ndarray:
    """The same of an answer of `transformers`, best first, cut at the picture's edges."""
    height, width = frame.depth_m.shape
    boxes, scores = result["boxes"].numpy(), result["scores"].numpy()
    boxes = np.clip(boxes, 0, (width, height, width, height))[np.argsort(-scores, kind="stable")]
    rows = np.column_stack([boxes, np.sort(scores)[::-1]])
    return rows[(rows[:, 2] - rows[:, 0] >= 1) & (rows[:, 3] - rows[:, 1] >= 1)]


@pytest.mark.parametrize(("width", "height"), [(96, 64), (64, 96)])
def test_boxes_of_owlv2_equal_those_of_transformers(width: int, height: int, owlv2_folder: Path) -> None:
    frame = picture(30, 220, width=width, height=height)
    eye = Owlv2(str(owlv2_folder), threshold=0.5)
    eye.set_query("red chair")
    model = transformers.Owlv2ForObjectDetection.from_pretrained(owlv2_folder).eval()
    tokenizer = transformers.AutoTokenizer.from_pretrained(owlv2_folder)
    processor = transformers.Owlv2ImageProcessorPil.from_pretrained(owlv2_folder)
    tokens = tokenizer(["red chair"], padding="max_length", max_length=16, padding_side="right", return_tensors="pt")
    pixels = processor([frame.rgb], return_tensors="pt", input_data_format="channels_last")
    with torch.inference_mode():
        outputs = model(tokens["input_ids"], pixels["pixel_values"], attention_mask=tokens["attention_mask"])
    (result,) = processor.post_process_object_detection(outputs, threshold=0.5, target_sizes=[(height, width)])
    found = eye.detect(frame)
    assert len(found) >= 3
    assert np.allclose(table(found), expected_table(result, frame), atol=1e-3)
    assert {item.label for item in found} == {"red chair"}


def test_boxes_of_grounding_dino_are_those_whose_phrase_is_the_whole_query(dino_folder: Path) -> None:
    frame = picture(30, 220)
    model = transformers.GroundingDinoForObjectDetection.from_pretrained(dino_folder).eval()
    processor = transformers.GroundingDinoProcessor(
        transformers.GroundingDinoImageProcessorPil.from_pretrained(dino_folder),
        transformers.AutoTokenizer.from_pretrained(dino_folder),
    )
    inputs = processor(
        images=[frame.rgb], text="red wooden chair .", return_tensors="pt", input_data_format="channels_last"
    )
    with torch.inference_mode():
        outputs = model(**inputs)
    partly = False
    for text_threshold in (0.5, 0.99):
        (result,) = processor.post_process_grounded_object_detection(
            outputs, inputs["input_ids"], threshold=0.35, text_threshold=text_threshold, target_sizes=[(64, 96)]
        )
        phrases = [phrase.replace(".", "").replace("[SEP]", "").strip() for phrase in result["text_labels"]]
        whole = [phrase == "red wooden chair" for phrase in phrases]
        kept = {"boxes": result["boxes"][whole], "scores": result["scores"][whole]}
        partly |= 0 < sum(whole) < len(whole)
        eye = GroundingDino(str(dino_folder), text_threshold=text_threshold)
        eye.set_query("Red wooden chair.")
        found, expected = eye.detect(frame), expected_table(kept, frame)
        assert table(found).shape[0] == len(expected)
        if len(found):
            assert np.allclose(table(found), expected, atol=1e-3)
            assert found[0].label == "Red wooden chair"
    assert partly  # some boxes were left out for their phrase alone


def test_long_queries_are_cut_and_thresholds_are_in_the_name(owlv2_folder: Path) -> None:
    eye = Owlv2(str(owlv2_folder), threshold=0.5)
    answers = []
    for last in ("sofa", "table"):
        eye.set_query("lamp " * 30 + last)
        answers.append(table(eye.detect(picture(30, 220))))
    assert np.allclose(*answers)
    assert eye.name.startswith("owlv2-0.5@")
    assert make_detector(f"owlv2:{owlv2_folder}").name.startswith("owlv2-0.4@")
    eye.set_query("lamp")
    everything = len(eye.detect(picture(30, 220)))
    strict = Owlv2(str(owlv2_folder), threshold=0.99)
    strict.set_query("lamp")
    assert len(strict.detect(picture(30, 220))) < everything


@pytest.mark.slow
def test_our_detectors_keep_the_contract(owlv2_folder: Path, dino_folder: Path) -> None:
    assert check_detector(lambda: make_detector(f"owlv2:{owlv2_folder}")) == []
    assert check_detector(lambda: make_detector(f"grounding-dino:{dino_folder}")) == []


def test_a_detector_without_query_or_of_another_family_is_refused(owlv2_folder: Path, dino_folder: Path) -> None:
    eye = Owlv2(str(owlv2_folder))
    with pytest.raises(AgentError, match="has no query; expected set_query"):
        eye.detect(picture(30, 220))
    with pytest.raises(AgentError, match=r"query is '  '; expected words"):
        eye.set_query("  ")
    with pytest.raises(AgentError, match=r"config\.json says model_type 'grounding-dino'; expected owlv2"):
        make_detector(f"owlv2:{dino_folder}")
    with pytest.raises(AgentError, match=r"found no such folder; expected one with config\.json"):
        make_detector("grounding-dino:./nothing/here")
    with pytest.raises(AgentError, match=r"in the local cache \(downloads are off\)"):
        make_detector("owlv2:nobody/no-such-model", options=ModelOptions(download=False))


def test_perception_of_models_scores_detects_and_says_their_names(owlv2_folder: Path, tmp_path: Path) -> None:
    clip = save_clip(tmp_path / "clip")
    eye = make_perception(f"encoder=clip:{clip},detector=owlv2:{owlv2_folder}")
    frame = picture(30, 220)
    scores = eye.scorer.score(frame, ["red chair", "large white sofa"])
    rows = eye.encoder.encode_texts(["red chair", "large white sofa"])
    assert np.allclose(scores, rows @ eye.encoder.encode_images([frame])[0], atol=1e-6)
    eye.detector.set_query("red chair")
    for found in eye.detector.detect(frame):
        assert eye.segmenter.mask(frame, found).shape == (64, 96)
    assert eye.name == f"clip:{clip} + {eye.detector.name} + depth region"  # type: ignore[attr-defined]

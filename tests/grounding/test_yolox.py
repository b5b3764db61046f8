"""YOLOX: its input and its decoding by hand, and, where onnxruntime is installed, a real file on real pictures."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.checks import check_detector
from grounding.perception.boxes import overlap
from grounding.perception.by_name import make_detector
from grounding.perception.segmenters import DepthRegion
from grounding.perception.yolox import Yolox, decoded, letterboxed, model_file
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, MissingDependencyError
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.types import Camera

from ..conftest import SHARED
from .tiny_models import picture

MODEL = SHARED / "models" / "yolox_nano.onnx"
PICTURES = SHARED / "robot" / "slambook2-ch12" / "color"


@pytest.fixture(scope="module")
def yolox() -> Yolox:
    pytest.importorskip("onnxruntime")
    if not MODEL.is_file():
        pytest.skip(f"no model at {MODEL}")
    return Yolox(MODEL)


def test_a_picture_keeps_its_proportions_at_the_top_left_in_blue_green_red() -> None:
    rgb = np.zeros((2, 4, 3), np.uint8)
    rgb[:] = (200, 100, 50)
    pixels, scale = letterboxed(rgb, (8, 8))
    assert scale == 2
    assert pixels.shape == (3, 8, 8)
    assert pixels.dtype == np.float32
    assert pixels[:, 0, 0].tolist() == [50, 100, 200]
    assert pixels[:, 3, 7].tolist() == [50, 100, 200]
    assert pixels[:, 4, 0].tolist() == [114, 114, 114]
    tall, scale = letterboxed(np.zeros((300, 100, 3), np.uint8), (60, 60))
    assert scale == 0.2
    assert (tall[0, :, :20] == 0).all()
    assert (tall[0, :, 20:] == 114).all()


def test_boxes_are_places_on_three_grids_from_fine_to_coarse() -> None:
    output = np.zeros((16 + 4 + 1, 5 + 2), np.float32)  # for 32 x 32 pixels: 4 x 4, 2 x 2 and 1 x 1 places
    output[6] = [0.5, 0.25, math.log(2), 0, 0.5, 0.8, 0.2]  # stride 8, row 1, column 2
    output[18] = [0, 0, 0, 0, 1, 0, 1]  # stride 16, row 1, column 0
    output[20] = [0.5, 0.5, 0, math.log(0.5), 0.9, 1, 0]  # stride 32
    boxes, scores = decoded(output, (32, 32))
    assert np.allclose(boxes[6], [20 - 8, 10 - 4, 20 + 8, 10 + 4], atol=1e-5)
    assert np.allclose(boxes[18], [-8, 8, 8, 24], atol=1e-5)
    assert np.allclose(boxes[20], [0, 8, 32, 24], atol=1e-5)
    assert np.allclose(scores[[6, 18, 20]], [[0.4, 0.1], [0, 1], [0.9, 0]], atol=1e-6)


def test_a_file_is_found_as_given_or_in_the_folder_of_models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tiny.onnx").write_bytes(b"no model")
    monkeypatch.delenv("PERSONAL_VIZ_MODELS", raising=False)
    assert model_file(tmp_path / "tiny.onnx") == tmp_path / "tiny.onnx"
    with pytest.raises(AgentError, match=r"'tiny\.onnx': found no such file \(PERSONAL_VIZ_MODELS is not set\)"):
        model_file("tiny.onnx")
    monkeypatch.setenv("PERSONAL_VIZ_MODELS", str(tmp_path))
    assert model_file("tiny.onnx") == tmp_path / "tiny.onnx"
    with pytest.raises(AgentError, match=r"'other\.onnx': found no such file \(PERSONAL_VIZ_MODELS is '"):
        model_file("other.onnx")


def test_without_onnxruntime_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tiny.onnx").write_bytes(b"no model")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingDependencyError, match=r"Run: pip install 'personal-viz\[perception\]'"):
        make_detector(f"yolox:{tmp_path / 'tiny.onnx'}")


def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    (tmp_path / "tiny.onnx").write_bytes(b"no model")
    with pytest.raises(AgentError, match=r"tiny\.onnx: cannot be loaded \(.*expected an ONNX file of YOLOX"):
        Yolox(tmp_path / "tiny.onnx")


def test_it_finds_the_sofa_in_a_real_picture(yolox: Yolox) -> None:
    if not PICTURES.is_dir():
        pytest.skip(f"no pictures at {PICTURES}")
    rgb = np.asarray(Image.open(PICTURES / "1.png").convert("RGB"))
    frame = replace(picture(0, 0, width=rgb.shape[1], height=rgb.shape[0]), rgb=rgb)
    yolox.set_query("white sofa with two cushions")
    assert yolox.query_class == "couch"
    best = yolox.detect(frame)[0]
    assert best.label == "couch"
    # by eye: from the left arm to the picture's right edge, from its back to the lower edge
    assert overlap(best.box, (304, 315, 640, 480)) > 0.5
    yolox.set_query("copper lamp")  # a thing that COCO has no class for
    assert yolox.query_class is None
    assert yolox.detect(frame) == []


@pytest.mark.slow
def test_it_keeps_the_contract_on_pictures_of_an_invented_home(yolox: Yolox, small_home_root: Path) -> None:
    assert check_detector(lambda: Yolox(MODEL)) == []
    dataset = PersonalDataset(small_home_root)
    scene = open_scene(dataset, "Small")
    start, camera = next(iter(dataset.episodes())).start, Camera(width=320, height=240)
    for turn in range(8):
        pose = replace(start, yaw=start.yaw + turn * math.pi / 4)
        frame = renderer_of(scene).render(T_world_camera(pose, camera), camera)
        for query in ("chair", "sofa", "bed", "plant", "table"):
            yolox.set_query(query)
            found = yolox.detect(frame)
            assert [item.score for item in found] == sorted((item.score for item in found), reverse=True)
            for item in found:
                assert 0 <= item.box[0] < item.box[2] <= 320
                assert DepthRegion().mask(frame, item).any()

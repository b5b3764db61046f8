"""YOLOX through onnxruntime: a fast detector of COCO's 80 classes; extra `perception`.

The file is the user's own, an export of YOLOX without decoding, as its authors publish them (Apache-2.0). It knows
classes, not descriptions: it finds all things of the class that the query's head noun names.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.errors import AgentError
from sim.extras import require
from sim.tasks.observers import Detection
from sim.types import Frame

from .boxes import corners_from_centres, detections_from_boxes, without_overlaps
from .named_things import COCO, checked_query, coco_class, require_query

FOLDER = "PERSONAL_VIZ_MODELS"
"""Environment variable with the folder of the user's model files."""
THRESHOLD, MOST_OVERLAP = 0.3, 0.45
"""Least score, and greatest overlap of two boxes of one class: those of YOLOX's own demonstration for ONNX."""
STRIDES = (8, 16, 32)
"""Pixels between the places at which the model answers, on its three grids."""
_PADDING = 114
"""Grey of the picture's padding, as in YOLOX's training."""


class Yolox:
    """A `Detector` of one YOLOX file, on the processor."""

    def __init__(self, file: str | Path, *, threshold: float = THRESHOLD) -> None:
        """Loads the model.

        Args:
            file: An .onnx file, or its name inside the folder of the environment variable PERSONAL_VIZ_MODELS.
            threshold: Least score, objectness times class.

        Raises:
            MissingDependencyError: Extra `perception` is not installed.
            AgentError: The file is missing, damaged, or no YOLOX of COCO's classes.
        """
        path = model_file(file)
        onnxruntime = require("onnxruntime", extra="perception")
        try:
            self._session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no common base
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise AgentError(
                f"model {path}: cannot be loaded ({first}); expected an ONNX file of YOLOX. Download it again."
            ) from error
        self._input, self._size = _input_of(self._session, path)
        self._threshold = threshold
        self._query, self._class = "", None
        self.name = f"yolox-{path.stem}-{threshold:g}"

    def set_query(self, text: str) -> None:
        """Says what to find; a thing that COCO has no class for is never found, see `query_class`."""
        self._query = checked_query(text, self.name)
        self._class = coco_class(self._query)

    @property
    def query_class(self) -> str | None:
        """The class of COCO that the query names; None where it names none, and `detect` finds nothing."""
        return self._class

    def detect(self, frame: Frame) -> list[Detection]:
        """The things of the query's class above the threshold, best first, named by their class.

        Raises:
            AgentError: There is no query yet.
        """
        require_query(self._query, self.name)
        if self._class is None:
            return []
        pixels, scale = letterboxed(frame.rgb, self._size)
        (output,) = self._session.run(None, {self._input: pixels[None]})
        boxes, scores = decoded(output[0], self._size)
        of_class = scores[:, COCO.index(self._class)]
        likely = np.flatnonzero(of_class > self._threshold)
        kept = likely[without_overlaps(boxes[likely], of_class[likely], most=MOST_OVERLAP)]
        return detections_from_boxes(boxes[kept] / scale, of_class[kept], frame, label=self._class)


def model_file(file: str | Path) -> Path:
    """The path of a user's model file: as given, or inside the folder that PERSONAL_VIZ_MODELS names.

    Raises:
        AgentError: There is no such file.
    """
    folder = os.environ.get(FOLDER)
    places = [Path(file).expanduser(), *([Path(folder).expanduser() / file] if folder else [])]
    for path in places:
        if path.is_file():
            return path
    found = f"{FOLDER} is {folder!r}" if folder else f"{FOLDER} is not set"
    raise AgentError(
        f"model {str(file)!r}: found no such file ({found}); expected an .onnx file of YOLOX. Give its path, or its "
        f"name in the folder of {FOLDER}."
    )


def letterboxed(rgb: NDArray[np.uint8], size: tuple[int, int]) -> tuple[NDArray[np.float32], float]:
    """A picture as YOLOX wants it, and the model's pixels per pixel of the picture.

    Args:
        rgb: (h, w, 3).
        size: (H, W) of the model's input.

    Returns:
        (3, H, W) blue, green, red from 0 to 255; the picture is at the top left, the rest is grey.
    """
    height, width = rgb.shape[:2]
    scale = min(size[0] / height, size[1] / width)
    small = Image.fromarray(rgb).resize((int(width * scale), int(height * scale)), Image.Resampling.BILINEAR)
    whole = np.full((*size, 3), _PADDING, np.float32)
    whole[: small.height, : small.width] = np.asarray(small)
    return np.ascontiguousarray(whole[..., ::-1].transpose(2, 0, 1)), scale


def decoded(output: NDArray[np.float32], size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Boxes and scores of the model's raw output.

    Args:
        output: (N, 5 + C): centre and size relative to the grid, objectness, and a share per class; N places of the
            three grids, row by row, finest first.
        size: (H, W) of the model's input, in pixels.

    Returns:
        Boxes (N, 4) in pixels of the input, and scores (N, C), objectness times class.
    """
    corners, strides = _grids(size)
    assert len(output) == len(corners), (output.shape, size)
    values = output.astype(np.float64)
    centres = (values[:, :2] + corners) * strides[:, None]
    boxes = corners_from_centres(np.concatenate([centres, np.exp(values[:, 2:4]) * strides[:, None]], axis=1))
    return boxes, values[:, 4:5] * values[:, 5:]


def _grids(size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 2) column and row of each place on its grid, and (N,) the grid's stride."""
    corners, strides = [], []
    for stride in STRIDES:
        rows, cols = np.mgrid[0 : size[0] // stride, 0 : size[1] // stride]
        corners.append(np.column_stack([cols.ravel(), rows.ravel()]))
        strides.append(np.full(rows.size, stride))
    return np.concatenate(corners).astype(float), np.concatenate(strides).astype(float)


def _input_of(session: Any, path: Path) -> tuple[str, tuple[int, int]]:
    """Name and (H, W) of the model's only input; raises AgentError for a model of another kind."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    shapes = [list(item.shape) for item in (*inputs, *outputs)]
    if len(shapes) == 2 and len(shapes[0]) == 4 and all(isinstance(side, int) for side in shapes[0][2:]):
        height, width = shapes[0][2:]
        num_places = sum((height // stride) * (width // stride) for stride in STRIDES)
        if shapes[0][1] == 3 and shapes[1][1:] == [num_places, 5 + len(COCO)]:
            return inputs[0].name, (height, width)
    raise AgentError(
        f"model {path}: has inputs and outputs of shapes {shapes}; expected (1, 3, H, W) and (1, N, {5 + len(COCO)}), "
        "YOLOX for COCO exported without decoding. Export it with YOLOX's tools/export_onnx.py."
    )

"""Open-vocabulary detectors of `transformers`: loading, devices, boxes in pixels; one file per model adapts it.

Extra `models`. The weights are never ours: users name a model id or a folder.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.tasks.observers import Detection
from sim.types import Frame

from ..encoders.pretrained import inference, load_model, weights_digest
from ..encoders.protocol import ModelOptions
from .boxes import detections_from_boxes
from .named_things import checked_query, require_query


class PretrainedDetector(ABC):
    """A `Detector` of a model in float32; an adapter says how a picture and a query go through its model."""

    name: str
    """Says the model's kind, thresholds and digest."""

    def __init__(self, source: str, classes: Mapping[str, str], options: ModelOptions | None) -> None:
        """Loads model, tokenizer and image processor.

        Args:
            source: A model id, or a folder as `save_pretrained` writes it.
            classes: Which `transformers` class loads which `model_type`.

        Raises:
            MissingDependencyError: Extra `models` is not installed.
            AgentError: The model cannot be loaded, as `load_model` says.
        """
        self._options = options or ModelOptions()
        self._model, self._tokenizer, self._processor = load_model(source, classes, self._options)
        self._digest = weights_digest(self._model)
        self._query = ""

    def set_query(self, text: str) -> None:
        """Says what to find; raises AgentError for a text without words."""
        self._query = checked_query(text, self.name)

    def detect(self, frame: Frame) -> list[Detection]:
        """The boxes above the model's threshold, best first, in pixels of the frame; overlapping ones are kept."""
        require_query(self._query, self.name)
        with inference(self._options):
            boxes, scores = self._found(frame, self._query)
        return detections_from_boxes(boxes, scores, frame, label=self._query)

    @abstractmethod
    def _found(self, frame: Frame, query: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Boxes (N, 4) in pixels of the frame, and scores (N,), for one query."""

    def _pixels(self, frame: Frame) -> dict[str, Any]:
        """The model's picture inputs on the device."""
        inputs = self._processor([np.asarray(frame.rgb)], return_tensors="pt", input_data_format="channels_last")
        return {key: value.to(self._options.device) for key, value in inputs.items()}

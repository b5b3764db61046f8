"""OWLv2: boxes for one text query; extra `models`.

The picture is padded at the right and at the bottom to a square, which is resized to the model's; boxes are shares of
that square. No suppression of overlapping boxes: one query has one class, and the model was trained to answer each
thing once.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from ..encoders.protocol import ModelOptions
from .boxes import corners_from_centres
from .pretrained_detector import PretrainedDetector

DEFAULT_MODEL = "google/owlv2-base-patch16-ensemble"
"""The one of a public VLFM with OWLv2 (AGENTS.md, section 1.7)."""
THRESHOLD = 0.4
"""Least score: the `non_coco_threshold` of VLFM, which that variant applies to OWLv2."""


class Owlv2(PretrainedDetector):
    """The adapter of OWLv2; queries are cut at the model's longest text, 16 tokens in the released ones."""

    def __init__(
        self, source: str = DEFAULT_MODEL, *, threshold: float = THRESHOLD, options: ModelOptions | None = None
    ) -> None:
        """Loads an OWLv2 model by id or folder; raises like PretrainedDetector."""
        super().__init__(source, {"owlv2": "Owlv2ForObjectDetection"}, options)
        self._threshold = threshold
        self._max_tokens = self._model.config.text_config.max_position_embeddings
        self.name = f"owlv2-{threshold:g}@{self._digest}"

    def _found(self, frame: Frame, query: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        found = self._model(**self._tokens(query), pixel_values=self._pixels(frame)["pixel_values"])
        scores = found.logits[0, :, 0].float().sigmoid().cpu().numpy()  # (P,) for the only query
        boxes = corners_from_centres(found.pred_boxes[0].float().cpu().numpy()) * max(frame.depth_m.shape)
        is_kept = scores > self._threshold
        return boxes[is_kept], scores[is_kept]

    def _tokens(self, query: str) -> dict[str, Any]:
        made = self._tokenizer(
            [query],
            padding="max_length",
            padding_side="right",
            truncation=True,
            max_length=self._max_tokens,
            return_tensors="pt",
        )
        return {key: made[key].to(self._options.device) for key in ("input_ids", "attention_mask")}

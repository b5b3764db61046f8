"""GroundingDINO: boxes whose phrase is the whole query; extra `models`.

The model gives each box a score per token of the caption. A box's phrase is the tokens above `TEXT_THRESHOLD`; a box
counts if its phrase is the whole query, so that "red chair" is not answered with chairs of any colour. The caption is
"<query> .", as the model was trained.
"""

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from ..encoders.protocol import ModelOptions
from .boxes import corners_from_centres
from .pretrained_detector import PretrainedDetector

DEFAULT_MODEL = "IDEA-Research/grounding-dino-tiny"
"""Swin-T, as in VLFM (AGENTS.md, section 1.7)."""
BOX_THRESHOLD, TEXT_THRESHOLD = 0.35, 0.25
"""Least score of a box, and of a token of its phrase (VLFM)."""


class GroundingDino(PretrainedDetector):
    """The adapter of GroundingDINO."""

    def __init__(
        self,
        source: str = DEFAULT_MODEL,
        *,
        box_threshold: float = BOX_THRESHOLD,
        text_threshold: float = TEXT_THRESHOLD,
        options: ModelOptions | None = None,
    ) -> None:
        """Loads a GroundingDINO model by id or folder; raises like PretrainedDetector."""
        super().__init__(source, {"grounding-dino": "GroundingDinoForObjectDetection"}, options)
        self._box_threshold, self._text_threshold = box_threshold, text_threshold
        self._max_tokens = self._model.config.max_text_len
        self.name = f"grounding-dino-{box_threshold:g}-{text_threshold:g}@{self._digest}"

    def _found(self, frame: Frame, query: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        made = self._tokenizer(
            [f"{query.lower()} ."], truncation=True, max_length=self._max_tokens, return_tensors="pt"
        )
        tokens = {key: made[key].to(self._options.device) for key in ("input_ids", "token_type_ids", "attention_mask")}
        found = self._model(**tokens, **self._pixels(frame))
        num_tokens = tokens["input_ids"].shape[1]
        scores = found.logits[0, :, :num_tokens].float().sigmoid().cpu().numpy()  # (Q, tokens)
        best = scores.max(axis=1)
        words = scores[:, 1 : num_tokens - 2]  # without the start, the full stop and the end
        is_kept = (best > self._box_threshold) & (words > self._text_threshold).all(axis=1)
        height, width = frame.depth_m.shape
        boxes = corners_from_centres(found.pred_boxes[0].float().cpu().numpy()) * (width, height, width, height)
        return boxes[is_kept], best[is_kept].astype(float)

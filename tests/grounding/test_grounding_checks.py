"""The checks for plug-ins: ours pass, and each breach of a contract is named."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from grounding.checks import check_encoder, check_grounder
from grounding.encoders.hashed import HashedWords
from grounding.maps.home_map import MemoryKind
from grounding.methods.baselines import QueryScoring
from grounding.methods.by_name import GrounderName, make_grounder
from grounding.methods.rpg import PRESETS, RegionGated, RpgOptions
from grounding.types import Grounding
from sim.errors import AgentError

WORDS = HashedWords()


@pytest.mark.parametrize("name", get_args(GrounderName))
def test_our_grounders_keep_the_contract(name) -> None:
    check_grounder(make_grounder(name, WORDS), WORDS)


@pytest.mark.parametrize("options", [PRESETS["authors"], RpgOptions(literal=True)])
def test_rpg_keeps_the_contract_with_other_options(options: RpgOptions) -> None:
    check_grounder(RegionGated(WORDS, options=options), WORDS)


class LongVectors(HashedWords):
    def encode_texts(self, texts):
        return 2 * super().encode_texts(texts)


class Doubles(HashedWords):
    def encode_texts(self, texts):
        return super().encode_texts(texts).astype(float)


class WrongDim(HashedWords):
    dim = 512


class Forgetful(HashedWords):
    def __init__(self) -> None:
        super().__init__()
        self._rng = np.random.default_rng(0)

    def encode_texts(self, texts):
        vectors = self._rng.normal(size=(len(texts), 768)).astype(np.float32)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


class Constant(HashedWords):
    def encode_texts(self, texts):
        return np.tile(np.eye(1, 768, dtype=np.float32), (len(texts), 1))


class MeanOfBatch(HashedWords):
    """Subtracts the batch's mean, so that a text's vector depends on its neighbours."""

    def encode_texts(self, texts):
        vectors = super().encode_texts(texts)
        if len(texts) > 1:
            vectors = vectors - 0.5 * vectors.mean(axis=0)
        norms = np.linalg.norm(vectors, axis=1, keepdims=True)
        return (vectors / np.where(norms > 0, norms, 1)).astype(np.float32)


@pytest.mark.parametrize(
    ("encoder", "message"),
    [
        (LongVectors(), r"lengths of vectors is \[2.0, 2.0, 2.0\]; expected 1"),
        (Doubles(), "dtype is 'float64'; expected float32"),
        (WrongDim(), r"shape is \(3, 768\); expected \(3, 512\)"),
        (Forgetful(), "second answer is 'another one'; expected the same vectors every time"),
        (Constant(), "cosine of different texts is 1.0; expected below 1"),
        (MeanOfBatch(), "change when a text is encoded alone is"),
    ],
)
def test_a_broken_encoder_is_named(encoder: HashedWords, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        check_encoder(encoder)


class Changed:
    """QS whose candidates are changed by `edit`."""

    name, uses_phrases, frame = "changed", False, "non-empty cells"
    takes: MemoryKind = "grid"

    def __init__(self, edit) -> None:
        self._edit = edit

    def ground(self, memory, task, phrases) -> Grounding:
        return Grounding(self._edit(QueryScoring(WORDS).ground(memory, task, phrases).candidates))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda found: (), "candidates is 0; expected at least one"),
        (lambda found: found[::-1], "expected finite numbers, best first"),
        (lambda found: tuple(replace(item, row=item.col, col=item.row) for item in found), "row and column is"),
        (lambda found: tuple(replace(item, index=item.index + 1) for item in found), "index is"),
        (
            lambda found: tuple(replace(item, position=(item.position[0], 9.0, item.position[2])) for item in found),
            r"height of a candidate is 9.0; expected one of the map's floors \[0.25\]",
        ),
    ],
)
def test_a_broken_grounder_is_named(edit, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        check_grounder(Changed(edit), WORDS)


def test_a_grounder_that_changes_its_mind_is_named() -> None:
    class Moody(Changed):
        calls = 0

        def ground(self, memory, task, phrases) -> Grounding:
            self.calls += 1
            found = super().ground(memory, task, phrases)
            return Grounding(found.candidates[: 1 + self.calls % 2])

    with pytest.raises(AgentError, match="expected the same answer to the same inputs"):
        check_grounder(Moody(lambda found: found), WORDS)

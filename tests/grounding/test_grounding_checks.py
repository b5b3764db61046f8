"""The checks for plug-ins: our own pass, and each breach of a contract is named."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from grounding.checks import check_encoder, check_grounder, check_phrases
from grounding.encoders.hashed import HashedWords
from grounding.maps.home_map import MemoryKind
from grounding.methods.baselines import QueryScoring
from grounding.methods.by_name import GrounderName, make_grounder
from grounding.methods.chat_grounders import CHAT_METHODS
from grounding.methods.rpg import PRESETS, RegionGated, RpgOptions
from grounding.phrases.rules import RulePhrases
from grounding.types import Grounding

WORDS = HashedWords()


@pytest.mark.parametrize("name", [name for name in get_args(GrounderName) if name not in CHAT_METHODS])
def test_our_grounders_keep_the_contract(name) -> None:
    assert check_grounder(lambda encoder: make_grounder(name, encoder), WORDS) == []


@pytest.mark.slow
def test_our_grounders_and_phrases_give_the_same_answers_in_another_process() -> None:
    assert check_grounder(make_grounder("joint", WORDS), WORDS) == []
    assert check_phrases(RulePhrases) == []


@pytest.mark.slow
@pytest.mark.parametrize("options", [PRESETS["authors"], RpgOptions(literal=True)])
def test_rpg_keeps_the_contract_with_other_options(options: RpgOptions) -> None:
    assert check_grounder(RegionGated(WORDS, options=options), WORDS) == []


def changed(encode_texts: Callable[[Sequence[str]], np.ndarray], *, dim: int = 768) -> HashedWords:
    """An encoder with this `encode_texts`."""
    return type("Changed", (HashedWords,), {"encode_texts": lambda self, texts: encode_texts(texts), "dim": dim})()


class Forgetful(HashedWords):
    def __init__(self) -> None:
        super().__init__()
        self._rng = np.random.default_rng(0)

    def encode_texts(self, texts):
        vectors = self._rng.normal(size=(len(texts), 768)).astype(np.float32)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


class MeanOfBatch(HashedWords):
    """Subtracts the mean of the batch, so that the vector of a text depends on the other texts."""

    def encode_texts(self, texts):
        vectors = super().encode_texts(texts)
        if len(texts) > 1:
            vectors = vectors - 0.5 * vectors.mean(axis=0)
        norms = np.linalg.norm(vectors, axis=1, keepdims=True)
        return (vectors / np.where(norms > 0, norms, 1)).astype(np.float32)


@pytest.mark.parametrize(
    ("encoder", "message"),
    [
        (changed(lambda texts: 2 * WORDS.encode_texts(texts)), r"lengths of vectors is \[2.0, 2.0, 2.0\]; expected 1"),
        (changed(lambda texts: WORDS.encode_texts(texts).astype(float)), "dtype is 'float64'; expected float32"),
        (changed(WORDS.encode_texts, dim=512), r"shape is \(3, 768\); expected \(3, 512\)"),
        (Forgetful(), "second answer is 'another one'; expected the same vectors every time"),
        (
            changed(lambda texts: np.tile(np.eye(1, 768, dtype=np.float32), (len(texts), 1))),
            "cosine of different texts is 1.0; expected below 1",
        ),
        (MeanOfBatch(), "change when a text is encoded alone is"),
    ],
)
def test_a_broken_encoder_is_named(encoder: HashedWords, message: str) -> None:
    (problem,) = check_encoder(encoder)
    assert re.search(message, problem)


class Hashes(HashedWords):
    """Makes vectors from Python's hash of a word, which differs between processes."""

    name = "hashes-8"
    dim = 8

    def encode_texts(self, texts):
        rows = [np.random.default_rng(abs(hash(text))).normal(size=8) for text in texts]
        vectors = np.array(rows, np.float32).reshape(len(texts), 8)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.slow
def test_an_encoder_that_differs_between_processes_is_named() -> None:
    for encoder in (Hashes(), Hashes, "tests.grounding.test_grounding_checks:Hashes"):
        (problem,) = check_encoder(encoder)
        assert "encoder 'hashes-8': a second process gives another answer to the same question" in problem


def test_an_object_that_is_no_plug_in_gives_one_line() -> None:
    assert check_encoder("hashes") == [
        "encoder is 'hashes'; expected your own as package.module:factory. See --help for others."
    ]
    assert check_encoder(object()) == [
        "encoder: found no method encode_texts(); expected one, because the contract needs it. Correct the plug-in."
    ]


class Changed:
    """A QS grounder whose candidates are changed by `edit`."""

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
    (problem,) = check_grounder(Changed(edit), WORDS)
    assert re.search(message, problem)


def test_a_grounder_whose_answer_changes_is_named() -> None:
    class Moody(Changed):
        calls = 0

        def ground(self, memory, task, phrases) -> Grounding:
            self.calls += 1
            found = super().ground(memory, task, phrases)
            return Grounding(found.candidates[: 1 + self.calls % 2])

    (problem,) = check_grounder(Moody(lambda found: found), WORDS)
    assert re.search("expected the same answer to the same inputs", problem)

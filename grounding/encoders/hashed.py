"""Hashed words: texts to 768-d vectors without any weights, the offline default.

Takes words of two or more letters and pairs of neighbours, without English function words. Each is added with a sign at
the index given by its MurmurHash3 (the scheme of scikit-learn's HashingVectorizer); then the vector gets unit length.
"""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

DIM = 768
"""The dimension of the paper's map cells (Sec. IV: 50 x 50 x 768)."""
_WORD = re.compile(r"\b\w\w+\b")
_MASK = 0xFFFFFFFF
STOP_WORDS = frozenset(
    word
    for line in (
        # determiners, pronouns, small numbers
        "the an this that these those each every either neither both all any some no none other another such same own",
        "he she it we you they him her us them me my mine your yours his hers its our ours their theirs myself",
        "yourself himself herself itself ourselves yourselves themselves who whom whose which what someone something",
        "anyone anything everyone everything nobody nothing one two three four five six seven eight nine ten",
        # prepositions, the nouns of compound ones (on top of, next to), conjunctions
        "about above across after against along among around as at before behind below beneath beside besides between",
        "beyond by down during for from in inside into near of off on onto out over per since through throughout to",
        "toward towards under until up upon via with within without next top bottom front back side",
        "and or nor but if than though although because while where when why how whether unless",
        # auxiliaries, adverbs
        "am is are was were be been being do does did done doing has have had having can could may might must shall",
        "should will would cannot not also almost already always again ever never often once only just even still yet",
        "then thus so too very rather quite perhaps else however together here there now more most less least much",
        "many few several enough last latter further etc",
        # verbs of requests
        "find get give go put see seem seems show take please",
    )
    for word in line.split()
)


class HashedWords:
    """A `TextEncoder` that needs no weights; knows words, not meanings."""

    name = "hashed-words-768"
    dim = DIM

    def __init__(self) -> None:
        """Starts with an empty table of known terms."""
        self._places: dict[str, tuple[int, int]] = {}

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 768) unit rows; a zero row for a text of stop words only."""
        rows, cols, signs = [], [], []
        for index, text in enumerate(texts):
            for term in terms(text):
                col, sign = self._place(term)
                rows.append(index)
                cols.append(col)
                signs.append(sign)
        flat = np.array(rows, np.int64) * DIM + np.array(cols, np.int64)
        counts = np.bincount(flat, np.array(signs, np.float64), len(texts) * DIM).reshape(len(texts), DIM)
        norms = np.linalg.norm(counts, axis=1, keepdims=True)
        return (counts / np.where(norms > 0, norms, 1)).astype(np.float32)

    def _place(self, term: str) -> tuple[int, int]:
        place = self._places.get(term)
        if place is None:
            signed = murmur3(term.encode())
            signed = signed - 2**32 if signed >= 2**31 else signed
            place = self._places[term] = (abs(signed) % DIM, 1 if signed >= 0 else -1)
        return place


def terms(text: str) -> list[str]:
    """The words that count, lower case, then the pairs of neighbours among them."""
    words = [word for word in _WORD.findall(text.lower()) if word not in STOP_WORDS]
    return words + [f"{first} {second}" for first, second in pairwise(words)]


def murmur3(data: bytes, *, seed: int = 0) -> int:
    """MurmurHash3 (x86, 32 bit) of the bytes, in [0, 2^32)."""
    state = seed
    for start in range(0, len(data) - len(data) % 4, 4):
        state ^= _scramble(int.from_bytes(data[start : start + 4], "little"))
        state = (_rotate(state, 13) * 5 + 0xE6546B64) & _MASK
    state ^= _scramble(int.from_bytes(data[len(data) - len(data) % 4 :], "little"))
    state ^= len(data)
    state = (state ^ state >> 16) * 0x85EBCA6B & _MASK
    state = (state ^ state >> 13) * 0xC2B2AE35 & _MASK
    return state ^ state >> 16


def _scramble(block: int) -> int:
    return _rotate(block * 0xCC9E2D51 & _MASK, 15) * 0x1B873593 & _MASK


def _rotate(value: int, bits: int) -> int:
    return (value << bits | value >> (32 - bits)) & _MASK

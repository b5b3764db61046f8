"""Checks that users run on their own encoders, map builders and grounders; our own pass the same ones."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.plugins import problems_of
from sim.types import GridSpec, Task

from ..encoders.by_name import make_encoder
from ..encoders.protocol import EncoderName, TextEncoder
from ..maps.home_map import Memory, ObjectInstance, ObjectMap
from ..methods.by_name import Grounder
from ..phrases.sources import PhraseSource
from ..types import TIE, FeatureMap, Grounding, map_from_cells

_TEXTS = ("red wooden chair beside the window", "large white sofa", "oval mirror with a golden frame")
_TASK = Task("pog", "Mira owns the red wooden chair. Tom owns the white sofa.", ("Find Mira's chair",))
_PHRASES = ("Mira owns the red wooden chair in the kitchen", "Tom owns the large white sofa in the lounge")
_TOLERANCE = 1e-3
"""Allowed difference of vectors that should be equal; half-precision models stay below it."""


def check_encoder(encoder: TextEncoder | Callable[[], TextEncoder] | str) -> list[str]:
    """How an encoder breaks the contract of `TextEncoder`, here and in a second process.

    Args:
        encoder: The object, a factory, or its name as package.module:factory.

    Returns:
        The first breach; empty = the contract is kept.
    """
    return problems_of(encoder, require_encoder, methods=("encode_texts",), again=_text_rows, kind="encoder")


def _text_rows(encoder: TextEncoder) -> NDArray[np.float32]:
    return encoder.encode_texts(_TEXTS)


def require_encoder(encoder: TextEncoder) -> None:
    """Refuses an encoder that breaks the contract of `TextEncoder` in this process.

    Raises:
        AgentError: The contract is broken; the message names the first breach.
    """
    where = f"encoder {encoder.name!r}"
    require(bool(encoder.name), "encoder", "name", encoder.name, "a name that is unique to its vector space")
    vectors = _encoded(encoder, _TEXTS)
    norms = np.linalg.norm(vectors, axis=1)
    unit = bool(np.allclose(norms, 1, atol=_TOLERANCE))
    require(unit, where, "lengths of vectors", norms.round(4).tolist(), "1 for every text with words")
    again = _encoded(encoder, _TEXTS)
    require(bool(np.array_equal(vectors, again)), where, "second answer", "another one", "the same vectors every time")
    alone = np.concatenate([_encoded(encoder, [text]) for text in reversed(_TEXTS)])[::-1]
    worst = float(np.abs(alone - vectors).max())
    require(worst <= _TOLERANCE, where, "change when a text is encoded alone", worst, f"at most {_TOLERANCE}")
    closest = float((vectors @ vectors.T)[~np.eye(len(_TEXTS), dtype=bool)].max())
    require(closest < 1 - _TOLERANCE, where, "cosine of different texts", closest, "below 1")
    _encoded(encoder, [])
    empty = float(np.linalg.norm(_encoded(encoder, [""])))
    require(min(abs(empty), abs(empty - 1)) <= _TOLERANCE, where, "length for an empty text", empty, "0 or 1")


def check_grounder(
    grounder: Grounder | Callable[[TextEncoder], Grounder] | str, encoder: TextEncoder | EncoderName = "hashed"
) -> list[str]:
    """How a grounder breaks the contract of `Grounder`, here and in a second process.

    Args:
        grounder: The object, a factory, or its name as package.module:factory; the factory gets the encoder.
        encoder: The encoder of the maps, or its name; small maps are built in its space.

    Returns:
        The first breach; empty = the contract is kept.
    """
    eye = make_encoder(encoder) if isinstance(encoder, str) else encoder
    return problems_of(
        grounder,
        partial(_require_grounder, encoder=eye),
        methods=("ground",),
        again=partial(_answers, encoder=eye),
        arguments=(eye,),
        kind="grounder",
    )


def check_phrases(source: PhraseSource | Callable[[], PhraseSource] | str) -> list[str]:
    """How a phrase source breaks the contract of `PhraseSource`, here and in a second process.

    Args:
        source: The object, a factory, or its name as package.module:factory.

    Returns:
        The first breach; empty = the contract is kept.
    """
    return problems_of(source, _require_phrases, methods=("phrases",), again=_phrases_of_task, kind="phrase source")


def _require_phrases(source: PhraseSource) -> None:
    where = f"phrase source {source.name!r}"
    require(bool(source.name), "phrase source", "name", source.name, "a name, which every row of results shows")
    require(isinstance(source.num_fallbacks, int), where, "num_fallbacks", source.num_fallbacks, "a whole number")
    for task in (_TASK, replace(_TASK, description="")):
        found = source.phrases(task)
        texts = isinstance(found, tuple) and all(isinstance(phrase, str) for phrase in found)
        require(texts, where, "answer", found, "a tuple of texts")
        require(len(set(found)) == len(found), where, "answer", found, "each phrase once")
        require(source.phrases(task) == found, where, "second answer", "another one", "the same phrases every time")


def _phrases_of_task(source: PhraseSource) -> tuple[str, ...]:
    return source.phrases(_TASK)


def _answers(grounder: Grounder, *, encoder: TextEncoder) -> list[tuple[tuple[float, ...], float]]:
    found = grounder.ground(_small_maps(encoder, grounder)[0], _TASK, _PHRASES).candidates
    return [(tuple(candidate.position), round(candidate.score, 3)) for candidate in found]


def _require_grounder(grounder: Grounder, *, encoder: TextEncoder) -> None:
    where = f"grounder {grounder.name!r}"
    memory, empty = _small_maps(encoder, grounder)
    before = _features(memory).copy()
    for phrases in (_PHRASES, (*_PHRASES, *_PHRASES), ()):
        first = grounder.ground(memory, _TASK, phrases)
        require(len(first.candidates) > 0, where, "candidates", 0, "at least one on a map that holds the object")
        _check_candidates(first, memory, where)
        second = grounder.ground(memory, _TASK, phrases)
        same = second.candidates == first.candidates
        require(same, where, "second answer", "another one", "the same answer to the same inputs")
    require(bool(np.array_equal(before, _features(memory))), where, "the map's rows", "changed", "unchanged")
    _check_candidates(grounder.ground(empty, _TASK, _PHRASES), empty, where)
    _check_refusal(grounder, encoder, where)


def require(holds: bool, where: str, what: str, found: object, expected: str) -> None:
    """Refuses a plug-in that breaks its contract.

    Raises:
        AgentError: `holds` is False.
    """
    if not holds:
        raise AgentError(f"{where}: {what} is {found!r}; expected {expected}. Correct the plug-in.")


def require_vectors(vectors: NDArray[np.float32], shape: tuple[int, ...], where: str) -> None:
    """Refuses vectors of another type or shape, and numbers that are not finite.

    Raises:
        AgentError: The vectors are refused.
    """
    require(isinstance(vectors, np.ndarray), where, "type", type(vectors).__name__, "a numpy array")
    require(vectors.dtype == np.float32, where, "dtype", str(vectors.dtype), "float32")
    require(vectors.shape == shape, where, "shape", vectors.shape, f"{shape}")
    require(bool(np.isfinite(vectors).all()), where, "smallest value", float(vectors.min(initial=0)), "finite numbers")


def _encoded(encoder: TextEncoder, texts: Sequence[str]) -> NDArray[np.float32]:
    vectors = encoder.encode_texts(texts)
    require_vectors(vectors, (len(texts), encoder.dim), f"encoder {encoder.name!r}, {len(texts)} texts")
    return vectors


def _check_refusal(grounder: Grounder, encoder: TextEncoder, where: str) -> None:
    """Checks that the grounder refuses the kind of map that it does not take."""
    other = _small_map(encoder) if grounder.takes == "objects" else _small_objects(encoder)
    try:
        grounder.ground(other, _TASK, _PHRASES)
    except AgentError:
        return
    require(False, where, "answer to the other kind of map", "given", f"AgentError: it takes {grounder.takes!r}")


def _check_candidates(grounding: Grounding, memory: Memory, where: str) -> None:
    grid = memory.grid
    scores = [candidate.score for candidate in grounding.candidates]
    ranked = all(first >= second - TIE for first, second in pairwise(scores))
    require(ranked and bool(np.isfinite(scores).all()), where, "scores", scores, "finite numbers, best first")
    floors = {memory.floor_y} if isinstance(memory, ObjectMap) else {memory.floor_y, *memory.cell_y.tolist()}
    for candidate in grounding.candidates:
        x, y, z = candidate.position
        rc = (candidate.row, candidate.col)
        cell = tuple(grid.rc_from_xz(np.array([x, z])).tolist())
        require(cell == rc, where, "row and column", rc, f"{cell}, the cell that holds the candidate's position")
        require(bool(grid.contains(np.array(rc))), where, "cell", rc, f"inside the grid {grid.shape}")
        index = candidate.row * grid.shape[1] + candidate.col
        require(candidate.index == index, where, "index", candidate.index, f"{index} = row * columns + column")
        on_floor = min(abs(y - floor) for floor in floors) <= _TOLERANCE
        require(on_floor, where, "height of a candidate", y, f"one of the map's floors {sorted(floors)}")


def _small_maps(encoder: TextEncoder, grounder: Grounder) -> tuple[Memory, Memory]:
    """A map with three things and one without any, of the kind that the grounder takes."""
    if grounder.takes == "objects":
        full = _small_objects(encoder)
        return full, replace(full, objects=())
    return _small_map(encoder), _empty_map(encoder)


def _features(memory: Memory) -> NDArray[np.float32]:
    """(N, E) vectors of the cells or things."""
    if isinstance(memory, ObjectMap):
        return np.array([item.feature for item in memory.objects])
    return memory.rows


def _small_objects(encoder: TextEncoder) -> ObjectMap:
    vectors = encoder.encode_texts(_TEXTS)
    spots = np.array([[-1.0, 0.7, 3.0], [1.0, 0.7, 3.0], [0.0, 0.7, 5.0]], np.float32)
    things = [
        ObjectInstance(spot[None], row, text, 1.0) for spot, row, text in zip(spots, vectors, _TEXTS, strict=True)
    ]
    return ObjectMap(tuple(things), 0.25, encoder.name, encoder.dim, (0.0, 4.0), 0.1)


def _small_map(encoder: TextEncoder) -> FeatureMap:
    return map_from_cells(
        encoder.encode_texts(_TEXTS),
        np.array([[1, 1], [1, 5], [4, 3]]),
        grid=GridSpec((-2.0, 3.0), 0.5, (6, 8)),
        floor_y=0.25,
        encoder=encoder.name,
    )


def _empty_map(encoder: TextEncoder) -> FeatureMap:
    none = np.empty((0, encoder.dim), np.float32)
    grid = GridSpec((-2.0, 3.0), 0.5, (6, 8))
    return map_from_cells(none, np.empty((0, 2), int), grid=grid, floor_y=0.25, encoder=encoder.name)

"""Algorithm 1 equals loops over Python floats, batches equal their members, and cases computed by hand."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from grounding.encoders.packed_bert import one_thread
from grounding.methods.rpg import PRESETS, RpgOptions, RpgResult, nms_peaks, rpg_dense, rpg_packed
from grounding.types import TIE, map_from_cells
from sim.errors import AgentError
from sim.types import GridSpec

LAWS = settings(max_examples=40, deadline=None)


@pytest.fixture(autouse=True, scope="module")
def few_threads() -> Iterator[None]:
    """Uses one thread, because the threads of such small products wait for each other on busy cores."""
    with one_thread():
        yield


@dataclass(frozen=True)
class Problem:
    """One map (H, W, E) with zero vectors in empty cells, phrases (K, E) and a query (E,)."""

    features: np.ndarray
    phrases: np.ndarray
    query: np.ndarray


@st.composite
def rough_problems(draw: st.DrawFn) -> Problem:
    """Problems of small integers: many empty cells and exact ties, no near ties."""
    shape = draw(st.tuples(st.integers(1, 5), st.integers(1, 5)))
    values = st.integers(-2, 2)
    features = draw(hnp.arrays(np.int8, (*shape, 3), elements=values)) * draw(
        hnp.arrays(np.int8, (*shape, 1), elements=st.integers(0, 1))
    )
    phrases = draw(hnp.arrays(np.int8, (draw(st.integers(0, 3)), 3), elements=values))
    query = draw(hnp.arrays(np.int8, (3,), elements=values))
    return Problem(features.astype(float), phrases.astype(float), query.astype(float))


@st.composite
def smooth_problems(draw: st.DrawFn, *, most: int = 4) -> Problem:
    """Problems of random directions: no near ties, about half of the cells empty, never all."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    height, width = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    features = rng.normal(size=(height, width, 5)) * (rng.random((height, width, 1)) < 0.6)
    features[rng.integers(height), rng.integers(width)] = rng.normal(size=5)
    phrases = rng.normal(size=(draw(st.integers(1, most)), 5))
    query = rng.normal(size=5)
    filled = features[np.any(features != 0, axis=2)]
    filled /= np.linalg.norm(filled, axis=1, keepdims=True)
    for text in (*phrases, query):
        cosines = np.sort(filled @ text / np.linalg.norm(text))
        assume(np.all(np.diff(cosines) > 20 * TIE))
    return Problem(features, phrases, query)


def any_options() -> st.SearchStrategy[RpgOptions]:
    return st.builds(RpgOptions, st.integers(1, 4), st.integers(0, 2), st.integers(0, 2))


def solve(problem: Problem, options: RpgOptions, *, mask: np.ndarray | None = None) -> RpgResult:
    """Solves it with the dense form on a batch of one, float32."""
    return rpg_dense(
        torch.tensor(problem.features[None], dtype=torch.float32),
        torch.tensor(problem.phrases[None], dtype=torch.float32),
        torch.tensor(problem.query[None], dtype=torch.float32),
        phrase_mask=None if mask is None else torch.tensor(mask[None]),
        options=options,
    )


def solve_packed(problem: Problem, options: RpgOptions) -> RpgResult:
    """Solves it with the packed form, float32."""
    height, width, _ = problem.features.shape
    rc = np.argwhere(np.ones((height, width), bool))
    memory = map_from_cells(
        problem.features.reshape(-1, problem.features.shape[2]),
        rc,
        grid=GridSpec((0.0, 0.0), 1.0, (height, width)),
        floor_y=0.0,
        encoder="test",
    )
    return rpg_packed(
        torch.tensor(memory.rows),
        torch.tensor(memory.rc.astype(int)),
        torch.tensor(problem.phrases, dtype=torch.float32),
        torch.tensor(problem.query[None], dtype=torch.float32),
        width=width,
        options=options,
    )


def answer(result: RpgResult) -> int:
    return int(result.index[0])


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    length = math.sqrt(sum(float(x) ** 2 for x in a)) * math.sqrt(sum(float(x) ** 2 for x in b))
    return sum(float(x) * float(y) for x, y in zip(a, b, strict=True)) / length if length else 0.0


def first_maximum(scores: dict[tuple[int, int], float]) -> tuple[int, int] | None:
    best = max(scores.values(), default=-math.inf)
    return next((cell for cell, score in sorted(scores.items()) if score >= best - TIE), None)


@dataclass(frozen=True)
class Found:
    """The answer, its value, the open cells and the peaks of each phrase; cells are flat indices, -1 = none."""

    index: int
    value: float
    gate: list[int]
    peaks: list[list[int]]


def loops(problem: Problem, options: RpgOptions) -> Found:
    """Algorithm 1 cell by cell in Python floats."""
    height, width, _ = problem.features.shape
    cells = [(row, col) for row in range(height) for col in range(width)]
    filled = [cell for cell in cells if np.any(problem.features[cell] != 0)]
    searched = cells if options.literal else filled
    opened = set(cells) if len(problem.phrases) == 0 else set()
    peaks = []
    for phrase in problem.phrases:
        scores = {cell: cosine(problem.features[cell], phrase) for cell in searched}
        found = []
        while len(found) < options.top_k and (peak := first_maximum(scores)) is not None:
            found.append(peak)
            scores = {cell: score for cell, score in scores.items() if far(cell, peak) > options.nms_r}
            opened |= {cell for cell in cells if far(cell, peak) <= options.nhood}
        peaks.append([row * width + col for row, col in found] + [-1] * (options.top_k - len(found)))
    final = {cell: cosine(problem.features[cell], problem.query) for cell in searched if cell in opened}
    if options.literal:
        final |= {cell: 0.0 for cell in cells if cell not in opened}
    best = first_maximum(final) if filled else None
    value = -math.inf if best is None else final[best]
    gate = sorted(row * width + col for row, col in opened)
    return Found(-1 if best is None else best[0] * width + best[1], value, gate, peaks)


def flat(result: RpgResult, cells: np.ndarray | None = None) -> Found:
    """The result of one episode; `cells` are the flat indices of the packed cells, None = dense."""
    cells = np.arange(result.gate.shape[1]) if cells is None else cells
    peaks = result.peaks[0] if result.peaks.ndim == 3 else result.peaks
    places = np.append(cells, -1)[peaks.numpy()].tolist()
    return Found(answer(result), float(result.value[0]), cells[result.gate[0].numpy()].tolist(), places)


def far(a: tuple[int, int], b: tuple[int, int]) -> int:
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]))


@settings(max_examples=300, deadline=None)
@given(st.one_of(rough_problems(), smooth_problems()), any_options(), st.booleans())
def test_dense_and_packed_equal_loops_over_floats_ties_included(
    problem: Problem, options: RpgOptions, literal: bool
) -> None:
    options = replace(options, literal=literal)
    expected = loops(problem, options)
    dense = flat(solve(problem, options))
    assert replace(dense, value=expected.value) == expected
    assert dense.value == pytest.approx(expected.value, abs=1e-5)
    if not literal:
        filled = np.flatnonzero(np.any(problem.features != 0, axis=2))
        packed = flat(solve_packed(problem, options), filled)
        assert replace(packed, value=0.0, gate=[]) == replace(expected, value=0.0, gate=[])
        assert packed.gate == [cell for cell in expected.gate if cell in filled]
        assert packed.value == pytest.approx(expected.value, abs=1e-5)


def test_the_literal_form_answers_outside_a_gate_of_negative_cosines_and_an_empty_map_has_no_answer() -> None:
    features = np.zeros((2, 2, 2))
    features[1, 1] = [-1.0, 0.5]
    problem = Problem(features, np.array([[0.0, 1.0]]), np.array([1.0, 0.0]))
    assert answer(solve(problem, RpgOptions(top_k=1, nhood=0))) == 3
    assert answer(solve(problem, RpgOptions(top_k=1, nhood=0, literal=True))) == 0
    problem = Problem(np.zeros((3, 4, 2)), np.ones((1, 2)), np.ones(2))
    for options in (PRESETS["paper"], RpgOptions(literal=True)):
        result = solve(problem, options)
        assert answer(result) == -1
        assert float(result.value[0]) == -math.inf
    assert answer(solve_packed(problem, PRESETS["paper"])) == -1


def test_a_gate_and_peaks_equal_those_computed_by_hand() -> None:
    # one row of five cells: the only peak of the phrase is cell 3; the query scores highest in cell 0, then 2
    features = np.array([[[9.0, 0.0], [0.0, 0.0], [3.0, 4.0], [0.0, 1.0], [-1.0, 1.0]]])
    problem = Problem(features, np.array([[0.0, 2.0]]), np.array([5.0, 0.0]))
    result = solve(problem, RpgOptions(top_k=1, nhood=1))
    assert result.gate[0].tolist() == [False, False, True, True, True]
    assert answer(result) == 2
    assert float(result.value[0]) == pytest.approx(0.6)
    assert result.peaks.tolist() == [[[3]]]
    scores = torch.tensor([[0.1, 0.9, 0.8, 0.2, 0.7]])
    line = torch.tensor([[0, col] for col in range(5)])
    assert nms_peaks(scores, line, top_k=4, nms_r=1).tolist() == [[1, 4, -1, -1]]
    assert nms_peaks(scores, line, top_k=4, nms_r=0).tolist() == [[1, 2, 4, 3]]


@LAWS
@given(smooth_problems(), any_options(), st.integers(1, 3))
def test_padded_phrases_have_no_peaks(problem: Problem, options: RpgOptions, padding: int) -> None:
    padded = np.concatenate([problem.phrases, np.full((padding, problem.query.size), np.nan)])
    mask = np.arange(len(padded)) < len(problem.phrases)
    result = solve(Problem(problem.features, padded, problem.query), options, mask=mask)
    assert answer(result) == answer(solve(problem, options))
    assert (result.peaks[0, len(problem.phrases) :] == -1).all()


@LAWS
@given(st.lists(smooth_problems(most=3), min_size=2, max_size=4), any_options())
def test_a_batch_equals_its_members_one_by_one(problems: list[Problem], options: RpgOptions) -> None:
    height = max(problem.features.shape[0] for problem in problems)
    width = max(problem.features.shape[1] for problem in problems)
    most = max(len(problem.phrases) for problem in problems)
    features = np.zeros((len(problems), height, width, 5), np.float32)
    phrases = np.zeros((len(problems), most, 5), np.float32)
    mask = np.zeros((len(problems), most), bool)
    for at, problem in enumerate(problems):
        features[at, : problem.features.shape[0], : problem.features.shape[1]] = problem.features
        phrases[at, : len(problem.phrases)] = problem.phrases
        mask[at, : len(problem.phrases)] = True
    queries = torch.tensor(np.array([problem.query for problem in problems]), dtype=torch.float32)
    result = rpg_dense(
        torch.tensor(features), torch.tensor(phrases), queries, phrase_mask=torch.tensor(mask), options=options
    )
    for at, problem in enumerate(problems):
        alone = Problem(features[at], problem.phrases, problem.query)
        assert int(result.index[at]) == answer(solve(alone, options))


@LAWS
@given(smooth_problems(), any_options(), st.integers(0, 2**32 - 1))
def test_many_episodes_on_one_packed_map_equal_each_alone(problem: Problem, options: RpgOptions, seed: int) -> None:
    rng = np.random.default_rng(seed)
    uses = rng.random((4, len(problem.phrases))) < 0.5
    queries = rng.normal(size=(4, 5))
    rc = np.argwhere(np.any(problem.features != 0, axis=2))
    rows = problem.features[tuple(rc.T)]
    rows = torch.tensor(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=torch.float32)
    together = rpg_packed(
        rows,
        torch.tensor(rc),
        torch.tensor(problem.phrases, dtype=torch.float32),
        torch.tensor(queries, dtype=torch.float32),
        width=problem.features.shape[1],
        uses=torch.tensor(uses),
        options=options,
    )
    for episode in range(4):
        alone = Problem(problem.features, problem.phrases[uses[episode]], queries[episode])
        assert int(together.index[episode]) == answer(solve(alone, options))


def test_ties_go_to_the_first_cell_in_row_major_order() -> None:
    rng = np.random.default_rng(0)
    direction, across = rng.normal(size=(2, 768))
    across -= direction * (across @ direction) / (direction @ direction)
    features = np.zeros((50, 50, 768))
    # the same direction with many lengths: float32 products of these cells differ in their last bits
    for row, col in rng.integers(4, 50, size=(40, 2)):
        features[row, col] = direction * rng.uniform(0.1, 9)
    features[4, 0] = direction
    # the cosine of the first cell is lower by half the tolerance of a tie
    features[3, 49] = direction * 0.3 + across * 0.3 * math.sqrt(TIE)
    problem = Problem(features, direction[None], direction * 7.5)
    assert answer(solve(problem, PRESETS["paper"])) == 3 * 50 + 49
    assert answer(solve_packed(problem, PRESETS["paper"])) == 3 * 50 + 49


def test_impossible_options_and_literal_packed_maps_are_refused() -> None:
    with pytest.raises(AgentError, match="expected top_k >= 1"):
        RpgOptions(top_k=0)
    one = torch.ones(1, 2)
    with pytest.raises(ValueError, match="call rpg_dense"):
        rpg_packed(one, torch.zeros(1, 2, dtype=torch.int64), one, one, width=1, options=RpgOptions(literal=True))


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

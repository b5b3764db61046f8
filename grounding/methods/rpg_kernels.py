"""Compiled loops of Algorithm 1: the product of few texts with a map, peaks with non-maximum suppression, grown gates.

In torch each step costs several passes over (phrases, cells) and as many calls; on a map of 30 filled cells the calls
cost more than the arithmetic.
"""

import numpy as np

from sim.compiled import njit


@njit(cache=True, nogil=True)
def few_answers(phrases, queries, rows, rc, width, uses, top_k, nms_r, nhood, tie, shortest):
    """All of Algorithm 1 for few texts in one call: the results of `gated_answers`, then the cosines (P + B, N).

    A map pushes the interpreter out of the processor's caches, so each further call from Python is slow. Takes phrases
    (P, E), queries (B, E) and `shortest` as `few_cosines` does, and the rest as `gated_answers` does.
    """
    cosines = np.empty((len(phrases) + len(queries), len(rows)), np.float32)
    few_cosines(np.concatenate((phrases, queries)), rows, shortest, cosines)
    return gated_answers(cosines, rc, width, uses, top_k, nms_r, nhood, tie), cosines


# sums may be taken in any order, so that the compiler vectorizes them; -inf and nan keep their meaning
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def few_cosines(texts, rows, shortest, cosines):
    """Fills cosines (L, N) of texts (L, E) of any length with unit rows (N, E); reads the rows once.

    Four texts at a time share each load of a row. A general product first copies rows and texts into its own layout,
    which costs as much as the product itself when there are few texts.

    Args:
        texts: (L, E) float32, contiguous like the others.
        rows: (N, E) float32.
        shortest: float32; the cosine of a shorter text is 0 or nearly 0.
        cosines: (L, N) float32, filled.
    """
    num, dim = texts.shape
    lengths = np.empty(num, np.float32)
    for at in range(num):
        square = np.float32(0.0)
        for e in range(dim):
            square += texts[at, e] * texts[at, e]
        lengths[at] = max(np.sqrt(square), shortest)
    for cell in range(rows.shape[0]):
        for at in range(0, num - 3, 4):
            first = second = third = fourth = np.float32(0.0)
            for e in range(dim):
                value = rows[cell, e]
                first += value * texts[at, e]
                second += value * texts[at + 1, e]
                third += value * texts[at + 2, e]
                fourth += value * texts[at + 3, e]
            cosines[at, cell] = first / lengths[at]
            cosines[at + 1, cell] = second / lengths[at + 1]
            cosines[at + 2, cell] = third / lengths[at + 2]
            cosines[at + 3, cell] = fourth / lengths[at + 3]
        for at in range(num - num % 4, num):
            first = np.float32(0.0)
            for e in range(dim):
                first += rows[cell, e] * texts[at, e]
            cosines[at, cell] = first / lengths[at]


@njit(cache=True, nogil=True)
def gated_answers(cosines, rc, width, uses, top_k, nms_r, nhood, tie):
    """Algorithm 1 after the product: flat index (B,), value (B,), final (B, N), gate (B, N), peaks (P, top_k).

    Args:
        cosines: (P + B, N) float32; first the phrases' cosines, then the queries'.
        rc: (N, 2) int64.
        width: Columns of the grid, for the flat index row * width + column; -1 = no answer.
        uses: (B, P) bool, which phrases each episode has.
        top_k: Peaks per phrase.
        nms_r: Chebyshev radius in cells that a peak keeps free of others.
        nhood: Chebyshev radius in cells by which peaks grow.
        tie: float32; scores closer than this are equal, and the first wins.
    """
    episodes, num = uses.shape
    cells = rc.shape[0]
    peaks = np.full((num, top_k), -1, np.int64)
    find_peaks(cosines[:num], rc, top_k, nms_r, tie, peaks)
    opened = np.zeros((num, cells), np.bool_)
    open_cells(peaks, rc, nhood, opened)
    gates = np.zeros((episodes, cells), np.bool_)
    join_gates(opened, uses, gates)
    final = np.full((episodes, cells), -np.inf, np.float32)
    best = np.full(episodes, -1, np.int64)
    values = np.full(episodes, -np.inf, np.float32)
    best_inside(cosines[num:], gates, tie, final, best, values)
    for at in range(episodes):
        if best[at] >= 0:
            best[at] = rc[best[at], 0] * width + rc[best[at], 1]
    return best, values, final, gates, peaks


@njit(cache=True, nogil=True)
def find_peaks(scores, rc, top_k, nms_r, tie, peaks):
    """Fills peaks (L, top_k) int64 with each row's best cells, best first: arg-max, drop the cells near it, repeat.

    Args:
        scores: (L, N) float32; -inf is never a peak.
        rc: (N, 2) int64.
        top_k: Peaks per row.
        nms_r: Chebyshev radius in cells.
        tie: float32; scores closer than this are equal, and the first wins.
        peaks: Filled with -1, which stays where there are no more.
    """
    num_rows, num_cells = scores.shape
    left = np.empty(num_cells, scores.dtype)
    for at in range(num_rows):
        left[:] = scores[at]
        for step in range(top_k):
            top = left.dtype.type(-np.inf)
            for cell in range(num_cells):
                top = max(top, left[cell])
            if top == -np.inf:
                break
            bound = left.dtype.type(top - tie)
            peak = 0
            while left[peak] < bound:
                peak += 1
            peaks[at, step] = peak
            for cell in range(num_cells):
                if abs(rc[cell, 0] - rc[peak, 0]) <= nms_r and abs(rc[cell, 1] - rc[peak, 1]) <= nms_r:
                    left[cell] = -np.inf


@njit(cache=True, nogil=True)
def open_cells(peaks, rc, nhood, opened):
    """Marks in opened (L, N) bool the cells within `nhood` (Chebyshev) of any of a row's peaks (L, top_k) >= 0."""
    for at in range(peaks.shape[0]):
        for step in range(peaks.shape[1]):
            peak = peaks[at, step]
            if peak < 0:
                continue
            for cell in range(rc.shape[0]):
                if abs(rc[cell, 0] - rc[peak, 0]) <= nhood and abs(rc[cell, 1] - rc[peak, 1]) <= nhood:
                    opened[at, cell] = True


@njit(cache=True, nogil=True)
def join_gates(opened, uses, gates):
    """Marks in gates (B, N) bool the cells opened (P, N) by the phrases that each episode uses (B, P).

    An episode that uses no phrase gets an open gate everywhere.
    """
    for episode in range(uses.shape[0]):
        has_any = False
        for phrase in range(uses.shape[1]):
            if uses[episode, phrase]:
                has_any = True
                for cell in range(opened.shape[1]):
                    gates[episode, cell] |= opened[phrase, cell]
        if not has_any:
            gates[episode] = True


@njit(cache=True, nogil=True)
def best_inside(scores, gates, tie, final, cells, values):
    """Fills each episode's answer: the best cell (B,) inside its gate and its score (B,); an empty gate leaves both.

    Args:
        scores: (B, N) float32.
        gates: (B, N) bool.
        tie: float32; scores closer than this are equal, and the first wins.
        final: (B, N), filled with -inf; gets the scores inside the gate.
        cells: (B,) int64, filled with -1.
        values: (B,) float32, filled with -inf.
    """
    for at in range(scores.shape[0]):
        top = scores.dtype.type(-np.inf)
        for cell in range(scores.shape[1]):
            if gates[at, cell]:
                final[at, cell] = scores[at, cell]
                top = max(top, scores[at, cell])
        if top == -np.inf:
            continue
        bound = scores.dtype.type(top - tie)
        cell = 0
        while final[at, cell] < bound:
            cell += 1
        cells[at] = cell
        values[at] = final[at, cell]

"""Compiled loops of Algorithm 1 behind the product with the map: peaks with non-maximum suppression, grown gates.

In torch each step costs several passes over (phrases, cells) and as many calls; on a map of 30 filled cells the calls
cost more than the arithmetic.
"""

import numpy as np

from sim.compiled import njit


@njit(cache=True, nogil=True)
def find_peaks(scores, rc, top_k, nms_r, tie, peaks):
    """Fills peaks (L, top_k) int64 with each row's best cells, best first: arg-max, drop what is near, repeat.

    Args:
        scores: (L, N) float32; -inf is never a peak.
        rc: (N, 2) int64.
        top_k: Peaks per row.
        nms_r: Chebyshev radius in cells.
        tie: float32; scores closer than this are equal, and the first wins.
        peaks: Of -1, which stays where there are no more.
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
    """Marks in gates (B, N) bool what any phrase opens (P, N) that an episode uses (B, P); without any, all cells."""
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
    """Fills each episode's answer: the best cell (B,) inside its gate and its score (B,); -1 and -inf stay without any.

    Args:
        scores: (B, N) float32.
        gates: (B, N) bool.
        tie: float32; scores closer than this are equal, and the first wins.
        final: (B, N) of -inf; gets the scores inside the gate.
        cells: (B,) int64 of -1.
        values: (B,) float32 of -inf.
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

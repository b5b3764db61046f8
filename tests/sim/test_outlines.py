"""Straight lines that replace the steps of walls."""

import numpy as np

from sim.homes.building.cells.outlines import Straight, outline, straight_lines
from sim.homes.images import distance_to


def cut_cells(lines: list[Straight], clear: np.ndarray, *, depth: float = 1e-9) -> set[tuple[int, int]]:
    """Clear cells that a line enters deeper than this (cells)."""
    found = set()
    for line in lines:
        for point in np.linspace(line.start, line.end, 2 + int(line.length * 200)):
            row, col = np.floor(point).astype(int).tolist()
            if clear[row, col] and np.abs(point - (row + 0.5, col + 0.5)).max() < 0.5 - depth:
                found.add((row, col))
    return found


def reached(centres: np.ndarray) -> np.ndarray:
    """Cells that a round body covers whose centre can be on the given cells, or in gaps too narrow for a wall."""
    closed = distance_to(distance_to(centres) > 5.1) > 5.1
    return distance_to(closed) <= 4.13


def test_lines_cut_almost_no_clear_cell_and_stay_near_it() -> None:
    num_lines, num_cut = 0, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        centres = np.zeros((90, 90), bool)
        for row, col in rng.integers(10, 60, (5, 2)).tolist():
            height, width = rng.integers(2, 20, 2).tolist()
            centres[row : row + height, col : col + width] = True
        clear = reached(centres)
        lines = straight_lines(outline(clear), clear=clear)
        num_lines += len(lines)
        num_cut += len(cut_cells(lines, clear))
        away = distance_to(clear)
        for line in lines:
            rows, cols = np.floor(np.linspace(line.start, line.end, 2 + int(line.length))).astype(int).T
            assert away[rows, cols].max() <= 2.5, seed
    # a very short line between two others may turn around
    assert num_cut <= 0.01 * num_lines


def test_narrow_winding_ways_keep_their_whole_width() -> None:
    num_cut = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        centres, at = np.zeros((120, 120), bool), np.array([60, 60])
        for step in rng.integers(-12, 13, (8, 2)):
            end = np.clip(at + step, 16, 104)
            for row, col in np.rint(np.linspace(at, end, 26)).astype(int).tolist():
                centres[row : row + 2, col : col + 2] = True
            at = end
        clear = reached(centres)
        num_cut += len(cut_cells(straight_lines(outline(clear), clear=clear), clear, depth=0.05))
    assert num_cut == 0


def test_lines_of_rooms_and_corridors_cut_no_clear_cell() -> None:
    centres = np.zeros((90, 120), bool)
    centres[20:50, 15:50] = centres[33:38, 50:80] = centres[25:60, 80:105] = True
    centres[50:80, 30:34] = centres[76:80, 30:90] = True
    clear = reached(centres)
    lines = straight_lines(outline(clear), clear=clear)
    assert cut_cells(lines, clear) == set()


def test_without_clear_cells_a_stair_of_cells_is_cut_in_its_middle() -> None:
    stair = np.zeros((60, 60), bool)
    for k in range(20):
        stair[10 + k : 45, 10 + k] = True
    free = straight_lines(outline(stair))
    assert len(cut_cells(free, stair)) > 10
    kept = straight_lines(outline(stair), clear=stair)
    assert cut_cells(kept, stair) == set()
    assert len(kept) <= len(free)

"""Deals episodes to people: nobody meets a home twice, and all do equally much of each split."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from sim.errors import StudyError
from sim.types import EpisodeKey, Split

_COST, _COST_OF_PART = 100.0, 1.0
"""Cost of each trial that a person has too many or too few of a split, and of a split within one part of the homes."""
_COST_BEYOND_ONE = 3.0
"""Factor for every further such trial of the same person: many small differences are better than a large one."""
_MOST_NODES = 1000
"""Branches of the search after which the best deal so far is taken; all deals known to us need one."""
_Row = tuple[str | int, ...]


def deal(
    keys: Sequence[EpisodeKey], raters: int, num_people: int, parts: Mapping[str, int], rng: np.random.Generator
) -> list[list[EpisodeKey]]:
    """Episodes of each person, sorted.

    An integer program decides how many people do episodes of a split in a home; then `rng` deals these episodes to
    them. Each person gets the same number of trials, of trials of each split, and of trials of each split in each part
    of the homes, rounded up or down; where splits cannot be that even, they are as close as possible.

    Args:
        keys: The episodes, each once.
        raters: Number of people who do each episode.
        num_people: At least as many as there are trials in any one home.
        parts: Number of the part that each home belongs to, such as the homes of one condition.
        rng: Decides among equally good deals.

    Raises:
        StudyError: There are fewer people than trials in a home.
    """
    cells: dict[tuple[str, Split], list[EpisodeKey]] = defaultdict(list)
    for key in keys:
        cells[key.scene, key.split].append(key)
    choices = [(person, *cell) for person in range(num_people) for cell in sorted(cells)]
    choices = [choices[place] for place in rng.permutation(len(choices))]
    rows: dict[_Row, list[int]] = defaultdict(list)
    for number, (person, home, split) in enumerate(choices):
        for row in (("cell", home, split), ("visit", person, home), ("trials", person), ("split", person, split)):
            rows[row].append(number)
        if len(set(parts.values())) > 1:
            rows["split", person, split, parts[home]].append(number)
    totals = Counter[_Row]()
    for (home, split), found in cells.items():
        for of in (("cell", home, split), ("trials",), ("split", split), ("split", split, parts[home])):
            totals[of] += raters * len(found)

    def bounds(row: _Row) -> tuple[int, int]:
        """Least and largest sum of a row."""
        if row[0] == "visit":
            return 0, 1
        if row[0] == "cell":
            return totals[row], totals[row]
        total = totals[row[0], *row[2:]]
        return total // num_people, -(-total // num_people)

    chosen = _solved(rows, [bounds(row) for row in rows], len(choices))
    if chosen is None:
        raise StudyError(
            f"found no way to deal {len(keys)} episodes, {raters} times each, to {num_people} people without a home "
            "twice; expected one. Ask for more people."
        )
    people: dict[tuple[str, Split], list[int]] = defaultdict(list)
    for number in np.flatnonzero(chosen):
        person, home, split = choices[number]
        people[home, split].append(person)
    dealt: list[list[EpisodeKey]] = [[] for _ in range(num_people)]
    for cell, found in sorted(people.items()):
        for place, which in enumerate(rng.permutation(len(found))):
            dealt[found[which]].append(cells[cell][place % len(cells[cell])])
    return [sorted(found) for found in dealt]


def _solved(
    rows: Mapping[_Row, Sequence[int]], bounds: Sequence[tuple[int, int]], num_choices: int
) -> NDArray[np.bool_] | None:
    """Which choices (num_choices,) to take, so that each row's sum is within its bounds; None if that is impossible.

    Rows named `split` may leave their bounds at a cost: further columns add to their sums or take away from them.
    """
    entries = [(row, choice, 1.0) for row, found in enumerate(rows.values()) for choice in found]
    costs, limits = [0.0] * num_choices, [1.0] * num_choices
    for row, name in enumerate(rows):
        cost = _COST if len(name) == 3 else _COST_OF_PART
        for sign in (1.0, -1.0) if name[0] == "split" else ():
            for limit, factor in ((1.0, 1.0), (np.inf, _COST_BEYOND_ONE)):
                entries.append((row, len(costs), sign))
                costs.append(cost * factor)
                limits.append(limit)
    at_rows, at_columns, values = zip(*entries, strict=True)
    matrix = coo_array((values, (at_rows, at_columns)), shape=(len(rows), len(costs))).tocsr()
    least, most = np.array(bounds, float).T
    is_whole = np.arange(len(costs)) < num_choices
    found = milp(
        costs,
        integrality=is_whole.astype(int),
        bounds=Bounds(0.0, np.array(limits)),  # type: ignore[arg-type]  # scipy says float, and takes arrays
        constraints=LinearConstraint(matrix, least, most),
        options={"mip_rel_gap": 0.0, "node_limit": _MOST_NODES},
    )
    return None if found.x is None else found.x[:num_choices] > 0.5

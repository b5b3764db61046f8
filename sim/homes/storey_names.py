"""Which floor each storey of a home is: the ground floor, the first floor, a basement, as the episodes number them."""

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal

from sim.episodes.schema import Goal
from sim.walk.storeys import nearest_storey

StoreyNaming = Literal["numbers", "british", "american", "texts"]
"""How storeys are named: `numbers` (storey 1 of 2), `british` (ground floor, first floor), `american` (first floor,
second floor), or `texts`, as the home's own descriptions do, which follow the one habit or the other."""


def storey_labels(heights: Sequence[float], goals: Iterable[Goal]) -> tuple[int, ...]:
    """The number of each storey in the descriptions of a home, in which 0 is called the ground floor, 1 the first.

    A storey has the number that most of its objects have (`floor_id`); one without goes on from the nearest that has
    one. Homes without numbers, or with numbers that do not rise from storey to storey, are numbered from 0.

    Args:
        heights: Floor height of each storey, metres, ascending.
        goals: The home's objects in the episodes.
    """
    found = [Counter[int]() for _ in heights]
    for goal in goals:
        if goal.floor_id.lstrip("-").isdecimal():
            found[int(nearest_storey(goal.floor_y, heights))][int(goal.floor_id)] += 1
    known = {index: count.most_common(1)[0][0] for index, count in enumerate(found) if count}
    if not known:
        return tuple(range(len(heights)))
    nearest = [min(known, key=lambda other, index=index: (abs(other - index), other)) for index in range(len(heights))]
    numbers = [known[other] + index - other for index, other in enumerate(nearest)]
    is_rising = all(below < above for below, above in itertools.pairwise(numbers))
    return tuple(numbers) if is_rising else tuple(range(len(heights)))


def floors_above_ground(labels: Sequence[int], naming: StoreyNaming) -> tuple[int, ...]:
    """How many floors each storey lies above the one that is called the ground floor; -1 = the basement.

    Descriptions that begin with floor 1 follow the American habit: their first floor is the ground floor of `british`.
    In `american` the storey on the ground has number 1; below it are still negative numbers.

    Args:
        labels: From `storey_labels`.
        naming: The study's choice; `numbers` numbers storeys from 0.
    """
    if naming == "numbers":
        return tuple(range(len(labels)))
    if naming == "texts":
        return tuple(labels)
    ground = min((label for label in labels if label >= 0), default=0)
    floors = [label - min(ground, 1) for label in labels]
    return tuple(floor + 1 if naming == "american" and floor >= 0 else floor for floor in floors)

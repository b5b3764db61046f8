"""How far people agree with each other on the same episodes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def krippendorff_alpha(counts: NDArray[np.integer]) -> float | None:
    """Krippendorff's alpha for names: 1 = all agree, 0 = as by chance; None where nothing differs or nothing repeats.

    Args:
        counts: (N, C), how many people put episode n into category c; episodes of one person do not count.

    The formula is that of Krippendorff, "Computing Krippendorff's alpha-reliability" (2011), nominal data.
    """
    table = counts[counts.sum(axis=1) >= 2].astype(np.float64)
    sizes = table.sum(axis=1)
    total = table.sum(axis=0)
    n = total.sum()
    by_chance = n**2 - (total**2).sum()
    if by_chance == 0:
        return None
    apart = ((sizes**2 - (table**2).sum(axis=1)) / (sizes - 1)).sum()
    return float(1 - (n - 1) * apart / by_chance)


def gwet_ac1(counts: NDArray[np.integer]) -> float | None:
    """Gwet's AC1: like alpha, but steady where nearly all answers are alike; None where no episode has two people.

    Args:
        counts: (N, C) as for `krippendorff_alpha`, at least two categories, used or not.

    The formula is that of Gwet, "Computing inter-rater reliability and its variance" (2008), missing answers allowed.
    """
    table = counts[counts.sum(axis=1) >= 1].astype(np.float64)
    sizes = table.sum(axis=1)
    repeated = sizes >= 2
    if not repeated.any():
        return None
    pairs = (table * (table - 1)).sum(axis=1)[repeated] / (sizes * (sizes - 1))[repeated]
    shares = (table / sizes[:, None]).mean(axis=0)
    by_chance = float((shares * (1 - shares)).sum() / (table.shape[1] - 1))
    return float((pairs.mean() - by_chance) / (1 - by_chance))


def common_place(points: NDArray[np.float64], *, radius: float, share: float) -> NDArray[np.float64] | None:
    """The point (2,) of `points` (N, 2) with at least `share` of all within `radius`, and most of them; None = none."""
    near = np.linalg.norm(points[:, None] - points[None], axis=-1) <= radius
    best = int(near.sum(axis=1).argmax())
    return points[best] if near[best].mean() >= share else None


def counts_of(labels: Sequence[int], episode_index: NDArray[np.intp], *, num_categories: int) -> NDArray[np.int64]:
    """(N, C): how many labels of each category each episode has."""
    counts = np.zeros((int(episode_index.max(initial=-1)) + 1, num_categories), np.int64)
    np.add.at(counts, (episode_index, np.asarray(labels, np.intp)), 1)
    return counts

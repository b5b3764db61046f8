"""Measures how far people agree on the same episodes: on success, and on the place where they pointed or stopped."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import EpisodeKey

from .trials import Frame, PeopleRow, TrialGroup

SUSPECT_SHARE = 0.8
"""An episode is suspect if at least this share of its people chose the same wrong place."""
SUSPECT_RADIUS = 1.0
"""Largest distance on the floor plan at which answers count as the same place, metres."""
SUSPECT_PEOPLE = 3
"""Least number of people at a suspect episode; fewer prove nothing."""
HomeObjects = Mapping[str, Sequence[tuple[str, tuple[float, float]]]]
"""(name, middle on the floor plan) of each object, by home."""


class AgreementRow(PeopleRow):
    """Agreement of people on which episodes succeed."""

    num_episodes: int
    """Episodes with at least two people."""
    krippendorff_alpha: float | None
    gwet_ac1: float | None


class PlaceRow(PeopleRow):
    """Agreement of people in one condition on the place that they choose."""

    num_episodes: int
    """Episodes with at least two people who chose a place."""
    num_choices: int
    spread_lower: float | None
    spread_median: float | None
    """Metres: mean distance of the answers at one episode from their middle; quartiles over the episodes."""
    spread_upper: float | None
    place_alpha: float | None
    """Krippendorff's alpha of the place; answers within a metre of each other are one place."""
    place_ac1: float | None
    """Gwet's AC1 of the place."""
    object_alpha: float | None
    """Krippendorff's alpha of the object that is nearest to the answer; None without the dataset."""
    object_ac1: float | None


class SuspectEpisode(PeopleRow):
    """An episode at which people agree on a wrong place: perhaps its label is wrong."""

    episode: str
    num_people: int
    num_agreeing: int
    xz: tuple[float, float]
    """Where they pointed or stopped, world metres."""
    object: str | None
    """Nearest object of the home; None without the dataset."""


def agreement_row(group: TrialGroup) -> AgreementRow:
    """Agreement of a group of people on success."""
    known = group.trials[group.trials["sr"].notna()]
    counts = counts_of((known["sr"] == 100).tolist(), known["episode"].tolist())
    return AgreementRow(
        **group.people_names,
        num_episodes=int((counts.sum(axis=1) >= 2).sum()),
        krippendorff_alpha=krippendorff_alpha(counts),
        gwet_ac1=gwet_ac1(counts),
    )


def place_row(group: TrialGroup, objects: HomeObjects | None = None) -> PlaceRow:
    """Spread and agreement of a group of people on the place."""
    by_key = _places(group.trials)
    repeated = [points for points in by_key.values() if len(points) >= 2]
    spreads = [float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean()) for points in repeated]
    lower, median, upper = np.quantile(spreads, [0.25, 0.5, 0.75]) if spreads else (None, None, None)
    places = [(key, (key, int(label))) for key, points in by_key.items() for label in _clusters(points)]
    named = objects or {}
    things = [
        (key, (key.scene, nearest_object(point, named.get(key.scene, ()))))
        for key, points in by_key.items()
        for point in points
    ]
    place_alpha, place_ac1 = _agreements(places)
    object_alpha, object_ac1 = _agreements(things) if objects else (None, None)
    return PlaceRow(
        **group.people_names,
        num_episodes=len(repeated),
        num_choices=len(places),
        spread_lower=lower,
        spread_median=median,
        spread_upper=upper,
        place_alpha=place_alpha,
        place_ac1=place_ac1,
        object_alpha=object_alpha,
        object_ac1=object_ac1,
    )


def suspect_episodes(group: TrialGroup, objects: HomeObjects | None = None) -> list[SuspectEpisode]:
    """Episodes whose people mostly chose one wrong place."""
    everybody = group.trials["episode"].value_counts()
    found = []
    for key, points in _places(group.trials[group.trials["sr"] == 0]).items():
        number = int(everybody[str(key)])
        needed = SUSPECT_SHARE * number / len(points)
        if number < SUSPECT_PEOPLE or needed > 1:
            continue
        place = common_place(points, radius=SUSPECT_RADIUS, share=needed)
        if place is not None:
            agreeing = int((np.linalg.norm(points - place, axis=1) <= SUSPECT_RADIUS).sum())
            found.append(
                SuspectEpisode(
                    **group.people_names,
                    episode=str(key),
                    num_people=number,
                    num_agreeing=agreeing,
                    xz=(float(place[0]), float(place[1])),
                    object=nearest_object(place, objects.get(key.scene, ())) if objects else None,
                )
            )
    return found


def chosen_place(item: EpisodeRun | Answer | None) -> NDArray[np.float64] | None:
    """The point (2,) on the floor plan where the person pointed or the robot stopped; None = nowhere."""
    if isinstance(item, Answer) and item.candidates:
        point = item.candidates[0]
    elif isinstance(item, EpisodeRun) and item.end.reason == "stop":
        point = item.poses[-1].position
    else:
        return None
    return np.array([point[0], point[2]], np.float64)


def nearest_object(point: NDArray[np.float64], objects: Sequence[tuple[str, tuple[float, float]]]) -> str:
    """Name of the object whose middle is nearest to `point` (2,) within a metre; `elsewhere` without one."""
    apart = [(float(np.hypot(xz[0] - point[0], xz[1] - point[1])), name) for name, xz in objects]
    distance, name = min(apart, default=(np.inf, ""))
    return name if distance <= SUSPECT_RADIUS else "elsewhere"


def krippendorff_alpha(counts: NDArray[np.integer]) -> float | None:
    """Krippendorff's alpha for names: 1 = all agree, 0 = as by chance; None where nothing differs or nothing repeats.

    `counts` (N, C) are people who put episode n into category c; episodes of one person do not count. The formula is
    that of Krippendorff, "Computing Krippendorff's alpha-reliability" (2011), nominal data.
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

    `counts` (N, C) as for `krippendorff_alpha`, with at least two categories, used or not. The formula is that of Gwet,
    "Computing inter-rater reliability and its variance" (2008), missing answers allowed.
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
    """The point (2,) of `points` (N, 2) with the most others within `radius`; None if fewer than `share` of all are."""
    near = np.linalg.norm(points[:, None] - points[None], axis=-1) <= radius
    best = int(near.sum(axis=1).argmax())
    return points[best] if near[best].mean() >= share else None


def counts_of(labels: Sequence[object], episodes: Sequence[object]) -> NDArray[np.int64]:
    """Number of labels of each category at each episode, (N, C); at least two categories."""
    names, places = ({name: at for at, name in enumerate(dict.fromkeys(found))} for found in (labels, episodes))
    counts = np.zeros((len(places), max(2, len(names))), np.int64)
    for label, episode in zip(labels, episodes, strict=True):
        counts[places[episode], names[label]] += 1
    return counts


def _places(trials: Frame) -> dict[EpisodeKey, NDArray[np.float64]]:
    """Chosen places (N, 2) of each episode, in order."""
    found: dict[EpisodeKey, list[NDArray[np.float64]]] = {}
    for key, item in zip(trials["key"], trials["item"], strict=True):
        place = chosen_place(item)
        if place is not None:
            found.setdefault(key, []).append(place)
    return {key: np.array(points) for key, points in found.items()}


def _clusters(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Label of each of `points` (N, 2): points linked by steps of at most the radius are one place."""
    near = np.linalg.norm(points[:, None] - points[None], axis=-1) <= SUSPECT_RADIUS
    return connected_components(near)[1]


def _agreements(labels: Sequence[tuple[EpisodeKey, object]]) -> tuple[float | None, float | None]:
    """Krippendorff's alpha and Gwet's AC1 of one label per answer."""
    counts = counts_of([label for _, label in labels], [key for key, _ in labels])
    return krippendorff_alpha(counts), gwet_ac1(counts)

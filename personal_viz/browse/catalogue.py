"""The list of episodes with its filter: a dataset's episodes -> the numbers of those that match, page by page. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from sim.episodes.schema import Episode
from sim.types import Split

PAGE = 50
"""Episodes that the panel shows at once."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the researcher asks for; empty fields ask for nothing."""

    split: Split | None = None
    scene: str | None = None
    words: str = ""
    """Each of them occurs somewhere in the texts, owner, objects or key of an episode, as a part of a word or whole."""
    with_runs: bool = False
    """Only episodes of which a run or an answer is shown."""


@dataclass(frozen=True, slots=True)
class ListPage:
    """One page of a filtered list."""

    numbers: tuple[int, ...]
    """Episodes on it, as places in the catalogue."""
    first: int
    """Place of the page's first episode in the filtered list, from 0."""
    total: int
    """Length of the filtered list."""


class Catalogue:
    """All episodes, ready to be searched on every key press."""

    def __init__(self, episodes: Sequence[Episode], *, num_runs: Sequence[int]) -> None:
        """Prepares the texts.

        Args:
            episodes: In the order in which they are listed.
            num_runs: How many runs and answers are there of each.
        """
        assert len(episodes) == len(num_runs), (len(episodes), len(num_runs))
        self.episodes = tuple(episodes)
        self.num_runs = tuple(num_runs)
        self._texts = tuple(_text(episode) for episode in episodes)

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of all scenes, sorted."""
        return tuple(sorted({episode.key.scene for episode in self.episodes}))

    def matching(self, wanted: Wanted) -> tuple[int, ...]:
        """Numbers of the episodes that match, in order."""
        words = wanted.words.lower().split()
        return tuple(
            number
            for number, (episode, text) in enumerate(zip(self.episodes, self._texts, strict=True))
            if wanted.split in (None, episode.key.split)
            and wanted.scene in (None, episode.key.scene)
            and (self.num_runs[number] or not wanted.with_runs)
            and all(word in text for word in words)
        )


def list_page(matching: Sequence[int], index: int) -> ListPage:
    """A page of a filtered list.

    Args:
        matching: The whole list.
        index: Of the page, from 0; the nearest one where there is no such page.
    """
    last = max(0, (len(matching) - 1) // PAGE)
    first = PAGE * min(max(index, 0), last)
    return ListPage(tuple(matching[first : first + PAGE]), first, len(matching))


def neighbour(matching: Sequence[int], number: int, by: int) -> int | None:
    """The episode `by` places further in a filtered list, its ends held; None for an empty list.

    From an episode that the filter hides, the first step leads to the nearest one in that direction.
    """
    if not matching:
        return None
    if number in matching:
        return matching[min(max(matching.index(number) + by, 0), len(matching) - 1)]
    after = sum(other < number for other in matching)
    place = after + by - 1 if by > 0 else after + by
    return matching[min(max(place, 0), len(matching) - 1)]


def _text(episode: Episode) -> str:
    record = episode.record
    parts = (str(episode.key), record.summary, record.query[0], record.owner, record.object_category)
    return "\n".join((*parts, *record.object_names)).lower()

"""Shared by all browsers of one `personal-viz browse`: episodes with their filter, runs, texts, open homes."""

import threading
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recordings.traces import Trace, select_traces
from sim.episodes.dataset import PersonalDataset
from sim.episodes.ownership import OwnershipEdge, OwnershipGraph, ownership_graph
from sim.episodes.schema import Episode, Goal
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import DatasetError
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.sequences.searches import search_episode, told_before
from sim.tasks.run_files import Run, Vector3, read_run
from sim.types import Camera, ClutterLevel, Pose, Split
from sim.walk.storeys import storey_of

from ..study_app.home.homes import HomeLibrary
from ..study_app.home.surfaces import StoreyCopies
from .object_links import ObjectLink, SceneTexts, object_links

PAGE = 50
"""Episodes that the panel shows at once."""
KEPT_HOMES = 4
"""Homes that stay open; a scan takes some hundred megabytes."""
Story = tuple[HomeSequence, int]
"""A home sequence and the index of one of its searches."""
UNKNOWN_SIZE = (0.5, 0.5, 0.5)
"""Box of an object of unknown size (scans without semantics), metres."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The researcher's filter; empty fields leave everything in."""

    split: Split | None = None
    scene: str | None = None
    words: str = ""
    """Each of them occurs in the texts, owner, objects or key of an episode, as a word or as part of one."""
    with_runs: bool = False
    """Only episodes that have a run or an answer."""


@dataclass(frozen=True, eq=False)
class OpenHome:
    """A home that is ready to be shown."""

    scene: Scene
    copies: StoreyCopies
    renderer: Renderer
    _rendering: threading.Lock = field(default_factory=threading.Lock)

    def storey(self, floor_y: float) -> int:
        """Index of the storey on which something at this height stands."""
        return storey_of(floor_y, [(height, height) for height in self.copies.storeys])

    def box(self, goal: Goal) -> tuple[Vector3, Vector3]:
        """Centre and extents of a goal's object, metres; UNKNOWN_SIZE where the home does not know the object."""
        item = next((item for item in self.scene.objects if item.name == goal.object_name), None)
        return (goal.position, UNKNOWN_SIZE) if item is None else (item.centre, item.size)

    def picture(self, pose: Pose, camera: Camera) -> NDArray[np.uint8]:
        """Colours (H, W, 3) that a robot sees there; one picture at a time."""
        with self._rendering:
            return self.renderer.render(T_world_camera(pose, camera), camera).rgb

    def close(self) -> None:
        """Does nothing, because visitors may still look at the home."""


Change = Literal["new", "gone"]


class Told(NamedTuple):
    """A message or a search of a home sequence."""

    kind: str
    """Of the message or the search."""
    text: str
    number: int | None
    """A search's place in the list of the library; None for a message."""
    is_here: bool
    """Whether the search is shown, or the message came just before it."""


@dataclass(frozen=True, slots=True)
class ShownEpisode:
    """An episode with everything that the panels and the 3-D view show of it."""

    number: int
    """Place among all episodes."""
    episode: Episode
    graph: OwnershipGraph
    links: tuple[ObjectLink, ...]
    goals: dict[str, Goal]
    """All objects of the home that some episode asks for, by name."""
    traces: tuple[Trace, ...]
    """Its runs and answers, people first."""
    changes: Mapping[tuple[str, str], Change] = field(default_factory=dict)
    """Edges of the graph, as (owner, node), that the message before this search of a home sequence adds or removes;
    the graph holds both."""
    history: tuple[Told, ...] = ()
    """Messages and searches of the home sequence; () for an episode."""


class Library:
    """All episodes and runs, ready to be searched on every key press; homes are opened when they are shown."""

    def __init__(
        self,
        episodes: Sequence[Episode],
        runs: Sequence[Run],
        texts: dict[str, SceneTexts],
        homes: HomeLibrary[OpenHome],
        *,
        stories: Sequence[Story] = (),
    ) -> None:
        """Prepares the search.

        Args:
            episodes: The episodes in the order of the list.
            texts: Captions that the episodes of each scene give to its objects.
            stories: The sequence and the search of each episode; () where they are episodes.
        """
        self.episodes, self.homes = tuple(episodes), homes
        self._stories = tuple(stories)
        self.nouns = ("search", "searches") if stories else ("episode", "episodes")
        """One and several of what is listed."""
        self._runs = sorted(runs, key=lambda run: run.info.who_kind != "human")
        counts = Counter(part.key for run in runs for part in (*run.episodes, *run.answers))
        self.num_runs = tuple(counts[episode.key] for episode in self.episodes)
        """Number of runs and answers of each episode."""
        self._texts = texts
        self._words = tuple(_words(episode) for episode in self.episodes)

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of all scenes, sorted."""
        return tuple(sorted({episode.key.scene for episode in self.episodes}))

    def matching(self, wanted: Wanted) -> tuple[int, ...]:
        """Numbers of the episodes that match, in order."""
        words = wanted.words.lower().split()
        return tuple(
            number
            for number, (episode, text) in enumerate(zip(self.episodes, self._words, strict=True))
            if wanted.split in (None, episode.key.split)
            and wanted.scene in (None, episode.key.scene)
            and (self.num_runs[number] or not wanted.with_runs)
            and all(word in text for word in words)
        )

    def read(self, number: int) -> ShownEpisode:
        """An episode with its graph, its linked objects and its runs."""
        episode = self.episodes[number]
        if self._stories:
            return _shown_search(number, episode, *self._stories[number])
        try:
            graph = ownership_graph(episode)
        except DatasetError:  # `personal-viz validate` lists such sentences; the rest of the episode can be looked at
            graph = OwnershipGraph(())
        texts = self._texts[episode.key.scene]
        traces = tuple(select_traces(self._runs, episode.key)) if self.num_runs[number] else ()
        return ShownEpisode(number, episode, graph, object_links(episode, graph, texts), dict(texts.goals), traces)


def nearest_page(matching: Sequence[int], index: int) -> int:
    """The index of the page of a filtered list that is nearest to `index`; 0 where the list is empty."""
    return min(max(index, 0), max(0, (len(matching) - 1) // PAGE))


def neighbour(matching: Sequence[int], number: int, by: int) -> int | None:
    """The episode `by` places further in a filtered list, its ends held; None for an empty list.

    From an episode that the filter hides, the first step leads to the nearest one in that direction.
    """
    if not matching:
        return None
    if number in matching:
        place = matching.index(number) + by
    else:
        after = sum(other < number for other in matching)
        place = after + by - 1 if by > 0 else after + by
    return matching[min(max(place, 0), len(matching) - 1)]


def open_library(
    dataset: Path,
    *,
    evidence: tuple[Path, ...] = (),
    runs: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    scenes: tuple[str, ...] = (),
    clutter: ClutterLevel = 0,
    labels: bool = False,
    sequences: Path | None = None,
) -> Library:
    """Reads all episodes and runs; homes are opened when somebody looks at them.

    Args:
        evidence: Folders of the dataset's evidence.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        scenes: Scenes to list; () = all.
        labels: Whether robots' pictures name the category of each object in view.
        sequences: A set of home sequences, whose searches are listed instead of the episodes.

    Raises:
        DatasetError: An episode file is damaged, a scene is unknown, or there is no episode.
        RunFileError: A run folder is damaged.
    """
    found = PersonalDataset(dataset, evidence=evidence)
    read = [read_run(folder) for folder in runs]
    stories = [
        (sequence, index)
        for sequence in (SequenceSet(sequences).sequences(scenes=scenes or None) if sequences else ())
        for index in range(len(sequence.record.subtasks))
    ]
    searches = tuple(search_episode(*story) for story in stories)
    episodes = searches or tuple(found.episodes(scenes=scenes or None))
    if not episodes:
        raise DatasetError(f"{dataset}: found files without episodes; expected at least one. Give another --dataset.")
    by_scene: dict[str, list[Episode]] = defaultdict(list)
    for episode in episodes:
        by_scene[episode.key.scene].append(episode)
    texts = {scene: SceneTexts.from_episodes(found.goals(scene), there) for scene, there in by_scene.items()}

    def open_home(name: str) -> OpenHome:
        scene = open_scene(found, name, scenes_dir=scenes_dir, clutter=clutter, labels=labels)
        return OpenHome(scene, StoreyCopies(scene), renderer_of(scene))

    return Library(episodes, read, texts, HomeLibrary(open_home, kept=KEPT_HOMES), stories=stories)


def _shown_search(number: int, episode: Episode, sequence: HomeSequence, index: int) -> ShownEpisode:
    """A search with who owns what before and after the messages that came just before it."""
    record, first = sequence.record, number - index
    after = sequence.ownership[index]
    before = sequence.ownership[index - 1] if index else after
    nodes = {edge: OwnershipEdge(edge.owner, edge.object_name, None) for edge in (*before, *after)}
    graph = OwnershipGraph(tuple(nodes.values()))
    names = {node.node: edge.object_name for edge, node in nodes.items()}
    links = tuple(ObjectLink(node, names[node], names[node] in episode.record.object_names) for node in graph.objects)
    changes: dict[tuple[str, str], Change] = {
        (edge.owner, node.node): "gone" if edge in before else "new"
        for edge, node in nodes.items()
        if (edge in before) != (edge in after)
    }
    history = []
    for place, subtask in enumerate(record.subtasks):
        told = told_before(record, place)[1 if place == 0 else 0 :]  # the intro is told beside the graph
        history += [Told(kind, text, None, place == index) for kind, text in told]
        history.append(Told(subtask.kind, subtask.query[0], first + place, place == index))
    goals = {goal.object_name: goal for goal in sequence.goals}
    return ShownEpisode(number, episode, graph, links, goals, (), changes, tuple(history))


def digest_of(trace: Trace) -> str | None:
    """Digest of the home in which a run was scored; None for answers and for runs that do not say."""
    return next(iter(trace.digests), None)


def _words(episode: Episode) -> str:
    record = episode.record
    parts = (str(episode.key), record.summary, record.query[0], record.owner, record.object_category)
    return "\n".join((*parts, *record.object_names)).lower()

"""Draws the home sequences of one home: ownerships, stories, texts, starts and distances.

Opened home -> storeys that can carry a split -> `SequenceRecord`s that keep every guarantee of checks.py.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw
from sim.types import SPLITS, EpisodeKey, Split

from ...episodes.checks_geometry import GEODESIC_LIMITS
from ...episodes.dataset import PersonalDataset
from ...episodes.ownership import queries_for
from ...episodes.schema import Episode, EpisodeInfo, Goal, Vector3
from ...episodes.sequence_files import HomeSequence, SequenceFile, resolve_sequence, search_record
from ...episodes.sequences import Edge, Generator, Message, SequenceRecord, Subtask, SubtaskInfo
from ..content import sequence_file
from ..descriptions import write_description
from ..edition import OpenedHome
from ..findable import Finder
from ..people import NAMES, draw_ownership, unmet_need
from ..searches import START_RULES, Start, Starts, draw_start, may_be_meant
from .checks import LEAST_APART, broken_guarantees
from .stories import Ask, Change, Needs, Setting, Story, StoryError, draw_story, keeps_rules
from .texts import Intro, message_text, owned_items, released_intros, sentences

VERSION = 1
"""Of the generator; another version may make other sequences of the same seed."""
LENGTHS = (5, 10)
"""Smallest and largest number of searches of a sequence."""
TRIES = 80
"""Most stories that are drawn for a sequence."""
_FROM_EPISODES = 0.8
"""Share of the tries that begin with an ownership that an episode tells, where one does."""
_OFFERED = 12
"""Most objects that are offered to a drawn ownership."""
_ALIKE = 4
"""Most of them that come first because the storey has another object of their category."""
_TWIN_TRIES = 6
"""Most ownerships that are drawn until somebody owns two objects of a category."""
_NEWCOMERS: dict[Split, int] = {"easy": 2, "medium": 0, "hard": 0}
"""People who own nothing at first; in easy, people with an object can get another one by a swap only."""
_SCANT = {
    "ownership rule": "ownerships that break the split's rule; expected objects of more categories",
    "unique answer": "no further search with one answer; expected more captioned objects",
    "2 m apart, reachable": f"only targets within {LEAST_APART:g} m of the one before, or without a way; expected "
    "objects in more places",
    "start": "no start in the split's window; expected a larger storey",
    "findable": "objects that nobody can find; expected captions that tell them apart",
}
"""What was found and would be needed, by the guarantee at which a sequence failed."""


@dataclass(slots=True)
class SetSoFar:
    """The figures of a set that grows home by home."""

    needs: Needs = field(default_factory=Needs)
    splits: Counter[Split] = field(default_factory=Counter)
    """Number of sequences."""
    refused: Counter[str] = field(default_factory=Counter)
    """Splits of homes that were given up, by the guarantee that would have broken."""
    lines: list[str] = field(default_factory=list)
    """One line for each of them."""

    def add(self, record: SequenceRecord) -> None:
        """Counts a sequence."""
        self.splits[record.split] += 1
        self.needs.kinds.update(subtask.kind for subtask in record.subtasks)
        self.needs.messages.update(message.kind for message in record.messages)

    def refuse(self, guarantee: str, line: str) -> None:
        """Counts a split that a home cannot carry, or no longer."""
        self.refused[guarantee] += 1
        self.lines.append(line)


class _Storey(NamedTuple):
    """A storey for one split."""

    floor_id: str
    setting: Setting
    places: dict[str, int]
    """Row and column of each thing in `walks`."""
    walks: NDArray[np.float64]
    """(N, N) metres between the first view points of the storey's things."""
    intros: Sequence[Intro]
    """The ownerships that episodes tell."""


class HomeSequences:
    """Draws the sequences of one home."""

    def __init__(
        self, opened: OpenedHome, episodes: PersonalDataset | None, total: SetSoFar, *, starts: Starts, seed: int
    ) -> None:
        """Prepares the home.

        Args:
            opened: The home.
            episodes: The edition that it comes from; None for annotated scans.
            total: The set that its sequences become part of; it says what the set lacks, and is changed.
            starts: Rule of the starts.
            seed: The seed of the set.
        """
        self._home, self._total, self._seed, self._rule = opened.home, total, seed, START_RULES[starts]
        own = int.from_bytes(hashlib.sha256(self._home.name.encode()).digest()[:8])
        self._rng = np.random.default_rng([seed, own])
        known = {} if episodes is None else episodes.goals(self._home.name)
        self._goals = (known | {name: thing.goal for name, thing in self._home.things.items()}).values()
        self._finder = None if opened.plan is None else Finder(opened.plan, opened.scene)
        self._intros = {} if episodes is None else released_intros(episodes, self._home)
        self._content = sequence_file(self._home, self._goals, ())

    def draw(self, count: int, *, tries: int = TRIES) -> SequenceFile:
        """The home's file with `count` sequences, or with fewer where the home cannot carry them."""
        floors = self._floors() if count else []
        storeys: dict[Split, list[_Storey]] = {
            split: found for split in SPLITS if (found := self._storeys(split, floors))
        }
        records: list[SequenceRecord] = []
        while len(records) < count and storeys:
            split = min(storeys, key=lambda split: (self._total.splits[split], SPLITS.index(split)))
            storey = storeys[split][sum(record.split == split for record in records) % len(storeys[split])]
            failed: Counter[str] = Counter()
            record = next((found for _ in range(tries) if (found := self._try(storey, len(records), failed))), None)
            if record is not None:
                records.append(record)
                self._total.add(record)
                continue
            storeys[split].remove(storey)
            if not storeys[split]:
                del storeys[split]
            self._refuse(split, storey.floor_id, failed.most_common(1)[0][0], tries)
        return self._content.model_copy(update={"sequences": tuple(records)})

    def _refuse(self, split: Split, floor_id: str, guarantee: str, tries: int) -> None:
        low, high = GEODESIC_LIMITS[split]
        window = f" ({low:g}-{high:g} m)" if guarantee == "start" else ""
        self._total.refuse(
            guarantee,
            f"scene {self._home.name!r}, {self._home.storeys[floor_id]}, {split}: guarantee {guarantee!r}{window}: "
            f"found {_SCANT[guarantee]}, in {tries} tries. Annotate more objects there, or take another --seed.",
        )

    def _floors(self) -> list[_Storey]:
        """The storeys with distractors, for no split yet; the others are refused."""
        found = []
        for floor_id, floor in self._home.storeys.items():
            num_alike = Counter(goal.object_category for goal in self._goals if goal.floor_id == floor_id)
            if max(num_alike[self._goal(name).object_category] for name in self._home.on_storey(floor_id)) > 1:
                found.append(self._storey(floor_id, num_alike))
                continue
            self._total.refuse(
                "distractor",
                f"scene {self._home.name!r}, {floor}: guarantee 'distractor': found no category with two objects; "
                "expected one for searches whose answer has changed. Annotate a second object of a category there.",
            )
        if not self._home.storeys:
            line = "found no object with words; expected some. Annotate the home first."
            self._total.refuse("ownership rule", f"scene {self._home.name!r}: guarantee 'ownership rule': {line}")
        return found

    def _storeys(self, split: Split, floors: Sequence[_Storey]) -> list[_Storey]:
        """The storeys that can carry a split; the others are refused."""
        found = []
        for floor in floors:
            setting = replace(floor.setting, split=split)
            need = unmet_need(split, self._conflicts(list(setting.category), setting))
            if need is None:
                told = [
                    intro
                    for intro in self._intros.get((split, floor.floor_id), ())
                    if keeps_rules(setting, intro.edges)
                ]
                found.append(floor._replace(setting=setting, intros=told))
                continue
            self._total.refuse(
                "ownership rule",
                f"scene {self._home.name!r}, {self._home.storeys[floor.floor_id]}, {split}: guarantee 'ownership "
                f"rule': {need}. Annotate more objects there.",
            )
        return found

    def _storey(self, floor_id: str, num_alike: Counter[str]) -> _Storey:
        names = self._home.on_storey(floor_id)
        things = [self._home.things[name] for name in names]
        walks = np.array([self._walks(thing.goal.view_points[0].agent_state.position, names) for thing in things])
        centres = np.array([thing.goal.position for thing in things]).reshape(-1, 3)[:, [0, 2]]
        apart = np.linalg.norm(centres[:, None] - centres, axis=2)
        pairs = list(combinations(range(len(names)), 2))
        setting = Setting(
            split=SPLITS[0],
            category={name: thing.goal.object_category for name, thing in zip(names, things, strict=True)},
            askable=frozenset(
                thing.goal.object_name
                for thing in things
                if self._finder is None or self._finder.is_visible(thing.goal)
            ),
            num_alike=num_alike,
            conflicts=frozenset(
                frozenset((names[a], names[b])) for a, b in pairs if may_be_meant(things[a], things[b], True)
            ),
            near=frozenset(
                frozenset((names[a], names[b]))
                for a, b in pairs
                if apart[a, b] < LEAST_APART or not np.isfinite(walks[[a, b], [b, a]]).all()
            ),
        )
        return _Storey(floor_id, setting, {name: place for place, name in enumerate(names)}, walks, [])

    @staticmethod
    def _conflicts(names: Sequence[str], setting: Setting) -> NDArray[np.bool_]:
        """(M, M) as `draw_ownership` takes them."""
        found = [[frozenset((a, b)) in setting.conflicts for b in names] for a in names]
        return np.array(found, bool).reshape(len(names), len(names))

    def _try(self, storey: _Storey, index: int, failed: Counter[str]) -> SequenceRecord | None:
        """A sequence; or None, with the guarantee that failed counted."""
        split = storey.setting.split
        try:
            intro = self._intro(storey)
            used = {edge.owner for edge in intro.edges}
            others = [name for name in NAMES if name not in used]
            newcomers = [str(name) for name in self._rng.choice(others, size=_NEWCOMERS[split], replace=False)]
            story = draw_story(
                storey.setting,
                intro.edges,
                newcomers=newcomers,
                num_asks=int(self._rng.integers(LENGTHS[0], LENGTHS[1] + 1)),
                needs=self._total.needs,
                rng=self._rng,
            )
            goals = [self._goal(name) for name in story.asks[0].names]
            start = draw_start(self._home.navigation, goals, split, self._rng, self._rule)
            if start is None:
                raise StoryError("start")
            record = self._record(storey, index, intro, story, start[1])
            sequence = resolve_sequence(self._home.name, record, self._content)
            if not self._is_findable(sequence):
                raise StoryError("findable")
        except StoryError as error:
            failed[str(error)] += 1
            return None
        broken = list(broken_guarantees(sequence))
        assert not broken, broken
        return record

    def _goal(self, name: str) -> Goal:
        return self._home.things[name].goal

    def _intro(self, storey: _Storey) -> Intro:
        """An initial ownership: one that an episode tells, or one that is drawn and told by our templates."""
        split, things = storey.setting.split, self._home.things
        if storey.intros and self._rng.random() < _FROM_EPISODES:
            return storey.intros[int(self._rng.integers(len(storey.intros)))]
        category, num_alike = storey.setting.category, storey.setting.num_alike
        names = [list(category)[k] for k in self._rng.permutation(len(category))]
        alike = [name for name in names if num_alike[category[name]] > 1][:_ALIKE]
        names = [*alike, *(name for name in names if name not in alike)][:_OFFERED]
        conflicts = self._conflicts(names, storey.setting)
        edges: list[Edge] = []
        for _ in range(_TWIN_TRIES):
            try:
                drawn = draw_ownership(split, conflicts, rng=self._rng)
            except DatasetError:
                raise StoryError("ownership rule") from None
            edges = [Edge(str(edge.person), names[edge.item]) for edge in drawn]
            owned = Counter((edge.owner, category[edge.object_name]) for edge in edges)
            if split == "easy" or max(owned.values()) > 1:
                break
        people = self._rng.choice(NAMES, size=len({edge.owner for edge in edges}), replace=False)
        edges = [Edge(str(people[int(edge.owner)]), edge.object_name) for edge in edges]
        floor = self._home.storeys[storey.floor_id]
        text = write_description(owned_items(edges, things), floor=floor, rng=self._rng)
        return Intro(tuple(edges), text, sentences(edges, things))

    def _record(self, storey: _Storey, index: int, intro: Intro, story: Story, start: Start) -> SequenceRecord:
        messages = tuple(self._message(change, intro) for change in story.changes)
        names = list(dict.fromkeys(name for ask in story.asks for name in ask.names))
        from_start = dict(zip(names, self._walks(start.position, names).tolist(), strict=True))
        if not np.isfinite(list(from_start.values())).all():
            raise StoryError("2 m apart, reachable")
        subtasks = []
        for number, ask in enumerate(story.asks):
            geodesic = start.geodesic if number == 0 else min(from_start[name] for name in ask.names)
            before = story.asks[number - 1].names if number else ()
            walks = [storey.walks[storey.places[a], storey.places[b]] for a in before for b in ask.names]
            info = SubtaskInfo(geodesic_distance=geodesic, previous_geodesic=float(min(walks)) if walks else None)
            subtasks.append(self._subtask(ask, info))
        return SequenceRecord(
            sequence_id=str(index),
            split=storey.setting.split,
            scene_id=self._home.scene_id,
            scene_dataset_config=self._home.scene_dataset_config,
            floor_id=storey.floor_id,
            start_position=start.position,
            start_rotation=quat_xyzw_from_yaw(start.yaw),
            messages=messages,
            subtasks=tuple(subtasks),
            sources=(intro.source,) if intro.source else (),
            generator=Generator(seed=self._seed, version=VERSION),
        )

    def _message(self, change: Change, intro: Intro) -> Message:
        is_intro = change.kind == "intro"
        return Message(
            before=change.before,
            kind=change.kind,
            text=intro.text if is_intro else message_text(change, things=self._home.things, rng=self._rng),
            adds=change.adds,
            removes=change.removes,
            until=change.until,
            extracted_summary=intro.sentences if is_intro else (),
        )

    def _subtask(self, ask: Ask, info: SubtaskInfo) -> Subtask:
        several = len(ask.names) > 1
        category = self._goal(ask.names[0]).object_category
        slots = tuple(self._home.things[name].captions for name in ask.names)
        return Subtask(
            query=queries_for(
                ask.owner, category, one_of=several and not ask.wants_all, all_of=several and ask.wants_all
            ),
            owner=ask.owner,
            object_category=category,
            object_id=ask.names if several else ask.names[0],
            mode="all" if ask.wants_all else "any",
            kind=ask.kind,
            old_object_id=ask.old,
            message=ask.message,
            description=slots if several else slots[0],
            info=info,
        )

    def _walks(self, place: Vector3, names: Sequence[str]) -> NDArray[np.float64]:
        """(N,) metres from a place to the first view point of each thing."""
        firsts = np.array([self._goal(name).view_points[0].agent_state.position for name in names]).reshape(-1, 3)
        straight = np.linalg.norm(firsts - place, axis=1)
        # a map that moves ends to its own places may measure less
        return np.maximum(self._home.navigation.distances(firsts, np.array([place])), straight)

    def _is_findable(self, sequence: HomeSequence) -> bool:
        """Whether the targets of all searches can be found from what was told until then."""
        record, finder = sequence.record, self._finder
        if finder is None:
            return True
        for index, targets in enumerate(sequence.targets):
            episode = search_record(
                record,
                index,
                info=EpisodeInfo(geodesic_distance=0.0, euclidean_distance=0.0, closest_goal_object_id=0),
                summary=" ".join(message.text for message in record.messages if message.before <= index),
                extracted_summary=sentences(sequence.ownership[index], self._home.things),
            )
            key = EpisodeKey(record.split, self._home.name, record.sequence_id)
            if not finder.can_find(Episode(key, episode, targets)):
                return False
        return True

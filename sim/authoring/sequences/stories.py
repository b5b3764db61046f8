"""Draws the story of a home sequence: messages that change an ownership, and the searches that follow them.

A storey's objects, an initial ownership and the needs of the set -> `Story`; each step keeps the guarantees of
checks.py, so a story that cannot go on is given up with the name of the guarantee.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sim.types import Split

from ...episodes.sequences import Edge, MessageKind, SubtaskKind
from ..searches import ODD_PLURALS
from .checks import broken_rule

SHARES: Mapping[SubtaskKind, float] = {"fresh": 0.4, "revisit": 0.2, "changed": 0.25, "stale": 0.15}
"""Shares of the kinds of searches in a set."""
_MOST: Mapping[SubtaskKind, int] = {"fresh": 6, "revisit": 2, "changed": 4, "stale": 4}
"""Most searches of a kind in a sequence."""
_WEIGHTS: Mapping[MessageKind, float] = {
    "transfer": 3.0, "swap": 3.0, "share": 1.5, "unshare": 1.0, "lend": 1.5, "leave": 0.5, "correction": 1.5,
}  # fmt: skip
"""How often a kind of message is wanted, as far as the split's rule allows it."""
_TELLS = 0.55
"""Chance of a message before a search that does not need one."""
_HELPS = 0.8
"""Chance that messages which leave an old object behind are tried first."""
_SEVERAL = 0.7
"""Chance that a search with several right objects is preferred."""
_FOR_ALL = 0.6
"""Share of the searches with several right objects that want all of them."""
_LONGEST_LOAN = 3
"""Most searches that a loan lasts."""


class StoryError(Exception):
    """A story cannot go on; the text is the guarantee that would break."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Everything that the stories of a storey keep to; objects by `object_name`."""

    split: Split
    category: Mapping[str, str]
    """Of each object that people can own."""
    askable: frozenset[str]
    """Objects that a robot or a person can find."""
    num_alike: Mapping[str, int]
    """Objects of each category on the storey, owned or not."""
    conflicts: frozenset[frozenset[str]]
    """Pairs that one person may not own, because a query could mean either."""
    near: frozenset[frozenset[str]]
    """Pairs too near each other for two searches in a row, and for an old object and the right one."""


@dataclass(slots=True)
class Needs:
    """What a set of sequences holds so far."""

    kinds: Counter[SubtaskKind] = field(default_factory=Counter)
    messages: Counter[MessageKind] = field(default_factory=Counter)

    def wanted(self, asked: Counter[SubtaskKind]) -> list[SubtaskKind]:
        """The kinds of searches, the one that the set lacks most first; `asked` are those of the sequence so far."""
        total = (self.kinds + asked).total() + 1
        lacking: dict[SubtaskKind, float] = {
            kind: share * total - self.kinds[kind] - asked[kind] for kind, share in SHARES.items()
        }
        allowed: list[SubtaskKind] = [kind for kind in lacking if asked[kind] < _MOST[kind]]
        return sorted(allowed, key=lambda kind: -lacking[kind])


class Change(NamedTuple):
    """A message without its words."""

    before: int
    kind: MessageKind
    adds: tuple[Edge, ...]
    removes: tuple[Edge, ...]
    until: int | None = None


class Ask(NamedTuple):
    """A search without its words and distances."""

    owner: str
    names: tuple[str, ...]
    """The right objects."""
    kind: SubtaskKind
    message: int
    old: str | None
    wants_all: bool = False


class Story(NamedTuple):
    """Changes, the intro first, and searches."""

    changes: tuple[Change, ...]
    asks: tuple[Ask, ...]


def draw_story(
    setting: Setting,
    edges: Sequence[Edge],
    *,
    newcomers: Sequence[str],
    num_asks: int,
    needs: Needs,
    rng: np.random.Generator,
) -> Story:
    """A story that begins with the ownership `edges`.

    Args:
        setting: The storey.
        edges: The initial ownership.
        newcomers: People who own nothing at first, but may get something.
        num_asks: Number of searches.
        needs: What the set holds so far; it decides which kinds come first.
        rng: The random numbers.

    Raises:
        StoryError: It cannot go on.
    """
    teller = _Teller(setting, edges, newcomers, num_asks, needs, rng)
    for index in range(num_asks):
        teller.go_on(index)
    return Story(tuple(teller.changes), tuple(teller.asks))


def keeps_rules(setting: Setting, edges: Iterable[Edge]) -> bool:
    """Whether an ownership keeps the split's rule, and no query about it has two meanings."""
    if broken_rule(setting.split, dict.fromkeys(edges, 0)) is not None:
        return False
    owned: dict[str, list[str]] = {}
    for edge in edges:
        owned.setdefault(edge.owner, []).append(edge.object_name)
    return not any(frozenset(pair) in setting.conflicts for names in owned.values() for pair in combinations(names, 2))


class _Teller:
    """The state of a story that grows by one search at a time."""

    def __init__(
        self,
        setting: Setting,
        edges: Sequence[Edge],
        newcomers: Sequence[str],
        num_asks: int,
        needs: Needs,
        rng: np.random.Generator,
    ) -> None:
        self.setting, self.num_asks, self.needs, self.rng = setting, num_asks, needs, rng
        self.edges = dict.fromkeys(edges, 0)
        self.people = [*dict.fromkeys(edge.owner for edge in edges), *newcomers]
        self.changes = [Change(0, "intro", tuple(edges), ())]
        self.asks: list[Ask] = []
        self.decided: dict[tuple[str, frozenset[str]], int] = {}
        """The message that decided each search that was asked."""
        self.sprung: set[tuple[str, frozenset[str], int]] = set()
        """Stale searches that were asked, with the message that made them so."""
        self.loan: Change | None = None
        if not keeps_rules(self.setting, self.edges):
            raise StoryError("ownership rule")

    def go_on(self, index: int) -> None:
        """Adds the search `index`, and maybe a message before it.

        Raises:
            StoryError: None keeps the guarantees.
        """
        returns = self.loan is not None and self.loan.until == index
        if self.loan is not None and returns:
            self.edges = _applied(self.edges, self.loan.removes, self.loan.adds, self.changes.index(self.loan))
            self.loan = None
            if not keeps_rules(self.setting, self.edges):
                raise StoryError("ownership rule")
        kinds: list[SubtaskKind] = ["fresh"]
        if index:
            kinds = self.needs.wanted(Counter(ask.kind for ask in self.asks))
        for kind in kinds:
            tells = self.rng.random() < _TELLS
            for with_message in (tells, not tells) if index and not returns else (False,):
                if self._told(index, kind) if with_message else self._asked(kind, self._choices(self.edges)):
                    return
        raise StoryError(self._missing(kinds))

    def _missing(self, kinds: Sequence[SubtaskKind]) -> str:
        """The guarantee that every search of these kinds would break."""
        if any(ask.kind in kinds for ask in self._choices(self.edges, anywhere=True)):
            return "2 m apart, reachable"
        if any(ask.kind in kinds for ask in self._choices(self.edges, anywhere=True, anything=True)):
            return "findable"
        return "unique answer"

    def _told(self, index: int, kind: SubtaskKind) -> bool:
        """Adds a message and a search of this kind, which it decides where kinds of that sort are wanted."""
        depends = kind in ("changed", "stale")
        for change in self._ordered(self._possible(index), kind):
            after = _applied(self.edges, change.adds, change.removes, len(self.changes))
            if not keeps_rules(self.setting, after):
                continue
            self.changes.append(change)
            choices = list(self._choices(after))
            if depends:
                choices = [ask for ask in choices if ask.message == len(self.changes) - 1]
            if self._asked(kind, choices):
                self.edges = after
                self.loan = change if change.kind == "lend" else self.loan
                if change.kind == "leave":
                    self.people.remove(change.removes[0].owner)
                return True
            self.changes.pop()
        return False

    def _asked(self, kind: SubtaskKind, choices: Iterator[Ask] | list[Ask]) -> bool:
        """Adds one of the searches of this kind, one with an old object if there is one."""
        fitting = [ask for ask in choices if ask.kind == kind]
        fitting = [ask for ask in fitting if ask.old is not None] or fitting
        if self.rng.random() < _SEVERAL:
            fitting = [ask for ask in fitting if len(ask.names) > 1] or fitting
        if not fitting:
            return False
        ask = fitting[int(self.rng.integers(len(fitting)))]
        ask = ask._replace(wants_all=len(ask.names) > 1 and self.rng.random() < _FOR_ALL)
        self.asks.append(ask)
        self.decided[ask.owner, frozenset(ask.names)] = self._said(ask) if kind == "stale" else ask.message
        if kind == "stale":
            self.sprung.add((ask.owner, frozenset(ask.names), ask.message))
        return True

    def _said(self, ask: Ask) -> int:
        """The message that said that the owner of a stale search has its object."""
        return max(self.edges[Edge(ask.owner, name)] for name in ask.names)

    def _choices(self, edges: Mapping[Edge, int], *, anywhere: bool = False, anything: bool = False) -> Iterator[Ask]:
        """The searches that an ownership allows next, of all kinds.

        Args:
            edges: The ownership.
            anywhere: Also near the search before.
            anything: Also for objects that cannot be found.
        """
        owned: dict[tuple[str, str], list[str]] = {}
        for edge in edges:
            owned.setdefault((edge.owner, self.setting.category[edge.object_name]), []).append(edge.object_name)
        before = self.asks[-1].names if self.asks and not anywhere else ()
        for (owner, category), found in owned.items():
            names = tuple(sorted(found))
            is_odd = len(names) > 1 and category.endswith(ODD_PLURALS)
            if is_odd or not (anything or self.setting.askable.issuperset(names)):
                continue
            if any(a == b or frozenset((a, b)) in self.setting.near for a in before for b in names):
                continue
            ask = self._choice(owner, category, names, max(edges[Edge(owner, name)] for name in names))
            if ask is not None and not any(frozenset((ask.old, name)) in self.setting.near for name in names):
                yield ask

    def _choice(self, owner: str, category: str, names: tuple[str, ...], decided: int) -> Ask | None:
        """The search for a person's objects of a category, with its kind; None where it is of no kind."""
        key = owner, frozenset(names)
        lost = [
            (number, edge.object_name)
            for number, change in enumerate(self.changes)
            for edge in change.removes
            if edge.owner == owner and self.setting.category[edge.object_name] == category
        ]
        number, old = lost[-1] if lost and lost[-1][1] not in names else (-1, None)
        if number > decided and (*key, number) not in self.sprung:
            return Ask(owner, names, "stale", number, old)
        if key in self.decided:
            return Ask(owner, names, "revisit", decided, None) if self.decided[key] == decided else None
        if decided == 0:
            return Ask(owner, names, "fresh", 0, None)
        is_told = any(Edge(owner, name) in self.changes[0].adds for name in names)
        if is_told or self.setting.num_alike[category] <= len(names):
            return None
        return Ask(owner, names, "changed", decided, old if number == decided else None)

    def _ordered(self, changes: Iterator[Change], kind: SubtaskKind) -> list[Change]:
        """Messages in the order in which they are tried: kinds that the set lacks first, and those that help."""
        twins = Counter((edge.owner, self.setting.category[edge.object_name]) for edge in self.edges)
        told = Counter(change.kind for change in self.changes) + self.needs.messages
        prefers = self.rng.random() < _HELPS

        def place(change: Change) -> tuple[bool, float]:
            lacking = (told[change.kind] + 3 * self.rng.random()) / _WEIGHTS[change.kind]
            return prefers and not self._helps(change, kind, twins), lacking

        found = list(changes)
        if kind == "stale":
            found = [change for change in found if self._helps(change, kind, twins)]
        elif kind == "changed":
            found = [change for change in found if change.adds]
        return sorted(found, key=place)

    def _helps(self, change: Change, kind: SubtaskKind, twins: Counter[tuple[str, str]]) -> bool:
        """Whether a message leaves an old object behind for this kind of search, or for a later one."""
        category = self.setting.category
        if kind == "stale":
            return any(twins[edge.owner, category[edge.object_name]] > 1 for edge in change.removes)
        if kind == "changed":
            return change.kind == "swap" and len({category[edge.object_name] for edge in change.adds}) == 1
        return any(twins[edge.owner, category[edge.object_name]] for edge in change.adds) and change.kind != "swap"

    def _possible(self, index: int) -> Iterator[Change]:
        """The messages that this ownership allows before the search `index`; rules are not looked at."""
        owners: dict[str, list[str]] = {}
        for edge in self.edges:
            owners.setdefault(edge.object_name, []).append(edge.owner)
        lent = set[str]() if self.loan is None else {self.loan.adds[0].object_name}
        busy = set[str]() if self.loan is None else {self.loan.adds[0].owner, self.loan.removes[0].owner}
        free = {name: found for name, found in owners.items() if name not in lent}
        sole = {name: found[0] for name, found in free.items() if len(found) == 1}
        for name, giver in sole.items():
            for taker in self.people:
                if taker == giver:
                    continue
                moved = (Edge(taker, name),), (Edge(giver, name),)
                yield Change(index, "transfer", *moved)
                yield Change(index, "correction", *moved)
                if self.loan is None and index + 1 < self.num_asks:
                    last = min(index + _LONGEST_LOAN, self.num_asks - 1)
                    yield Change(index, "lend", *moved, until=int(self.rng.integers(index + 1, last + 1)))
        for one, other in combinations(sole, 2):
            a, b = sole[one], sole[other]
            if a != b:
                yield Change(index, "swap", (Edge(b, one), Edge(a, other)), (Edge(a, one), Edge(b, other)))
        for name, found in free.items():
            for person in self.people:
                if person not in found:
                    yield Change(index, "share", (Edge(person, name),), ())
                elif len(found) > 1:
                    yield Change(index, "unshare", (), (Edge(person, name),))
        for person in {edge.owner: None for edge in self.edges}:
            if person not in busy:
                yield Change(index, "leave", (), tuple(edge for edge in self.edges if edge.owner == person))


def _applied(edges: Mapping[Edge, int], adds: Sequence[Edge], removes: Sequence[Edge], number: int) -> dict[Edge, int]:
    """The ownership after message `number`."""
    return {edge: told for edge, told in edges.items() if edge not in removes} | dict.fromkeys(adds, number)

"""An agent that remembers things: what a home's things look like and where they are, for one search after the other.

Observation -> detections of all that the table of owners names -> `UnknownThings` -> the thing that fits the asked
texts best -> STOP at it; frontiers while nothing fits enough.
"""

import math
import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grounding.encoders.hashed import HashedWords
from grounding.maps.object_map import MERGE_RULE, features_of_masks
from grounding.maps.occupancy import MAX_DEPTH
from grounding.maps.thing_merging import UnknownThings
from grounding.methods.matching import DUAL_TEMPERATURE, dual_scores
from grounding.perception.protocol import Perception
from grounding.perception.segments import Segments
from grounding.phrases.ownership_text import asked_thing, parse_phrase, parse_query, says_category
from grounding.phrases.sources import PhraseSource
from sim.tasks.observers import Detection, Insight
from sim.types import Action, Camera, Frame, Task
from sim.words.places import PLACE_PHRASES

from .frontiers import Frontier
from .looking_agent import LookingAgent
from .seeking import FOR_EVER, FULL_TURN

LEAST_VIEWS = 2
"""Views that must show a thing before the robot goes to it; one is enough when no frontier is left."""
SAME_PLACE = 0.5
"""Two things whose middles are nearer to each other on the floor plan are taken for one, metres."""
STAY_GAIN = 0.5
"""The thing that the robot goes to is kept while no other one's score, a logarithm, is better by more than this."""
_HEIGHTS = (-0.5, 2.5)
"""The middle of a thing on the robot's storey is between these heights above the floor, metres; stairs show others."""
_TAIL = re.compile(rf"[,;.:(]|\b(?:{'|'.join(PLACE_PHRASES)}|with|that|which|has|is)\b")
"""Where the words about the thing itself end."""
_BAN_STEPS = 20
"""Steps for which a thing is left out to which no way leads."""
_REPLAN_STEPS = 4
"""Steps between two plans of the way to the same frontier."""


class Sought(NamedTuple):
    """What a search asks for, in words, and what else was told."""

    own: tuple[str, ...]
    """The text to look for first, then the owner's other things of the same category."""
    others: tuple[str, ...]
    """The other things that anybody owns."""
    categories: tuple[str, ...]
    """The query's category, and the head nouns of `own`."""
    num_wanted: int
    """Things that the query asks for: 1, or all that the owner was told to have of the category."""


class _Known(NamedTuple):
    """A thing of the memory, matched with the texts."""

    place: tuple[float, float, float]
    """Middle of the box around its points, the map's frame, metres."""
    score: float
    """Logarithm of the dual softmax of its cosine with the asked texts."""
    rank: int
    """2: it was detected as the asked category and for an asked text, and no other text fits it better, so that the
    robot may go to it at once; 1: it was detected as the category alone; 0: neither."""

    @property
    def xz(self) -> tuple[float, float]:
        """Its place on the floor plan, metres."""
        return self.place[0], self.place[2]


class InstanceMemoryAgent(LookingAgent):
    """An `Agent` with a memory of things, on the storey where it starts.

    It detects everything that the phrases name, so that a thing seen on the way is known when it is asked for later, or
    belongs to somebody else by then. Without a language model: rules read descriptions and messages.
    """

    def __init__(
        self,
        perception: Perception | Callable[[], Perception],
        goal_text: Callable[[Task], str],
        phrases: PhraseSource,
    ) -> None:
        """Makes an agent.

        Args:
            perception: What it sees with, or a function that makes it when the first episode begins.
            goal_text: What to look for, such as "red backpack", from the task; never from the goal.
            phrases: Says who owns what after all that was told.
        """
        super().__init__(perception, goal_text)
        self._phrases = phrases

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Begins with nothing known; with `keep_memory`, after `carry` and on the same storey, map and things stay.

        `seed` changes nothing: nothing is drawn.
        """
        is_kept = self._begin(camera, can_look=Action.LOOK_DOWN in task.actions, keep_memory=keep_memory)
        if not is_kept:
            self._memory = UnknownThings(MERGE_RULE, max_depth=MAX_DEPTH)
        self._sought = sought(task, self._goal_text(task), self._phrases)
        told = (*self._sought.own, *self._sought.others)
        self._rows = self._opened().encoder.encode_texts([f"a {text}" for text in told])
        self._looked_for = tuple(dict.fromkeys((*told, *self._sought.categories, *map(head_noun, told))))
        self._turns_left = 0 if is_kept else FULL_TURN
        self._known: list[_Known] = []
        self._target: _Known | None = None
        self._left_out: list[tuple[tuple[float, float], int]] = []
        self._marked = 0
        self._is_explored, self._planned_at = False, 0
        self._frontiers: list[Frontier] = []
        self._detections: tuple[Detection, ...] = ()
        self._note = ""

    @property
    def wants_more(self) -> bool:
        """After STOP, whether the query asks for all things and the owner has more of them."""
        return self._marked < self._sought.num_wanted

    def insight(self) -> Insight:
        """The map, frontiers, detections, the things that fit with their scores, the goal and the note."""
        memory = self._seeker.memory
        shown = self._seeker.insight(self._frontiers, note=self._note)
        fitting = self._fitting()
        return self._in_start(
            Insight(
                grid=memory.grid,
                occupancy=memory.cells,
                frontiers=shown.frontiers,
                detections=self._detections,
                candidates=np.array([each.place for each in fitting], float).reshape(-1, 3),
                candidate_scores=tuple(each.score for each in fitting),
                goal=shown.goal if self._target is None else self._target.place,
                note=self._note,
            )
        )

    def _look(self, frame: Frame) -> None:
        """Adds what a view shows of all the texts to the memory, and matches the memory with them."""
        perception = self._opened()
        found: list[tuple[Detection, NDArray[np.bool_]]] = []
        for text in self._looked_for:
            perception.detector.set_query(text)
            for each in sorted(perception.detector.detect(frame), key=lambda each: (each.box, each.score)):
                mask = perception.segmenter.mask(frame, each)
                found.append((Detection(text, each.box, each.score), mask))
        masks = np.array([mask for _, mask in found], bool).reshape(-1, *frame.depth_m.shape)
        segments = Segments(masks, tuple(each.label for each, _ in found))
        patches = perception.encoder.encode_patches([frame])[0]
        self._memory.add(frame, segments, features_of_masks(segments, frame.camera, patches))
        self._detections = tuple(each for each, _ in found if each.label in self._sought.own)
        self._known = self._matched()

    def _search(self) -> Action:
        """The next action; STOP at the thing that fits best, or when nothing is left to go to.

        It may be asked again after STOP: then it goes on to another thing.
        """
        return self._towards_thing() or self._explore() or self._towards_thing() or self._give_up()

    def _matched(self) -> list[_Known]:
        """The memory's things that are on the robot's storey with their scores, in a fixed order."""
        low, high = self._seeker.memory.floor_y + np.array(_HEIGHTS)
        placed = [(thing, _middle(thing.points)) for thing in self._memory.things() if len(thing.points)]
        placed = [(thing, place) for thing, place in placed if low < place[1] < high]
        if not placed:
            return []
        things = [thing for thing, _ in placed]
        num_own = len(self._sought.own)
        cosines = self._rows @ np.array([thing.feature for thing in things], np.float32).T
        scores = dual_scores(cosines, temperature=DUAL_TEMPERATURE)[:num_own].max(axis=0)
        own = cosines[:num_own].max(axis=0)
        is_own = (own > 0) & (own >= cosines.max(axis=0))  # a thing too small for a feature fits nothing
        found = []
        for (thing, place), score, fits in zip(placed, scores.tolist(), is_own.tolist(), strict=True):
            as_category = max(thing.captions[text] for text in self._sought.categories)
            as_asked = max(thing.captions[text] for text in self._sought.own)
            is_clear = fits and as_category >= LEAST_VIEWS and as_asked >= LEAST_VIEWS
            found.append(_Known(place, score, 2 if is_clear else int(as_category > 0)))
        return found

    def _fitting(self) -> list[_Known]:
        """The things that may be gone to, best first: any of them when no frontier is left and nothing was marked."""
        gone = [xz for xz, until in self._left_out if until > self._step]
        left = [each for each in self._known if all(math.dist(each.xz, xz) > SAME_PLACE for xz in gone)]
        if self._marked or not self._is_explored:
            left = [each for each in left if each.rank == 2]
        return sorted(left, key=lambda each: (-each.rank, -each.score))

    def _towards_thing(self) -> Action | None:
        """The next action towards the thing that fits best, STOP at it; None without one, or if no way leads there."""
        while fitting := self._fitting():
            last, self._target = self._target, self._chosen(fitting)
            if last is None or math.dist(last.xz, self._target.xz) > SAME_PLACE:
                self._seeker.choose(None)
            action = self._seeker.stop_at(self._target.xz)
            if action is Action.STOP:
                self._left_out.append((self._target.xz, FOR_EVER))
                self._marked += 1
            if action is not None:
                self._note = f"to the best of {len(fitting)} things that fit, score {self._target.score:.2f}"
                return action
            self._left_out.append((self._target.xz, self._step + _BAN_STEPS))
        if self._target is not None:
            self._seeker.choose(None)
        self._target = None
        return None

    def _chosen(self, fitting: list[_Known]) -> _Known:
        """The best of them, or the last target unless another is clearly better."""
        best, last = fitting[0], self._target
        if last is None:
            return best
        kept = min(fitting, key=lambda each: math.dist(each.xz, last.xz))
        is_same = math.dist(kept.xz, last.xz) <= SAME_PLACE
        is_better = best.rank > kept.rank or best.score > kept.score + STAY_GAIN
        return kept if is_same and not is_better else best

    def _explore(self) -> Action | None:
        """The next action towards a frontier; None if none is left that is worth it."""
        seeker = self._seeker
        if not seeker.is_turning and self._step - self._planned_at >= _REPLAN_STEPS:
            seeker.replan()
            self._planned_at = self._step
        while not self._is_explored:
            action = seeker.pursue()
            if action is not None:
                return action
            self._frontiers = [each for each in seeker.frontiers() if math.isfinite(each.cost)]
            if self._frontiers and not seeker.is_dull():
                seeker.choose(self._frontiers[0])
                self._note = f"to a frontier, one of {len(self._frontiers)}: no thing fits yet"
            elif seeker.is_dull() or not (seeker.squeeze() or seeker.forgive()):
                self._is_explored = True
        seeker.choose(None)
        return None

    def _give_up(self) -> Action:
        """STOP, or turns where other things of the search were found: STOP would mark the place too."""
        self._note = "nothing is left to go to"
        if self._marked:
            return Action.LEFT
        self._marked = 1
        return Action.STOP


def sought(task: Task, text: str, phrases: PhraseSource) -> Sought:
    """What a task asks for by the text and the phrases, and what else these name; rooms and owners left out."""
    told = phrases.phrases(task)
    items, query = [parse_phrase(phrase) for phrase in told], task.queries[0]
    asked, wanted = asked_thing(told, query, HashedWords()), parse_query(query)
    chosen = "" if asked is None else asked.things[asked.chosen].thing
    mine = [
        item.thing
        for item in items
        if wanted
        and item.owner.casefold() == wanted.owner.casefold()
        and says_category(_TAIL.split(item.thing)[0], wanted.category)  # "the chair next to the bench" is no bench
    ]
    own = tuple(dict.fromkeys([text, *(thing for thing in mine if thing != chosen)]))
    others = tuple(dict.fromkeys(item.thing for item in items if item.thing not in (*own, chosen)))
    heads = [head_noun(found) for found in own]
    categories = tuple(dict.fromkeys([wanted.category, *heads] if wanted else heads))
    is_for_all = re.search(r"\ball of\b", query) is not None
    return Sought(own, others, categories, max(len(own), len(mine)) if is_for_all else 1)


def head_noun(text: str) -> str:
    """The word that says what a thing is: "rug" of "green and white striped rug next to the bed"."""
    words = _TAIL.split(text)[0].split() or text.split()
    return words[-1]


def _middle(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Middle of the box around points (P, 3), metres."""
    x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
    return x, y, z

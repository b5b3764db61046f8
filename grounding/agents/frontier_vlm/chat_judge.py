"""The judge of `frontier-vlm`: a chat model that sees a numbered map, views towards frontiers, and things."""

import math
from dataclasses import replace

from sim.types import Frame

from ...chat.protocol import Chat, NoAnswer
from ..frontiers import Frontier
from .agent import NEW_CELLS, NEW_DISTANCE
from .choices import MOST_FRONTIERS, Choices, GeometryJudge, Verdict
from .question import PROMPT, choice_of, question
from .things import Thing
from .views import KeptViews


class ChatJudge:
    """Asks a chat model; geometry chooses where its answer cannot be used.

    It is not asked about a single choice, twice in a step, or while frontiers are left around the place that it chose
    and neither a new thing nor a new frontier far from all earlier ones has appeared.
    """

    def __init__(self, chat: Chat) -> None:
        """For one episode."""
        self._chat, self._geometry, self._views = chat, GeometryJudge(), KeptViews()
        self._has_asked = False
        self._chosen_xz: tuple[float, float] | None = None
        self._offered_xz: list[tuple[float, float]] = []
        self._offered: set[int] = set()
        self.num_asked = 0
        """Questions in this episode."""
        self.unusable: dict[int, str] = {}
        """Number of a question, from 1, to the reason why its answer could not be used."""

    def see(self, frame: Frame) -> None:
        """Keeps the view; a step begins."""
        self._views.see(frame)
        self._has_asked = False

    def choose(self, choices: Choices) -> Verdict:
        """The model's choice, or that of geometry.

        Raises:
            AgentError: The server refuses the key or the model, or the budget is spent.
        """
        choices = replace(choices, frontiers=choices.frontiers[:MOST_FRONTIERS])
        onwards = self._onwards(choices)
        if onwards is not None:
            return Verdict(onwards, f"on around the frontier that {self._chat.name} chose{self._counts()}")
        if self._has_asked or len(choices.frontiers) + len(choices.things) == 1:
            return self._by_geometry(choices, "not asked")
        crops = [self._views.towards(choices.place_of(each), floor_y=choices.floor_y) for each in choices.frontiers]
        self._has_asked, self._chosen_xz = True, None
        self._offered_xz = [choices.place_of(each) for each in choices.frontiers]
        self._offered |= {thing.number for thing in choices.things}
        self.num_asked += 1
        try:
            chosen = choice_of(self._chat.ask(PROMPT, question(choices, crops), is_json=True), choices)
        except NoAnswer as problem:
            self.unusable[self.num_asked] = str(problem)
            return self._by_geometry(choices, "no usable answer")
        self._chosen_xz = None if isinstance(chosen, Thing) else choices.place_of(chosen)
        kind, among = ("snapshot", choices.things) if isinstance(chosen, Thing) else ("frontier", choices.frontiers)
        number = next(index for index, each in enumerate(among, start=1) if each is chosen)
        return Verdict(chosen, f"{kind} {number} of {len(among)} by {self._chat.name}{self._counts()}")

    def _onwards(self, choices: Choices) -> Frontier | None:
        """The frontier nearest to the chosen place, while one is within NEW_DISTANCE of it and nothing else is new."""
        if self._chosen_xz is None or any(thing.number not in self._offered for thing in choices.things):
            return None
        places = [choices.place_of(each) for each in choices.frontiers]
        for frontier, place in zip(choices.frontiers, places, strict=True):
            is_far = all(math.dist(place, xz) > NEW_DISTANCE for xz in (self._chosen_xz, *self._offered_xz))
            if is_far and len(frontier.cells_rc) >= NEW_CELLS:
                return None
        away = [math.dist(place, self._chosen_xz) for place in places]
        nearest = min(range(len(away)), key=away.__getitem__, default=None)
        return None if nearest is None or away[nearest] > NEW_DISTANCE else choices.frontiers[nearest]

    def _by_geometry(self, choices: Choices, why: str) -> Verdict:
        verdict = self._geometry.choose(choices)
        return Verdict(verdict.chosen, f"{verdict.note}; {self._chat.name}: {why}{self._counts()}")

    def _counts(self) -> str:
        return f" ({self.num_asked} asked, {len(self.unusable)} unusable)"

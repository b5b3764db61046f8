"""The judge of `frontier-vlm`: a chat model that sees a numbered map, views towards frontiers, and things."""

from sim.types import Frame

from ...chat.protocol import Chat, NoAnswer
from .choices import Choices, GeometryJudge, Verdict
from .question import PROMPT, choice_of, question
from .things import Thing
from .views import KeptViews


class ChatJudge:
    """Asks a chat model, at most once a step and never about a single choice; geometry chooses where it cannot say."""

    def __init__(self, chat: Chat) -> None:
        """For one episode."""
        self._chat, self._geometry, self._views = chat, GeometryJudge(), KeptViews()
        self._has_asked = False
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
        if self._has_asked or len(choices.frontiers) + len(choices.things) == 1:
            return self._by_geometry(choices, "not asked")
        crops = [self._views.towards(each.middle_xz, floor_y=choices.floor_y) for each in choices.frontiers]
        self._has_asked = True
        self.num_asked += 1
        try:
            chosen = choice_of(self._chat.ask(PROMPT, question(choices, crops), is_json=True), choices)
        except NoAnswer as problem:
            self.unusable[self.num_asked] = str(problem)
            return self._by_geometry(choices, "no usable answer")
        kind, among = ("snapshot", choices.things) if isinstance(chosen, Thing) else ("frontier", choices.frontiers)
        number = next(index for index, each in enumerate(among, start=1) if each is chosen)
        return Verdict(chosen, f"{kind} {number} of {len(among)} by {self._chat.name}{self._counts()}")

    def _by_geometry(self, choices: Choices, why: str) -> Verdict:
        verdict = self._geometry.choose(choices)
        return Verdict(verdict.chosen, f"{verdict.note}; {self._chat.name}: {why}{self._counts()}")

    def _counts(self) -> str:
        return f" ({self.num_asked} asked, {len(self.unusable)} unusable)"

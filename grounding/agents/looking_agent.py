"""What agents inherit that look for a described thing: first a look around, then whatever their search says.

Observation -> `Seeker`'s floor and the agent's own memory of the view -> LEFT at the start, later the search's action.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

from grounding.perception.protocol import Perception
from sim.types import Action, Frame, Observation, Task

from .carried_map import CarriedMap
from .seeking import require_picture


class LookingAgent(CarriedMap, ABC):
    """An `Agent` that looks for one described thing on the storey where it starts."""

    _turns_left: int
    """Turns until it has looked around at the start."""
    _note: str

    def __init__(self, perception: Perception | Callable[[], Perception], goal_text: Callable[[Task], str]) -> None:
        """Makes an agent.

        Args:
            perception: What it sees with, or a function that makes it when the first episode begins.
            goal_text: What to look for, such as "red backpack", from the task; never from the goal.
        """
        self._perception, self._goal_text = perception, goal_text

    def act(self, observation: Observation) -> Action:
        """The next action.

        Raises:
            AgentError: The observation has no colours or no depth; or a model that the agent asks cannot be asked.
        """
        self._look(self._seen(observation))
        if not self._turns_left:
            return self._search()
        self._turns_left -= 1
        self._note = "looking around at the start"
        return Action.LEFT

    @abstractmethod
    def _look(self, frame: Frame) -> None:
        """Adds a view, in the map's frame, to what the agent knows."""

    @abstractmethod
    def _search(self) -> Action:
        """The next action once it has looked around."""

    def _opened(self) -> Perception:
        """The perception, which is made when it is first needed."""
        if not isinstance(self._perception, Perception):
            self._perception = self._perception()
        return self._perception

    def _seen(self, observation: Observation) -> Frame:
        """The view in the map's frame, whose floor the seeker knows now; raises AgentError without a picture."""
        require_picture(observation)
        in_map = self._in_map(observation)
        self._seeker.see(in_map)
        return self._opened().frame_of(in_map)

"""The agent behind `frontier-vlm`, `frontier-geometry` and `nearest-frontier`: they differ in their judge alone.

Observation -> `Seeker`, `SeenThings` -> choices -> a judge -> the frontier to look at, or the thing to stop at.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from grounding.perception.protocol import Perception
from sim.tasks.observers import Detection, Insight
from sim.types import Action, Camera, Frame, Task

from ..frontiers import Frontier
from ..looking_agent import LookingAgent
from ..seeking import FULL_TURN
from .choices import MOST_THINGS, Choices, Judge
from .things import SeenThings, Thing

LEAST_VIEWS = 2
"""Views that must show a thing before it is a choice; one is enough when no frontier is left."""
REVIEW_STEPS = 10
"""Steps after a decision, and between two looks, before new frontiers are looked for on the way to another one."""
NEW_CELLS, NEW_DISTANCE = 20, 2.0
"""A frontier is news if it has this many unknown cells (1 m) and all those last chosen from are this far away, m."""
_REPLAN_STEPS = 4
"""Steps between two plans of the way to the same frontier."""
_BAN_STEPS = 40
"""Steps for which a thing is left out to which no way leads."""


class JudgedFrontierAgent(LookingAgent):
    """An `Agent` that looks for one described thing on the storey where it starts.

    It looks around, then a judge chooses among frontiers and things. It is asked again when the robot has seen the
    frontier or cannot get there, when a thing appears that was no choice before, and when a long frontier appears far
    from all earlier ones (LEAST_VIEWS, NEW_CELLS). STOP follows a chosen thing, or the end of all choices.
    """

    def __init__(
        self,
        perception: Perception | Callable[[], Perception],
        goal_text: Callable[[Task], str],
        *,
        judge: Callable[[], Judge],
    ) -> None:
        """Makes an agent.

        Args:
            perception: What it sees with, or a function that makes it when the first episode begins.
            goal_text: What the detector looks for, such as "red backpack", from the task; never from the goal.
            judge: Makes what chooses in an episode.
        """
        super().__init__(perception, goal_text)
        self._make_judge = judge

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Begins with an empty map; with `keep_memory`, after `carry` and on the same storey, its obstacles stay."""
        self._opened().detector.set_query(self._goal_text(task))
        self._judge = self._make_judge()
        self._task = task
        can_look = Action.LOOK_DOWN in task.actions
        self._begin(camera, can_look=can_look, keep_memory=keep_memory, obstacles_alone=True)
        self._things = SeenThings()
        self._detections: tuple[Detection, ...] = ()
        self._turns_left = FULL_TURN
        self._thing: int | None = None
        self._left_out: dict[int, int] = {}
        self._offered: set[int] = set()
        self._choices: Choices | None = None
        self._reviewed_at, self._planned_at = 0, 0
        self._note = ""

    def insight(self) -> Insight:
        """The map, the frontiers and things last chosen from in the order of their numbers, the goal and the note."""
        memory, seeker = self._seeker.memory, self._seeker
        goal = None if seeker.goal is None else (seeker.goal.place_xz[0], memory.floor_y, seeker.goal.place_xz[1])
        thing = self._current_thing()
        frontiers, things = (self._choices.frontiers, self._choices.things) if self._choices else ((), ())
        return self._in_start(
            Insight(
                grid=memory.grid,
                occupancy=memory.cells,
                frontiers=np.array([each.middle_xz for each in frontiers], float).reshape(-1, 2),
                detections=self._detections,
                candidates=np.array([each.centre for each in things], float).reshape(-1, 3),
                candidate_scores=tuple(each.score for each in things),
                goal=goal if thing is None else thing.centre,
                note=self._note,
            )
        )

    def _look(self, frame: Frame) -> None:
        """Shows the judge a view, and looks for things in it."""
        self._judge.see(frame)
        perception = self._opened()
        found = [(each, perception.segmenter.mask(frame, each)) for each in perception.detector.detect(frame)]
        self._detections = self._things.see(frame, found)

    def _search(self) -> Action:
        """The next action towards what the judge chose last or chooses now; STOP at a thing, or with no choice left."""
        if self._has_news():
            self._decide()
        while True:
            action = self._towards_thing() if self._thing is not None else self._towards_frontier()
            if action is not None:
                return action
            if not self._decide():
                self._seeker.choose(None)
                self._note = "nothing is left to choose"
                return Action.STOP

    def _towards_thing(self) -> Action | None:
        """The next action towards the chosen thing, STOP at it; None if no way leads there: it is left out a while."""
        thing = self._current_thing()
        assert thing is not None
        action = self._seeker.stop_at(thing.xz)
        if action is None:
            self._left_out[thing.number] = self._step + _BAN_STEPS
            self._thing = None
        return action

    def _towards_frontier(self) -> Action | None:
        """The next action towards seeing the chosen frontier; None if it is seen or has failed."""
        if not self._seeker.is_turning and self._step - self._planned_at >= _REPLAN_STEPS:
            self._seeker.replan()
            self._planned_at = self._step
        return self._seeker.pursue()

    def _has_news(self) -> bool:
        """Whether the choices differ enough from the last ones to choose again on the way."""
        if any(thing.number not in self._offered for thing in self._fitting(LEAST_VIEWS)):
            return True
        if self._thing is not None or self._seeker.is_turning or self._step - self._reviewed_at < REVIEW_STEPS:
            return False
        self._reviewed_at = self._step
        earlier = [frontier.middle_xz for frontier in self._choices.frontiers] if self._choices else []
        return any(
            len(frontier.cells_rc) >= NEW_CELLS
            and all(math.dist(frontier.middle_xz, xz) > NEW_DISTANCE for xz in earlier)
            for frontier in self._open_frontiers()
        )

    def _decide(self) -> bool:
        """Lets the judge choose; False if there is nothing to choose."""
        frontiers = self._open_frontiers()
        while not frontiers and not self._seeker.is_dull() and (self._seeker.squeeze() or self._seeker.forgive()):
            frontiers = self._open_frontiers()
        if self._seeker.is_dull():
            frontiers = []
        things = self._fitting(LEAST_VIEWS if frontiers else 1)
        if not frontiers and not things:
            return False
        self._choices = self._choices_of(frontiers, things)
        self._offered |= {thing.number for thing in things}
        self._reviewed_at = self._planned_at = self._step
        verdict = self._judge.choose(self._choices)
        self._note = verdict.note
        if isinstance(verdict.chosen, Thing):
            self._seeker.choose(None)
            self._thing = verdict.chosen.number
        else:
            self._thing = None
            self._seeker.choose(verdict.chosen)
        return True

    def _choices_of(self, frontiers: Sequence[Frontier], things: Sequence[Thing]) -> Choices:
        memory = self._seeker.memory
        robot = (*memory.xz, memory.yaw)
        return Choices(self._task, tuple(frontiers), tuple(things), memory.ground(), robot, memory.floor_y)

    def _open_frontiers(self) -> list[Frontier]:
        """Those that a way leads to."""
        return [each for each in self._seeker.frontiers() if math.isfinite(each.cost)]

    def _fitting(self, least_views: int) -> list[Thing]:
        """At most MOST_THINGS that are not left out, highest score first."""
        fitting = [
            thing
            for thing in self._things.all()
            if thing.num_views >= least_views and self._left_out.get(thing.number, 0) <= self._step
        ]
        return sorted(fitting, key=lambda thing: (-thing.score, thing.number))[:MOST_THINGS]

    def _current_thing(self) -> Thing | None:
        return None if self._thing is None else self._things.all()[self._thing]

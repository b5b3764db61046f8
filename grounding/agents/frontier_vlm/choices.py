"""What an agent may do next, and the judges that choose: the `Judge` protocol and `GeometryJudge`.

Frontiers, things -> `Choices` -> a judge -> `Verdict` -> the agent walks there.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from sim.types import Frame, Task

from ..floor_memory import Ground
from ..frontiers import Frontier
from .things import Thing

MOST_FRONTIERS, MOST_THINGS = 8, 8
GeometryRule = Literal["distance-weighted", "nearest"]


@dataclass(frozen=True, slots=True)
class Choices:
    """At least one frontier or thing. Frame: start."""

    task: Task
    frontiers: tuple[Frontier, ...]
    """Those with a way to them, cheapest for their size first (`find_frontiers`)."""
    things: tuple[Thing, ...]
    """At most MOST_THINGS that fit the goal text, highest score first."""
    ground: Ground
    """What is known of the floor; the grid of the frontiers' cells."""
    robot: tuple[float, float, float]
    """x, z (metres) and yaw."""
    floor_y: float
    """Height of the floor, metres."""

    def place_of(self, frontier: Frontier) -> tuple[float, float]:
        """(x, z) of the frontier's cell that is nearest to its middle, metres: the middle of an arc lies beside it."""
        places = self.ground.grid.xz_from_rc(frontier.cells_rc)
        x, z = places[np.hypot(*(places - np.array(frontier.middle_xz)).T).argmin()].tolist()
        return x, z


@dataclass(frozen=True, slots=True)
class Verdict:
    """A judge's choice."""

    chosen: Frontier | Thing
    """One of the choices."""
    note: str
    """Why, in a few words."""


class Judge(Protocol):
    """Chooses where an agent goes in one episode."""

    def see(self, frame: Frame) -> None:
        """The robot's view at a step, before any choice in it. Frame: start."""
        ...

    def choose(self, choices: Choices) -> Verdict:
        """One of the choices.

        Raises:
            AgentError: A model behind it refuses every question, or its budget is spent.
        """
        ...


class GeometryJudge:
    """Chooses the thing of the highest score, and without a thing a frontier by the actions that it costs.

    `distance-weighted`: cost x (1 + 60 / cells), so that long frontiers may be farther away; `nearest`: cost alone.
    """

    def __init__(self, rule: GeometryRule = "distance-weighted") -> None:
        """Takes the rule for frontiers."""
        self.rule: GeometryRule = rule

    def see(self, frame: Frame) -> None:
        """Nothing is kept: geometry does not look."""

    def choose(self, choices: Choices) -> Verdict:
        """The first thing; without things, the first or the cheapest frontier."""
        if choices.things:
            thing = choices.things[0]
            return Verdict(thing, f"the thing of the highest score, {thing.score:.2f}")
        frontiers = choices.frontiers
        if self.rule == "nearest":
            frontiers = sorted(frontiers, key=lambda frontier: frontier.cost)
        return Verdict(frontiers[0], f"the {self.rule} frontier of {len(frontiers)}, {frontiers[0].cost:.0f} actions")

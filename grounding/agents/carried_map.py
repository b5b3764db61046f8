"""An agent's map through the searches of a home sequence, for all agents that may keep one.

Each search has its own start frame. `carry` says where it lies in the first one; observations -> the map's frame ->
`Seeker` and the agent's own maps -> `Insight` in the start frame again.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from sim.frames import wrap_angle
from sim.tasks.observers import Insight
from sim.types import STOREY_GAP, Camera, Observation

from .floor_memory import FloorMemory
from .seeking import Seeker


class CarriedMap:
    """What agents with a map inherit. All that they store is in the map's frame, the frame of the first start.

    The pictures that they look at are too, so that perception with ground truth needs to know the first start alone.
    """

    _seeker: Seeker
    _T_map_start: NDArray[np.float64] | None = None
    _next_T: NDArray[np.float64] | None = None
    _step, _steps_before = -1, 0

    def carry(self, T_map_start: NDArray[np.float64]) -> None:
        """Says where the next episode starts (4, 4) in the map, the frame of the first start, to keep the memory.

        Each episode has its own start frame and no observation tells how they lie to each other. Who runs a sequence of
        episodes in one home calls this before `reset(..., keep_memory=True)`.
        """
        self._next_T = np.array(T_map_start, np.float64)

    def _begin(self, camera: Camera, *, can_look: bool, keep_memory: bool, obstacles_alone: bool = False) -> bool:
        """Begins an episode, with the seeker that it has or with a new one.

        Args:
            camera: The robot's camera.
            can_look: Whether it may be tilted.
            keep_memory: Keeps the map if `carry` was called and the robot is on the map's storey.
            obstacles_alone: What is kept is not the whole map, with its steps, but its obstacles: a new seeker knows
                where they are, and nothing of the floor between them.

        Returns:
            Whether anything is kept.
        """
        T, self._next_T = self._next_T, None
        has_map = self._T_map_start is not None
        self._T_map_start = np.eye(4) if T is None or not keep_memory else T
        feet_y = float(self._T_map_start[1, 3])
        is_kept = keep_memory and T is not None and has_map and abs(feet_y - self._seeker.memory.start_y) < STOREY_GAP
        if is_kept and not obstacles_alone:
            self._steps_before = self._step + 1
            self._seeker.carry()
            return True
        memory = self._seeker.memory if is_kept else FloorMemory(start_y=feet_y)
        if is_kept:
            memory.forget_floor()
        self._seeker, self._steps_before = Seeker(camera, can_look=can_look, memory=memory), 0
        return is_kept

    def _in_map(self, observation: Observation) -> Observation:
        """The observation with its pose in the map, and its step counted since the map began."""
        self._step = observation.step + self._steps_before
        if self._is_first_start():
            return dataclasses.replace(observation, step=self._step)
        T = self._T_map_start
        assert T is not None
        x, _, z, _ = (T @ np.array([observation.gps[1], 0.0, -observation.gps[0], 1.0])).tolist()
        return dataclasses.replace(
            observation,
            gps=(-z, x),
            compass=wrap_angle(observation.compass + math.atan2(T[0, 2], T[2, 2])),
            T_start_camera=T @ observation.T_start_camera,
            step=self._step,
        )

    def _in_start(self, insight: Insight) -> Insight:
        """The insight in the start frame, without cells where the map has another frame: a grid cannot be turned."""
        if self._is_first_start():
            return insight
        assert self._T_map_start is not None
        T = np.linalg.inv(self._T_map_start)

        def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
            return points @ T[:3, :3].T + T[:3, 3]

        def placed(point: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
            if point is None:
                return None
            x, y, z = moved(np.array(point)).tolist()
            return x, y, z

        edges, points = insight.frontiers, insight.candidates
        return dataclasses.replace(
            insight,
            grid=None,
            occupancy=None,
            similarity=None,
            frontiers=None if edges is None else moved(np.insert(edges, 1, 0.0, axis=1))[:, [0, 2]],
            detections=tuple(dataclasses.replace(each, position=placed(each.position)) for each in insight.detections),
            candidates=None if points is None else moved(points),
            goal=placed(insight.goal),
        )

    def _is_first_start(self) -> bool:
        """Whether the start frame is that of the map."""
        assert self._T_map_start is not None, "an episode was begun"
        return np.array_equal(self._T_map_start, np.eye(4))

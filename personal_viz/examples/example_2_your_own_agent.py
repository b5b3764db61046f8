r"""An agent that explores and shows its reasons: its map, its frontiers, where it goes and why.

    personal-viz run --dataset DATA --limit 1 --rerun live \
        --agent personal_viz.examples.example_2_your_own_agent:ExplainingAgent

It walks to the nearest edge of the known floor until there is none. All places that it uses are in the start frame.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from sim.frames import wrap_angle, yaw_towards
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN, Insight
from sim.types import TURN_STEP, Action, Camera, GridSpec, Observation, Task

GRID = GridSpec(origin_xz=(-15.0, -15.0), cell=0.1, shape=(300, 300))
BLOCK = np.ones((3, 3), bool)


class ExplainingAgent:
    """Nearest-frontier exploration on a 10 cm map made from depth."""

    name = "explainer"  # of its runs and of its rows in tables

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Forgets the map."""
        self._map = np.full(GRID.shape, UNKNOWN, np.uint8)
        self._insight: Insight | None = None

    def act(self, observation: Observation) -> Action:
        """Looks around first; then turns towards the next place on the path, or steps forward when it lies ahead."""
        x, y, z = observation.T_start_camera[:3, 3]
        self._draw(observation, np.array([x, z]))
        is_free = self._map == FREE
        frontiers = is_free & grown(self._map == UNKNOWN, 1)
        here = np.zeros(GRID.shape, bool)
        here[tuple(GRID.rc_from_xz(np.array([x, z])))] = True
        walkable = is_free & (grown(here, 3) | ~grown(self._map == OCCUPIED, 2))  # it may stand close to a wall
        way = shortest_way(here, frontiers & walkable, walkable)
        goal_x, goal_z = (x, z) if way is None else GRID.xz_from_rc(way[-1]).tolist()
        reason = "no frontier can be reached" if way is None else f"nearest frontier, {len(way) / 10:.1f} m to walk"
        is_looking = observation.step < 12
        self._insight = Insight(
            grid=GRID,
            occupancy=self._map.copy(),
            frontiers=GRID.xz_from_rc(np.argwhere(frontiers)[::5]),
            goal=(goal_x, y - observation.camera.mount_height, goal_z),
            note="looking around" if is_looking else reason,
        )
        if is_looking or way is None:
            return Action.LEFT if is_looking else Action.STOP
        ahead_x, ahead_z = GRID.xz_from_rc(way[min(4, len(way) - 1)]).tolist()
        turn = wrap_angle(yaw_towards((x, z), (ahead_x, ahead_z)) - observation.compass)
        side = Action.LEFT if turn > 0 else Action.RIGHT
        return Action.FORWARD if abs(turn) <= 0.6 * TURN_STEP else side

    def insight(self) -> Insight | None:
        """The map, the goal and the reason of the last action."""
        return self._insight

    def _draw(self, observation: Observation, here: NDArray[np.float64]) -> None:
        """Draws free cells along rays, and occupied ones where they end between ankle and head, or at a collision."""
        assert observation.depth_m is not None, "this agent needs pictures"
        camera, T = observation.camera, observation.T_start_camera
        rows, cols = np.mgrid[4 : camera.height : 8, 4 : camera.width : 8]
        depth = observation.depth_m[rows, cols]
        rays = np.stack([cols - camera.width / 2, rows - camera.height / 2, np.full(rows.shape, camera.focal)], -1)
        hits = (rays / camera.focal * depth[..., None])[(depth > 0) & (depth < 5)] @ T[:3, :3].T + T[:3, 3]
        hits = hits[hits[:, 1] < T[1, 3] + 0.3]
        along = here + np.linspace(0, 0.97, 50)[:, None, None] * (hits[:, [0, 2]] - here)
        set_cells(self._map, along.reshape(-1, 2), FREE)
        set_cells(self._map, hits[hits[:, 1] > T[1, 3] - camera.mount_height + 0.15][:, [0, 2]], OCCUPIED)
        if observation.collided:
            set_cells(self._map, here + 0.3 * T[[0, 2], 2] + 0.1 * (np.argwhere(BLOCK) - 1), OCCUPIED)


def set_cells(grid: NDArray[np.uint8], xz: NDArray[np.float64], value: int) -> None:
    rc = GRID.rc_from_xz(xz)
    row, col = rc[GRID.contains(rc)].T
    grid[row, col] = np.maximum(grid[row, col], value)


def grown(cells: NDArray[np.bool_], num_cells: int) -> NDArray[np.bool_]:
    return np.asarray(binary_dilation(cells, BLOCK, iterations=num_cells), bool)


def shortest_way(start: np.ndarray, goals: np.ndarray, walkable: np.ndarray) -> NDArray[np.int64] | None:
    """Cells (K, 2) from the start to the nearest goal that can be reached; None if there is none."""
    reached = [start]
    while not (reached[-1] & goals).any():
        reached.append(reached[-1] | (grown(reached[-1], 1) & walkable))
        if (reached[-1] == reached[-2]).all():
            return None
    way = [np.argwhere(reached[-1] & goals)[0]]
    for cells in reached[-2::-1]:
        row, col = way[-1] - 1
        way.append(np.argwhere(cells[row : row + 3, col : col + 3])[0] + (row, col))
    return np.array(way[::-1])

"""Stand-ins, on our own map, for the parts of habitat_sim and habitat-lab that recordings/habitat_golden.py calls.

They prove that the script makes the right calls and writes files that check-habitat reads. The names are those of the
real library's documentation; the tests do not run the real library.
"""

import math
import shutil
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

from sim.frames import T_world_camera, forward_from_yaw, yaw_from_quat_xyzw
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.types import Camera, Pose
from sim.walk.navmesh import load_navmesh


class PathFinder:
    """Answers queries with a `.navmesh` of the golden houses."""

    def load(self, path: Path) -> bool:
        self._path, self._map = path, load_navmesh(path)
        self.nav_mesh_settings = self._map.settings
        self.navigable_area = np.float32(self._map.area)
        return True

    def load_nav_mesh(self, path: str) -> bool:
        return self.load(Path(path))

    def save_nav_mesh(self, path: str) -> bool:
        shutil.copyfile(self._path, path)
        return True

    def seed(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def get_bounds(self):
        return self.bounds

    def get_random_navigable_point(self):
        return self._map.random_point(self._rng).astype(np.float32)

    def snap_point(self, point):
        found = self._map.snap(single(point))
        return np.full(3, np.nan) if found is None else found

    def is_navigable(self, point, max_y_delta=0.5):
        return self._map.is_navigable(single(point), max_dy=max_y_delta)

    def island_radius(self, point):
        return self._map.island_radius(single(point))

    def distance_to_closest_obstacle(self, point, max_search_radius=2.0):
        return self._map.distance_to_obstacle(single(point), max_radius=max_search_radius)

    def try_step(self, start, end):
        return np.float32(self._map.step(single(start), single(end), slide=True).position)

    def try_step_no_sliding(self, start, end):
        return np.float32(self._map.step(single(start), single(end)).position)

    def find_path(self, path) -> bool:
        goals = single(path.requested_ends if hasattr(path, "requested_ends") else [path.requested_end])
        start = single(path.requested_start)
        path.geodesic_distance = float(self._map.distances(start[None], goals)[0])
        points = self._map.shortest_path(start, goals)
        path.points = [] if points is None else list(points)
        return points is not None


class Agent:
    """An agent with a position in single precision, a yaw, and the tilt of its camera."""

    def __init__(self, actions) -> None:
        self.controls = SimpleNamespace(move_filter_fn=None)
        self.actions = actions

    def set_state(self, state) -> None:
        self.position, self.tilt = single(state.position), 0.0
        assert math.isclose(np.linalg.norm(state.rotation), 1)
        self.yaw = yaw_from_quat_xyzw(tuple(state.rotation))

    def get_state(self):
        rotation = SimpleNamespace(x=0.0, y=math.sin(self.yaw / 2), z=0.0, w=math.cos(self.yaw / 2))
        return SimpleNamespace(position=self.position.copy(), rotation=rotation)

    def act(self, name: str) -> bool:
        spec = self.actions[name]
        assert spec.name == name
        amount = spec.actuation.amount
        if name != "move_forward":
            turn = math.radians(amount) * (1 if name in ("turn_left", "look_up") else -1)
            self.yaw, self.tilt = (self.yaw + turn, self.tilt) if "turn" in name else (self.yaw, self.tilt + turn)
            return False
        end = single(self.position + amount * forward_from_yaw(self.yaw))
        found = single(self.controls.move_filter_fn(self.position, end))
        moved, wanted = found - self.position, end - self.position
        self.position = found
        return bool(moved @ moved + 1e-5 < wanted @ wanted)


class Simulator:
    """One house of the golden folder."""

    def __init__(self, configuration) -> None:
        self._config, (agent,) = configuration.sim_cfg, configuration.agents
        (self._sensor,) = agent.sensor_specifications
        assert (agent.height, agent.radius) == (0.88, 0.18)
        self._scene = Path(self._config.scene_id)
        self.pathfinder = PathFinder()
        mesh = load_glb(self._scene, up="y")
        self.pathfinder.bounds = (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
        self._raycaster, self._agent = Raycaster(mesh), Agent(agent.action_space)

    def get_agent(self, index: int) -> Agent:
        assert index == 0
        return self._agent

    def recompute_navmesh(self, pathfinder, settings) -> bool:
        ending = {(0.88, 0.18): ".navmesh", (1.5, 0.1): ".default.navmesh"}[
            settings.agent_height, settings.agent_radius
        ]
        return pathfinder.load(self._scene.with_suffix(ending))

    def get_sensor_observations(self):
        height, width = self._sensor.resolution
        camera = Camera(width, height, self._sensor.hfov, mount_height=self._sensor.position[1])
        pose = Pose(tuple(self._agent.position.tolist()), self._agent.yaw, self._agent.tilt)
        frame = self._raycaster.render(T_world_camera(pose, camera), camera)
        assert self._sensor.sensor_type == "depth type"
        return {self._sensor.uuid: frame.depth_m}


def habitat_sim(*, version: str = "0.3.3", **changes) -> ModuleType:
    """The module habitat_sim; `changes` replace methods of the path finder."""

    class Changed(Simulator):
        def __init__(self, configuration) -> None:
            super().__init__(configuration)
            for name, method in changes.items():
                setattr(self.pathfinder, name, method.__get__(self.pathfinder))

    module = ModuleType("habitat_sim")
    module.__dict__.update(
        __version__=version,
        Simulator=Changed,
        SimulatorConfiguration=SimpleNamespace,
        CameraSensorSpec=SimpleNamespace,
        SensorType=SimpleNamespace(DEPTH="depth type"),
        Configuration=lambda sim_cfg, agents: SimpleNamespace(sim_cfg=sim_cfg, agents=agents),
        ShortestPath=SimpleNamespace,
        MultiGoalShortestPath=SimpleNamespace,
        nav=SimpleNamespace(NavMeshSettings=lambda: SimpleNamespace(set_defaults=lambda: None)),
        agent=SimpleNamespace(
            AgentConfiguration=lambda: SimpleNamespace(action_space={}),
            ActionSpec=lambda name, actuation: SimpleNamespace(name=name, actuation=actuation),
            ActuationSpec=lambda amount: SimpleNamespace(amount=amount),
            AgentState=lambda position, rotation: SimpleNamespace(position=position, rotation=rotation),
        ),
    )
    return module


def habitat_lab() -> dict[str, ModuleType]:
    """Modules of habitat-lab by name, whose measures have its formulas and call signatures."""
    nav, simulator = ModuleType("nav"), ModuleType("habitat_simulator")
    for kind in (DistanceToGoal, Success, SPL, SoftSPL, Collisions):
        setattr(nav, kind.__name__, kind)
    simulator.__dict__["HabitatSim"] = HabitatSim
    return {"habitat.tasks.nav.nav": nav, "habitat.sims.habitat_simulator.habitat_simulator": simulator}


class HabitatSim:
    def geodesic_distance(self, position_a, position_b, episode=None):
        path = SimpleNamespace(requested_start=position_a, requested_ends=position_b)
        self.pathfinder.find_path(path)
        return path.geodesic_distance


class Measure:
    uuid: str

    def __init__(self, sim, config) -> None:
        self._sim, self._config, self._metric = sim, config, None

    def get_metric(self):
        return self._metric

    def of(self, task, name: str) -> float:
        return task.measurements.measures[name].get_metric()


class DistanceToGoal(Measure):
    uuid = "distance_to_goal"

    def reset_metric(self, episode, task):
        self._last = None
        self.update_metric(episode, task)

    def update_metric(self, episode, task, action=None):
        here = self._sim.get_agent_state().position
        if self._last is not None and np.allclose(self._last, here, atol=1e-4):
            return
        goals = [goal.position for goal in episode.goals]
        if self._config.distance_to == "VIEW_POINTS":
            goals = [point.agent_state.position for goal in episode.goals for point in goal.view_points]
        self._last, self._metric = here, self._sim.geodesic_distance(here, goals, episode)


class Success(Measure):
    uuid = "success"

    def reset_metric(self, episode, task):
        task.measurements.check_measure_dependencies(self.uuid, ["distance_to_goal"])
        self.update_metric(episode, task)

    def update_metric(self, episode, task, action=None):
        is_near = self.of(task, "distance_to_goal") < self._config.success_distance
        self._metric = 1.0 if task.is_stop_called and is_near else 0.0


class SPL(Measure):
    uuid = "spl"

    def reset_metric(self, episode, task):
        self._last, self._path = self._sim.get_agent_state().position, 0.0
        self._start = self.of(task, "distance_to_goal")
        self.update_metric(episode, task)

    def update_metric(self, episode, task, action=None):
        here = self._sim.get_agent_state().position
        self._path, self._last = self._path + float(np.linalg.norm(here - self._last)), here
        self._metric = self.share(task) * (self._start / max(self._start, self._path))

    def share(self, task) -> float:
        return self.of(task, "success")


class SoftSPL(SPL):
    uuid = "soft_spl"

    def share(self, task) -> float:
        return max(0, 1 - self.of(task, "distance_to_goal") / self._start)


class Collisions(Measure):
    uuid = "collisions"

    def reset_metric(self, episode, task):
        self._metric = None

    def update_metric(self, episode, task, action):
        self._metric = self._metric or {"count": 0}
        self._metric["count"] += bool(self._sim.previous_step_collided)


def single(values) -> np.ndarray:
    """The values in single precision, as Habitat stores them."""
    return np.array(values, np.float32)

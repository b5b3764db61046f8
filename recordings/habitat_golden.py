"""Write the answers of YOUR Habitat on own scans. Copy this ONE file there: stdlib, numpy, habitat_sim; Python 3.8+.

    python habitat_golden.py --scene hm3d/val/00800-TEEsavR23oF/TEEsavR23oF.basis.glb --out golden --seed 0
    personal-viz check-habitat --golden golden --json > report.json      # where PersONAL Workbench is installed

The folder holds the scan and points on it: keep it where the scan's licence lets you. The report holds figures and
hashes only and may be shared. Written for habitat-sim 0.2.5 to 0.3.x from its published interface and tested with a
stand-in; NOT RUN INSIDE HABITAT BY US, please report what fails. Trajectories with measures are written when
habitat-lab can be imported too. Everything that touches Habitat is in the classes `Habitat` and `Lab`.
"""

from __future__ import annotations

import argparse
import gzip
import importlib
import json
import math
import os
import re
import shutil
import sys
from collections import Counter
from types import SimpleNamespace
from typing import Any, Sequence  # noqa: UP035 - Python 3.8

import numpy as np

ROBOT, THIN_ROBOT = (0.88, 0.18), (1.5, 0.1)  # (height, radius) in metres: ObjectNav's, and Habitat's default
FORWARD, TURN_DEG, MOUNT, WIDTH, HEIGHT, HFOV_DEG = 0.25, 30.0, 0.88, 640, 480, 79.0
ACTIONS = ("stop", "move_forward", "turn_left", "turn_right", "look_up", "look_down")
SCALE_M = 0.0002
"""Metres per unit of the stored depth; depth beyond 13.1 m is stored as 0."""
JITTER, JUMP = 2e-6, 1e-3
"""A forward is `sensitive` when moving it by JITTER metres moves its end by more than JUMP."""
NUM_PAIRS = {"on_mesh": 150, "goal_off_mesh": 60, "both_off_mesh": 30, "any_islands": 30, "other_island": 30}
NUM_STEPS = {"random": 450, "near_wall": 410, "off_mesh": 40, "wall_contact": 100}
NUM_SNAPS = {"on_mesh": 100, "near": 100, "far": 80, "wild": 20}
NUM_MULTI, NUM_POSES, NUM_EPISODES, NUM_POOL, MAX_ACTIONS = 45, 12, 24, 2000, 120
LAST_OLD_RULE = (0, 3, 3)  # the last habitat-sim that stops at the first wall; later versions have another rule
Point = list  # of three floats


class Habitat:
    """All calls of habitat_sim; plain floats come out."""

    def __init__(self, scene: str, *, seed: int) -> None:
        hs: Any = importlib.import_module("habitat_sim")
        backend, sensor, robot = hs.SimulatorConfiguration(), hs.CameraSensorSpec(), hs.agent.AgentConfiguration()
        backend.scene_id, backend.enable_physics, backend.random_seed = scene, False, seed
        sensor.uuid, sensor.sensor_type, sensor.channels = "depth", hs.SensorType.DEPTH, 1
        sensor.resolution, sensor.position, sensor.hfov = [HEIGHT, WIDTH], [0.0, MOUNT, 0.0], HFOV_DEG
        robot.height, robot.radius, robot.sensor_specifications = ROBOT[0], ROBOT[1], [sensor]
        for name in ACTIONS[1:]:
            amount = hs.agent.ActuationSpec(amount=FORWARD if name == "move_forward" else TURN_DEG)
            robot.action_space[name] = hs.agent.ActionSpec(name, amount)
        self._sim = hs.Simulator(hs.Configuration(backend, [robot]))
        self._agent = self._sim.get_agent(0)
        self._agent.controls.move_filter_fn = self._filter
        self._hs, self._slide, self._seed = hs, False, seed
        self.asked = ([0.0] * 3, [0.0] * 3)  # (start, end) that the last forward passed to the step filter
        self.pathfinder, self.version = self._sim.pathfinder, str(hs.__version__)

    def use_navmesh(self, height: float, radius: float, path: str | None = None) -> None:
        """Builds the navmesh of a robot, or loads a file."""
        settings, finder = self._hs.nav.NavMeshSettings(), self.pathfinder
        settings.set_defaults()
        settings.agent_height, settings.agent_radius = height, radius
        if not (finder.load_nav_mesh(path) if path else self._sim.recompute_navmesh(finder, settings)):
            raise SystemExit(f"habitat_golden: Habitat made no navmesh of {path!r}; check --scene and --navmesh.")
        finder.seed(self._seed)

    def navmesh_info(self) -> dict[str, Any]:
        finder, used = self.pathfinder, self.pathfinder.nav_mesh_settings
        values = {name: getattr(used, name) for name in dir(used) if not name.startswith("_")}
        settings = {name: value for name, value in values.items() if isinstance(value, (bool, int, float))}
        bounds = [_floats(corner) for corner in finder.get_bounds()]
        return {"navigable_area": float(finder.navigable_area), "bounds": bounds, "settings": settings}

    def random_points(self, count: int) -> list[Point]:
        points = [_floats(self.pathfinder.get_random_navigable_point()) for _ in range(count)]
        return [point for point in points if all(map(math.isfinite, point))]

    def facts(self, point: Point) -> dict[str, Any]:
        """Everything that Habitat reports about one point; an island is known by its radius, 0 = on no island."""
        finder, at = self.pathfinder, _vector(point)
        snap = _floats(finder.snap_point(at))
        return {
            "snap": snap if all(map(math.isfinite, snap)) else None,
            "is_navigable": bool(finder.is_navigable(at, 0.5)),
            "is_navigable_dy_0_1": bool(finder.is_navigable(at, 0.1)),
            "island_radius": float(finder.island_radius(at)),
            "distance_to_obstacle": _finite(finder.distance_to_closest_obstacle(at, 2.0)),
        }

    def way(self, start: Point, goal: Point) -> tuple[float | None, list]:
        """(metres or None, corners)."""
        path = self._hs.ShortestPath()
        path.requested_start, path.requested_end = _vector(start), _vector(goal)
        found = self.pathfinder.find_path(path)
        return (_finite(path.geodesic_distance) if found else None), [_floats(corner) for corner in path.points]

    def distance_to_any(self, start: Point, goals: Sequence[Point]) -> float | None:
        path = self._hs.MultiGoalShortestPath()
        path.requested_start, path.requested_ends = _vector(start), _vector(goals)
        return _finite(path.geodesic_distance) if self.pathfinder.find_path(path) else None

    def place(self, position: Point, yaw: float) -> None:
        turn = np.array([0.0, math.sin(yaw / 2), 0.0, math.cos(yaw / 2)])
        self._agent.set_state(self._hs.agent.AgentState(position=_vector(position), rotation=turn))

    def act(self, action: str, *, slide: bool = False) -> bool:
        """Takes one action; returns whether it collided."""
        self._slide = slide
        return bool(self._agent.act(action))

    def pose(self) -> list[float]:
        """x, y, z, qx, qy, qz, qw of the body."""
        state = self._agent.get_state()
        turn = state.rotation
        return [*_floats(state.position), float(turn.x), float(turn.y), float(turn.z), float(turn.w)]

    def depth(self) -> np.ndarray:
        return np.array(self._sim.get_sensor_observations()["depth"], np.float64).reshape(HEIGHT, WIDTH)

    def stepped(self, start: Any, end: Any, *, slide: bool) -> Any:
        """The place where the step filter lets a forward end."""
        return (self.pathfinder.try_step if slide else self.pathfinder.try_step_no_sliding)(start, end)

    def _filter(self, start: Any, end: Any) -> Any:
        self.asked = (_floats(start), _floats(end))
        return self.stepped(start, end, slide=self._slide)


class Lab:
    """habitat-lab's own measure classes, fed with given trajectories; no environment, no configuration files."""

    def __init__(self, pathfinder: Any) -> None:
        nav = importlib.import_module("habitat.tasks.nav.nav")
        simulator = importlib.import_module("habitat.sims.habitat_simulator.habitat_simulator")
        self._kinds = (nav.DistanceToGoal, nav.Success, nav.SPL, nav.SoftSPL, nav.Collisions)
        self._sim = sim = SimpleNamespace(pathfinder=pathfinder, previous_step_collided=False, position=[0.0] * 3)
        sim.get_agent_state = lambda *_: SimpleNamespace(position=_vector(sim.position))
        geodesic = simulator.HabitatSim.geodesic_distance
        sim.geodesic_distance = lambda a, b, episode=None: geodesic(sim, a, b, episode)

    def measured(self, row: dict[str, Any]) -> dict[str, Any]:
        """The measures at the end and, for the distance, after each action."""
        new, goals = SimpleNamespace, []
        for goal in row["goals"]:
            points = [new(agent_state=new(position=point)) for point in goal["view_points"]]
            goals.append(new(position=goal["position"], view_points=points))
        episode, config = new(goals=goals, _shortest_path_cache=None), new(**row["settings"])
        made = [kind(sim=self._sim, config=config) for kind in self._kinds]
        measures = {measure.uuid: measure for measure in made}
        holder = new(measures=measures, check_measure_dependencies=lambda *_: None)
        task = new(measurements=holder, is_stop_called=False)
        self._sim.position, self._sim.previous_step_collided = row["trajectory"][0][:3], False
        for measure in made:
            measure.reset_metric(episode=episode, task=task)
        distances = [float(made[0].get_metric())]
        for index, action in enumerate(row["actions"]):
            self._sim.position = row["trajectory"][index + 1][:3]
            self._sim.previous_step_collided, task.is_stop_called = row["collided"][index], action == 0
            for measure in made:
                measure.update_metric(episode=episode, task=task, action={"action": ACTIONS[action]})
            distances.append(float(made[0].get_metric()))
        final = {n: float(measures[n].get_metric()) for n in ("distance_to_goal", "success", "spl", "soft_spl")}
        count = int((measures["collisions"].get_metric() or {"count": 0})["count"])
        finite = {name: _finite(value) for name, value in final.items()}
        return {
            "measures": {**finite, "num_steps": len(row["actions"]), "collisions": count},
            "nonfinite": {n: "nan" if math.isnan(final[n]) else "inf" for n, v in finite.items() if v is None},
            "distance_after_step": [_finite(distance) for distance in distances],
        }


class Pool:
    """Random places on one navmesh: all of them, those on the largest island, and the others."""

    def __init__(self, habitat: Habitat, rng: np.random.Generator) -> None:
        facts = [(point, habitat.facts(point)) for point in habitat.random_points(NUM_POOL)]
        if not facts:
            raise SystemExit("habitat_golden: Habitat found no place to stand on the navmesh; check --scene.")
        main = Counter(round(fact["island_radius"], 4) for _, fact in facts).most_common(1)[0][0]
        self.all = [point for point, _ in facts]
        self.main = [point for point, fact in facts if round(fact["island_radius"], 4) == main]
        self.others = [point for point, fact in facts if round(fact["island_radius"], 4) != main]
        self.near_walls = [p for p, fact in facts if (fact["distance_to_obstacle"] or 0.0) < 0.3] or self.all
        self._rng = rng

    def draw(self, among: Sequence[Point]) -> Point:
        return list(among[int(self._rng.integers(len(among)))])

    def moved(self, point: Point, sideways: float, up: float) -> Point:
        """The point moved at random by at most these distances, metres."""
        reach = np.array([sideways, up, sideways])
        return _floats(np.asarray(point) + self._rng.uniform(-reach, reach))


def geodesic_rows(habitat: Habitat, pool: Pool, navmesh: str, share: float) -> tuple[list, list]:
    """Pairs of points, and queries with several goals; as many as `share` of NUM_PAIRS and NUM_MULTI."""
    pairs, multi = [], []
    for kind, count in NUM_PAIRS.items():
        starts = pool.all if kind == "any_islands" else pool.main
        goals = pool.others if kind == "other_island" else starts
        for _ in range(round(count * share) if goals else 0):
            start, goal = pool.draw(starts), pool.draw(goals)
            start = pool.moved(start, 0.5, 0.5) if kind == "both_off_mesh" else start
            goal = pool.moved(goal, 1.0, 1.0) if kind.endswith("off_mesh") else goal
            distance, path = habitat.way(start, goal)
            row = {"navmesh": navmesh, "kind": kind, "start": start, "goal": goal, "distance": distance, "path": path}
            pairs.append({**row, "reverse_distance": habitat.way(goal, start)[0]})
    for index in range(round(NUM_MULTI * share)):
        start, goals = pool.draw(pool.main), [pool.draw(pool.all) for _ in range(2 + index % 12)]
        distance = habitat.distance_to_any(start, goals)
        multi.append({"navmesh": navmesh, "kind": "any_islands", "start": start, "goals": goals, "distance": distance})
    return pairs, multi


def step_rows(habitat: Habitat, pool: Pool, rng: np.random.Generator, old_rule: bool) -> list:
    """Single forwards under the simulator's two rules."""
    rows: list = []
    for kind, count in NUM_STEPS.items():
        for _ in range(count):
            start, yaw = pool.draw(pool.near_walls if "wall" in kind else pool.all), float(rng.uniform(-3.14, 3.14))
            if kind == "off_mesh":
                start = pool.moved(start, 0.4, 0.3)
            if kind == "wall_contact":  # starts where two forwards ended
                habitat.place(start, yaw)
                habitat.act("move_forward")
                habitat.act("move_forward")
                start, yaw = habitat.pose()[:3], yaw + float(rng.uniform(-0.5, 0.5))
            row: dict[str, Any] = {"kind": kind, "start": start, "yaw": yaw, "sensitive": False}
            for name, slide in (("no_slide_le_0_3_3" if old_rule else "no_slide_ge_0_3_4", False), ("slide", True)):
                habitat.place(start, yaw)
                collided = habitat.act("move_forward", slide=slide)
                row[name] = {"position": habitat.pose()[:3], "collided": collided}
                row["start_used"], row["requested_end"] = habitat.asked
                row["sensitive"] = row["sensitive"] or is_sensitive(habitat, *habitat.asked, slide=slide)
            rows.append(row)
    return rows


def is_sensitive(habitat: Habitat, start: Point, end: Point, *, slide: bool) -> bool:
    """Whether JITTER, on both ends or only on the wanted end, moves the answer by more than JUMP."""
    answer = np.array(_floats(habitat.stepped(_vector(start), _vector(end), slide=slide)))
    for x, z in ((JITTER, 0.0), (-JITTER, 0.0), (0.0, JITTER), (0.0, -JITTER)):
        shift = np.array([x, 0.0, z])
        for first in (shift, 0 * shift):
            moved = habitat.stepped(_vector(start + first), _vector(end + shift), slide=slide)
            if np.linalg.norm(_floats(moved) - answer) > JUMP:
                return True
    return False


def snap_rows(habitat: Habitat, pool: Pool) -> list:
    """Points on, near, far from and wildly off the mesh."""
    reach = {"on_mesh": (0.0, 0.0), "near": (0.4, 0.3), "far": (3.0, 2.0), "wild": (60.0, 30.0)}
    points = [(kind, pool.moved(pool.draw(pool.all), *reach[kind])) for kind, n in NUM_SNAPS.items() for _ in range(n)]
    return [{"kind": kind, "point": point, **habitat.facts(point)} for kind, point in points]


def pose_rows(habitat: Habitat, pool: Pool, rng: np.random.Generator) -> tuple[list, np.ndarray]:
    """Poses, a third of them tilted, and the depth camera's picture at each."""
    rows, images = [], []
    for index in range(NUM_POSES):
        position, yaw, tilt = pool.draw(pool.main), float(rng.uniform(-3.14, 3.14)), (0, 0, 0, 0, 1, -1)[index % 6]
        habitat.place(position, yaw)
        if tilt:
            habitat.act("look_up" if tilt > 0 else "look_down")
        units = np.round(habitat.depth() / SCALE_M)
        images.append(np.where(units <= 65535, units, 0).astype(np.uint16))
        rows.append({"index": index, "body_position": position, "yaw": yaw, "tilt_deg": tilt * TURN_DEG})
    return rows, np.stack(images)


def episode_rows(habitat: Habitat, lab: Lab, pool: Pool, rng: np.random.Generator, old_rule: bool) -> list:
    """Trajectories with measures: two thirds by a follower with errors, one third at random; one to another island."""
    rows: list = []
    for index in range(NUM_EPISODES):
        among = pool.others if index == 1 and pool.others else pool.main
        points = [[pool.draw(among) for _ in range(3)] for _ in range(1 + index % 3)]
        slide = index % 4 == 2 or not old_rule
        settings = {
            "distance_to": "POINT" if index % 4 == 3 else "VIEW_POINTS",
            "success_distance": (0.1, 1.0)[index % 2],
        }
        row: dict[str, Any] = {"id": index, "kind": "noisy_follower" if index % 3 else "random"}
        row["settings"] = {**settings, "rule": "slide" if slide else "no_slide_le_0_3_3"}
        row["goals"] = [{"position": pool.moved(some[0], 0.5, 0.5), "view_points": some} for some in points]
        habitat.place(pool.draw(pool.main), float(rng.uniform(-3.14, 3.14)))
        row.update(walk(habitat, row, rng, slide=slide))
        try:
            rows.append({**row, **lab.measured(row)})
        except ZeroDivisionError:  # the start lies on the goal: habitat-lab gives no measures
            continue
    return rows


def walk(habitat: Habitat, row: dict[str, Any], rng: np.random.Generator, *, slide: bool) -> dict[str, Any]:
    """Actions and poses until STOP or MAX_ACTIONS; the follower takes one action in eight at random."""
    points = [point for goal in row["goals"] for point in goal["view_points"]]
    if row["settings"]["distance_to"] == "POINT":
        points = [goal["position"] for goal in row["goals"]]
    poses, actions, flags = [habitat.pose()], [], []
    while len(actions) < MAX_ACTIONS and actions[-1:] != [0]:
        action = int(rng.integers(1, 6)) if rng.random() > 0.02 else 0
        if row["kind"] == "noisy_follower" and rng.random() > 0.125:
            action = _towards(habitat, poses[-1], points, 0.9 * row["settings"]["success_distance"])
        flags.append(habitat.act(ACTIONS[action], slide=slide) if action else False)
        actions.append(action)
        poses.append(habitat.pose())
    return {"actions": actions, "trajectory": poses, "collided": flags}


def _towards(habitat: Habitat, pose: Sequence[float], points: Sequence[Point], near: float) -> int:
    """The follower's next action: STOP when near, or when there is no way."""
    ways = [habitat.way(list(pose[:3]), point) for point in points]
    distance, path = min(ways, key=lambda way: math.inf if way[0] is None else way[0])
    if distance is None or distance < near:
        return 0
    ahead = next((corner for corner in path[1:] if math.dist(corner[::2], pose[:3:2]) > 0.05), path[-1])
    yaw = 2 * math.atan2(pose[4], pose[6])
    turn = math.remainder(math.atan2(pose[0] - ahead[0], pose[2] - ahead[2]) - yaw, 2 * math.pi)
    return 1 if abs(turn) < math.radians(TURN_DEG / 2) else 2 if turn > 0 else 3


def write_house(habitat: Habitat, scene: str, *, out: str, seed: int, navmesh: str | None, rule: str) -> str:
    """Runs all queries and writes the files of one house; returns its name."""
    name = os.path.basename(scene).split(".")[0]
    rng, files, info, pairs, multi = np.random.default_rng(seed), {}, {}, [], []
    main, thin = f"{name}.navmesh", f"{name}.default.navmesh"
    for file, robot, path, share in ((thin, THIN_ROBOT, None, 1 / 3), (main, ROBOT, navmesh, 1.0)):
        habitat.use_navmesh(*robot, path=path)
        habitat.pathfinder.save_nav_mesh(os.path.join(out, file))
        info[file], pool = habitat.navmesh_info(), Pool(habitat, rng)
        more = geodesic_rows(habitat, pool, file, share)
        pairs, multi = pairs + more[0], multi + more[1]
    version = tuple(int(part) for part in re.findall(r"\d+", habitat.version)[:3])
    old_rule = rule == "le_0_3_3" or (rule == "auto" and version <= LAST_OLD_RULE)
    poses, images = pose_rows(habitat, pool, rng)
    files["poses.json"] = {"width": WIDTH, "height": HEIGHT, "hfov_deg": HFOV_DEG, "sensor_offset": [0.0, MOUNT, 0.0]}
    files["poses.json"]["poses"] = poses
    files["geodesic.json.gz"] = {"pairs": pairs, "multi_goal": multi}
    files["steps.json.gz"] = {"navmesh": main, "forward": FORWARD, "steps": step_rows(habitat, pool, rng, old_rule)}
    files["snap.json"] = {"navmesh": main, "obstacle_max_radius": 2.0, "queries": snap_rows(habitat, pool)}
    try:
        rows = episode_rows(habitat, Lab(habitat.pathfinder), pool, rng, old_rule)
        files["episodes.json.gz"] = {"navmesh": main, "episodes": rows}
    except ImportError as error:
        print(f"habitat_golden: no trajectories with measures, habitat-lab is missing: {error}", file=sys.stderr)
    files["info.json"] = {"made_with": f"habitat-sim {habitat.version}", "seed": seed, "navmeshes": info}
    shutil.copyfile(scene, os.path.join(out, name + (".basis.glb" if scene.endswith(".basis.glb") else ".glb")))
    np.savez_compressed(os.path.join(out, f"{name}.depth.npz"), depth_u16=images, scale_m=SCALE_M)
    for ending, content in files.items():  # info.json last: without it there is no house
        _write_json(os.path.join(out, f"{name}.{ending}"), {"house": name, **content})
    return name


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Write the answers of your Habitat for personal-viz check-habitat.")
    parser.add_argument("--scene", required=True, help="scan, a .glb file that Habitat can open")
    parser.add_argument("--navmesh", help="use this file instead of building one for ObjectNav's robot")
    parser.add_argument("--out", required=True, help="folder; further scenes may be added to it")
    parser.add_argument("--seed", type=int, default=0)
    rules = {"choices": ("auto", "le_0_3_3", "ge_0_3_4"), "default": "auto"}
    parser.add_argument("--no-sliding-rule", help="auto = by habitat-sim's version", **rules)
    given = parser.parse_args(arguments)
    if not (given.scene.endswith(".glb") and os.path.isfile(given.scene)):
        parser.error(f"--scene is {given.scene!r}; expected an existing .glb file")
    os.makedirs(given.out, exist_ok=True)
    habitat, rule = Habitat(given.scene, seed=given.seed), given.no_sliding_rule
    name = write_house(habitat, given.scene, out=given.out, seed=given.seed, navmesh=given.navmesh, rule=rule)
    print(f"wrote {name} into {given.out}")


def _vector(values: Any) -> np.ndarray:
    return np.array(values, np.float32)


def _floats(values: Any) -> list[float]:
    """Plain floats rounded to single precision, in which Habitat computes."""
    return [float(value) for value in _vector(values)]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _write_json(path: str, content: dict[str, Any]) -> None:
    data = json.dumps(content, allow_nan=False).encode("utf-8")
    with open(f"{path}.part", "wb") as file:
        file.write(gzip.compress(data) if path.endswith(".gz") else data)
    os.replace(f"{path}.part", path)


if __name__ == "__main__":
    main()

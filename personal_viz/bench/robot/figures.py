"""Measures what `map` finds in recordings: which way is up, the floor, free floor and edges, on simulated walks.

Walks -> `find_up` in frames turned at random -> `floors_of_frames` -> maps -> shares beside the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.spatial.transform import Rotation

from grounding.maps.occupancy import OccupancyMapper, measured
from grounding.maps.storeys import floors_of_frames
from grounding.robot.upright import T_map_recording, find_up
from sim.errors import PersonalVizError, SceneError
from sim.types import Frame

from ..harness import Findings, Plan, Progress, Target
from .free_floor import MapScore, TrueFloor, cells_seen, map_score
from .things import FAULTS, ThingsSettings, measure_things
from .walks import NEAREST, WAYS, Walk, handheld_walk

PLAN = Plan(
    targets={
        "up.within_2_deg": Target(0.95, at_least=True),
        "up.wrong": Target(0.0),
        "floor.within_3_cm": Target(0.95, at_least=True),
        "floor.free_recall": Target(0.9, at_least=True),
        "floor.edge_p95_cm": Target(10.0),
        **{f"things.{level}.things_per_object": Target(1.5) for level in FAULTS},
        **{f"things.{level}.found_share": Target(0.8, at_least=True) for level in FAULTS},
        **{f"ways.{way}.wrong": Target(0.0) for way in (*WAYS, "short") if way != "handheld"},
    },
    units={"edge_p95_cm": "cm", "error_p95_cm": "cm", "error_p95_deg": "deg"},
)
"""Targets of issue 18, section 2; the share that is found in other ways of carrying has none."""
_RIGHT_DEG, _NEAR = 2.0, 0.03
_SHORT = 60
"""Number of frames of a short recording."""


class RobotSettings(BaseModel):
    """Numbers of walks."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    seeds: int = 40
    """Handheld walks, in the invented homes of seeds 0, 1, ..."""
    rotations: int = 5
    """Random turns of each walk's frame."""
    num_frames: int = 300
    looked_at: int = 50
    """Frames, spread over the walk, from which up and the floor are found."""
    other_seeds: int = 10
    """Walks carried in each other way."""
    other_rotations: int = 2


FULL = RobotSettings()
QUICK = RobotSettings(seeds=2, rotations=2, num_frames=100, other_seeds=1, other_rotations=1)


class _Ups(NamedTuple):
    """Answers of `find_up`: degrees off, nan = refused."""

    off_deg: NDArray[np.float64]

    @property
    def values(self) -> dict[str, float | None]:
        """Figures of these answers."""
        found = self.off_deg[~np.isnan(self.off_deg)]
        return {
            "asked": len(self.off_deg),
            "within_2_deg": float((self.off_deg <= _RIGHT_DEG).mean()),
            "refused": float(np.isnan(self.off_deg).mean()),
            "wrong": float((self.off_deg > _RIGHT_DEG).mean()),
            "error_p95_deg": float(np.quantile(found, 0.95)) if len(found) else None,
        }


@dataclass(frozen=True, slots=True)
class _Recording:
    """A walk's pictures, or some of them."""

    walk: Walk
    some: list[Frame]
    """The frames that are looked at for up and the floor."""

    @classmethod
    def of(cls, walk: Walk, count: int) -> "_Recording":
        chosen = np.unique(np.linspace(0, len(walk.Ts_world_camera) - 1, count).round().astype(int))
        return cls(walk, list(replace(walk, Ts_world_camera=walk.Ts_world_camera[chosen]).frames()))

    def ups(self, rotations: int) -> _Ups:
        """Up in frames that are turned at random."""
        rng = np.random.default_rng([self.walk.seed, 2])
        return _Ups(np.array([_off_deg(self.some, R) for R in Rotation.random(rotations, rng=rng).as_matrix()]))

    def floor_error(self) -> float:
        """Metres between the floor that is found after finding up, and the true one below the carrier; inf = none."""
        try:
            up = find_up(self.some).up
            T = T_map_recording(up)
            floors = np.array(floors_of_frames([_moved(frame, T) for frame in self.some]))
        except PersonalVizError:
            return np.inf
        below = np.mean([frame.T_world_camera[:3, 3] for frame in self.some], axis=0)
        below[1] = self.walk.floor_y
        off = floors - (T[:3, :3] @ below)[1]
        return float(off[np.abs(off).argmin()])


def measure(settings: RobotSettings, progress: Progress) -> Findings:
    """Measures everything in one run.

    Args:
        settings: Numbers of walks.
        progress: Gets a line about the current work.

    Returns:
        Values: `up`, shares of answers in turned frames of handheld walks: within 2 degrees, refused, wrong. `floor`:
        share of those walks whose floor is within 3 cm; share of the truly free cells, whose floor the walk showed,
        that the map calls free, and of the worst walk; 95th percentile of the distance (cm) from the map's blocked
        cells beside free ones to the nearest true edge. `ways`: as `up`, for other ways of carrying. `things`: those of
        `measure_things`.
    """
    ups, floors, scores = [], [], []
    for seed in range(settings.seeds):
        progress(f"handheld walk {seed + 1} of {settings.seeds}")
        walk = handheld_walk(seed, num_frames=settings.num_frames)
        recording = _Recording.of(walk, settings.looked_at)
        ups.append(recording.ups(settings.rotations).off_deg)
        floors.append(recording.floor_error())
        scores.append(_mapped(walk, floors[-1] if np.isfinite(floors[-1]) else 0.0))
    other_ways = [way for way in (*WAYS, "short") if way != "handheld" and settings.other_seeds]
    ways = {way: _way(way, settings, progress) for way in other_ways}
    note = (
        f"{settings.seeds} handheld walks of {settings.num_frames} frames in invented homes (seeds from 0), each in "
        f"{settings.rotations} frames turned at random; up and floor from {settings.looked_at} frames. Other ways: "
        f"{settings.other_seeds} walks, {settings.other_rotations} turns; short has {_SHORT} frames."
    )
    things = measure_things(ThingsSettings(seeds=tuple(range(settings.seeds)), frames=settings.num_frames), progress)
    up = _Ups(np.concatenate(ups)).values
    return Findings({"up": up, "floor": _floor(floors, scores), "ways": ways, "things": things}, [note])


def _way(way: str, settings: RobotSettings, progress: Progress) -> dict[str, float | None]:
    """Up in walks that are carried in another way; homes where nobody can be carried so are left out."""
    ups = []
    for seed in range(settings.other_seeds):
        progress(f"{way} walk {seed + 1} of {settings.other_seeds}")
        num_frames = _SHORT if way == "short" else settings.num_frames
        try:
            walk = handheld_walk(seed, num_frames=num_frames, carrying=WAYS[way if way in WAYS else "handheld"])
        except SceneError:
            continue
        ups.append(_Recording.of(walk, settings.looked_at).ups(settings.other_rotations).off_deg)
    return _Ups(np.concatenate(ups)).values


def _mapped(walk: Walk, floor_error: float) -> MapScore:
    """The map of a walk beside the truth."""
    x, _, z = np.floor(walk.Ts_world_camera[:, :3, 3].mean(axis=0))
    mapper = OccupancyMapper(centre_xz=(x, z), floor_y=walk.floor_y + floor_error)
    seen = []
    for true, sensed in walk.pairs():
        seen.append(cells_seen(true, mapper.grid, walk.floor_y, nearest=NEAREST))
        mapper.add(measured(sensed.depth_m), sensed.T_world_camera, sensed.camera)
    return map_score(mapper.cells, mapper.grid, seen, TrueFloor.of(walk.scene, walk.floor_y))


def _floor(errors: Sequence[float], scores: Sequence[MapScore]) -> dict[str, float | None]:
    edges = np.concatenate([score.edges for score in scores])
    found = np.abs([error for error in errors if np.isfinite(error)])
    return {
        "walks": len(errors),
        "within_3_cm": float((np.abs(errors) <= _NEAR).mean()),
        "error_p95_cm": 100 * float(np.quantile(found, 0.95)) if len(found) else None,
        "free_recall": sum(score.num_recalled for score in scores) / sum(score.num_free for score in scores),
        "free_recall_worst": min(score.num_recalled / max(score.num_free, 1) for score in scores),
        "edge_p95_cm": 100 * float(np.quantile(edges, 0.95)),
        "edge_median_cm": 100 * float(np.median(edges)),
    }


def _off_deg(frames: Sequence[Frame], R: NDArray[np.float64]) -> float:
    """Degrees between up as found in frames turned by R (3, 3) and the true one; nan = refused."""
    T = np.eye(4)
    T[:3, :3] = R
    try:
        found = find_up([_moved(frame, T) for frame in frames])
    except SceneError:
        return np.nan
    return float(np.degrees(np.arccos(np.clip(found.up @ R[:, 1], -1.0, 1.0))))


def _moved(frame: Frame, T: NDArray[np.float64]) -> Frame:
    """The frame in another frame of poses, which T (4, 4) turns it into."""
    return replace(frame, T_world_camera=T @ frame.T_world_camera)

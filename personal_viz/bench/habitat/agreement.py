"""Computes how closely navigation, depth and measures agree with a real Habitat's answers in a golden folder."""

import hashlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..harness import Target
from .compare import DEPTH_BINS, STEP_CLOSE, Samples, merged, samples_of
from .golden import read_houses

TARGETS: dict[str, Target] = {
    "geodesic_within_1e-4": Target(0.995, at_least=True),
    "reachability": Target(1.0, at_least=True),
    "steps_within_1mm": Target(0.995, at_least=True),
    "snap": Target(0.995, at_least=True),
    "navigable": Target(0.995, at_least=True),
    "grid_mean_rel_error": Target(0.01),
    "grid_reachability": Target(0.99, at_least=True),
    "grid_area_rel_error": Target(0.01),
    "depth_median_mm": Target(0.1),
    "depth_within_1mm": Target(0.999, at_least=True),
    "measures_max_abs_error": Target(1e-5),
}
"""Targets of issue 3, by JSON key."""


class Rows(BaseModel):
    """Number of rows behind each figure."""

    model_config = ConfigDict(frozen=True)
    geodesic: int
    reachability: int
    """Pairs in both directions and queries with several goals, reachable or not."""
    steps: int
    sensitive: int
    """Forwards left out because two micrometres decide their result."""
    snap: int
    grid: int
    grid_off_mesh: int
    depth_pixels: int
    episodes: int


class Further(BaseModel):
    """More figures; shares 0-1, None = nothing to compare."""

    model_config = ConfigDict(frozen=True)
    reverse_within_1e_4: float | None = Field(serialization_alias="reverse_within_1e-4")
    multi_goal_within_1e_4: float | None = Field(serialization_alias="multi_goal_within_1e-4")
    step_flags: float | None
    """Share of forwards with the same `collided`."""
    slide_steps_within_1mm: float | None
    slide_flags: float | None
    navigable_dy_0_1: float | None
    island_radius: float | None
    obstacle_distance: float | None
    grid_mean_signed_rel_error: float | None
    """Positive = our paths are longer."""
    grid_off_mesh_mean_rel_error: float | None
    """Pairs with an end off the navmesh, where Detour counts heights above the floor."""
    grid_off_mesh_reachability: float | None
    depth_same_holes: float | None
    """Share of pixels where both see something, or neither does."""
    success_exact: float | None
    num_steps_exact: float | None
    collisions_exact: float | None
    nonfinite_exact: float | None
    """Share of distance_to_goal, spl and soft_spl that are both finite, both inf or both nan."""
    distance_after_step_within_1e_4: float | None = Field(serialization_alias="distance_after_step_within_1e-4")


class Figures(BaseModel):
    """The figures of issue 3; shares 0-1, None = nothing to compare."""

    model_config = ConfigDict(frozen=True)
    geodesic_within_1e_4: float | None = Field(serialization_alias="geodesic_within_1e-4")
    """Share of pairs whose distance differs by at most 1e-4 m, over the pairs for which Habitat finds a path."""
    reachability: float | None
    """Share of queries for which both find a path, or neither does."""
    steps_within_1mm: float | None
    """Share of forwards under the old no-sliding rule, without sensitive ones."""
    snap: float | None
    navigable: float | None
    grid_mean_rel_error: float | None
    """Mean of |ours / Habitat's - 1| over pairs on the mesh, the grid made from the mesh file alone."""
    grid_reachability: float | None
    grid_area_rel_error: float | None
    """Largest relative error over houses and robots."""
    depth_median_mm: float | None
    """Median over pixels where both see something."""
    depth_within_1mm: float | None
    """Share of the pixels where at least one sees something; a pixel that only one sees counts as disagreement."""
    measures_max_abs_error: float | None
    """Largest error of distance_to_goal, spl and soft_spl. None if nothing is compared, or if a value is finite, inf or
    nan on one side only (`further.nonfinite_exact` below 1); `targets_met` is False in that last case."""
    further: Further
    rows: Rows


class HouseFigures(Figures):
    """Figures of one house."""

    house: str
    missing: tuple[str, ...]
    """Parts that are not in the folder; their figures are None."""


class Agreement(Figures):
    """Figures of all rows of all houses together, with the facts needed to trust them. Holds no geometry."""

    missing: tuple[str, ...]
    houses: tuple[HouseFigures, ...]
    made_with: tuple[str, ...]
    """Habitat's versions, as the folder states them."""
    compared_with: str
    files: dict[str, str]
    """sha256 of every file that was read, by name."""


def agreement(golden: Path, *, on_house: Callable[[str], None] = lambda name: None) -> Agreement:
    """Compares everything that a folder of Habitat's answers holds.

    Args:
        golden: Layout of recordings/habitat_golden.py; houses are its `*.info.json`.
        on_house: Called with the name of each house before its comparison, which takes some seconds.

    Raises:
        SceneError: The folder is missing or empty, or a file in it is damaged or contradicts another one.
    """
    houses = read_houses(golden)
    samples, reports = [], []
    for house in houses:
        on_house(house.name)
        found, missing = samples_of(house)
        samples.append(found)
        reports.append(HouseFigures(house=house.name, missing=tuple(missing), **_figures(found)))
    names = {house.name for house in houses}
    return Agreement(
        missing=tuple(name for report in reports for name in report.missing),
        houses=tuple(reports),
        made_with=tuple(dict.fromkeys(house.info.made_with for house in houses if house.info.made_with)),
        compared_with=f"personal-viz {version('personal-viz')}",
        files={
            path.name: _sha256(path)
            for path in sorted(golden.iterdir())
            if path.is_file() and path.name.split(".")[0] in names
        },
        **_figures(merged(samples)),
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def targets_met(figures: Figures) -> dict[str, bool | None]:
    """By JSON key: whether the target is met; None = nothing was compared.

    The target of the measures also requires exact success, steps and collisions, and the same values that are not
    finite.
    """
    values = figures.model_dump(by_alias=True)
    met = {key: None if values[key] is None else target.is_met_by(values[key]) for key, target in TARGETS.items()}
    further = figures.further
    exact = (further.success_exact, further.num_steps_exact, further.collisions_exact, further.nonfinite_exact)
    if any(share is not None and share < 1 for share in exact):
        met["measures_max_abs_error"] = False
    return met


def _figures(samples: Samples) -> dict[str, Any]:
    """The fields of `Figures`: those named like a sample are its mean."""
    bins = samples.get("depth_bins", np.zeros(DEPTH_BINS, np.int64))
    num_single = int(samples.get("depth_single", np.zeros(1, np.int64)).sum())
    num_both = int(bins.sum())
    num_pixels = num_both + num_single
    num_close = int(bins[: round(STEP_CLOSE * 1e6)].sum())
    errors, areas = samples.get("measures", np.zeros(0)), samples.get("grid_area", np.zeros(0))
    own = {
        "grid_mean_rel_error": _mean(samples, "grid", absolute=True),
        "grid_area_rel_error": float(areas.max()) if len(areas) else None,
        "depth_median_mm": int(np.searchsorted(np.cumsum(bins), num_both / 2)) / 1000 if num_both else None,
        "depth_within_1mm": num_close / num_pixels if num_pixels else None,
        "measures_max_abs_error": float(errors.max()) if len(errors) and np.isfinite(errors).all() else None,
        "grid_mean_signed_rel_error": _mean(samples, "grid"),
        "grid_off_mesh_mean_rel_error": _mean(samples, "grid_off_mesh", absolute=True),
        "depth_same_holes": num_both / num_pixels if num_pixels else None,
    }
    counts = {name: len(samples.get(name, ())) for name in ("reachability", "snap", "grid", "grid_off_mesh")}
    rows = Rows(
        **counts,
        geodesic=len(samples.get("geodesic_within_1e_4", ())),
        steps=len(samples.get("steps_within_1mm", ())),
        sensitive=int(samples.get("sensitive", np.zeros(0)).sum()),
        depth_pixels=num_pixels,
        episodes=len(samples.get("success_exact", ())),
    )

    def fields(model: type[BaseModel]) -> dict[str, float | None]:
        names = model.model_fields.keys() - {"further", "rows"}
        return {name: own[name] if name in own else _mean(samples, name) for name in names}

    return {**fields(Figures), "further": Further(**fields(Further)), "rows": rows}


def _mean(samples: Samples, name: str, *, absolute: bool = False) -> float | None:
    values = samples.get(name)
    if values is None or not len(values):
        return None
    return float(np.mean(np.abs(values) if absolute else values))

"""The arrays of one storey of a map file, and the storey made of them, with every shape and number checked."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError
from sim.tasks.observers import OCCUPIED

from ..types import FeatureMap
from .header import MapHeader, StoreyHeader
from .home_map import ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory

_UNIT_TOLERANCE = 1e-4
_AGAIN = "The file is damaged: build the map again."


@dataclass(frozen=True, slots=True)
class MapArrays:
    """Reads the arrays of one storey."""

    file: str
    """Name of the file, for errors."""
    folder: str
    """`storey0`."""
    read: Callable[[str], NDArray[Any]]
    """Reads the array with this name from the file; raises RunFileError."""

    def array(self, name: str, dtype: type, shape: tuple[int | None, ...]) -> NDArray[Any]:
        """The array, finite, of this dtype and shape; None = any length.

        Raises:
            RunFileError: The array has another dtype or shape, or is damaged.
        """
        full = f"{self.folder}/{name}"
        found = self.read(full)
        fits = found.ndim == len(shape) and all(
            want is None or want == have for want, have in zip(shape, found.shape, strict=True)
        )
        if found.dtype != np.dtype(dtype) or not fits:
            wanted = tuple("any" if want is None else want for want in shape)
            self.refuse(full, f"{found.dtype} of shape {found.shape}", f"{np.dtype(dtype)} of shape {wanted}")
        if not np.isfinite(found).all():
            self.refuse(full, "with nan or inf in it", "finite numbers")
        return found

    def require(self, holds: bool, name: str, found: str, expected: str) -> None:
        """Refuses the file if `holds` is False."""
        if not holds:
            self.refuse(f"{self.folder}/{name}", found, expected)

    def refuse(self, name: str, found: str, expected: str) -> NoReturn:
        """Raises the error of a damaged array."""
        raise RunFileError(f"{self.file}: {name} is {found}; expected {expected}. {_AGAIN}")


def arrays_of_storey(storey: StoreyMemory) -> dict[str, NDArray[Any]]:
    """All arrays of a storey, by name."""
    memory = storey.memory
    arrays: dict[str, NDArray[Any]] = {"occupancy": storey.occupancy.cells}
    if isinstance(memory, FeatureMap):
        return arrays | {
            "rows": memory.rows,
            "rc": memory.rc,
            "cell_y": memory.cell_y,
            "weights": memory.weights,
        }
    points = [item.points for item in memory.objects]
    features = [item.feature for item in memory.objects]
    return arrays | {
        "points": np.concatenate(points) if points else np.empty((0, 3), np.float32),
        "num_points": np.array([len(item) for item in points], np.int64),
        "features": np.array(features, np.float32).reshape(len(features), memory.dim),
        "weights": np.array([item.weight for item in memory.objects], np.float64),
    }


def storey_of_arrays(arrays: MapArrays, header: MapHeader, storey: StoreyHeader) -> StoreyMemory:
    """The storey of a file.

    Raises:
        RunFileError: An array is missing, damaged, or does not fit the others.
    """
    cells = arrays.array("occupancy", np.uint8, storey.occupancy.shape)
    arrays.require(bool((cells <= OCCUPIED).all()), "occupancy", f"up to {cells.max(initial=0)}", "values 0, 1 and 2")
    occupancy = OccupancyGrid(cells, storey.occupancy)
    if header.layout == "objects":
        return StoreyMemory(occupancy, _object_map(arrays, header, storey))
    return StoreyMemory(occupancy, _feature_map(arrays, header, storey))


def _feature_map(arrays: MapArrays, header: MapHeader, storey: StoreyHeader) -> FeatureMap:
    if storey.grid is None:
        arrays.refuse(f"header.json: {arrays.folder}", "without a grid", "a grid, as the layout says")
    if storey.grid != header.storeys[0].grid:
        arrays.refuse(f"header.json: {arrays.folder}", "of another grid than storey0", "one grid for all storeys")
    grid = storey.grid
    rows = arrays.array("rows", np.float32, (None, header.dim))
    rc = arrays.array("rc", np.int16, (len(rows), 2))
    flat = rc[:, 0].astype(np.int64) * grid.shape[1] + rc[:, 1]
    is_in_order = bool(grid.contains(rc).all() and (np.diff(flat) > 0).all())
    arrays.require(is_in_order, "rc", "out of the grid or out of order", "cells in row-major order, each once")
    _require_unit(arrays, "rows", rows)
    return FeatureMap(
        rows=rows,
        rc=rc,
        grid=grid,
        floor_y=storey.floor_y,
        cell_y=arrays.array("cell_y", np.float32, (len(rows),)),
        encoder=header.encoder,
        weights=arrays.array("weights", np.float32, (len(rows),)),
        centre_xz=storey.centre_xz,
    )


def _object_map(arrays: MapArrays, header: MapHeader, storey: StoreyHeader) -> ObjectMap:
    if storey.merge_m is None or storey.captions is None:
        arrays.refuse(f"header.json: {arrays.folder}", "without merge_m or captions", "both, as the layout says")
    count = len(storey.captions)
    features = arrays.array("features", np.float32, (count, header.dim))
    _require_unit(arrays, "features", features)
    weights = arrays.array("weights", np.float64, (count,))
    points = arrays.array("points", np.float32, (None, 3))
    lengths = arrays.array("num_points", np.int64, (count,))
    fits = bool((lengths > 0).all()) and int(lengths.sum()) == len(points)
    arrays.require(fits, "num_points", f"{lengths.sum()} together", f"{len(points)}, at least 1 each")
    parts = np.split(points, np.cumsum(lengths)[:-1]) if count else []
    objects = tuple(
        ObjectInstance(part, feature, caption, float(weight))
        for part, feature, caption, weight in zip(parts, features, storey.captions, weights, strict=True)
    )
    return ObjectMap(objects, storey.floor_y, header.encoder, header.dim, storey.centre_xz, storey.merge_m)


def _require_unit(arrays: MapArrays, name: str, vectors: NDArray[np.float32]) -> None:
    lengths = np.linalg.norm(vectors, axis=1)
    worst = float(np.abs(lengths - 1).max(initial=0))
    arrays.require(worst <= _UNIT_TOLERANCE, name, f"up to {worst:.3g} off length 1", "unit vectors")

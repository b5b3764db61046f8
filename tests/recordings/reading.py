"""Content of a recording, read back with Rerun's own reader."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from recordings.replay import log_comparison
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.run_files import Run
from sim.types import Camera

SMALL = Camera(width=64, height=48)
Tables = dict[tuple[str, bool], dict[str, Any]]


def tables(rrd: Path, *, kind: str = "recordings") -> Tables:
    """Columns, as lists, by (entity, is static); `kind` is `recordings` or `blueprints`."""
    reader = RrdReader(str(rrd))
    (store,) = getattr(reader, kind)()
    parts: dict[tuple[str, bool, tuple[str, ...]], dict[str, list]] = {}
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        names = tuple(name for name in batch.schema.names if not name.startswith("rerun."))
        columns = parts.setdefault((chunk.entity_path, chunk.is_static, names), {name: [] for name in names})
        for name in names:
            column = batch.column(name)
            columns[name] += (column.cast(pa.int64()) if pa.types.is_temporal(column.type) else column).to_pylist()
    found: Tables = {}
    for (entity, is_static, _), columns in parts.items():
        found.setdefault((entity, is_static), {}).update(columns)
    return found


def view_names(rrd: Path) -> set[str]:
    """Names of all views of the blueprint."""
    found = tables(rrd, kind="blueprints").values()
    return {row[0] for columns in found for row in columns.get("ViewBlueprint:display_name", []) if row}


def column(found: Tables, entity: str, name: str, *, static: bool = False) -> list[Any]:
    """The rows of a column in the order of their steps."""
    columns = found[(entity, static)]
    if static:
        return columns[name]
    return [columns[name][index] for index in np.argsort(columns["step"], kind="stable")]


def record(out: Path, runs: Sequence[Run], episode: Episode, scene: Scene, **options: Any) -> Tables:
    """Records these runs and reads the recording; it has pictures only if a renderer is among the options."""
    defaults: dict[str, Any] = {"renderer": None, "with_pixels": False, "camera": SMALL}
    return tables(log_comparison(runs, episode=episode, scene=scene, out=out, **(defaults | options)))

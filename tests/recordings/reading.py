"""What stands in a recording, read back with Rerun's own reader."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader

from recordings.replay import log_comparison
from sim.episodes.schema import Episode
from sim.scenes.scene import Scene
from sim.tasks.run_files import Run
from sim.types import Camera

SMALL = Camera(width=64, height=48)
Tables = dict[tuple[str, bool], dict[str, Any]]


def tables(rrd: Path, *, kind: str = "recordings") -> Tables:
    """(entity, is static) to its columns as lists; `kind` is `recordings` or `blueprints`."""
    reader = RrdReader(str(rrd))
    (store,) = getattr(reader, kind)()
    found: Tables = {}
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        columns = found.setdefault((chunk.entity_path, chunk.is_static), {})
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if not name.startswith("rerun."):
                values = column.cast(pa.int64()) if pa.types.is_temporal(column.type) else column
                columns[name] = values.to_pylist()
    return found


def record(out: Path, runs: Sequence[Run], episode: Episode, scene: Scene, **options: Any) -> Tables:
    """Content of the recording of these runs, without pictures unless a renderer is among the options."""
    defaults: dict[str, Any] = {"renderer": None, "with_pixels": False, "camera": SMALL}
    return tables(log_comparison(runs, episode=episode, scene=scene, out=out, **(defaults | options)))

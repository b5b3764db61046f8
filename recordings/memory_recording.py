"""A map that an exploration or a robot left behind, as a recording of its own; in its home where that is at hand."""

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from grounding.maps.home_map import HomeMemory
from sim.errors import RecordingError
from sim.homes.kind import scene_label
from sim.mesh import Scene

from . import paths
from .blueprint_layers import memory_views
from .blueprints import BACKGROUND, home_eye
from .log_maps import StoreyMap, log_map_picture, storey_map
from .log_memory import (
    HOME_LAYERS,
    home_entity,
    log_memory,
    memory_markdown,
    storey_at,
    storeys_of_memory,
)
from .log_scene import log_scene, log_up
from .log_text import NOTICE, plain_text
from .stream import open_recording


def record_memory(memory: HomeMemory, *, name: str, out: Path, scene: Scene | None, with_pixels: bool) -> Path:
    """Writes a map into a recording.

    Args:
        memory: The map.
        name: What it is called.
        out: The .rrd file; replaced when it exists.
        scene: The home in which it was made; None = the map alone, as for a robot's recording.
        with_pixels: Whether a licensed scan's geometry and maps may be written; other homes need no leave.

    Returns:
        `out`.

    Raises:
        RecordingError: `out` cannot be written, the map is empty, is in another frame than the home, or is of a scan
            that may not be shown.
    """
    _require_shown(memory, name, scene, with_pixels=with_pixels)
    if scene is None:
        maps = storeys_of_memory(memory)
    else:
        every = [storey_map(scene.navigation, index) for index in range(len(scene.navigation.storey_heights))]
        maps = [shown for shown in every if storey_at(memory, shown) is not None]
    with open_recording(out, paths.MapKey(name)) as stream:
        stream.send_blueprint(_blueprint(name, memory, maps))
        stream.send_recording_name(f"map {name}" + (f" in {scene.label}" if scene else ""))
        log_up(stream)
        parts = [memory_markdown(name, memory)]
        if scene is not None:
            parts.append(f"{plain_text(scene.label)}, scene digest {scene.digest[:12]}")
            parts += [f"_{NOTICE}_"] if scene.kind == "scan" else [f"**{scene_label(scene.kind)}.**"]
            log_scene(stream, scene, storeys=[shown.index for shown in maps])
        for shown in maps:
            log_map_picture(stream, shown)
        text = rr.TextDocument("\n\n".join(parts), media_type=rr.MediaType.MARKDOWN)
        stream.log(paths.TASK, text, static=True)
        log_memory(stream, name, memory, maps)
    return out


def _require_shown(memory: HomeMemory, name: str, scene: Scene | None, *, with_pixels: bool) -> None:
    if not memory.storeys:
        raise RecordingError(f"{name}: found a map without storeys; expected at least one. Explore the home again.")
    if scene is not None and memory.frame != "world":
        raise RecordingError(
            f"{name}: is in frame {memory.frame!r}; expected 'world' to be shown in a home. Leave the home out."
        )
    if scene is not None and scene.kind == "scan" and not with_pixels:
        raise RecordingError(
            f"{name}: is a map of a licensed scan; expected leave to write it. Give --with-pixels if you may "
            "keep such a file."
        )


def _blueprint(name: str, memory: HomeMemory, maps: list[StoreyMap]) -> rrb.Blueprint:
    """A page per storey: the home, and a flat view per layer; the text below."""
    pages = [_page(name, memory, shown, many=len(maps) > 1) for shown in maps]
    return rrb.Blueprint(
        rrb.Vertical(
            pages[0] if len(pages) == 1 else rrb.Tabs(*pages),
            rrb.TextDocumentView(origin=paths.TASK, name="Map"),
            row_shares=[4, 1],
        ),
        rrb.TimePanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _page(name: str, memory: HomeMemory, shown: StoreyMap, *, many: bool) -> rrb.Container:
    known = storey_at(memory, shown)
    assert known is not None
    rows, cols = shown.grid.shape
    home = rrb.Spatial3DView(
        origin="/",
        contents=[f"{paths.MESH}/{shown.part}/**", *(f"{home_entity(name, layer, shown)}/**" for layer in HOME_LAYERS)],
        name="Home",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=home_eye(shown, extent=max(rows, cols) * shown.grid.cell),
    )
    flat = memory_views(name, known, shown)
    grid = rrb.Grid(*flat, grid_columns=2)
    return rrb.Horizontal(home, grid, name=f"Storey {shown.index + 1}" if many else "Map", column_shares=[1, 1])

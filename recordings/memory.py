"""Logs a map that explorations made (`HomeMemory`): free space, features as colours, evidence, coverage, objects.

All of it lies on the storeys' maps in the maps' pixels; features and objects stand in the home too. A map is shown at
all times: it was made before any question was asked, and holds no goal. Answers to free text are marked on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grounding.maps.home_map import HomeMemory, Memory, ObjectInstance, OccupancyGrid, StoreyMemory
from grounding.methods.free_text import Reply
from grounding.types import FeatureMap, Layers
from sim.plan_view.storey import StoreyMap, cropped_map
from sim.tasks.observers import FREE, UNKNOWN
from sim.walk.storeys import same_storey, storey_of

from . import paths
from .layers import places_of
from .maps import carpet, heat_rgb, occupancy_png, on_map, rgb_png, seen_png, similarity_png, vector_rgb
from .scene import LIFT
from .texts import table

MapLayer = Literal["occupancy", "coverage", "features", "evidence", "objects"]
FLAT_LAYERS: tuple[MapLayer, ...] = ("coverage", "occupancy", "features", "evidence", "objects")
"""The layers on a storey's map, from bottom to top."""
HOME_LAYERS: tuple[MapLayer, ...] = ("features", "objects")
"""The layers in the home."""
LAYER_NAMES: dict[MapLayer, str] = {
    "coverage": "Free floor known (bright)",
    "occupancy": "Free (green), occupied (brown)",
    "features": "Features: like colours, like vectors",
    "evidence": "Evidence, logarithmic",
    "objects": "Objects",
}
"""Titles of views."""
_LABEL = 40
"""Largest number of a caption's letters beside a box."""
_POINT = 0.02
"""Radius of an object's points, metres."""
MARK_RGB = (255, 96, 32)
_BALL, _DOT = 0.12, -6.0
"""Radius of a mark: metres in the home, pixels (negative) on the map."""


@dataclass(frozen=True, slots=True)
class NamedMemory:
    """A map with the name under which it is shown."""

    name: str
    """Names its entities."""
    memory: HomeMemory


def named_memories(files: Sequence[Path]) -> list[NamedMemory]:
    """The maps in these files, each once, named after the folder that holds them.

    Raises:
        RunFileError: A file is damaged.
    """
    from grounding.maps.files import load_memory

    found = []
    for path in dict.fromkeys(files):
        folder = path.parent.parent if path.parent.name == "maps" else path.parent
        found.append(NamedMemory(folder.name or path.stem, load_memory(path)))
    return found


def storeys_of_memory(memory: HomeMemory) -> list[StoreyMap]:
    """Each storey as its own map, cropped to the known cells: for maps of homes that are not available."""
    return [
        cropped_map(
            index,
            storey.floor_y,
            storey.occupancy.cells == FREE,
            storey.occupancy.grid,
            around=storey.occupancy.cells != UNKNOWN,
        )
        for index, storey in enumerate(memory.storeys)
    ]


def log_memory(stream: rr.RecordingStream, name: str, memory: HomeMemory, maps: Sequence[StoreyMap]) -> None:
    """Logs every layer on each storey of `maps` that the memory knows; both are in one frame.

    The entities are `/memory/<name>/map/<storey>/<layer>` and `/memory/<name>/home/<storey>/<layer>`.
    """
    colours = vector_rgb([_vectors(storey) for storey in memory.storeys])
    for shown in maps:
        known = storey_at(memory, shown)
        for storey, rgb in zip(memory.storeys, colours, strict=True):
            if storey is known:  # `==` would compare arrays
                _Sheet(stream, name, storey, rgb, shown).log()


def log_replies(
    stream: rr.RecordingStream, name: str, memory: Memory, replies: Sequence[Reply], maps: Sequence[StoreyMap]
) -> None:
    """Logs each question's scores and places below `/memory/<name>/<view>/<storey>/asked_<number>`.

    Args:
        name: Name of the map, as in `log_memory`.
        memory: The map that was asked, `Asker.memory`.
        maps: The storeys shown.
    """
    floors = [(shown.floor_y, shown.floor_y) for shown in maps]
    for number, reply in enumerate(replies):
        layers = reply.grounding.layers
        points = np.empty((0, 3)) if layers is None else places_of(memory, layers)
        storeys = np.array([storey_of(y, floors) for y in points[:, 1].tolist()], np.int64)
        for place, shown in enumerate(maps):
            flat, home = (paths.asked_path(name, view, shown.name, number) for view in ("map", "home"))
            if layers is not None:
                _log_scores(stream, flat, memory, layers, storeys == place, shown)
            _log_places(stream, (flat, home), reply, shown)


def _log_places(stream: rr.RecordingStream, entities: tuple[str, str], reply: Reply, shown: StoreyMap) -> None:
    """Logs the numbered places of one storey on its map and in the home."""
    here = [
        (rank, place)
        for rank, place in enumerate(reply.places, start=1)
        if same_storey(place.position[1] - place.height, shown.floor_y)
    ]
    points = np.array([place.position for _, place in here], float).reshape(-1, 3)
    words = [f"{rank} {reply.query}" for rank, _ in here]
    style = {"colors": [MARK_RGB], "labels": words, "show_labels": True}
    flat, home = entities
    stream.log(f"{flat}/places", rr.Points2D(shown.pixels(points), radii=_DOT, draw_order=50.0, **style))
    stream.log(f"{home}/places", rr.Points3D(points + np.array([0.0, LIFT, 0.0]), radii=_BALL, **style))


def _log_scores(
    stream: rr.RecordingStream,
    flat: str,
    memory: Memory,
    layers: Layers,
    here: NDArray[np.bool_],
    shown: StoreyMap,
) -> None:
    """Logs the scores of the cells or things that are on this storey, `here` (N,)."""
    if isinstance(memory, FeatureMap):
        values = layers.on_grid(np.where(here & np.isfinite(layers.final), layers.final, np.nan))
        png = similarity_png(on_map(values, memory.grid, shown))
        stream.log(f"{flat}/scores", rr.EncodedImage(contents=png, media_type="image/png", draw_order=5.0))
    elif here.any():
        boxes = np.array([item.box for item in memory.objects], float)[here]
        mins, sizes = shown.flat_boxes(boxes[:, 0], boxes[:, 1])
        colours = heat_rgb(layers.final[None])[0][here]
        stream.log(f"{flat}/scores", rr.Boxes2D(mins=mins, sizes=sizes, colors=colours, draw_order=30.0))


def storey_at(memory: HomeMemory, shown: StoreyMap) -> StoreyMemory | None:
    """The memory's storey that matches a shown storey; None if the memory does not know it."""
    near = [storey for storey in memory.storeys if same_storey(storey.floor_y, shown.floor_y)]
    return min(near, key=lambda storey: abs(storey.floor_y - shown.floor_y), default=None)


def layers_of(storey: StoreyMemory) -> tuple[MapLayer, ...]:
    """The layers that a storey has: a map of objects has no cells, a map of cells no objects."""
    left_out = {"objects"} if isinstance(storey.memory, FeatureMap) else {"features", "evidence"}
    return tuple(layer for layer in FLAT_LAYERS if layer not in left_out)


def map_entity(name: str, layer: MapLayer, shown: StoreyMap) -> str:
    """Entity of a layer on a storey's map."""
    return paths.memory_path(name, "map", shown.name, layer)


def home_entity(name: str, layer: MapLayer, shown: StoreyMap) -> str:
    """Entity of a layer in the home."""
    return paths.memory_path(name, "home", shown.name, layer)


@dataclass(frozen=True, slots=True)
class _Sheet:
    """Draws one storey of a memory on one shown storey."""

    stream: rr.RecordingStream
    name: str
    known: StoreyMemory
    colours: NDArray[np.uint8]
    """(N, 3) colours of its cells or objects."""
    shown: StoreyMap

    def log(self) -> None:
        """Logs all layers, at all times."""
        cells = _at_pixels(self.known.occupancy, self.shown)
        self._picture("coverage", seen_png(self.shown.free, cells != UNKNOWN), order=1.0)
        self._picture("occupancy", occupancy_png(cells), order=2.0)
        memory = self.known.memory
        if isinstance(memory, FeatureMap):
            self._log_features(memory)
            evidence = np.full(memory.grid.shape, np.nan, np.float32)
            evidence[memory.rc[:, 0], memory.rc[:, 1]] = np.log1p(memory.weights)
            self._picture("evidence", similarity_png(on_map(evidence, memory.grid, self.shown)), order=4.0)
        else:
            self._log_objects(memory.objects)

    def _log_features(self, memory: FeatureMap) -> None:
        rgb = np.zeros((*memory.grid.shape, 3), np.uint8)
        rows, cols = memory.rc[:, 0], memory.rc[:, 1]
        rgb[rows, cols] = self.colours
        index = np.full(memory.grid.shape, np.nan, np.float32)
        index[rows, cols] = np.arange(len(memory.rc))
        at = on_map(index, memory.grid, self.shown)
        is_known = np.isfinite(at)
        pixels = np.zeros((*at.shape, 4), np.uint8)
        pixels[is_known, :3] = self.colours[at[is_known].astype(int)]
        pixels[is_known, 3] = 255
        self._picture("features", rgb_png(pixels), order=3.0)
        squares = carpet(rgb, np.isfinite(index), memory.grid, self.shown)
        self.stream.log(home_entity(self.name, "features", self.shown), squares, static=True)

    def _log_objects(self, objects: Sequence[ObjectInstance]) -> None:
        labels = [short_caption(item) for item in objects]
        low, high = (np.array([item.box[end] for item in objects], float).reshape(-1, 3) for end in (0, 1))
        boxes = rr.Boxes3D(mins=low, sizes=high - low, colors=self.colours, labels=labels, show_labels=len(labels) <= 1)
        home = home_entity(self.name, "objects", self.shown)
        self.stream.log(home, boxes, static=True)
        if objects:
            counts = [len(item.points) for item in objects]
            points = np.concatenate([item.points for item in objects])
            cloud = rr.Points3D(points, colors=np.repeat(self.colours, counts, axis=0), radii=_POINT)
            self.stream.log(f"{home}/points", cloud, static=True)
        mins, sizes = self.shown.flat_boxes(low, high)
        flat = rr.Boxes2D(
            mins=mins, sizes=sizes, colors=self.colours, labels=labels, show_labels=False, draw_order=20.0
        )
        self.stream.log(map_entity(self.name, "objects", self.shown), flat, static=True)

    def _picture(self, layer: MapLayer, png: bytes, *, order: float) -> None:
        picture = rr.EncodedImage(contents=png, media_type="image/png", draw_order=order)
        self.stream.log(map_entity(self.name, layer, self.shown), picture, static=True)


def short_caption(item: ObjectInstance) -> str:
    """The label beside an object's box."""
    text = item.caption or "(no caption)"
    return text if len(text) <= _LABEL else text[: _LABEL - 3] + "..."


def memory_markdown(name: str, memory: HomeMemory) -> str:
    """A Markdown table of the memory's contents, storey by storey."""
    rows = []
    for storey in memory.storeys:
        area = storey.occupancy.grid.cell**2
        cells, held = storey.occupancy.cells, storey.memory
        free, occupied = ((cells == value).sum() * area for value in (FREE, FREE + 1))
        holds = (
            f"{len(held.rows)} cells of {held.grid.cell:g} m"
            if isinstance(held, FeatureMap)
            else f"{len(held.objects)} objects"
        )
        rows.append((f"{storey.floor_y:.2f} m", f"{free:.1f}", f"{occupied:.1f}", holds, held.encoder))
    names = ("storey at", "free, m²", "occupied, m²", "holds", "encoder")
    return f"**Map {name}** of {memory.num_frames} views, frame {memory.frame}.\n\n{table(names, rows)}"


def _vectors(storey: StoreyMemory) -> NDArray[np.float32]:
    if isinstance(storey.memory, FeatureMap):
        return storey.memory.rows
    return np.array([item.feature for item in storey.memory.objects], np.float32).reshape(-1, storey.memory.dim)


def _at_pixels(occupancy: OccupancyGrid, shown: StoreyMap) -> NDArray[np.uint8]:
    values = on_map(occupancy.cells.astype(np.float32), occupancy.grid, shown)
    return np.where(np.isfinite(values), values, UNKNOWN).astype(np.uint8)

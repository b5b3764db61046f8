"""Logs how grounders found their answers: similarity per phrase, peaks, gate and final scores.

Run files hold the answers only: the grounder answers again, with the settings in its `run.json`, and must give the same
points. Values of cells lie on the storey's map in the map's pixels, and in the home as a carpet above the floor; things
have boxes in the colours of their scores.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grounding.maps.home_map import Memory
from grounding.report.asked_again import AskAgain
from grounding.types import FeatureMap, Layers
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.plan_view.storey import StoreyMap, storeys_of
from sim.tasks.run_files import Answer
from sim.types import GridSpec
from sim.walk.navigation_map import NavigationMap

from . import paths
from .episode import set_answered
from .maps import carpet, heat_rgb, on_map, similarity_png
from .scene import LIFT
from .texts import plain_text, table
from .traces import Rgb, Trace

SIMILARITY, PEAKS, GATE, FINAL = "similarity", "peaks", "gate", "final"
"""Names of layers; the first two are followed by a phrase's number."""
GATE_RGB: Rgb = (255, 0, 160)
PEAK_RGB: Rgb = (255, 140, 0)
_PEAK, _OUTLINE = -3.5, -1.5
"""Radii; negative = points of the screen."""


@dataclass(frozen=True, slots=True)
class Regrounded:
    """A grounder's answer with the layers behind it, or why there are none."""

    trace: Trace
    memory: Memory | None = None
    """The map that the grounder answered on."""
    layers: Layers | None = None
    map_file: Path | None = None
    """The file of the whole home's map; None for oracle maps."""
    problem: str = ""
    """One sentence that says why there are no layers; empty otherwise."""

    @property
    def names(self) -> list[str]:
        """Names of its layers."""
        if self.layers is None:
            return []
        numbers = range(len(self.layers.phrases))
        gate = [] if self.layers.gate is None else [GATE]
        return [*(f"{name}_{number}" for name in (SIMILARITY, PEAKS) for number in numbers), *gate, FINAL]


def reground(
    traces: Sequence[Trace], episode: Episode, dataset: PersonalDataset, *, beside: Sequence[Path] = ()
) -> list[Regrounded]:
    """The grounders' answers among `traces`, given again; answers of grounders that score no cells are left out.

    Raises:
        PersonalVizError: The episode's files are damaged.
    """
    asking = AskAgain(dataset, beside=beside)
    found: list[Regrounded] = []
    for trace in traces:
        if not isinstance(trace.run, Answer) or trace.info.who_kind != "agent":
            continue
        again = asking.ask(trace.info, trace.run, episode)
        if again.problem:
            found.append(Regrounded(trace, problem=again.problem))
        elif again.grounding is not None and again.grounding.layers is not None:
            found.append(Regrounded(trace, again.memory, again.grounding.layers, again.map_file))
    return found


def reground_markdown(regrounded: Sequence[Regrounded]) -> list[str]:
    """Paragraphs for the document: each phrase with its cosines, or the reason why a grounder shows no layers."""
    parts = []
    for item in regrounded:
        title, layers = plain_text(item.trace.title), item.layers
        if layers is None:
            parts.append(f"No layers of {title}: it {item.problem}.")
        elif layers.phrases:
            rows = [
                (f"{number}. {plain_text(phrase)}", f"{row.min():.2f} to {row.max():.2f}")
                for number, (phrase, row) in enumerate(zip(layers.phrases, layers.similarity, strict=True), start=1)
            ]
            parts.append(table((f"{title}'s phrase", "least and most alike"), rows))
    return parts


def covering(regrounded: Sequence[Regrounded]) -> list[tuple[Trace, str]]:
    """(trace, layer) of the layers that would hide the main layers: phrases and other grounders colour the same cells.

    The main layers are the peaks, gate and final scores of one grounder, the first with a gate.
    """
    with_layers = [item for item in regrounded if item.layers is not None]
    main = min(with_layers, key=lambda item: item.layers is None or item.layers.gate is None, default=None)
    return [
        (item.trace, name)
        for item in with_layers
        for name in item.names
        if item is not main or name.startswith(SIMILARITY)
    ]


def log_layers(
    stream: rr.RecordingStream,
    regrounded: Sequence[Regrounded],
    maps: Sequence[StoreyMap],
    navigation: NavigationMap,
) -> None:
    """Logs every layer on each storey where it has cells, at the moment of the answer."""
    for item in regrounded:
        if item.layers is None or item.memory is None:
            continue
        assert isinstance(item.trace.run, Answer)
        set_answered(stream, item.trace.run)
        points = places_of(item.memory, item.layers)
        floors = storeys_of(points[:, 1], navigation)
        for storey in maps:
            here = floors == storey.index
            if here.any():
                _Sheet(item.trace, item.memory, item.layers, points, storey, here).log(stream)
        stream.reset_time()


def places_of(memory: Memory, layers: Layers) -> NDArray[np.float64]:
    """(N, 3) world middles of the layers' cells, on their floors, or of the layers' things."""
    if isinstance(memory, FeatureMap):
        return memory.points_from_rc(layers.rc)
    return np.array([item.centre for item in memory.objects], float).reshape(-1, 3)


def map_entity(trace: Trace, layer: str, storey: StoreyMap) -> str:
    """Entity of a layer on a storey's map."""
    return paths.run_path(trace.label, "map", storey.name, paths.LAYERS, layer)


def home_entity(trace: Trace, layer: str, storey: StoreyMap) -> str:
    """Entity of a layer above a storey's floor."""
    return paths.run_path(trace.label, paths.LAYERS, layer, storey.name)


def outline(inside: NDArray[np.bool_], grid: GridSpec) -> NDArray[np.float64]:
    """Segments (S, 2, 2) of the border around the cells (R, C) that are inside: both ends, each world x and z."""
    padded = np.pad(inside, 1)
    above = np.argwhere(padded[:-1, 1:-1] != padded[1:, 1:-1])  # (row, col) with a border at smaller z
    left = np.argwhere(padded[1:-1, :-1] != padded[1:-1, 1:])
    corners = np.concatenate(
        [np.stack([above, above + np.array([0, 1])], axis=1), np.stack([left, left + np.array([1, 0])], axis=1)]
    )
    return np.array(grid.origin_xz, np.float64) + corners[..., ::-1].astype(np.float64) * grid.cell


@dataclass(frozen=True, slots=True)
class _Sheet:
    """A grounder's layers on one storey."""

    trace: Trace
    memory: Memory
    layers: Layers
    """A column per cell or thing of the memory."""
    points: NDArray[np.float64]
    """(N, 3) from `places_of`."""
    storey: StoreyMap
    here: NDArray[np.bool_]
    """(N,) cells or things on this storey."""

    def log(self, stream: rr.RecordingStream) -> None:
        """Logs all layers at the stream's present time."""
        for number, (row, peaks) in enumerate(zip(self.layers.similarity, self.layers.peaks, strict=True)):
            self._log_values(stream, f"{SIMILARITY}_{number}", row)
            self._log_peaks(stream, f"{PEAKS}_{number}", peaks)
        if self.layers.gate is not None and isinstance(self.memory, FeatureMap):
            self._log_outline(stream, GATE, self.layers.gate, self.memory.grid)
        self._log_values(stream, FINAL, self.layers.final)

    def _log_values(self, stream: rr.RecordingStream, name: str, values: NDArray[np.float32]) -> None:
        shown = self.here & np.isfinite(values)
        if isinstance(self.memory, FeatureMap):
            self._log_cells(stream, name, self.layers.on_grid(np.where(shown, values, np.nan)), self.memory.grid)
        else:
            boxes = np.array([item.box for item in self.memory.objects], float).reshape(-1, 2, 3)
            self._log_boxes(stream, name, boxes[shown], heat_rgb(values[None])[0][shown], values[shown])

    def _log_cells(self, stream: rr.RecordingStream, name: str, values: NDArray[np.float32], grid: GridSpec) -> None:
        """Logs the values (R, C) of a grid as colours; NaN shows nothing."""
        png = similarity_png(on_map(values, grid, self.storey))
        flat = rr.EncodedImage(contents=png, media_type="image/png", draw_order=5.0)
        stream.log(map_entity(self.trace, name, self.storey), flat)
        if np.isfinite(values).any():
            squares = carpet(heat_rgb(values), np.isfinite(values), grid, self.storey)
            stream.log(home_entity(self.trace, name, self.storey), squares)

    def _log_boxes(
        self,
        stream: rr.RecordingStream,
        name: str,
        boxes: NDArray[np.float64],
        colours: NDArray[np.uint8],
        values: NDArray[np.float32],
    ) -> None:
        """Logs the things' boxes (M, 2, 3) in colours (M, 3) for their values (M,)."""
        low, high = boxes[:, 0], boxes[:, 1]
        labels = [f"{value:.2f}" for value in values.tolist()]
        style = {"colors": colours, "labels": labels, "show_labels": False}
        solid = rr.Boxes3D(mins=low, sizes=high - low, fill_mode="solid", **style)
        stream.log(home_entity(self.trace, name, self.storey), solid)
        mins, sizes = self.storey.flat_boxes(low, high)
        flat = rr.Boxes2D(mins=mins, sizes=sizes, radii=-2.0, draw_order=30.0, **style)
        stream.log(map_entity(self.trace, name, self.storey), flat)

    def _log_peaks(self, stream: rr.RecordingStream, name: str, peaks: NDArray[np.int64]) -> None:
        """Logs a phrase's best cells or things, numbered."""
        found = peaks[peaks >= 0]
        found = found[self.here[found]]
        points, ranks = self.points[found], [str(rank + 1) for rank in range(len(found))]
        style = {"colors": [PEAK_RGB], "radii": _PEAK, "labels": ranks, "show_labels": False}
        flat = rr.Points2D(self.storey.pixels(points), draw_order=42.0, **style)
        stream.log(map_entity(self.trace, name, self.storey), flat)
        spheres = rr.Points3D(points + np.array([0.0, LIFT, 0.0]), **style)
        stream.log(home_entity(self.trace, name, self.storey), spheres)

    def _log_outline(self, stream: rr.RecordingStream, name: str, inside: NDArray[np.bool_], grid: GridSpec) -> None:
        edges = outline(self.layers.on_grid(inside & self.here) == 1, grid)  # (S, 2, 2) xz
        lines = np.insert(edges, 1, self.storey.floor_y + LIFT, axis=-1)
        flat = rr.LineStrips2D(list(self.storey.pixels(lines)), colors=[GATE_RGB], radii=_OUTLINE, draw_order=41.0)
        stream.log(map_entity(self.trace, name, self.storey), flat)
        above = rr.LineStrips3D(list(lines), colors=[GATE_RGB], radii=_OUTLINE)
        stream.log(home_entity(self.trace, name, self.storey), above)

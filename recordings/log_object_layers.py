"""Log how a grounder on a map of objects came to its answer: each thing's box in the colour of its score."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grounding.maps.home_map import ObjectMap
from grounding.types import Layers

from .carpets import heat_rgb
from .log_maps import StoreyMap
from .log_run import LIFT, Rgb, Trace
from .paths import layer_in_home, layer_on_map


@dataclass(frozen=True, slots=True)
class ObjectSheet:
    """A grounder's layers on the things of one storey."""

    trace: Trace
    storey: StoreyMap
    memory: ObjectMap
    layers: Layers
    """A column per thing."""
    here: NDArray[np.bool_]
    """(N,) things on this storey."""
    peak_rgb: Rgb
    peak_radius: float

    def log_values(self, stream: rr.RecordingStream, name: str, values: NDArray[np.float32]) -> None:
        """Logs the boxes with a colour per value (N,); without the things where there is none."""
        shown = self.here & np.isfinite(values)
        colours = heat_rgb(values[None])[0][shown]
        boxes = np.array([item.box for item in self.memory.objects], float).reshape(-1, 2, 3)[shown]
        low, high = boxes[:, 0], boxes[:, 1]
        labels = [f"{value:.2f}" for value in values[shown].tolist()]
        solid = rr.Boxes3D(
            mins=low, sizes=high - low, colors=colours, labels=labels, show_labels=False, fill_mode="solid"
        )
        stream.log(layer_in_home(self.trace.label, name, self.storey.part), solid)
        corners = np.stack([self.storey.pixels(low), self.storey.pixels(high)], axis=1)  # (M, 2, 2)
        flat = rr.Boxes2D(
            mins=corners.min(axis=1),
            sizes=np.ptp(corners, axis=1),
            colors=colours,
            labels=labels,
            show_labels=False,
            radii=-2.0,
            draw_order=30.0,
        )
        stream.log(layer_on_map(self.trace.label, name, self.storey.part), flat)

    def log_peaks(self, stream: rr.RecordingStream, name: str, peaks: NDArray[np.int64]) -> None:
        """Logs a phrase's best things, numbered."""
        found = peaks[peaks >= 0]
        found = found[self.here[found]]
        middles = np.array([self.memory.objects[index].centre for index in found.tolist()], float).reshape(-1, 3)
        ranks = [str(rank + 1) for rank in range(len(found))]
        style = {"colors": [self.peak_rgb], "radii": self.peak_radius, "labels": ranks, "show_labels": False}
        flat = rr.Points2D(self.storey.pixels(middles), draw_order=42.0, **style)
        stream.log(layer_on_map(self.trace.label, name, self.storey.part), flat)
        stream.log(
            layer_in_home(self.trace.label, name, self.storey.part),
            rr.Points3D(middles + np.array([0.0, LIFT, 0.0]), **style),
        )

"""Free-text answers on a map in Rerun: the scores of its cells or things, and numbered marks for each question."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grounding.maps.home_map import Memory
from grounding.methods.free_text import Reply
from grounding.types import FeatureMap, Layers
from sim.plan_view.storey import StoreyMap
from sim.walk.storeys import same_storey, storey_of

from . import paths
from .layers import places_of
from .maps import heat_rgb, on_map, similarity_png
from .scene import LIFT

MARK_RGB = (255, 96, 32)
_BALL, _DOT = 0.12, -6.0
"""Radius of a mark: metres in the home, pixels (negative) on the map."""


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

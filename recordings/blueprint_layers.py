"""How the viewer shows what grounders computed: all layers on one map and in the home, a small map per phrase."""

from collections.abc import Callable, Iterable, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.api import VisualizerLike
from rerun.encodings import EntityPathLike

from grounding.maps.home_map import StoreyMemory

from . import paths
from .log_grounding import FINAL, GATE, PEAKS, SIMILARITY, Regrounded, home_entity, map_entity, places_of
from .log_maps import StoreyMap
from .log_memory import LAYER_NAMES, NamedMemory, layers_of, storey_at
from .log_memory import map_entity as map_layer
from .log_run import Trace

Overrides = dict[EntityPathLike, VisualizerLike | Iterable[VisualizerLike]]
PER_PAGE = 6
"""Most phrases whose maps are shown beside each other."""
_TITLE = 44
"""Most letters of a phrase in the title of its map."""


def home_layers(regrounded: Sequence[Regrounded], storey: StoreyMap) -> list[str]:
    """Entities of all layers above a storey's floor."""
    return [home_entity(item.trace, name, storey) for item in regrounded for name in _names(item)]


def hidden_layers(
    regrounded: Sequence[Regrounded], storey: StoreyMap, *, entity: Callable[[Trace, str, StoreyMap], str]
) -> Overrides:
    """Layers that a view of a storey holds without showing them at first; the eye beside their names shows them.

    `entity` is `map_entity` or `home_entity`. Shown are the peaks, gate and final scores of one grounder, the first
    with a gate: what phrases and other grounders have lies on the same cells.
    """
    with_layers = [item for item in regrounded if item.layers is not None]
    main = min(with_layers, key=lambda item: item.layers is None or item.layers.gate is None, default=None)
    hidden: Overrides = {}
    for item in with_layers:
        for name in _names(item):
            if item is not main or name.startswith(SIMILARITY):
                hidden[entity(item.trace, name, storey)] = rrb.EntityBehavior(visible=False)
    return hidden


def phrase_pages(item: Regrounded, maps: Sequence[StoreyMap]) -> list[rrb.Container]:
    """Pages with a small map per phrase of one grounder, with the phrase's similarity, peaks and the answers."""
    if item.layers is None or item.memory is None:
        return []
    heights = places_of(item.memory, item.layers)[:, 1]
    storey = min(maps, key=lambda storey: float(abs(heights - storey.floor_y).mean()))
    views = [_phrase_view(item, number, phrase, storey) for number, phrase in enumerate(item.layers.phrases)]
    pages: list[rrb.Container] = []
    for first in range(0, len(views), PER_PAGE):
        page = views[first : first + PER_PAGE]
        name = f"{item.trace.title}: phrases {first + 1}-{first + len(page)}"
        pages.append(rrb.Grid(*page, grid_columns=min(3, len(page)), name=name))
    return pages


def memory_pages(item: NamedMemory, maps: Sequence[StoreyMap]) -> list[rrb.Container]:
    """A page per storey with the layers of a map that grounders answered on, beside each other."""
    pages: list[rrb.Container] = []
    for storey in maps:
        known = storey_at(item.memory, storey)
        if known is None:
            continue
        views = memory_views(item.name, known, storey)
        words = f", storey {storey.index + 1}" if len(maps) > 1 else ""
        pages.append(rrb.Grid(*views, grid_columns=len(views), name=f"Map {item.name[:_TITLE]}{words}"))
    return pages


def memory_views(name: str, known: StoreyMemory, storey: StoreyMap) -> list[rrb.View]:
    """A flat view per layer of a map's storey."""
    return [
        rrb.Spatial2DView(
            origin=storey.entity,
            contents=[f"{storey.entity}/**", map_layer(name, layer, storey)],
            name=LAYER_NAMES[layer],
            visual_bounds=map_bounds(storey),
        )
        for layer in layers_of(known)
    ]


def map_bounds(storey: StoreyMap) -> rrb.VisualBounds2D:
    """What a view of a storey's map shows at first: its picture, whatever lies beyond."""
    rows, cols = storey.grid.shape
    return rrb.VisualBounds2D(x_range=(0.0, float(cols)), y_range=(0.0, float(rows)))


def _phrase_view(item: Regrounded, number: int, phrase: str, storey: StoreyMap) -> rrb.View:
    layers = [map_entity(item.trace, f"{name}_{number}", storey) for name in (SIMILARITY, PEAKS)]
    short = phrase if len(phrase) <= _TITLE else phrase[: _TITLE - 3] + "..."
    contents = [storey.entity, *layers, f"{paths.GOAL}/map/{storey.part}/region"]
    return rrb.Spatial2DView(
        origin=storey.entity, contents=contents, name=f"{number + 1}. {short}", visual_bounds=map_bounds(storey)
    )


def _names(item: Regrounded) -> list[str]:
    if item.layers is None:
        return []
    numbers = range(len(item.layers.phrases))
    gate = [] if item.layers.gate is None else [GATE]
    return [f"{name}_{number}" for name in (SIMILARITY, PEAKS) for number in numbers] + [*gate, FINAL]

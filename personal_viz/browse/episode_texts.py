"""An episode, its runs and the list as HTML for the panels; everything that comes from files is escaped.

`panels.html.j2` has a macro for each part.
"""

import base64
import re
from collections.abc import Collection, Iterator, Sequence
from functools import cache
from pathlib import Path

import jinja2
import jinja2.environment
import numpy as np
from numpy.typing import NDArray

from sim.episodes.ownership import OwnershipGraph
from sim.episodes.schema import Episode
from sim.render.renderer import jpeg_bytes

from .catalogue import Catalogue, ListPage
from .graph_svg import color_of_person
from .shown import LayerChoice, Shown

_HERE = Path(__file__).parent
_LAYERS = (
    ("view_points", "view points", "Darts where the target can be seen from: larger and darker with iou, grey: extra."),
    ("region", "success region", "Places where STOP succeeds under rule paper."),
    ("names", "all names", "Categories of all objects of the storey."),
)
"""Fields of LayerChoice with what is written beside their boxes."""


def style_html() -> str:
    """The style of every panel; sent once."""
    return f"<style>{(_HERE / 'browse.css').read_text(encoding='utf-8')}</style>"


def list_html(catalogue: Catalogue, page: ListPage, here: int) -> str:
    """One page of the list, with buttons to turn it.

    Args:
        catalogue: All episodes.
        page: What to list.
        here: Number of the episode that is shown.
    """
    return _part("list", catalogue, page, here)


def head_html(episode: Episode, *, place: int | None, total: int) -> str:
    """Query and key of the shown episode, with buttons to its neighbours.

    Args:
        episode: What is shown.
        place: Its place in the filtered list, from 0; None = the filter hides it.
        total: Length of that list.
    """
    return _part("head", episode, place, total)


def home_html(label: str, *, storeys: int, storey: int, choice: LayerChoice) -> str:
    """What the home is called, buttons for its storeys, check boxes for the layers.

    Args:
        label: Of the scene.
        storeys: How many it has.
        storey: Which one is shown.
        choice: Layers that are switched on.
    """
    layers = [(name, words, title, getattr(choice, name)) for name, words, title in _LAYERS]
    return _part("home", label, storeys, storey, layers)


def notice_html(text: str, *, is_warning: bool = False) -> str:
    """One paragraph."""
    return _part("notice", text, is_warning)


def story_html(episode: Episode, graph: OwnershipGraph) -> str:
    """The paragraph with its names in the graph's colours."""
    return _part("story", list(_with_names(episode, graph)))


def facts_html(episode: Episode) -> str:
    """What is known about the target, its captions among it."""
    points = [point for goal in episode.targets for point in goal.view_points]
    num_seen = sum(point.iou is not None for point in points)
    captions = [text for texts in episode.record.captions_per_object for text in texts]
    return _part("facts", episode.record, num_seen, len(points) - num_seen, captions)


def runs_html(shown: Sequence[Shown], *, hidden: Collection[str], walked: str | None, notes: Sequence[str] = ()) -> str:
    """Runs and answers of the episode as tables with check boxes.

    Args:
        shown: Of the episode.
        hidden: Labels of those whose path or points are not drawn.
        walked: Label of the run along which the slider leads.
        notes: What a reader must know about them, one line each.
    """
    return _part("runs", shown, hidden, walked, notes)


def picture_html(rgb: NDArray[np.uint8], *, step: int, caption: str) -> str:
    """What a robot sees, (H, W, 3), as an inline JPEG with a line below it."""
    return _part("picture", base64.b64encode(jpeg_bytes(rgb)).decode(), step, caption)


def _part(name: str, *values: object) -> str:
    """What a macro of the template makes of these values."""
    return str(getattr(_macros(), name)(*values))


@cache
def _macros() -> jinja2.environment.TemplateModule:
    """All parts."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("panels.html.j2").module


def _with_names(episode: Episode, graph: OwnershipGraph) -> Iterator[tuple[str, str | None, bool]]:
    """The paragraph in pieces: text, colour of the person whose name it is, whether that is the owner asked for."""
    summary, owner = episode.record.summary, episode.record.owner
    names = sorted(graph.people, key=len, reverse=True)
    if not names:
        yield summary, None, False
        return
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names))})\b")
    for place, part in enumerate(pattern.split(summary)):
        yield part, color_of_person(graph, part) if place % 2 else None, part == owner

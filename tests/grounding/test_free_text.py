"""A description and a query in free text are grounded on a map without an episode, with every method."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from grounding import ground
from grounding.encoders.hashed import HashedWords
from grounding.maps.files import MapSource, save_memory
from grounding.maps.home_map import HomeMemory, Memory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory
from grounding.methods.by_name import GrounderName, takes_objects
from grounding.methods.chat_grounders import CHAT_METHODS
from grounding.methods.free_text import Asker
from grounding.phrases.rules import RulePhrases
from grounding.types import map_from_cells
from sim.errors import AgentError
from sim.types import GridSpec

TEXTS = ("red wooden chair beside the window", "large white sofa", "oval mirror with a golden frame")
SPOTS = np.array([[-0.5, 0.25, 0.5], [3.5, 0.25, 0.5], [1.5, 0.25, 3.5]])
DESCRIPTION = "Mira owns the red wooden chair beside the window. Tom owns the large white sofa."
ENCODER = HashedWords()
KNOWS_OWNERS = ("phrase", "dual", "joint", "object-phrase", "object-dual")


def home(*, objects: bool) -> HomeMemory:
    """A home with three objects a few metres apart, as an object map or a grid map."""
    rows = ENCODER.encode_texts(TEXTS)
    grid = GridSpec((-2.0, 0.0), 1.0, (6, 8))
    memory: Memory
    if objects:
        things = zip(SPOTS, rows, TEXTS, strict=True)
        items = tuple(ObjectInstance(np.array([spot], np.float32), row, text, 1.0) for spot, row, text in things)
        memory = ObjectMap(items, 0.25, ENCODER.name, ENCODER.dim, (1.5, 2.0), 0.1)
    else:
        rc = grid.rc_from_xz(SPOTS[:, [0, 2]])
        memory = map_from_cells(rows, rc, grid=grid, floor_y=0.25, encoder=ENCODER.name)
    seen = OccupancyGrid(np.zeros((10, 10), np.uint8), GridSpec((-2.0, 0.0), 0.05, (10, 10)))
    return HomeMemory((StoreyMemory(seen, memory),), "world", 3)


@pytest.mark.parametrize("method", [name for name in get_args(GrounderName) if name not in CHAT_METHODS])
def test_every_method_answers_free_text(method: GrounderName) -> None:
    built = home(objects=takes_objects(method))
    found = ground(built, description=DESCRIPTION, query="Tom's sofa", method=method).candidates
    assert found
    if method in KNOWS_OWNERS:
        assert np.hypot(found[0].position[0] - 3.5, found[0].position[2] - 0.5) < 1


def test_a_map_file_and_an_empty_description_are_enough(tmp_path: Path) -> None:
    save_memory(tmp_path / "map.npz", home(objects=False), MapSource(scene="mine", kind="robot"))
    found = ground(tmp_path / "map.npz", description="", query="the golden mirror", encoder="hashed-words-768")
    assert found.candidates


def test_phrases_that_need_an_episode_and_unknown_methods_are_refused() -> None:
    built = home(objects=False)
    with pytest.raises(AgentError, match="found no episode with query 'the sofa'"):
        ground(built, description=DESCRIPTION, query="the sofa", phrases="dataset")
    with pytest.raises(AgentError, match="--method is 'best'; expected random, center"):
        ground(built, description=DESCRIPTION, query="the sofa", method="best")


def two_storeys() -> HomeMemory:
    """The home of objects, and above it another one, whose mirror hangs 1.2 m above its floor."""
    (below,) = home(objects=True).storeys
    memory = below.memory
    assert isinstance(memory, ObjectMap)
    vase = ENCODER.encode_texts(["blue glass vase"])[0]
    points = np.array([[0.5, 4.45, 2.5]], np.float32)
    above = replace(memory, objects=(ObjectInstance(points, vase, "blue glass vase", 1.0),), floor_y=3.25)
    return HomeMemory((below, StoreyMemory(below.occupancy, above)), "world", 3)


def asker(home: HomeMemory, method: str | None = None) -> Asker:
    return Asker(home, encoder=ENCODER, phrases=RulePhrases(), method=method)


def test_places_of_things_have_a_storey_and_a_height() -> None:
    reply = asker(two_storeys()).ask("the blue glass vase", description="")
    best = reply.places[0]
    assert best.position == pytest.approx((0.5, 4.45, 2.5))
    assert (best.storey, best.height) == (1, pytest.approx(1.2))
    assert reply.places[0].score > reply.places[1].score
    assert len(reply.places) == 3
    sofa = asker(two_storeys()).ask("Tom's sofa", description=DESCRIPTION).places[0]
    assert (sofa.storey, sofa.height) == (0, pytest.approx(0.0))


def test_places_on_cells_lie_on_their_floor() -> None:
    reply = asker(home(objects=False), method="dual").ask("Mira's chair", description=DESCRIPTION)
    assert (reply.places[0].storey, reply.places[0].height, reply.places[0].position[1]) == (0, 0.0, 0.25)


def test_a_reply_names_the_phrase_that_the_query_means() -> None:
    ask = asker(home(objects=True))
    assert "sofa" in ask.ask("Tom's sofa", description=DESCRIPTION).phrase
    assert ask.ask("the mirror", description="").phrase == ""
    assert ask.method == "object-dual"

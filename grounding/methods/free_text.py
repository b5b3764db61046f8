"""Asks a map one question in free text, without an episode."""

from pathlib import Path

from sim.types import Task

from ..encoders.by_name import make_encoder
from ..encoders.protocol import ORACLE_SUFFIX, EncoderName, TextEncoder
from ..maps.files import load_memory
from ..maps.home_map import HomeMemory, ObjectMap, merged_storeys
from ..phrases.sources import PhraseSource, PhraseSourceName, make_phrases
from ..types import Grounding
from .by_name import GrounderName, make_grounder


def ground(
    map: HomeMemory | Path | str,
    *,
    description: str,
    query: str,
    method: GrounderName | str | None = None,
    phrases: PhraseSource | PhraseSourceName = "rules",
    encoder: TextEncoder | EncoderName = "hashed",
    storey_y: float | None = None,
) -> Grounding:
    """Places of the query's object on a map: candidates in world metres, best first.

    Args:
        map: A map made by `build_map`, or its `.npz` file.
        description: The paragraph about the owners; may be empty.
        query: The object to find, such as "Lily's backpack".
        method: Name of a grounder, or your own as package.module:factory; None = `joint`, or `object-dual` on maps of
            objects.
        phrases: Source that reads the description, or its name; `dataset` needs episodes and is refused.
        encoder: The encoder that the map was built with, or its name.
        storey_y: Height of the storey to search, metres; None = all storeys.

    Raises:
        RunFileError: The file is missing, damaged or not a map.
        AgentError: The map is empty, was made with another encoder, or is of a kind that the method does not take.
    """
    home = map if isinstance(map, HomeMemory) else load_memory(Path(map))
    memory = merged_storeys(home) if storey_y is None else home.storey_near(storey_y).memory
    name = method or ("object-dual" if isinstance(memory, ObjectMap) else "joint")
    if isinstance(encoder, str):
        is_perceived = memory.encoder.endswith(ORACLE_SUFFIX) and not encoder.endswith(ORACLE_SUFFIX)
        encoder = make_encoder(encoder + ORACLE_SUFFIX if is_perceived else encoder)
    grounder = make_grounder(name, encoder)
    task = Task("pog", description=description, queries=(query,))
    source = make_phrases(phrases) if isinstance(phrases, str) else phrases
    found = source.phrases(task) if grounder.uses_phrases else ()
    return grounder.ground(memory, task, found)

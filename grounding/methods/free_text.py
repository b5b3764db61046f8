"""Asks a map in free text, without an episode: one question (`ground`), or several on one loaded model (`Asker`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.episodes.schema import Vector3
from sim.errors import AgentError
from sim.types import Frame, Task

from ..chat.protocol import Chat
from ..encoders.by_name import make_encoder
from ..encoders.protocol import ORACLE_SUFFIX, EncoderName, ModelOptions, TextEncoder
from ..maps.files import load_memory
from ..maps.home_map import HomeMemory, Memory, ObjectMap, OccupancyGrid, StoreyMemory, merged_storeys
from ..phrases.sources import PhraseSource, PhraseSourceName, make_phrases
from ..types import Candidate, Grounding
from .by_name import GrounderName, make_grounder


@dataclass(frozen=True, slots=True)
class FoundPlace:
    """One place at which the asked object may be."""

    position: Vector3
    """Map frame, metres: the middle of a thing; on grid maps the floor of a cell, whose things have no height."""
    storey: int
    """Place of its storey in `HomeMemory.storeys`, 0 = the lowest."""
    height: float
    """Metres above that storey's floor."""
    score: float
    """Higher is better, among the answers to one question only."""


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to one question."""

    query: str
    phrase: str
    """The phrase of the description that the query means; "" = none, or the method does not use phrases."""
    places: tuple[FoundPlace, ...]
    """At most three, best first; none on an empty map."""
    grounding: Grounding
    """The method's own answer, with its layers."""


@dataclass(frozen=True, slots=True)
class _MapAlone:
    """A map without the pictures from which it was made."""

    storeys: tuple[StoreyMemory, ...]

    def floors(self, memory: Memory) -> Sequence[tuple[float, OccupancyGrid]]:
        return [(storey.floor_y, storey.occupancy) for storey in self.storeys]

    def key_frames(self, memory: Memory) -> Sequence[Frame]:
        raise AgentError(
            "--method is 'frames-vlm'; expected a method that answers on the map, because free text has no pictures "
            "beside it. Ask with another one; personal-viz ground --map explore takes frames-vlm."
        )


class Asker:
    """Answers questions about one home with one method; the model is loaded once."""

    def __init__(
        self,
        home: HomeMemory,
        *,
        encoder: TextEncoder,
        phrases: PhraseSource,
        method: GrounderName | str | None = None,
        storey_y: float | None = None,
        chat: Chat | None = None,
    ) -> None:
        """Takes the map, the encoder with which it was built, and the source that reads descriptions.

        Args:
            method: Name of a grounder, or your own as package.module:factory; None = `joint`, or `object-dual` on maps
                of objects.
            storey_y: Height of the storey to search, metres; None = all storeys.
            chat: The model of methods that ask one.

        Raises:
            AgentError: The map is empty or the method is unknown.
        """
        storeys = home.storeys if storey_y is None else (home.storey_near(storey_y),)
        self._home, self._phrases = home, phrases
        self.memory: Memory = merged_storeys(home) if storey_y is None else storeys[0].memory
        """The map that is asked, of one storey or of all."""
        name = method or ("object-dual" if isinstance(self.memory, ObjectMap) else "joint")
        self._grounder = make_grounder(name, encoder, chat=chat, seen=_MapAlone(storeys))

    @property
    def method(self) -> str:
        """The grounder's name."""
        return self._grounder.name

    def ask(self, query: str, *, description: str) -> Reply:
        """The places of the query's object.

        Args:
            query: The object to find, such as "Lily's backpack".
            description: The paragraph about the owners; may be empty.

        Raises:
            AgentError: The map was made with another encoder, or is of a kind that the method does not take.
        """
        task = Task("pog", description=description, queries=(query,))
        found = self._phrases.phrases(task) if self._grounder.uses_phrases else ()
        grounding = self._grounder.ground(self.memory, task, found)
        layers = grounding.layers
        phrase = layers.phrases[layers.chosen] if layers is not None and layers.chosen >= 0 else ""
        return Reply(query, phrase, tuple(map(self._place, grounding.candidates)), grounding)

    def _place(self, found: Candidate) -> FoundPlace:
        x, floor_y, z = found.position
        if not isinstance(self.memory, ObjectMap):
            index = int(np.argmin([abs(storey.floor_y - floor_y) for storey in self._home.storeys]))
            return FoundPlace(found.position, index, 0.0, found.score)
        thing = self.memory.objects[int(np.argmin(np.linalg.norm(self.memory.places - (x, floor_y, z), axis=1)))]
        index = next(
            index
            for index, storey in enumerate(self._home.storeys)
            if isinstance(storey.memory, ObjectMap) and any(item is thing for item in storey.memory.objects)
        )
        return FoundPlace(thing.centre, index, thing.centre[1] - self._home.storeys[index].floor_y, found.score)


def encoder_of_queries(memory: Memory, encoder: EncoderName, *, options: ModelOptions | None = None) -> TextEncoder:
    """The encoder of this name in the space of the map, which oracle perception may have made.

    Args:
        options: Options of a real model.

    Raises:
        AgentError: The encoder is unknown, or cannot be loaded.
    """
    is_perceived = memory.encoder.endswith(ORACLE_SUFFIX) and not encoder.endswith(ORACLE_SUFFIX)
    return make_encoder(encoder + ORACLE_SUFFIX if is_perceived else encoder, options=options)


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
    asked = home.storey_near(-np.inf if storey_y is None else storey_y).memory
    asker = Asker(
        home,
        encoder=encoder_of_queries(asked, encoder) if isinstance(encoder, str) else encoder,
        phrases=make_phrases(phrases) if isinstance(phrases, str) else phrases,
        method=method,
        storey_y=storey_y,
    )
    return asker.ask(query, description=description).grounding

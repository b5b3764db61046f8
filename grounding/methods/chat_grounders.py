"""Grounders that ask a chat model once for each episode: `object-list-llm`, `map-image-vlm` and `frames-vlm`.

Map of objects as JSON, map as a picture, or key frames of the exploration -> prompt with the task's description and
query -> the model's JSON -> places. A prompt holds nothing else: no goal, no phrase of the dataset, and no caption that
perception did not give. Where no answer can be used, a method without a model answers, and the answer says so.
"""

import json
from collections.abc import Sequence
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Len
from pydantic import BaseModel, Field

from sim.errors import AgentError
from sim.types import Frame, GridSpec, Task

from ..chat.answers import read_answer
from ..chat.protocol import Chat, NoAnswer, Part
from ..encoders.protocol import TextEncoder
from ..maps.home_map import (
    Memory,
    MemoryKind,
    ObjectInstance,
    ObjectMap,
    OccupancyGrid,
    floors_below,
    require_grid,
    require_objects,
)
from ..maps.storeys import points_at
from ..phrases.rules import RulePhrases
from ..types import Grounding
from .baselines import NUM_CANDIDATES, candidates_at
from .map_picture import numbered_map
from .matching import MATCHERS, OBJECT_MATCHERS, ObjectMatcher, PhraseMatcher

CHAT_METHODS: dict[str, MemoryKind] = {"object-list-llm": "objects", "map-image-vlm": "objects", "frames-vlm": "grid"}
"""The methods, and the kind of map that each takes."""
STANDS_IN = {"object-list-llm": "object-phrase", "map-image-vlm": "object-phrase", "frames-vlm": "phrase"}
"""The method without a model that answers where the model gives nothing to use; rules read its phrases."""
MOST_THINGS = 200
"""Things in a prompt, those seen most often: a list of 200 has some 8,000 tokens."""
MOST_FRAMES = 16
"""Key frames in a prompt."""
_NEAR_PIXELS = 4
"""Pixels around a named one whose depth counts where its own is missing."""
_TASK = "People live in this home. The description says who owns what. Find the object that the query means."
_THINGS_ANSWER = (
    'Answer with one JSON object and nothing else: {"ids": [best, second, third]}, the numbers of one to three objects '
    "of the list, the most probable first."
)
LIST_PROMPT = f"""You get a description of a home, a query, and a list of the objects that a robot found there as JSON.
{_TASK}
Each object has an id, the words that the robot's perception has for it, the middle of its box (x, z and height above
the floor, metres) and its size (along x, height, along z, metres). Objects with close x and z are near each other, if
they are on the same storey (1 is the lowest; one storey is not named).
{_THINGS_ANSWER}"""
PICTURE_PROMPT = f"""You get a description of a home, a query, and a map that a robot made, seen from above.
{_TASK}
White is free floor, dark grey are walls and obstacles, light grey is unknown. Coloured areas are objects with their
numbers; the colours mean nothing. Below is a list with the words that the robot's perception has for each number.
{_THINGS_ANSWER}"""
FRAMES_PROMPT = f"""You get a description of a home, a query, and pictures that a robot took on its way through it.
{_TASK}
Point at it in the picture that shows it best: x is the number of pixels from the left side of the picture, y from its
upper side. Answer with one JSON object and nothing else: {{"places": [{{"frame": number, "x": pixels, "y": pixels}}]}},
one to three places, the most probable first."""


class _Ids(BaseModel):
    """The answer to a question about things."""

    ids: Annotated[tuple[int, ...], Len(1)]


class _FramePixel(BaseModel):
    """A pixel of a picture."""

    frame: int
    x: Annotated[float, Field(allow_inf_nan=False)]
    y: Annotated[float, Field(allow_inf_nan=False)]


class _Places(BaseModel):
    """The answer to a question about pictures."""

    places: Annotated[tuple[_FramePixel, ...], Len(1)]


class Seen(Protocol):
    """What the robot knows beside the map; ours is `grounding.evaluation.seen_home`."""

    def floors(self, memory: Memory) -> Sequence[tuple[float, OccupancyGrid]]:
        """Height (metres) and floor of each storey of the memory, lowest first."""
        ...

    def key_frames(self, memory: Memory) -> Sequence[Frame]:
        """At most MOST_FRAMES views of the memory's storeys, in the order of the walk."""
        ...


class ChatGrounder:
    """Asks a chat model about a map of objects, or about pictures."""

    uses_phrases = False

    def __init__(self, encoder: TextEncoder, *, name: str, chat: Chat | None = None, seen: Seen | None = None) -> None:
        """Asks nothing yet.

        Args:
            encoder: The map's encoder, for the method that answers where the model does not.
            name: One of CHAT_METHODS.
            chat: The model; without it, the grounder only tells its properties.
            seen: Floors and pictures, for the methods that show them.
        """
        self.name = name
        self.takes: MemoryKind = CHAT_METHODS[name]
        self.frame = "points on pictures of the exploration" if self.takes == "grid" else "middles of the map's objects"
        self._encoder, self._chat, self._seen = encoder, chat, seen
        self._rules = RulePhrases()
        self._drawn: tuple[ObjectMap, list[Part]] | None = None
        self._other = (
            PhraseMatcher(encoder, name="phrase", options=MATCHERS["phrase"])
            if self.takes == "grid"
            else ObjectMatcher(encoder, name="object-phrase", temperature=OBJECT_MATCHERS["object-phrase"])
        )

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """One to three places of the model, best first; those of `phrase` or `object-phrase` where it gives none.

        Args:
            memory: A map of the kind that it takes.
            task: Description and queries; the first query counts.
            phrases: Not used: the model reads the description. The method that stands in reads it by rules.

        Raises:
            AgentError: There is no model, the server refuses it, or the budget is spent; or the map is of the other
                kind, or none of its objects has a caption.
        """
        if self._chat is None:
            raise AgentError(
                f"--method is {self.name!r} without a model; expected one. Give --llm-url and --llm-model."
            )
        if isinstance(memory, ObjectMap) and not memory.objects:
            return Grounding(())
        try:
            points, grid = self._answered(self._chat, memory, task)
        except NoAnswer:
            found = self._other.ground(memory, task, self._rules.phrases(task))
            return Grounding(found.candidates, found.layers, fell_back=True)
        return Grounding(candidates_at(grid, points, 1 / np.arange(1, len(points) + 1)))

    def _answered(self, chat: Chat, memory: Memory, task: Task) -> tuple[np.ndarray, GridSpec]:
        """World points (M, 3) on the floor, best first, and the map's grid; NoAnswer where the model gives none."""
        if self.takes == "grid":
            grid_map = require_grid(memory, self.name, self._encoder)
            frames = self._required_seen().key_frames(memory)
            answer = read_answer(chat.ask(FRAMES_PROMPT, frames_question(task, frames), is_json=True), _Places)
            floors = np.unique([grid_map.floor_y, *grid_map.cell_y])
            return np.array([_lifted(place, frames, floors) for place in answer.places[:NUM_CANDIDATES]]), grid_map.grid
        objects = require_objects(memory, self.name, self._encoder)
        things = numbered_things(objects)
        if not any(item.caption for _, item in things):
            raise AgentError(
                f"--method {self.name}: none of the map's {len(things)} objects has a caption; expected words for the "
                "model to read. Use perception that gives names, or --method frames-vlm."
            )
        if self.name == "object-list-llm":
            answer = chat.ask(LIST_PROMPT, [_asked(task), things_json(objects)], is_json=True)
        else:
            answer = chat.ask(PICTURE_PROMPT, [_asked(task), *self._maps(objects)], is_json=True)
        return _named_places(read_answer(answer, _Ids), objects), objects.grid

    def _required_seen(self) -> Seen:
        if self._seen is None:
            raise AgentError(
                f"--method {self.name}: has no view of the home beside its map; expected an explored home. Give "
                "--map explore."
            )
        return self._seen

    def _maps(self, memory: ObjectMap) -> list[Part]:
        """Each storey's picture with its list; drawn once for a memory."""
        if not self._drawn or self._drawn[0] is not memory:
            self._drawn = (memory, map_parts(memory, self._required_seen().floors(memory)))
        return self._drawn[1]


def map_parts(memory: ObjectMap, floors: Sequence[tuple[float, OccupancyGrid]]) -> list[Part]:
    """Each storey's picture with the words for its numbers; storeys without things are left out."""
    things, heights = numbered_things(memory), np.array([height for height, _ in floors])
    storeys = floors_below(np.array([item.centre[1] for _, item in things]), heights)
    parts: list[Part] = []
    for index, (_, floor) in enumerate(floors):
        here = [things[k] for k in np.flatnonzero(storeys == index)]
        if not here:
            continue
        picture, view = numbered_map(here, floor)
        words = "\n".join(f"{number}: {item.caption or 'unknown'}" for number, item in here)
        storey = f"Storey {index + 1} of {len(floors)}, the lowest first. " if len(floors) > 1 else ""
        parts += [f"{storey}Map, {view.scale:.0f} pixels for a metre:", picture, f"Objects on it:\n{words}"]
    return parts


def numbered_things(memory: ObjectMap) -> list[tuple[int, ObjectInstance]]:
    """The things of a prompt with their numbers from 1, in the map's order; of too many, those seen most often."""
    return list(enumerate((memory.objects[index] for index in _shown(memory)), start=1))


def _shown(memory: ObjectMap) -> list[int]:
    """Indices of the things of a prompt, ascending."""
    return sorted(sorted(range(len(memory.objects)), key=lambda index: -memory.objects[index].weight)[:MOST_THINGS])


def things_json(memory: ObjectMap) -> str:
    """The list of things that the model reads, one line each; with their storeys where the map holds several."""
    lines = []
    shown = _shown(memory)
    places, storeys = memory.places[shown], memory.storeys[shown]
    for (number, item), (x, floor_y, z), storey in zip(numbered_things(memory), places, storeys, strict=True):
        low, high = np.array(item.box)
        entry = {
            "id": number,
            "caption": item.caption or "unknown",
            **({"storey": int(storey) + 1} if memory.upper_floors else {}),
            "x": round(float(x), 1) + 0.0,
            "z": round(float(z), 1) + 0.0,
            "height": round(item.centre[1] - float(floor_y), 1) + 0.0,
            "size": [round(side, 1) for side in (high - low).tolist()],
        }
        lines.append(json.dumps(entry, ensure_ascii=False))
    return "[" + ",\n".join(lines) + "]"


def frames_question(task: Task, frames: Sequence[Frame]) -> list[Part]:
    """The task, then each picture with its number and size."""
    parts: list[Part] = [f"{_asked(task)}\n\nThere are {len(frames)} pictures."]
    for number, frame in enumerate(frames, start=1):
        height, width = frame.rgb.shape[:2]
        parts += [f"Frame {number}, {width} pixels wide and {height} high:", frame.rgb]
    return parts


def _asked(task: Task) -> str:
    return f"Description: {task.description}\n\nQuery: {task.queries[0]}"


def _named_places(answer: _Ids, memory: ObjectMap) -> np.ndarray:
    """(M, 3) the named things' middles on the floor below them, each once."""
    ids, shown = answer.ids[:NUM_CANDIDATES], _shown(memory)
    unknown = [number for number in ids if not 1 <= number <= len(shown)]
    if unknown:
        raise NoAnswer(f"the answer names {unknown[0]}, and the objects have the numbers 1 to {len(shown)}")
    return memory.places[[shown[number - 1] for number in dict.fromkeys(ids)]]


def _lifted(place: _FramePixel, frames: Sequence[Frame], floors: np.ndarray) -> np.ndarray:
    """(3,) the point that a picture shows at a pixel or the nearest one with depth, on the floor where the robot stood.

    Args:
        place: The pixel.
        frames: The pictures.
        floors: (F,) heights of the map's floors, metres.
    """
    if not 1 <= place.frame <= len(frames):
        raise NoAnswer(f"the answer names frame {place.frame}, and there are {len(frames)}")
    frame = frames[place.frame - 1]
    height, width = frame.depth_m.shape
    if not (0 <= place.x <= width and 0 <= place.y <= height):
        raise NoAnswer(f"the answer names pixel {place.x:g}, {place.y:g}, and frames have {width} x {height}")
    row, col = min(int(place.y), height - 1), min(int(place.x), width - 1)
    top, left = max(0, row - _NEAR_PIXELS), max(0, col - _NEAR_PIXELS)
    window = frame.depth_m[top : row + _NEAR_PIXELS + 1, left : col + _NEAR_PIXELS + 1]
    near = np.argwhere(window > 0) + np.array((top, left))
    if not len(near):
        raise NoAnswer(f"the answer names pixel {place.x:g}, {place.y:g} of frame {place.frame}, where nothing is seen")
    nearest = near[np.argmin(np.abs(near - (row, col)).sum(axis=1))]
    x, _, z = points_at(frame, nearest[None])[0].tolist()
    stood_y = frame.T_world_camera[1, 3] - frame.camera.mount_height
    return np.array([x, floors[np.argmin(np.abs(floors - stood_y))], z])

"""Names inside a recording: entity paths, timelines, ids. Light; every other module of `recordings` uses these."""

import re
from typing import NamedTuple

from sim.types import EpisodeKey

APPLICATION_ID = "personal-viz"
"""Name of the application; Rerun shows all recordings of one application with one blueprint."""
SCENE = "/scene"
MESH = "/scene/mesh"
TOPDOWN = "/scene/topdown"
GOAL = "/goal"
TASK = "/task"
TOLD, OWNERS = "/sequence/told", "/sequence/owners"
"""Of a home sequence: messages and queries as a log, and who owns what as a graph."""
"""The edges of that graph that hold since the last message."""
MEMORY = "/memory"
"""Root of the maps that explorations made, by name (memory.py)."""
RUNS = "/runs"
LAYERS = "layers"
"""Part of a path: `layers/<layer>/<storey>` below a run, `layers/<layer>` below its map of a storey."""
RECORD = "record"
"""Part of a path below a run: the lines of its run file (read.py)."""
STEP = "step"
"""Timeline: number of actions taken, 0 at the start."""
PATH_M = "path_m"
"""Timeline: metres walked. Rerun has no timeline of lengths: one second of this duration is one metre."""
TIME_S = "time_s"
"""Timeline: seconds since the episode's start; absent from runs that measured no time."""
TOGETHER = "together"
"""Timeline of home sequences: number of actions, where every run begins each search at the same moment."""
TIMELINES = (STEP, PATH_M, TIME_S, TOGETHER)


class ExplorationKey(NamedTuple):
    """Names one exploration of a home's storey, which has no episode and no goal."""

    scene: str
    storey: int
    """Index from the lowest."""
    seed: int

    def __str__(self) -> str:
        return f"explore/{self.scene}/storey{self.storey}/seed{self.seed}"


class MapKey(NamedTuple):
    """Names a recording of a map alone."""

    name: str

    def __str__(self) -> str:
        return f"map/{self.name}"


class SequenceRecordingKey(NamedTuple):
    """Names a recording of a home sequence."""

    sequence: EpisodeKey
    """The sequence, named as an episode is."""

    def __str__(self) -> str:
        return f"sequence/{self.sequence}"


RecordingKey = EpisodeKey | ExplorationKey | MapKey | SequenceRecordingKey
"""A key that names a recording."""


def recording_id(key: RecordingKey) -> str:
    """Id of a recording; several files of one episode have one id and open as one recording."""
    return f"personal/{key}"


def file_name(key: RecordingKey) -> str:
    """Name of a recording's file in a folder of recordings."""
    return f"{str(key).replace('/', '-')}.rrd"


def escape_part(name: str) -> str:
    """A text as one part of an entity path (Rerun's rule: a backslash before all but letters, digits, `_`, `-`, `.`).

    Control characters would break the path's text form and become `_`.
    """
    return re.sub(r"([^\w.-])", r"\\\1", re.sub(r"[\x00-\x1f\x7f]", "_", name))


def run_path(label: str, *parts: str) -> str:
    """Entity of a run: `/runs/<label>/<parts>`; the label is escaped, the parts are ours."""
    return "/".join((RUNS, escape_part(label), *parts))


def memory_path(name: str, *parts: str) -> str:
    """Entity of a map: `/memory/<name>/<parts>`; the name is escaped, the parts are ours."""
    return "/".join((MEMORY, escape_part(name), *parts))


def asked_path(name: str, view: str, storey: str, number: int) -> str:
    """Entity of a question's answer on a map's storey, in the `map` or `home` view; questions are numbered from 0."""
    return memory_path(name, view, storey, f"asked_{number + 1}")


def map_entity(storey: str) -> str:
    """Entity of a storey's picture from above; `storey` is its name (sim/plan_view/storey.py)."""
    return f"{TOPDOWN}/{storey}"

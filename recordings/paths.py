"""Names inside a recording: entity paths, timelines, ids. Light; every other module of `recordings` uses these."""

import re

from sim.types import EpisodeKey

APPLICATION_ID = "personal-viz"
"""Rerun shows recordings of one application with one blueprint."""
SCENE = "/scene"
MESH = "/scene/mesh"
TOPDOWN = "/scene/topdown"
GOAL = "/goal"
TASK = "/task"
RUNS = "/runs"
RECORD = "record"
"""Below a run: the lines of its run file (log_record.py)."""
STEP = "step"
"""Timeline: number of actions taken, 0 at the start."""
PATH_M = "path_m"
"""Timeline: metres walked. Rerun has no timeline of lengths: one second of this duration is one metre."""
TIME_S = "time_s"
"""Timeline: seconds since the episode's start; absent from runs that measured no time."""
TIMELINES = (STEP, PATH_M, TIME_S)


def recording_id(key: EpisodeKey) -> str:
    """Id of the one recording of an episode; files of one episode open as one recording."""
    return f"personal/{key}"


def escape_part(name: str) -> str:
    """A text as one part of an entity path (Rerun's rule: a backslash before all but letters, digits, `_`, `-`, `.`).

    Control characters would break the path's text form and become `_`.
    """
    return re.sub(r"([^\w.-])", r"\\\1", re.sub(r"[\x00-\x1f\x7f]", "_", name))


def run_path(label: str, *parts: str) -> str:
    """Entity of a run: `/runs/<label>/<parts>`; the label is escaped, the parts are ours."""
    return "/".join((RUNS, escape_part(label), *parts))


def storey_part(index: int) -> str:
    """Name of a storey's entities, index from the lowest."""
    return f"storey_{index}"

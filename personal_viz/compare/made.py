"""What an episode's folder holds, and whether it was made from the same as now. Light."""

import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from sim.types import EpisodeKey

MADE, RECORDING, SHEET, THUMBNAIL = "made.json", "replay.rrd", "sheet.png", "thumb.jpg"
FORMAT = 2
"""Raised when the same runs make other files."""


class Made(BaseModel):
    """`made.json`: what the files beside it were made from."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    inputs: str
    """sha256 of runs, episode files, options and programs."""
    scene_digest: str
    """Version of the home."""


def folder_name(key: EpisodeKey, suffix: str) -> str:
    """Name of an episode's folder."""
    return f"{key.split}-{key.scene}-{key.episode_id}{suffix}"


def inputs_digest(parts: Mapping[str, object]) -> str:
    """`Made.inputs`: of what the caller names, and of the programs that write the files."""
    programs = {name: version(name) for name in ("personal-viz", "rerun-sdk", "matplotlib")}
    named = sorted({**parts, **programs, "format": FORMAT}.items())
    return hashlib.sha256(repr(named).encode()).hexdigest()


def is_made(folder: Path, inputs: str) -> bool:
    """Whether the folder holds everything, made from these inputs."""
    try:
        made = Made.model_validate_json((folder / MADE).read_bytes())
    except (OSError, ValidationError):
        return False
    return made.inputs == inputs and all((folder / name).is_file() for name in (RECORDING, SHEET, THUMBNAIL))

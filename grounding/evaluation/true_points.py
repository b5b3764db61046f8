"""Scores free-text answers against points that a user measured: a file of queries, in the paper's layout.

One JSON object per line: {"query": "Lily's backpack", "points": [[1.2, 0.4, -3.0]], "split": "easy", "radius": 1.0,
"frame": "recording", "description": "Lily owns ..."}; only `query` and `points` are needed.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Len
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.episodes.schema import Vector3
from sim.errors import DatasetError, line_from_validation_error
from sim.files import bounded_lines
from sim.frames import planar_distance
from sim.types import SPLITS, SUCCESS_RADIUS, Split
from sim.walk.storeys import storey_of

from ..maps.home_map import HomeMemory
from ..methods.free_text import Reply

_ADVICE = 'Write one JSON object per line, such as {"query": "Lily\'s backpack", "points": [[1.2, 0.4, -3.0]]}.'
TOTAL = "total"


class TrueQuery(BaseModel):
    """One line: a question and where its objects truly are."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    query: Annotated[str, Len(1)]
    points: Annotated[tuple[Vector3, ...], Len(1)]
    """Middles of the objects that are right, metres."""
    radius: float = Field(default=SUCCESS_RADIUS, gt=0)
    """An answer is right within this planar distance (metres) on the same storey."""
    split: Split = "easy"
    frame: Literal["recording", "map"] = "recording"
    """Frame of the points; on maps of homes both are the world."""
    description: str | None = None
    """Paragraph about the owners; None = that of the command line."""


class AskedScore(BaseModel):
    """One answer beside its truth."""

    query: str
    split: Split
    distance: float | None
    """Planar metres from the first answer to the nearest true point of its storey; None = another storey, or none."""
    success: bool
    top3: bool
    """Whether one of the three places is right."""


def read_true_points(path: Path) -> list[TrueQuery]:
    """The lines of a file.

    Raises:
        DatasetError: The file cannot be read, holds no line, or a line has another form.
    """
    found, number = [], 0
    try:
        for line in bounded_lines(path):
            number += 1
            if line.strip():
                found.append(TrueQuery.model_validate_json(line))
    except ValidationError as error:
        raise DatasetError(line_from_validation_error(f"{path}:{number}", error, advice=_ADVICE)) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror}); expected a text file. {_ADVICE}") from None
    if not found:
        raise DatasetError(f"{path}: holds no line; expected at least one query. {_ADVICE}")
    return found


def score_reply(
    reply: Reply, truth: TrueQuery, home: HomeMemory, *, T_map_recording: NDArray[np.float64] | None
) -> AskedScore:
    """The distances of a reply's places from the true points.

    Args:
        T_map_recording: (4, 4) recording's frame -> map frame; None = they are one.
    """
    points = np.array(truth.points, float)
    if truth.frame == "recording" and T_map_recording is not None:
        points = points @ T_map_recording[:3, :3].T + T_map_recording[:3, 3]
    floors = [(storey.floor_y, storey.floor_y) for storey in home.storeys]
    storeys = [storey_of(y, floors) for y in points[:, 1].tolist()]
    distances = [
        min(
            (
                planar_distance(place.position, point)
                for point, storey in zip(points.tolist(), storeys, strict=True)
                if storey == place.storey
            ),
            default=math.inf,
        )
        for place in reply.places[:3]
    ]
    first = distances[0] if distances else math.inf
    return AskedScore(
        query=truth.query,
        split=truth.split,
        distance=first if math.isfinite(first) else None,
        success=first <= truth.radius,
        top3=any(distance <= truth.radius for distance in distances),
    )


def scored_table(scores: Sequence[AskedScore]) -> dict[str, dict[str, float | int | None]]:
    """`n`, and percent `sr` and `top3`, by split and in total: the plain mean of the splits, as in the paper."""
    by_split = {split: [score for score in scores if score.split == split] for split in SPLITS}
    table: dict[str, dict[str, float | int | None]] = {
        "n": {**{split: len(found) for split, found in by_split.items()}, TOTAL: len(scores)}
    }
    for name in ("sr", "top3"):
        field = "success" if name == "sr" else name
        shares: dict[str, float | int | None] = {
            split: 100 * sum(getattr(score, field) for score in found) / len(found) if found else None
            for split, found in by_split.items()
        }
        known = [share for share in shares.values() if share is not None]
        table[name] = {**shares, TOTAL: sum(known) / len(known) if known else None}
    return table

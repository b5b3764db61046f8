"""Small handmade runs of POG: whose answers are right, and how far off they are."""

from collections.abc import Sequence

from sim.tasks.run_files import Answer, AnswerMeasures, Run
from sim.types import EpisodeKey

from ..sim.worlds import run_info

CONFIG = {"map": "oracle", "encoder": "hashed", "all_storeys": False, "phrases": "none"}


def answer_to(
    key: EpisodeKey,
    distance: float | None,
    *,
    top3: bool | None = None,
    others: tuple[float | None, ...] | None = None,
    participant: str | None = None,
) -> Answer:
    """An answer `distance` metres off, None = on another storey; `others` are those of its other candidates."""
    is_right = distance is not None and distance <= 1
    measures = AnswerMeasures(
        success=is_right,
        top3_success=is_right if top3 is None else top3,
        planar_distance=distance,
        distance_3d=5.0,
        planar_distances=None if others is None else (distance, *others),
    )
    return Answer(
        **key._asdict(),
        candidates=((0.0, 0.0, 0.0),),
        scores=() if participant else (0.5,),
        participant=participant,
        measures=measures,
    )


def run_of(who: str, answers: Sequence[Answer], *, config: dict | None = None, **changes: object) -> Run:
    """A run of `personal-viz ground`."""
    run_id = "-".join([who, str(changes.get("seed", 0)), *map(str, (config or {}).values())])
    values = {"who": who, "scene_kind": "oracle-map", "seed": 0, "config": CONFIG | (config or {}), "git_commit": "abc"}
    return Run(info=run_info(str(changes.pop("run_id", run_id)), **values | changes), answers=tuple(answers))


def keys(split: str, homes: int, each: int) -> list[EpisodeKey]:
    """Keys of `each` episodes in each of `homes` homes."""
    return [EpisodeKey(split, f"Home{home}", str(number)) for home in range(homes) for number in range(each)]

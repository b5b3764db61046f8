"""`plan.json`: who does which trials in which order, made offline from a seed. Holds no secret."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import StudyError, line_from_validation_error
from sim.types import EpisodeKey, Split, TaskKind

from .study import StudyConfig, write_whole

PLAN_FILE = "plan.json"
_MODEL = ConfigDict(frozen=True, extra="forbid")


class PlannedTrial(BaseModel):
    """One trial of one participant."""

    model_config = _MODEL
    order_no: int = Field(ge=1)
    """Place in the participant's order, from 1."""
    task: TaskKind
    split: Split
    scene: str
    episode_id: str

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)


class PlannedParticipant(BaseModel):
    """One participant's trials in order."""

    model_config = _MODEL
    code: str = Field(pattern=r"^p[0-9]{2,}$")
    """Public: p01, p02, ..."""
    trials: tuple[PlannedTrial, ...]


class StudyPlan(BaseModel):
    """The whole plan of one frozen study."""

    model_config = _MODEL
    schema_version: Literal[1] = 1
    study_version: str
    participants: tuple[PlannedParticipant, ...]


def make_plan(
    config: StudyConfig, episodes: Sequence[EpisodeKey], participants: Sequence[TaskKind], *, limit: int | None = None
) -> StudyPlan:
    """Give every participant the same episodes, each in an own order drawn from the study's seed.

    Args:
        episodes: The pool; its order does not matter.
        participants: The task of each participant: ("pog", "pan") makes p01 answer POG and p02 do PAN.
        limit: How many episodes to draw from the pool; None takes all.

    Raises:
        StudyError: The pool is empty, repeats an episode or leaves the study's scenes; a task or the limit is not
            possible.
    """
    pool = sorted(set(episodes))
    _require_plannable(config, episodes, participants, limit=limit)
    drawn = np.random.default_rng(config.seed).permutation(len(pool))[:limit]
    planned = []
    for index, task in enumerate(participants):
        rng = np.random.default_rng([config.seed, index + 1])
        keys = [pool[drawn[place]] for place in rng.permutation(len(drawn))]
        trials = tuple(
            PlannedTrial(order_no=number, task=task, split=key.split, scene=key.scene, episode_id=key.episode_id)
            for number, key in enumerate(keys, start=1)
        )
        planned.append(PlannedParticipant(code=f"p{index + 1:02d}", trials=trials))
    return StudyPlan(study_version=config.study_version, participants=tuple(planned))


def save_plan(folder: Path, plan: StudyPlan) -> Path:
    """Write `plan.json`; returns its path.

    Raises:
        StudyError: The folder cannot be written.
    """
    path = folder / PLAN_FILE
    write_whole(path, plan.model_dump_json(indent=2) + "\n")
    return path


def load_plan(folder: Path, config: StudyConfig) -> StudyPlan:
    """Read `plan.json` of a study folder.

    Raises:
        StudyError: The file is missing, not valid, or made for another study.
    """
    path = folder / PLAN_FILE
    try:
        plan = StudyPlan.model_validate_json(path.read_bytes(), strict=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected a plan. Run personal-viz study init first."
        ) from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice="Make the plan again.")) from None
    if plan.study_version != config.study_version:
        raise StudyError(
            f"{path}: study_version is {plan.study_version[:12]}; expected {config.study_version[:12]}. "
            "Make the plan again for this study."
        )
    return plan


def _require_plannable(
    config: StudyConfig, episodes: Sequence[EpisodeKey], participants: Sequence[TaskKind], *, limit: int | None
) -> None:
    """Raises StudyError unless each episode is named once, lies in the study's scenes and each task is the study's."""
    if not episodes or len(set(episodes)) != len(episodes):
        raise StudyError(
            f"study {config.study}: found {len(episodes)} episodes, {len(set(episodes))} of them different; "
            "expected at least one, each once. Correct the list of episodes."
        )
    for key in episodes:
        config.scene_kind(key.scene)
    for task in participants:
        if task not in config.tasks:
            raise StudyError(
                f"study {config.study}: a participant's task is {task!r}; expected one of {list(config.tasks)}. "
                "Add the task to the study or leave the participant out."
            )
    if limit is not None and not 1 <= limit <= len(episodes):
        raise StudyError(
            f"study {config.study}: limit is {limit}; expected 1 to {len(episodes)}, the number of episodes. "
            "Give another limit."
        )

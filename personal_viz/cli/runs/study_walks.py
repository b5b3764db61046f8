"""The walks of an agent on what a study's people do: the same episodes, terms and looks at the home, by condition."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from human_study.design.plan import AGENT_RUNS
from human_study.design.study import Condition
from human_study.export.runs import run_condition
from sim.errors import StudyError
from sim.tasks.looks import LookKind
from sim.tasks.runner import WalkTerms
from sim.types import EpisodeKey

from ...study_app.home.agent_looks import StudyLook
from ...study_app.planned_study import PlannedStudy
from ..grounding.ground import EXPLORATIONS

NO_EXPOSURE = "no exposure"
"""Condition of agents that stand beside people who saw the home before, and did not see it."""
_LOOKS: Mapping[Condition, LookKind] = {"topdown": "topdown", "glb": "glb"}


@dataclass(frozen=True, slots=True)
class StudyWalk:
    """Conditions of people in which an agent does the same; its results stand beside those of all of them."""

    conditions: tuple[Condition, ...]
    keys: tuple[EpisodeKey, ...]
    """The episodes of these conditions, sorted."""
    look_at: StudyLook | None
    """The look at the home before each episode; None = none."""

    @property
    def condition(self) -> str:
        """The condition of the agent's run: as people's, or that it saw nothing where people did."""
        if self.look_at is not None or self.conditions == ("none",):
            return run_condition(self.conditions[0])
        return NO_EXPOSURE


def agent_runs(study: PlannedStudy, out: Path | None) -> Path:
    """The folder of the runs of agents: `out`, or the study's own, where `study report` finds them."""
    return out or study.folder / AGENT_RUNS


def study_walks(study: PlannedStudy, looks: frozenset[LookKind], *, out: Path, seed: int) -> list[StudyWalk]:
    """One walk without a look, and one for each of the study's looks that the agent can take.

    Args:
        study: The study.
        looks: Looks that the agent can take.
        out: Folder of the runs, and of the explorations whose views an agent sees instead of the 3-D model.
        seed: Seed of these explorations; `ground` with the same seed makes its maps from the same ones.

    Raises:
        StudyError: Nobody walks in the study.
    """
    camera = study.config.robot_camera
    blind: dict[Condition, tuple[EpisodeKey, ...]] = {}
    walks = []
    for condition, keys in study.episodes("pan").items():
        kind = _LOOKS.get(condition)
        if kind in looks:
            walks.append(StudyWalk((condition,), keys, StudyLook(kind, camera, out / EXPLORATIONS, seed)))
        else:
            blind[condition] = keys
    if blind:
        keys = tuple(sorted({key for found in blind.values() for key in found}))
        walks.insert(0, StudyWalk(tuple(sorted(blind, key=_none_first)), keys, None))
    return walks


def walk_terms(study: PlannedStudy) -> WalkTerms:
    """The limits, actions, texts and camera that people have."""
    config = study.config
    return WalkTerms(config.action_set, config.steps, config.query_index, config.robot_camera)


def _none_first(condition: Condition) -> tuple[bool, str]:
    return condition != "none", condition


def require_plans_choices(options: Mapping[str, object]) -> None:
    """Refuses options beside `--study` that say what the plan says.

    Args:
        options: Their values by field name; what is empty, 0 or `off` was not given.

    Raises:
        StudyError: One was given.
    """
    for name, value in options.items():
        if value not in (None, (), 0, "off", False):
            raise StudyError(
                f"--{name.replace('_', '-')}: found {value!r} beside --study; expected none, because the study's "
                "plan names its episodes and homes. Leave it out."
            )

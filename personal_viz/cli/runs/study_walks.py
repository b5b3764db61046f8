"""The walks of an agent on what a study's people do: the same episodes or home sequences, terms and looks at homes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from human_study.design.study import Condition
from human_study.export.runs import NO_EXPOSURE, run_condition, study_facts
from sim.tasks.looks import LookKind
from sim.tasks.runner import WalkTerms
from sim.types import EpisodeKey

from ...study_app.home.agent_looks import StudyLook
from ...study_app.planned_study import PlannedStudy
from ..grounding.ground import EXPLORATIONS
from .sequence_walks import SequenceWalks

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
        """The condition of the agent's run: as people's, or that it saw nothing where all of them did."""
        return run_condition(self.conditions[0]) if self.look_at or "none" in self.conditions else NO_EXPOSURE


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


def walks_of_study(study: PlannedStudy, *, out: Path) -> SequenceWalks:
    """The home sequences that people walk, once whatever the condition; results go below `out`.

    Raises:
        StudyError: Nobody walks in the study.
    """
    assert study.sequences is not None, "a study of episodes"
    by_condition, config, home = study.episodes("pan"), study.config, study.scenes("pan")[0]
    return SequenceWalks(
        study.dataset,
        study.scenes_dir,
        study.sequences,
        study.keys("pan"),
        home.clutter,
        home.labels,
        out,
        walk_terms(study),
        config.study,
        {"actions": config.actions, "max_steps": config.steps, **study_facts(config, tuple(by_condition))},
    )


def walk_terms(study: PlannedStudy) -> WalkTerms:
    """The limits, actions, texts and camera that people have."""
    config = study.config
    return WalkTerms(config.action_set, config.steps, config.query_index, config.robot_camera)


def _none_first(condition: Condition) -> tuple[bool, str]:
    return condition != "none", condition

"""`ground --study`: what a study's people point at."""

from pathlib import Path
from typing import Any

from grounding.encoders.protocol import ModelOptions
from grounding.evaluation.evaluate import GroundJob, select_jobs
from grounding.evaluation.home_maps import MapFolders
from grounding.evaluation.settings import GroundSettings
from human_study.export.runs import study_facts
from sim.tasks.run_files import RunInfo, fitting_run_id

from ...study_app.planned_study import PlannedStudy


def study_places(study: PlannedStudy, *, explores: bool, out: Path) -> dict[str, Any]:
    """The options of `ground` by which it asks what the study's people are asked, in their homes.

    Args:
        study: The study.
        explores: Whether homes are explored for the maps; only then does it matter what lies about in them.
        out: Folder of the runs.
    """
    homes = study.scenes("pog")
    return {
        "study": None,
        "sequences": study.sequences,
        "dataset": study.dataset.root,
        "evidence": tuple(edition.root for edition in study.dataset.evidence),
        "scenes_dir": study.scenes_dir,
        "scene": tuple(home.name for home in homes),
        "clutter": homes[0].clutter if explores else 0,
        "all_storeys": True,
        "out": out,
    }


def study_jobs(
    study: PlannedStudy, settings: GroundSettings, *, folders: MapFolders | None, model: ModelOptions
) -> list[GroundJob]:
    """One job per scene, on the plan's episodes."""
    keys, index = study.keys("pog"), study.config.query_index
    return select_jobs(study.dataset, settings, folders=folders, model=model, keys=keys, query_index=index)


def study_info(study: PlannedStudy, info: RunInfo, *, is_named: bool) -> RunInfo:
    """The contents of run.json, with the study and all its conditions: a grounder answers alike in each."""
    config, clutter = study.config, study.scenes("pog")[0].clutter
    facts = {"clutter": clutter, **study_facts(config, tuple(study.episodes("pog")))}
    run_id = info.run_id if is_named else fitting_run_id(f"{config.study}-{info.run_id}")
    return info.model_copy(update={"run_id": run_id, "config": {**info.config, **facts}})

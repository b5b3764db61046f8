"""`ground --study`: what a study's people point at."""

from dataclasses import dataclass

from grounding.evaluation.evaluate import GroundJob, select_jobs
from grounding.evaluation.settings import GroundSettings
from human_study.export.runs import study_facts
from sim.episodes.dataset import PersonalDataset
from sim.tasks.run_files import RunInfo, fitting_run_id

from ...study_app.planned_study import PlannedStudy
from .ground import Ground


@dataclass
class GroundStudy(Ground):
    """`Ground` on the episodes of a planned study; its other options are those of the plan."""

    planned: PlannedStudy | None = None

    def _work(self, episodes: PersonalDataset, settings: GroundSettings, info: RunInfo) -> list[GroundJob]:
        """One job per scene."""
        assert self.planned is not None
        keys = sorted({key for found in self.planned.episodes("pog").values() for key in found})
        index = self.planned.config.query_index
        return select_jobs(
            episodes,
            settings,
            folders=self._folders(settings, info),
            model=self._model,
            keys=keys,
            query_index=index,
        )

    def _info(self, episodes: PersonalDataset, settings: GroundSettings) -> RunInfo:
        """The contents of run.json, with the study and all its conditions: a grounder answers alike in each."""
        assert self.planned is not None
        config, info = self.planned.config, super()._info(episodes, settings)
        clutter = self.planned.scenes("pog")[0].clutter
        facts = {"clutter": clutter, **study_facts(config, tuple(self.planned.episodes("pog")))}
        run_id = info.run_id if self.run_id else fitting_run_id(f"{config.study}-{info.run_id}")
        return info.model_copy(update={"run_id": run_id, "config": {**info.config, **facts}})

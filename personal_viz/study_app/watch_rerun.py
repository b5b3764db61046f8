"""Observers that stream the trials of a study into Rerun: one recording per trial, for the researcher."""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.design.study import StudyConfig
from human_study.export.runs import trial_run_info
from human_study.store.store import Trial
from recordings.observer import AnswerObserver, RerunObserver
from recordings.paths import APPLICATION_ID
from recordings.sinks import LiveSink
from sim.mesh import Scene
from sim.tasks.run_files import RunInfo


class RerunObservers:
    """Makes the observer of each trial, for `watch.Watches`."""

    def __init__(
        self, scene: Scene, config: StudyConfig, where: str, *, with_pixels: bool, is_pilot: bool = False
    ) -> None:
        """Opens nothing yet.

        Args:
            scene: The home of the trials.
            config: The study.
            where: A folder, or the address of a viewer (`rerun+http://HOST:PORT/proxy`).
            with_pixels: Whether geometry, maps and pictures of a licensed scan are shown.
            is_pilot: Whether the study was planned as a pilot.
        """
        self._scene, self._config, self._where, self._with_pixels = scene, config, where, with_pixels
        self._is_pilot = is_pilot

    def of_walk(self, trial: Trial) -> RerunObserver:
        """The observer of a PAN trial."""
        return RerunObserver(
            self._scene,
            self._sink(trial),
            self.run_info(trial),
            with_pixels=self._with_pixels,
            camera=self._config.robot_camera,
            participant=trial.code,
        )

    def of_answer(self, trial: Trial) -> AnswerObserver:
        """The observer of a POG trial."""
        return AnswerObserver(
            self._scene,
            self._sink(trial),
            self.run_info(trial),
            with_pixels=self._with_pixels,
            participant=trial.code,
        )

    def run_info(self, trial: Trial) -> RunInfo:
        """The `run.json` that `personal-viz study export` writes, but with the participant's code in the study."""
        return trial_run_info(
            self._config,
            StudyScene(
                name=self._scene.name, kind=self._scene.kind, clutter=self._scene.clutter, labels=self._scene.labels
            ),
            trial.code,
            trial.task,
            condition=trial.condition,
            created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
            app_version=version("personal-viz"),
            is_pilot=self._is_pilot,
        )

    def _sink(self, trial: Trial) -> LiveSink:
        """A sink to the viewer, or to the trial's own file, because two participants may do the same episode."""
        if "://" in self._where:
            # recordings of one application share a layout, so each participant and task has its own application
            return LiveSink("address", self._where, application_id=f"{APPLICATION_ID} {trial.code}-{trial.task}")
        split, scene, episode_id = trial.key
        return LiveSink("file", str(Path(self._where) / f"{trial.code}-{split}-{scene}-{episode_id}.rrd"))

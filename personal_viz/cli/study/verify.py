"""Verb `study verify`: replays every finished trial, home by home, and stores the results."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from human_study.design.plan import PRACTICE_FOLDER, StudyPlan, StudyScene, load_plan
from human_study.design.secrets import new_id
from human_study.design.study import Condition, load_study
from human_study.export.verify import verify_trial
from human_study.store.lock import take_lock
from human_study.store.records import StoredTrial, VerificationEntry, read_study
from human_study.store.store import open_store
from personal_viz.study_app.home.trial_homes import open_trial_home, sim_hash
from personal_viz.study_app.study_files import require_same_homes
from personal_viz.study_app.study_sequences import PRACTICE_SET, study_set
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.errors import StudyError
from sim.tasks.workers import SceneJob, results
from sim.types import EpisodeKey

from ...progress import counted
from ..options import Dataset, Evidence, ScenesDir, Sequences
from ..refusals import check_options, require_same_dataset

BATCH = 20
"""Number of episodes that a worker process replays before it returns them."""


@dataclass(frozen=True, slots=True)
class VerifyJob(SceneJob):
    """The finished trials of one home."""

    study: Path
    study_scene: StudyScene
    scenes_dir: Path | None
    sequences: Path | None
    """Set of home sequences of this home, in a study of them."""
    trials: tuple[tuple[EpisodeKey, str, str, Condition], ...]
    """(episode, trial id, participant, planned condition) of each trial."""
    run_id: str


@dataclass
class StudyVerify:
    """Do every finished trial again, step by step, and compare with what is stored; the result is stored too."""

    study: Positional[Path]
    dataset: Dataset
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    sequences: Sequences = None
    jobs: Annotated[int, arg(help="Worker processes, each with homes of its own.")] = 1
    store: Annotated[bool, arg(help="Write the result into the study, unless it is being served.")] = True

    def run(self) -> int:
        check_options(self)
        run_id = new_id()
        with read_study(self.study) as reader:
            reader.check()
            people = [reader.trials(code) for code in reader.codes()]
            config, plan, digest = reader.config, reader.plan, reader.config.dataset.sha256
        finished = [status for trials in people for status in trials if status.outcome is not None]
        num_deleted = sum(bool(trials) and trials[0].is_shredded for trials in people)
        names = {status.key.scene for status in finished}
        if any(status.phase == "main" for status in finished):
            episodes = PersonalDataset(self.dataset, evidence=self.evidence)
            require_same_dataset(episodes, {digest}, whose="the study's")
            require_same_homes(plan, [scene for scene in plan.scenes if scene.name in names], episodes, self.scenes_dir)
            study_set(self.study, config, self.sequences)
        practice = [scene for scene in plan.practice_scenes if scene.name in names]
        if practice:
            require_same_homes(plan, practice, PersonalDataset(self.study / PRACTICE_FOLDER), None)
        work = self._jobs(plan, finished, run_id, has_sequences=config.sequences is not None)
        found: list[VerificationEntry] = []
        with counted("verify", len(finished)) as progress:
            for entries in results(_open_home, work, processes=self.jobs, batch=BATCH):
                found += entries
                progress.add(len(entries))
        _print_found(self.study, found, {status.trial_id: status for status in finished}, num_deleted=num_deleted)
        if self.store and found:
            _store(self.study, found)
        return 0 if all(entry.status == "verified" for entry in found) else 1

    def _jobs(
        self, plan: StudyPlan, finished: Sequence[StoredTrial], run_id: str, *, has_sequences: bool
    ) -> list[VerifyJob]:
        """One job for each home."""
        by_scene: defaultdict[str, list[tuple[EpisodeKey, str, str, Condition]]] = defaultdict(list)
        for status in finished:
            assert status.trial_id is not None, status
            by_scene[status.key.scene].append((status.key, status.trial_id, status.code, status.condition))
        practice = {scene.name for scene in plan.practice_scenes}
        practised = self.study / PRACTICE_SET if has_sequences else None
        return [
            VerifyJob(
                self.study / PRACTICE_FOLDER if name in practice else self.dataset,
                name,
                tuple(dict.fromkeys(trial[0] for trial in trials)),
                study=self.study,
                study_scene=plan.scene(name),
                scenes_dir=None if name in practice else self.scenes_dir,
                sequences=practised if name in practice else self.sequences,
                trials=tuple(trials),
                evidence=() if name in practice else self.evidence,
                run_id=run_id,
            )
            for name, trials in sorted(by_scene.items())
        ]


def _open_home(job: VerifyJob) -> Callable[[EpisodeKey], tuple[VerificationEntry, ...]]:
    """Opens the job's home; returns a function that replays the trials of one episode by all its people."""
    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    sequences = None if job.sequences is None else SequenceSet(job.sequences)
    home = open_trial_home(dataset, job.study_scene, job.scenes_dir, sequences=sequences)
    simulator = sim_hash(home)

    def do_again(key: EpisodeKey) -> tuple[VerificationEntry, ...]:
        entries = []
        with read_study(job.study) as reader:
            for _, trial_id, code, condition in (trial for trial in job.trials if trial[0] == key):
                events, outcome = [stored.event for stored in reader.events(trial_id)], reader.outcome(trial_id)
                if outcome is None:
                    continue  # the participant withdrew a moment ago
                done = verify_trial(events, outcome, key, home=home, participant=code, condition=condition)
                entries.append(
                    VerificationEntry(
                        trial_id=trial_id,
                        run_id=job.run_id,
                        status=done.status,
                        max_position_error=done.max_position_error,
                        first_bad_step=done.first_bad_step,
                        detail=done.detail,
                        sim_hash=simulator,
                        at_ns=time.time_ns(),
                    )
                )
        return tuple(entries)

    return do_again


def _print_found(
    study: Path, found: Sequence[VerificationEntry], trials: dict[str | None, StoredTrial], *, num_deleted: int
) -> None:
    """Prints one line per trial that is not verified, then the counts."""
    for entry in found:
        if entry.status != "verified":
            status = trials[entry.trial_id]
            place = f"{status.code}, trial {status.order_no}, attempt {status.attempt} ({status.task} {status.key})"
            print(f"{place}: {entry.status}: {entry.detail}")
    counts = Counter(entry.status for entry in found)
    text = ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "no finished trial"
    deleted = f"; {num_deleted} people withdrew and their trials are deleted" if num_deleted else ""
    print(f"{study}: {text}{deleted}")


def _store(study: Path, found: Sequence[VerificationEntry]) -> None:
    """Adds the results to the study, unless another process writes to it."""
    try:
        take_lock(study).close()
    except StudyError as error:
        print(f"Not stored: {error}")
        return
    config = load_study(study)
    with open_store(study, config, load_plan(study, config)) as store:
        for entry in found:
            store.add_verification(entry)
    print(f"Stored beside the trials; study export and study report show it. Run {found[0].run_id}.")

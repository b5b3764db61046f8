"""A study with people, planned from Python: episodes drawn, people assigned, frozen, and its records read back.

    python -m personal_viz.examples.example_4_a_study_in_code DATASET FOLDER

It writes a study just as `personal-viz study init` and `study plan` do: serve it with
`personal-viz study serve FOLDER --dataset DATASET --pilot`.
"""

import sys
from collections import Counter
from pathlib import Path

from human_study import Study, make_plan, open_store, read_records
from human_study.design.plan import StudyPlan, StudyScene, save_plan
from human_study.design.sampling import sample_episodes
from human_study.design.study import StudyAggregate, StudyChecks, StudyDataset, StudyDesign, StudyPractice, save_study
from sim import Dataset
from sim.homes.kind import scene_kind
from sim.types import SPLITS


def plan(dataset: Path, folder: Path, *, people_per_episode: int = 2, per_split: int = 2) -> StudyPlan:
    """A pilot on invented or reconstructed homes: several people do each episode, and nobody does one twice."""
    episodes = Dataset(dataset)
    study = Study(
        study="example",
        dataset=StudyDataset(
            sha256=episodes.digest(), splits=dict.fromkeys(SPLITS, per_split), seed=1, max_per_scene=None
        ),
        task=("pan",),
        design=StudyDesign(kind="crossed", raters_per_episode=people_per_episode),
        practice=StudyPractice(pan=0, pog=0),
        checks=StudyChecks(every=None),
        aggregate=StudyAggregate(intervals="homes"),
    )
    keys = sample_episodes(study, [episode.key for episode in episodes.episodes()])
    names = sorted({key.scene for key in keys})
    homes = [StudyScene(name=name, kind=scene_kind(episodes, name, None)) for name in names]
    made = make_plan(study, homes, keys, is_pilot=True)
    save_study(folder, study)
    save_plan(folder, made)
    with open_store(folder, study, made):  # makes the database; `study serve` continues it
        pass
    return made


def show(folder: Path) -> list[str]:
    """One line per person, from the records."""
    with read_records(folder) as records:
        return [
            f"{person.code} ({person.task.upper()}): "
            + ", ".join(f"{count} {split}" for split, count in Counter(trial.split for trial in person.trials).items())
            for person in records.plan.participants
        ]


if __name__ == "__main__":
    plan(Path(sys.argv[1]), Path(sys.argv[2]))
    print("\n".join(show(Path(sys.argv[2]))))

"""Writes data/runs, data/study and data/study-agents; works at commit 0d21b8b only, and is kept to say how they came.

`runs`: two agents and two grounders on episodes of one recovered home. `study`: the export of an invented study: people
who walk with and without a map and people who point, with an exclusion, a technical failure and a trial given up.
`study-agents`: an agent and a grounder on its episodes. Nobody's data, and no texts.

The scene digest in the steps of `runs` was replaced on 2026-11-23: HOMES_VERSION 2 draws the grain of mirrored parts
and the facets of thin tubes otherwise, so the same home has another digest, and `replay` would refuse the runs. Poses,
distances and all literals stayed.
"""

import shutil
from pathlib import Path

import numpy as np

from human_study.design.study import StudyDataset, StudyMemory
from human_study.export.trial_table import TrialRow
from sim.tasks.run_files import Answer, AnswerMeasures, Run
from sim.types import SPLITS
from tests.conftest import SHARED
from tests.human_study.report_examples import (
    DIGEST,
    KEYS,
    agent_run,
    example_rows,
    people_runs,
    run_info,
    study_config,
    trial_row,
    write_export,
    write_runs,
)

from .answers import AGENTS, RECOVERED, RUNS, STUDY
from .doors import personal_viz

DATASET = SHARED / "personal-dataset" / "split"
CONFIG = study_config(
    study="frozen",
    task=("pan", "pog"),
    dataset=StudyDataset(sha256=DIGEST, splits=dict.fromkeys(SPLITS, 4)),
    memory=StudyMemory(arms=("none", "topdown")),
    primary=("human_minus_walker_SR", "memory_effect_SR"),
)
POINTING = [f"p{number:02d}" for number in range(7, 12)]
KIND = "invented"


def write_agents_runs(out: Path) -> None:
    """Real runs on the released episodes of one home, two of each split."""
    home = ("--dataset", DATASET, "--scene", RECOVERED, "--limit", "2", "--out", out)
    for agent in ("shortest-path", "random"):
        personal_viz("run", *home, "--agent", agent, "--run-id", agent)
    for method in ("qs", "rpg"):
        personal_viz("ground", *home, "--method", method, "--run-id", method)


def write_study() -> None:
    """The export and the agents' runs."""
    rows = [
        row.model_copy(update={"scene_kind": KIND, "n_steps": 4 + (row.n_steps or 0) % 7}) for row in example_rows(5)
    ]
    rows[4] = rows[4].model_copy(update={"excluded": ("disturbed",)})
    nothing = dict.fromkeys(("success", "spl", "softspl", "dtg", "planar_distance"))
    again = rows[7]
    rows[7] = again.model_copy(update={"attempt": 2})
    rows.append(again.model_copy(update={"end_reason": "technical", **nothing}))
    rows += pointing_rows()
    shutil.rmtree(STUDY, ignore_errors=True)
    write_export(STUDY, rows, CONFIG)  # its runs are of scans: written again below
    for path in STUDY.glob("*/run.json"):
        shutil.rmtree(path.parent)
    walked = [row for row in rows if row.task == "pan"]
    write_runs(STUDY, [of_kind(run) for run in people_runs(walked, CONFIG)])
    write_runs(STUDY, [pointing_run(code, rows) for code in POINTING])
    shutil.rmtree(AGENTS, ignore_errors=True)
    write_runs(AGENTS, [of_kind(agent_run("walker", 0, CONFIG, rate=0.4)), grounder_run()])


def of_kind(run: Run) -> Run:
    """The run as one in invented homes."""
    return run.model_copy(update={"info": run.info.model_copy(update={"scene_kind": KIND})})


def pointing_rows() -> list[TrialRow]:
    """Everybody who points does every episode once."""
    rng = np.random.default_rng(6)
    rows = []
    for code in POINTING:
        for order_no, at in enumerate(rng.permutation(len(KEYS)), start=1):
            row = trial_row(code, order_no, KEYS[at], "none", success=bool(rng.random() < 0.6), steps=1)
            far = float(rng.uniform(1.2, 6.0))
            pointed = {
                **dict.fromkeys(("n_steps", "path_m", "spl", "softspl", "dtg", "t_look_s")),
                **{"task": "pog", "scene_kind": KIND, "end_reason": "click", "t_total_s": float(rng.uniform(5, 60))},
                "planar_distance": 0.4 if row.success else far,
            }
            rows.append(row.model_copy(update=pointed))
    return rows


def pointing_run(code: str, rows: list[TrialRow]) -> Run:
    """A person's answers."""
    info = run_info(f"frozen-{code}-pog", "human", CONFIG, condition="map_open", scene_kind=KIND)
    answers = [
        pointed(row.split, row.scene, row.episode_id, distance=row.planar_distance or 0.0, code=code, t_s=row.t_total_s)
        for row in rows
        if row.participant == code
    ]
    return Run(info=info, answers=tuple(answers))


def grounder_run() -> Run:
    """A grounder's answers on the same episodes."""
    rng = np.random.default_rng(7)
    answers = [pointed(*key, distance=float(rng.uniform(0, 2.2)), code=None, t_s=None) for key in KEYS]
    return Run(info=run_info("seeker-0", "seeker", CONFIG, seed=0, scene_kind=KIND), answers=tuple(answers))


def pointed(split, scene: str, episode_id: str, *, distance: float, code: str | None, t_s: float | None) -> Answer:
    """One answer, so far from a target at the origin."""
    return Answer(
        split=split,
        scene=scene,
        episode_id=episode_id,
        candidates=((distance, 0.5, 0.0),),
        participant=code,
        t_s=t_s,
        measures=AnswerMeasures(
            success=distance <= 1.0,
            top3_success=distance <= 1.0,
            planar_distance=distance,
            distance_3d=distance,
        ),
    )


if __name__ == "__main__":
    shutil.rmtree(RUNS, ignore_errors=True)
    write_agents_runs(RUNS)
    write_study()

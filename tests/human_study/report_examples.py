"""An export folder of a small invented study, for tests of the report: six people, two conditions, two agents."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from human_study.design.study import StudyConfig, StudyDataset, StudyMemory, save_study
from human_study.export.rows import ExclusionRow, ParticipantRow, StageRow
from human_study.export.runs import run_condition
from human_study.export.trial_table import TrialRow
from human_study.journey import Stage
from sim.tasks.run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Measures, RuleMeasures, Run, RunInfo, Step
from sim.tasks.run_writer import RunWriter
from sim.types import SPLITS, SUCCESS_RULES, Action, EndReason, EpisodeKey

DIGEST = "d" * 64
KEYS = [EpisodeKey(split, f"Home{n // 2}", str(n)) for split in SPLITS for n in range(4)]
PEOPLE = [f"p{n:02d}" for n in range(1, 7)]


def study_config(**more: object) -> StudyConfig:
    """A study of PAN with and without the map."""
    fields = {
        "study": "example",
        "dataset": StudyDataset(sha256=DIGEST, splits=dict.fromkeys(SPLITS, 4)),
        "task": ("pan",),
        "memory": StudyMemory(arms=("none", "topdown")),
        "primary": ("human_minus_walker_SR", "memory_effect_SR"),
    }
    return StudyConfig.model_validate(fields | more)


def pan_episode(
    key: EpisodeKey,
    *,
    success: bool,
    steps: int,
    code: str | None,
    path: int = 3,
    reason: EndReason = "stop",
    scene_digest: str = "s",
) -> EpisodeRun:
    """A walk of `steps` steps, one second each; the first `path` steps go 0.25 m along z."""
    rule = RuleMeasures(
        success=success, spl=0.5 * success, soft_spl=0.4, dtg=0.0 if success else 3.0, start_distance=5.0
    )
    measures = Measures(
        rules=dict.fromkeys(SUCCESS_RULES, rule),
        centre_distance=1.0,
        path_m=0.25 * path,
        num_steps=steps,
        collisions=0,
        stored_geodesic=5.0,
        scene_digest=scene_digest,
    )
    start = EpisodeStart(
        split=key.split, scene=key.scene, episode_id=key.episode_id, position=(0, 0, 0), yaw=0.0, participant=code
    )
    walked = tuple(
        Step(action=Action.FORWARD, position=(0, 0, 0.25 * min(k + 1, path)), yaw=0.0, t_s=float(k + 1))
        for k in range(steps)
    )
    return EpisodeRun(start=start, steps=walked, end=EpisodeEnd(reason=reason, measures=measures))


def run_info(run_id: str, who: str, config: StudyConfig | None = None, **more: object) -> RunInfo:
    """`run.json` of people, as the study export writes it, or of an agent; without `config` it names no study."""
    fields = {
        "run_id": run_id,
        "who": who,
        "who_kind": "human" if who == "human" else "agent",
        "scene_kind": "scan",
        "dataset_digest": DIGEST,
        "created_utc": "2026-11-22T00:00:00+00:00",
        "config": {"study": config.study, "study_version": config.study_version} if config and who == "human" else {},
    }
    return RunInfo.model_validate(fields | more)


def example_rows(seed: int = 3) -> list[TrialRow]:
    """Every person does every episode once; half of them with the map, which the next person has in the other half."""
    rng = np.random.default_rng(seed)
    rows = []
    for number, code in enumerate(PEOPLE):
        for order_no, at in enumerate(rng.permutation(len(KEYS)), start=1):
            condition = "topdown" if (at + number) % 2 else "none"
            hits = bool(rng.random() < 0.45 + 0.3 * (condition == "topdown"))
            rows.append(trial_row(code, order_no, KEYS[at], condition, success=hits, steps=20 + int(rng.integers(40))))
    return rows


def trial_row(code: str, order_no: int, key: EpisodeKey, condition: str, *, success: bool, steps: int, **more: object):
    """One counted trial that ended with STOP; `more` replaces fields."""
    fields = {
        "participant": code,
        "order_no": order_no,
        "attempt": 1,
        "phase": "main",
        "task": "pan",
        "condition": condition,
        "split": key.split,
        "scene": key.scene,
        "scene_kind": "scan",
        "episode_id": key.episode_id,
        "rep": 1,
        "end_reason": "stop",
        "success": success,
        "spl": 0.5 * success,
        "softspl": 0.4,
        "dtg": 0.0 if success else 3.0,
        "planar_distance": 1.0,
        "n_steps": steps,
        "path_m": 0.75,
        "t_total_s": float(steps),
        "t_look_s": 20.0 if condition == "topdown" else None,
        "t_hidden_s": 0.0,
        "is_long_hidden": False,
        "t_first_view_s": 0.5,
        "confidence": None,
        "prior_visits_scene": (order_no - 1) // 6,
        "prior_visits_split": 0,
        "secs_in_scene_before": 10.0 * ((order_no - 1) // 6),
        "verification": "verified" if order_no % 3 else None,
        "excluded": (),
        "is_released": False,
        "head_hash": "h" * 64,
    }
    return TrialRow.model_validate(fields | more)


def people_runs(rows: Sequence[TrialRow], config: StudyConfig) -> list[Run]:
    """The run folders that an export has: trials with a result that no rule excludes."""
    runs = []
    for code in dict.fromkeys(row.participant for row in rows):
        for condition in ("none", "topdown"):
            found = [
                row
                for row in rows
                if (row.participant, row.condition) == (code, condition)
                and row.phase == "main"
                and row.end_reason == "stop"
                and not row.excluded
            ]
            name = "" if condition == "none" else f"-{condition}"
            info = run_info(f"example-{code}-pan{name}", "human", config, condition=run_condition(condition))
            episodes = [
                pan_episode(
                    EpisodeKey(row.split, row.scene, row.episode_id),
                    success=bool(row.success),
                    steps=row.n_steps or 1,
                    code=code,
                )
                for row in found
            ]
            if episodes:
                runs.append(Run(info=info, episodes=tuple(episodes)))
    return runs


def agent_run(who: str, seed: int, config: StudyConfig, *, rate: float) -> Run:
    """A run of an agent on all episodes."""
    rng = np.random.default_rng([seed, len(who)])
    episodes = [pan_episode(key, success=bool(rng.random() < rate), steps=60, code=None, path=8) for key in KEYS]
    return Run(info=run_info(f"{who}-{seed}", who, config, seed=seed), episodes=tuple(episodes))


def write_runs(folder: Path, runs: Sequence[Run]) -> None:
    """Run folders below `folder`."""
    for run in runs:
        writer = RunWriter(folder / run.info.run_id, run.info)
        for episode in run.episodes:
            writer.add_episode(episode)
        writer.add_answers(run.answers)


def write_export(folder: Path, rows: Sequence[TrialRow], config: StudyConfig) -> None:
    """An export folder: run folders, study file and tables (no manifest)."""
    write_runs(folder, people_runs(rows, config))
    save_study(folder, config)
    people = [participant_row(code) for code in dict.fromkeys(row.participant for row in rows)]
    uses = [
        ExclusionRow(
            target_kind="trial",
            participant=row.participant,
            order_no=row.order_no,
            attempt=row.attempt,
            rule_id=rule,
            is_planned=True,
            reason="said so",
            is_undone=False,
        )
        for row in rows
        for rule in row.excluded
    ]
    for name, lines in (("trials", rows), ("participants", people), ("exclusions", uses)):
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        (folder / f"{name}.jsonl").write_text(text)


def participant_row(code: str, stages: Sequence[Stage] = ("arrived", "consented", "quiz_passed", "finished")):
    """The row of a participant who reached these stages."""
    return ParticipantRow(
        participant=code,
        task="pan",
        arm=0,
        conditions=("none", "topdown"),
        has_come=bool(stages),
        has_consented="consented" in stages,
        consent_text=None,
        is_withdrawn="withdrawn" in stages,
        last_stage=stages[-1] if stages else None,
        left_by="withdrawn" if "withdrawn" in stages else None,
        num_assigned=12,
        num_ended=12,
        time_in_study_s=600.0,
        stages=tuple(StageRow(stage=stage, t_s=float(at), detail={}) for at, stage in enumerate(stages)),
    )

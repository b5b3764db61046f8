"""Counted trials of people as run folders: the same `EpisodeRun` and `Answer` that agents have."""

from collections.abc import Sequence
from datetime import UTC, datetime

from sim.sequences.runs import SEQUENCES_FILE, SequenceEnd, SequenceRun
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, Run, RunInfo, run_texts
from sim.types import TaskKind

from ..design.plan import StudyScene
from ..design.study import Condition, StudyConfig
from ..trial.events import Event
from ..trial.outcome import Outcome, episode_run
from ..trial.searches import sequence_run

_RUN_CONDITIONS: dict[Condition, str] = {"topdown": "memory_topdown", "glb": "memory_glb"}
"""Names in run files where they differ from the study file's."""
NO_EXPOSURE = "no exposure"
"""An agent that stands beside people who saw the home before, and did not see it."""


def run_condition(condition: Condition) -> str:
    """The condition of `run.json` for a condition of the study file."""
    return _RUN_CONDITIONS.get(condition, condition)


def study_facts(config: StudyConfig, conditions: Sequence[Condition]) -> dict[str, str | int]:
    """The entries of `run.json` that say on which study an agent ran, and beside which of its people it stands.

    Args:
        config: The study.
        conditions: The conditions of these people.
    """
    return {
        "study": config.study,
        "study_version": config.study_version,
        "study_conditions": ",".join(run_condition(condition) for condition in conditions),
        "query_index": config.query_index,
    }


def trial_run_info(
    config: StudyConfig,
    home: StudyScene,
    code: str,
    task: TaskKind,
    *,
    condition: Condition,
    created_utc: str,
    app_version: str,
    study_version: str | None = None,
    mixes_kinds: bool = False,
    is_pilot: bool = False,
) -> RunInfo:
    """The `run.json` of the run folder for a participant's trials of one task and condition.

    Args:
        home: The home of the trial; trials in homes of one kind share a folder.
        code: The participant's code in the run.
        condition: The trial's condition; part of the run's name where the task has several.
        created_utc: ISO 8601.
        study_version: The version in the records; None = that of `config`. In studies of the first format the two
            differ.
        mixes_kinds: Whether the study has homes of several kinds; then the run's name holds the kind.
        is_pilot: Whether the study was served without an ethics id.
    """
    parts = [config.study, code, task]
    parts += [condition] if len(config.conditions(task)) > 1 else []
    parts += [home.kind] if mixes_kinds else []
    return RunInfo(
        run_id="-".join(parts),
        who="human",
        who_kind="human",
        condition=run_condition(condition),
        scene_kind=home.kind,
        dataset_digest=config.dataset.sha256,
        seed=config.dataset.seed,
        config={
            "study": config.study,
            "study_version": study_version or config.study_version,
            "actions": config.actions,
            "max_steps": config.steps,
            "query_index": config.query_index,
            "clutter": home.clutter,
            "information": ",".join(config.information),
            "pilot": is_pilot,
            **({} if config.sequences is None else {"sequences": config.sequences.sha256}),
        },
        versions={"personal-viz": app_version},
        created_utc=created_utc,
        made_for=config.success if task == "pan" else None,
        labels=home.labels and task == "pan",
    )


def created_utc(created_ns: int) -> str:
    """The time at which a study was made, as run files write it: ISO 8601 to the second."""
    return datetime.fromtimestamp(created_ns / 1e9, UTC).isoformat(timespec="seconds")


def result_of(events: Sequence[Event], outcome: Outcome, *, code: str) -> EpisodeRun | Answer | SequenceRun:
    """The result of a finished trial as run files hold it, under an exported code; POG's answers need no events."""
    if isinstance(outcome, SequenceEnd):
        return sequence_run(events, outcome, participant=code)
    if isinstance(outcome, EpisodeEnd):
        return episode_run(events, end=outcome, participant=code)
    return outcome.model_copy(update={"participant": code})


def sequence_files(info: RunInfo, runs: Sequence[SequenceRun]) -> dict[str, tuple[bytes, int]]:
    """Content and number of results of each file of a run folder of home sequences, by path."""
    lines = [line for run in runs for line in (run.start, *run.steps, run.end)]
    texts = {"run.json": info.model_dump_json(indent=2) + "\n"}
    texts[SEQUENCES_FILE] = "".join(f"{line.model_dump_json()}\n" for line in lines)
    return {f"{info.run_id}/{name}": (text.encode(), len(runs)) for name, text in texts.items()}


def run_files(run: Run) -> dict[str, tuple[bytes, int]]:
    """Content and number of results of each file of a run folder, by path."""
    counts = {"steps.jsonl": len(run.episodes), "answers.jsonl": len(run.answers)}
    counts["run.json"] = sum(counts.values())
    return {f"{run.info.run_id}/{name}": (text.encode(), counts[name]) for name, text in run_texts(run).items()}

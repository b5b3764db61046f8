"""A study's finished trials as run folders, the same format that agents' runs have."""

from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, RunInfo
from sim.tasks.run_writer import RunWriter
from sim.types import EndReason, SceneKind, TaskKind

from .outcome import episode_run
from .records import StudyReader, TrialStatus, read_study
from .study import StudyConfig, write_whole

MANIFEST_FILE = "export.json"
_NOT_COUNTED: tuple[EndReason, ...] = ("technical", "abandoned")
"""Ends that are not a result of the person (HUMAN_STUDY.md, section 4); listed in the manifest, not in runs."""


class ExportedTrial(BaseModel):
    """One trial in the manifest."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    code: str
    order_no: int
    episode: str
    end_reason: EndReason
    head_hash: str
    """Of the trial's last event: stands for the whole chain."""
    run_id: str | None
    """None = left out, because of `end_reason`."""


class Manifest(BaseModel):
    """`export.json`: which trials went where."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    study: str
    study_version: str
    trials: tuple[ExportedTrial, ...]
    num_unfinished: int
    """Planned trials without an outcome."""


def export_study(folder: Path, out: Path) -> list[Path]:
    """Write one run folder per participant, task and scene kind, and `export.json` beside them.

    Exporting again adds what has finished since; the same records into an empty folder give the same bytes. Works while
    the study is served.

    Args:
        folder: Of the study.
        out: Where the run folders go.

    Returns:
        The run folders that hold at least one trial, by participant.

    Raises:
        StudyError: The store cannot be read or was changed.
        RunFileError: `out` cannot be written or holds another study's runs under these names.
    """
    with read_study(folder) as reader:
        reader.check()
        config = reader.config
        created = datetime.fromtimestamp(reader.created_ns / 1e9, UTC).isoformat(timespec="seconds")
        exported: list[ExportedTrial] = []
        writers: dict[str, RunWriter] = {}
        num_unfinished = 0
        for status in (status for code in reader.codes() for status in reader.trials(code)):
            if status.outcome is None or status.trial_id is None:
                num_unfinished += 1
                continue
            run_id = None
            if status.outcome.reason not in _NOT_COUNTED:
                info = trial_run_info(
                    config,
                    status.code,
                    status.task,
                    scene=status.key.scene,
                    created_utc=created,
                    app_version=reader.app_version,
                )
                run_id = info.run_id
                if run_id not in writers:
                    writers[run_id] = RunWriter(out / run_id, info)
                _add(writers[run_id], _result(reader, status))
            exported.append(_manifest_row(reader, status, run_id))
    manifest = Manifest(
        study=config.study,
        study_version=config.study_version,
        trials=tuple(exported),
        num_unfinished=num_unfinished,
    )
    write_whole(out / MANIFEST_FILE, manifest.model_dump_json(indent=2) + "\n")
    return [writer.folder for writer in writers.values()]


def run_id_for(config: StudyConfig, code: str, task: TaskKind, *, kind: SceneKind) -> str:
    """Name of the run folder of a participant's trials; names the scene kind only where the study mixes them."""
    parts = [config.study, code, task]
    if len({scene.kind for scene in config.scenes}) > 1:
        parts.append(kind)
    return "-".join(parts)


def trial_run_info(
    config: StudyConfig, code: str, task: TaskKind, *, scene: str, created_utc: str, app_version: str
) -> RunInfo:
    """`run.json` of the run folder that a participant's trials of one task in one home go to."""
    kind = config.scene_kind(scene)
    return RunInfo(
        run_id=run_id_for(config, code, task, kind=kind),
        who="human",
        who_kind="human",
        scene_kind=kind,
        dataset_digest=config.dataset_digest,
        seed=config.seed,
        config={
            "study": config.study,
            "study_version": config.study_version,
            "actions": config.actions,
            "max_steps": config.max_steps,
            "query_index": config.query_index,
            "clutter": config.scene(scene).clutter,
        },
        versions={"personal-viz": app_version},
        created_utc=created_utc,
    )


def _result(reader: StudyReader, status: TrialStatus) -> EpisodeRun | Answer:
    """The trial's result: events and stored end for PAN, the stored answer for POG."""
    assert status.trial_id is not None
    if isinstance(status.outcome, EpisodeEnd):
        events = [stored.event for stored in reader.events(status.trial_id)]
        return episode_run(events, end=status.outcome, participant=status.code)
    assert isinstance(status.outcome, Answer)
    return status.outcome


def _add(writer: RunWriter, result: EpisodeRun | Answer) -> None:
    if result.key in writer.done:
        return
    if isinstance(result, EpisodeRun):
        writer.add_episode(result)
    else:
        writer.add_answers([result])


def _manifest_row(reader: StudyReader, status: TrialStatus, run_id: str | None) -> ExportedTrial:
    assert status.trial_id is not None
    assert status.outcome is not None
    head = reader.head_hash(status.trial_id)
    if head is None:
        raise StudyError(f"trial {status.trial_id}: has an outcome but no events; expected both. Restore a backup.")
    return ExportedTrial(
        code=status.code,
        order_no=status.order_no,
        episode=str(status.key),
        end_reason=status.outcome.reason,
        head_hash=head,
        run_id=run_id,
    )

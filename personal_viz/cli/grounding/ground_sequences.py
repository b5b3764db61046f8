"""`ground` in home sequences, of a set or of a study: the run folder of a grounder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from grounding.evaluation.sequences import SequenceGroundJob, evaluate_sequences
from sim.episodes.sequence_files import SequenceSet
from sim.errors import PersonalVizError
from sim.sequences.writer import SequenceWriter
from sim.tasks.run_files import RunInfo, fitting_run_id
from sim.tasks.workers import Workers
from sim.types import EpisodeKey

from ...progress import counted
from ..output import say
from ..refusals import require_none


class GroundOptions(Protocol):
    """The options of verb `ground` that sequences look at."""

    sequences: Path | None
    ignore_messages: bool


def require_options_of_sequences(verb: GroundOptions, *, is_of_sequences: bool) -> None:
    """Raises PersonalVizError where options of `ground` do not fit home sequences, or need them."""
    if is_of_sequences:
        require_none(verb, ("sweep", "shard"), beside="--sequences" if verb.sequences else "--study of home sequences")
    elif verb.ignore_messages:
        raise PersonalVizError(
            "--ignore-messages: found no --sequences; expected it too, or a --study of home sequences. Give it, or "
            "leave it out."
        )


def sequence_info(info: RunInfo, root: Path, *, ignores_messages: bool, is_named: bool) -> RunInfo:
    """`run.json` of the same grounder on the set `root`; a run that the user named keeps its name."""
    ignored = ["messages ignored"] if ignores_messages else []
    parts = ["sequences", info.run_id, *(part.replace(" ", "-") for part in ignored)]
    told = {"sequences": SequenceSet(root).digest(), "ignore_messages": ignores_messages}
    return info.model_copy(
        update={
            "run_id": info.run_id if is_named else fitting_run_id("-".join(parts)),
            "condition": ", ".join([*ignored, info.condition]),
            "config": {**info.config, **told},
        }
    )


def ground_sequences(
    job: SequenceGroundJob, keys: Sequence[EpisodeKey], info: RunInfo, *, out: Path, processes: Workers
) -> Path:
    """Answers the sequences that the run's folder does not hold yet; returns the folder.

    Args:
        job: What the jobs of all scenes share.
        keys: The sequences.
        info: The run.
        out: Folder of the runs.
        processes: The workers.

    Raises:
        PersonalVizError: A sequence could not be answered; all before it are on disk.
    """
    folder = out / info.run_id
    writer = SequenceWriter(folder, info)
    names = sorted({key.scene for key in keys})
    jobs = [replace(job, scene=name, keys=tuple(key for key in keys if key.scene == name)) for name in names]
    with counted(info.run_id, sum(key not in writer.done for key in keys)) as progress:
        evaluate_sequences(jobs, writer, processes=processes, on_sequence=progress.add)
    say(f"Written to {folder}.")
    return folder

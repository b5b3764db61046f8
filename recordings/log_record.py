"""Log the run files' own lines beside the pictures, so that `read_rrd` gives back the very runs that were logged."""

from collections.abc import Sequence

import rerun as rr

from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeStart, RunInfo, Step

from . import paths

LINE, INFO, START, END = "line", "info", "start", "end"
"""Component names below a run's `record`: JSON texts as in the run folder."""


def log_record_start(stream: rr.RecordingStream, label: str, info: RunInfo, start: EpisodeStart) -> None:
    """Logs who runs and where the episode starts."""
    texts = {INFO: info.model_dump_json(), START: start.model_dump_json()}
    stream.log(paths.run_path(label, paths.RECORD), rr.AnyValues(True, **texts), static=True)


def log_record_step(stream: rr.RecordingStream, label: str, step: Step) -> None:
    """Logs one step at the stream's present time."""
    stream.log(paths.run_path(label, paths.RECORD, LINE), rr.AnyValues(True, **{LINE: step.model_dump_json()}))


def log_record_steps(
    stream: rr.RecordingStream, label: str, steps: Sequence[Step], *, times: Sequence[rr.TimeColumn]
) -> None:
    """Logs T steps at once; each of `times` has T rows."""
    lines = [step.model_dump_json() for step in steps]
    columns = rr.AnyValues.columns(True, **{LINE: lines})
    stream.send_columns(paths.run_path(label, paths.RECORD, LINE), times, columns)


def log_record_end(stream: rr.RecordingStream, label: str, end: EpisodeEnd) -> None:
    """Logs how the episode ended; a recording without it holds a run that was cut off."""
    entity = paths.run_path(label, paths.RECORD, END)
    stream.log(entity, rr.AnyValues(True, **{END: end.model_dump_json()}), static=True)


def log_record_answer(stream: rr.RecordingStream, label: str, info: RunInfo, answer: Answer) -> None:
    """Logs a whole POG answer."""
    texts = {INFO: info.model_dump_json(), LINE: answer.model_dump_json()}
    stream.log(paths.run_path(label, paths.RECORD), rr.AnyValues(True, **texts), static=True)

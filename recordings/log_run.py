"""Log one run: its camera, what it saw, its path, its actions and distances; or the points of a POG answer."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.episodes.schema import Goal
from sim.frames import T_world_camera
from sim.tasks.run_files import Answer, EpisodeRun, RunInfo
from sim.types import Camera

from . import paths
from .palette import Rgb as Rgb

LIFT = 0.15
"""Paths are drawn this far above the feet (metres), so that no floor covers them; recorded heights are noisy."""
UNDER_TRAIL = np.array([0.0, 0.04, 0.0])
"""The line of the whole way lies this much lower than the trail, which so covers it, metres."""
WHOLE, TRAIL, FRAME = -0.7, -2.0, -3.0
"""Radii of paths and of a picture's frame; negative = points of the screen, to be seen in homes of any size."""
ANSWER_STEP = 1
"""Step at which a POG answer appears."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One run of one person or agent as the recording shows it."""

    label: str
    """Unique in the recording; names the run's entities."""
    title: str
    """What views and tables call it."""
    rgb: Rgb
    info: RunInfo
    run: EpisodeRun | Answer

    @property
    def positions(self) -> NDArray[np.float64]:
        """World points: (T + 1, 3) feet of a PAN run, (K, 3) candidates of a POG answer."""
        points = [pose.position for pose in self.run.poses] if isinstance(self.run, EpisodeRun) else self.run.candidates
        return np.array(points, float).reshape(-1, 3)


def path_lengths(run: EpisodeRun) -> NDArray[np.float64]:
    """Metres walked at the start and after each step; (T + 1,)."""
    positions = np.array([pose.position for pose in run.poses])
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))


def times(run: EpisodeRun) -> NDArray[np.float64] | None:
    """Seconds at the start and after each step, (T + 1,); None when the run measured no time."""
    seconds = np.array([0.0, *(step.t_s for step in run.steps)])
    return seconds if seconds.any() else None


def indexes(run: EpisodeRun, *, first: int = 0, end: int | None = None) -> list[rr.TimeColumn]:
    """The timelines of rows `first` to T of a run (row 0 = its start), or to before `end`."""
    rows = slice(first, end)
    columns = [
        rr.TimeColumn(paths.STEP, sequence=np.arange(len(run.steps) + 1)[rows]),
        rr.TimeColumn(paths.PATH_M, duration=path_lengths(run)[rows]),
    ]
    seconds = times(run)
    return columns if seconds is None else [*columns, rr.TimeColumn(paths.TIME_S, duration=seconds[rows])]


def log_run(
    stream: rr.RecordingStream,
    trace: Trace,
    *,
    targets: Sequence[Goal],
    camera: Camera,
) -> None:
    """Logs a PAN run of T steps below `/runs/<label>`, without pictures.

    Args:
        stream: The recording.
        trace: The run.
        targets: Of its episode; only the distance to their centres is logged.
        camera: The robot's camera.
    """
    assert isinstance(trace.run, EpisodeRun)
    _log_camera(stream, trace, camera)
    _log_path(stream, trace)
    _log_actions(stream, trace)
    _log_end(stream, trace, camera)
    centres = np.array([target.position for target in targets])[:, [0, 2]]
    apart = np.linalg.norm(trace.positions[:, None, [0, 2]] - centres, axis=-1).min(axis=1)
    log_series(stream, trace, "centre_distance", apart)


def log_pictures(stream: rr.RecordingStream, trace: Trace, jpegs: Sequence[bytes], *, first: int = 0) -> None:
    """Logs what the robot of a PAN run saw through its camera.

    Args:
        stream: The recording.
        trace: The run.
        jpegs: Successive pictures.
        first: Row of the pose at which the first one was seen.
    """
    assert isinstance(trace.run, EpisodeRun)
    columns = rr.EncodedImage.columns(blob=jpegs, media_type=["image/jpeg"] * len(jpegs))
    at = indexes(trace.run, first=first, end=first + len(jpegs))
    stream.send_columns(paths.run_path(trace.label, "camera"), at, columns)


def log_series(stream: rr.RecordingStream, trace: Trace, name: str, values: NDArray[np.float64]) -> None:
    """Logs a figure per pose of a PAN run, (T + 1,), as a line to plot; what is not finite leaves a gap."""
    assert isinstance(trace.run, EpisodeRun)
    entity = paths.run_path(trace.label, name)
    stream.log(entity, rr.SeriesLines(names=trace.title, colors=[trace.rgb], widths=2.0), static=True)
    known = np.where(np.isfinite(values), values, np.nan)
    stream.send_columns(entity, indexes(trace.run), rr.Scalars.columns(scalars=known))


def set_row(stream: rr.RecordingStream, run: EpisodeRun, row: int) -> None:
    """Sets every timeline to the moment after `row` steps of a run; what is logged then appears there."""
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=row)
    stream.set_time(paths.PATH_M, duration=float(path_lengths(run)[row]))
    if (seconds := times(run)) is not None:
        stream.set_time(paths.TIME_S, duration=float(seconds[row]))


def set_answered(stream: rr.RecordingStream, answer: Answer) -> None:
    """Sets the timelines to the moment of a POG answer."""
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=ANSWER_STEP)
    if answer.t_s is not None:
        stream.set_time(paths.TIME_S, duration=answer.t_s)


def log_answer(stream: rr.RecordingStream, trace: Trace) -> None:
    """Logs a POG answer below `/runs/<label>`: ranked points, and how a person pointed."""
    answer = trace.run
    assert isinstance(answer, Answer)
    set_answered(stream, answer)
    if answer.candidates:
        ranks = [f"{trace.title} {rank}" for rank in range(1, len(answer.candidates) + 1)]
        points = rr.Points3D(trace.positions, colors=[trace.rgb], radii=0.08, labels=ranks)
        stream.log(paths.run_path(trace.label, "candidates"), points)
    if answer.ray is not None and answer.candidates:
        ray = rr.LineStrips3D([[answer.ray.camera_position, answer.candidates[0]]], colors=[trace.rgb], radii=0.015)
        stream.log(paths.run_path(trace.label, "click_ray"), ray)
    text = f"{answer.reason}: {len(answer.candidates)} points" if answer.candidates else f"{answer.reason}: no answer"
    stream.log(paths.run_path(trace.label, "actions"), rr.TextLog(f"{trace.title}: {text}", color=trace.rgb))
    stream.reset_time()


def _log_camera(stream: rr.RecordingStream, trace: Trace, camera: Camera) -> None:
    assert isinstance(trace.run, EpisodeRun)
    entity = paths.run_path(trace.label, "camera")
    pinhole = rr.Pinhole(
        focal_length=camera.focal,
        width=camera.width,
        height=camera.height,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.5,
        color=trace.rgb,
    )
    stream.log(entity, pinhole, static=True)
    Ts = np.array([T_world_camera(pose, camera) for pose in trace.run.poses])
    columns = rr.Transform3D.columns(translation=Ts[:, :3, 3], mat3x3=Ts[:, :3, :3])
    stream.send_columns(entity, indexes(trace.run), columns)


def _log_path(stream: rr.RecordingStream, trace: Trace) -> None:
    """The whole way as a faint static line, and one piece per step: the view shows all pieces up to its time."""
    assert isinstance(trace.run, EpisodeRun)
    lifted = trace.positions + np.array([0.0, LIFT, 0.0])
    whole = rr.LineStrips3D([lifted - UNDER_TRAIL], colors=[dimmed(trace.rgb)], radii=WHOLE)
    stream.log(paths.run_path(trace.label, "path"), whole, static=True)
    if not trace.run.steps:
        return
    entity = paths.run_path(trace.label, "trail")
    stream.log(entity, rr.LineStrips3D.from_fields(colors=[trace.rgb], radii=[TRAIL]), static=True)
    pieces = np.stack([lifted[:-1], lifted[1:]], axis=1)  # (T, 2, 3)
    stream.send_columns(entity, indexes(trace.run, first=1), rr.LineStrips3D.columns(strips=list(pieces)))


def _log_actions(stream: rr.RecordingStream, trace: Trace) -> None:
    assert isinstance(trace.run, EpisodeRun)
    if not trace.run.steps:
        return
    texts = [f"{trace.title}: {step.action.value}{' (blocked)' if step.collided else ''}" for step in trace.run.steps]
    texts[-1] += "" if trace.run.end.reason == "stop" else f" - ended: {trace.run.end.reason}"
    colors = np.full(len(texts), rgba_u32(trace.rgb), np.uint32)
    columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
    stream.send_columns(paths.run_path(trace.label, "actions"), indexes(trace.run, first=1), columns)


def _log_end(stream: rr.RecordingStream, trace: Trace, camera: Camera) -> None:
    """Marks the last picture, which stays, as the last: other runs may go on much longer."""
    assert isinstance(trace.run, EpisodeRun)
    set_row(stream, trace.run, len(trace.run.steps))
    stream.log(paths.run_path(trace.label, "camera", "ended"), picture_note(_ending(trace.run), trace.rgb, camera))
    stream.reset_time()


def log_no_clock(stream: rr.RecordingStream, trace: Trace, camera: Camera) -> None:
    """Says in the camera's view why the timeline of seconds, which other runs have, shows nothing of this run."""
    stream.reset_time()
    stream.set_time(paths.TIME_S, duration=0.0)
    note = picture_note("measured no time: choose the timeline step or path_m", trace.rgb, camera)
    stream.log(paths.run_path(trace.label, "camera", "no_clock"), note)
    stream.reset_time()


def picture_note(text: str, rgb: Rgb, camera: Camera) -> rr.Boxes2D:
    """A frame around a camera's picture with a text in it."""
    size = np.array([[camera.width, camera.height]], float)
    return rr.Boxes2D(centers=size / 2, sizes=size, colors=[rgb], radii=FRAME, labels=[text], draw_order=50.0)


def _ending(run: EpisodeRun) -> str:
    how = {"stop": "stopped", "steps": "out of steps", "giveup": "gave up"}.get(run.end.reason, run.end.reason)
    paper = run.end.measures.rules["paper"] if run.end.measures else None
    outcome = "" if paper is None else ": success" if paper.success else ": no success"
    return f"{how} after {len(run.steps)} steps{outcome}"


def dimmed(rgb: Rgb) -> Rgb:
    """The colour of a run's whole way, darker than that of the part walked so far."""
    return (rgb[0] // 2, rgb[1] // 2, rgb[2] // 2)


def rgba_u32(rgb: Rgb) -> int:
    """Rerun's packed opaque colour."""
    return (rgb[0] << 24) | (rgb[1] << 16) | (rgb[2] << 8) | 255

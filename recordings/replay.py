"""Any number of runs of one episode, people and agents, side by side in one .rrd file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.scenes.scene import Scene
from sim.tasks.rules import storey_of
from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import Camera, EpisodeKey
from sim.world.renderer import Renderer

from . import paths
from .blueprints import comparison_blueprint
from .log_maps import POINT, StoreyMap, log_answer_on_map, log_map_picture, log_run_on_map, storey_map
from .log_run import ANSWER_STEP, Rgb, Trace, log_answer, log_run, path_lengths, times
from .log_scene import log_scene
from .log_text import log_task
from .stream import open_recording

RUN_COLORS: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (240, 228, 66),
    (213, 94, 0),
    (0, 114, 178),
)
"""Okabe and Ito's palette, which colour-blind people can tell apart; more runs begin it again."""
GOAL_RGB: Rgb = (255, 60, 60)


def log_comparison(
    runs: Sequence[Run],
    *,
    episode: Episode,
    scene: Scene,
    out: Path,
    renderer: Renderer | None,
    with_pixels: bool,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
) -> Path:
    """Writes every run of one episode into one recording.

    Args:
        runs: Run folders of people, agents, grounders and imports; their other episodes are left out.
        episode: With its targets: the recording is for researchers, it shows the goal at its end.
        scene: The home in which the runs were made.
        out: The .rrd file; replaced when it exists.
        renderer: Renders what the robots saw from their poses; None = no first-person pictures.
        with_pixels: Whether geometry and pictures of a licensed scan may be written; other homes need no leave.
        camera: The robots' camera.

    Returns:
        `out`.

    Raises:
        RecordingError: No run has the episode, runs and scene differ in kind or version, or `out` is no .rrd file or
            cannot be written.
    """
    _require_rrd(out)
    traces = select_traces(runs, episode.key)
    _require_one_kind(traces, scene)
    _require_one_version(traces, scene)
    may_show = scene.kind != "scan" or with_pixels
    storeys = [(height, height) for height in scene.navigation.storey_heights]
    floors = _floors_shown(episode, traces, storeys)
    maps = [storey_map(scene.navigation, index) for index in floors]
    with open_recording(out, episode.key) as stream:
        _log_identity(stream, episode, scene)
        log_task(stream, episode, scene, traces, has_scan_pixels=scene.kind == "scan" and with_pixels)
        if may_show:
            log_scene(stream, scene, storeys=floors)
            for storey in maps:
                log_map_picture(stream, storey)
        for trace in traces:
            _log_trace(stream, trace, episode, maps, storeys, renderer if may_show else None, camera)
        _log_goal(stream, episode, traces, maps, storeys)
        stream.send_blueprint(comparison_blueprint(traces, maps))
    return out


def select_traces(runs: Sequence[Run], key: EpisodeKey) -> list[Trace]:
    """Every run and answer of one episode with a label, a title and a colour of its own.

    Raises:
        RecordingError: There is none.
    """
    found = [(run.info, item) for run in runs for item in (*run.episodes, *run.answers) if item.key == key]
    if not found:
        names = ", ".join(run.info.run_id for run in runs) or "no run"
        raise RecordingError(
            f"{names}: found no run of episode {key}; expected at least one. Choose another --episode."
        )
    labels = _distinct([_with_code(info.run_id, item) for info, item in found])
    titles = _distinct([_with_code(info.who, item) for info, item in found])
    return [
        Trace(label, title, RUN_COLORS[index % len(RUN_COLORS)], info, item)
        for index, (label, title, (info, item)) in enumerate(zip(labels, titles, found, strict=True))
    ]


def common_episode(runs: Sequence[Run]) -> EpisodeKey:
    """The only episode that all runs hold.

    Raises:
        RecordingError: They have none in common, or several.
    """
    held = [{item.key for item in (*run.episodes, *run.answers)} for run in runs]
    common = sorted(set.intersection(*held)) if held else []
    if len(common) == 1:
        return common[0]
    names = ", ".join(run.info.run_id for run in runs) or "no run"
    if common:
        some = ", ".join(str(key) for key in common[:5])
        found, more = f"{len(common)} episodes that all hold", f": {some}{', ...' if len(common) > 5 else ''}"
    else:
        some = ", ".join(f"{run.info.run_id} has {len(keys)}" for run, keys in zip(runs, held, strict=True))
        found, more = "no episode that all hold", f" ({some})"
    raise RecordingError(f"{names}: found {found}{more}; expected one. Choose it with --episode SPLIT/SCENE/ID.")


def _with_code(name: str, item: EpisodeRun | Answer) -> str:
    """The name with the participant's public code, where there is one."""
    participant = item.start.participant if isinstance(item, EpisodeRun) else item.participant
    return f"{name}-{participant}" if participant else name


def _distinct(names: Sequence[str]) -> list[str]:
    """The names, those that came before with -2, -3, ... after them."""
    taken: list[str] = []
    for name in names:
        number, candidate = 1, name
        while candidate in taken:
            number += 1
            candidate = f"{name}-{number}"
        taken.append(candidate)
    return taken


def _require_one_kind(traces: Sequence[Trace], scene: Scene) -> None:
    """Runs of different kinds of homes cannot be compared; answers on oracle maps belong to any."""
    for trace in traces:
        kind = trace.info.scene_kind
        if kind not in (scene.kind, "oracle-map"):
            raise RecordingError(
                f"{trace.info.run_id}: was made on a home of kind {kind!r}, {scene.name} is opened as {scene.kind!r}; "
                "expected one kind in a recording. Leave the run out, or give (leave out) --scenes-dir."
            )


def _require_one_version(traces: Sequence[Trace], scene: Scene) -> None:
    """Runs made on another version of the home would walk through its walls; answers name no version."""
    for trace in traces:
        measures = trace.run.end.measures if isinstance(trace.run, EpisodeRun) else None
        if measures is not None and measures.scene_digest != scene.digest:
            raise RecordingError(
                f"{trace.info.run_id}: was made on {scene.name} with scene_digest {measures.scene_digest[:12]!r}, the "
                f"home opened now has {scene.digest[:12]!r}; expected the same version of the home. Give the "
                "--dataset or --scenes-dir of the run, or leave the run out."
            )


def _require_rrd(out: Path) -> None:
    """The recording replaces its file, so a run file given by mistake would be lost."""
    if out.suffix != ".rrd":
        raise RecordingError(f"--out: found {str(out)!r}; expected a file that ends in .rrd. Give another name.")


def _floors_shown(episode: Episode, traces: Sequence[Trace], storeys: Sequence[tuple[float, float]]) -> list[int]:
    """Storeys on which a run, an answer or a target is, from the lowest."""
    heights = [float(y) for trace in traces for y in trace.positions[:, 1]]
    heights += [target.floor_y for target in episode.targets]
    return sorted({storey_of(y, storeys) for y in heights})


def _log_identity(stream: rr.RecordingStream, episode: Episode, scene: Scene) -> None:
    stream.send_recording_name(f"{episode.key} in {scene.label}")
    facts = rr.AnyValues(episode=str(episode.key), scene=scene.name, scene_kind=scene.kind, scene_digest=scene.digest)
    stream.send_property("episode", facts)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)


def _log_trace(
    stream: rr.RecordingStream,
    trace: Trace,
    episode: Episode,
    maps: Sequence[StoreyMap],
    storeys: Sequence[tuple[float, float]],
    renderer: Renderer | None,
    camera: Camera,
) -> None:
    floors = np.array([storey_of(float(y), storeys) for y in trace.positions[:, 1]], int)
    if isinstance(trace.run, Answer):
        log_answer(stream, trace)
        for storey in maps:
            log_answer_on_map(stream, trace, storey, on_storey=floors == storey.index)
        return
    log_run(stream, trace, targets=episode.targets, renderer=renderer, camera=camera)
    for storey in maps:
        log_run_on_map(stream, trace, storey, on_storey=floors == storey.index)


def _log_goal(
    stream: rr.RecordingStream,
    episode: Episode,
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    storeys: Sequence[tuple[float, float]],
) -> None:
    """The targets, at the very end of every timeline: what a viewer sees before it, the runner could see too."""
    walks = [trace.run for trace in traces if isinstance(trace.run, EpisodeRun)]
    answers = [trace.run for trace in traces if isinstance(trace.run, Answer)]
    after_answers = [ANSWER_STEP + 1] if answers else []
    ends = [float(seconds[-1]) for run in walks if (seconds := times(run)) is not None]
    ends += [answer.t_s for answer in answers if answer.t_s is not None]
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=max([*(len(run.steps) for run in walks), *after_answers]))
    if walks:
        stream.set_time(paths.PATH_M, duration=max(float(path_lengths(run)[-1]) for run in walks))
    if ends:
        stream.set_time(paths.TIME_S, duration=max(ends))
    names = [target.object_name for target in episode.targets]
    centres = np.array([target.position for target in episode.targets])
    stream.log(f"{paths.GOAL}/centre", rr.Points3D(centres, colors=[GOAL_RGB], radii=0.14, labels=names))
    floors = [storey_of(target.floor_y, storeys) for target in episode.targets]
    for storey in maps:
        here = np.array(floors) == storey.index
        labels = [name for name, is_here in zip(names, here, strict=True) if is_here]
        points = rr.Points2D(storey.pixels(centres)[here], colors=[GOAL_RGB], radii=POINT, labels=labels)
        stream.log(f"{paths.GOAL}/map/{storey.part}", points)

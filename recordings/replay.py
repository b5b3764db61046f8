"""Any number of runs of one episode, people and agents, side by side in one .rrd file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import Camera

from . import paths
from .blueprints import comparison_blueprint
from .divergence import Divergence, divergence_of
from .log_divergence import log_divergence
from .log_goal import GoalRegion, goal_region, log_goal
from .log_grounding import Regrounded, log_layers, reground, reground_markdown
from .log_maps import StoreyMap, log_answer_on_map, log_map_picture, log_run_on_map, storey_map, storeys_of
from .log_memory import log_memory, memory_markdown, named_memories
from .log_record import log_record_answer, log_record_end, log_record_start, log_record_steps
from .log_run import ANSWER_STEP, Trace, indexes, log_answer, log_no_clock, log_pictures, log_run, path_lengths, times
from .log_scene import log_identity, log_scene
from .log_text import log_task
from .palette import RUN_COLORS as RUN_COLORS
from .pictures import picture_cameras, rendered_jpegs
from .stream import open_recording
from .traces import best_two, require_same_home, select_traces
from .traces import common_episode as common_episode


def log_comparison(
    runs: Sequence[Run],
    *,
    episode: Episode,
    scene: Scene,
    out: Path,
    renderer: Renderer | None,
    with_pixels: bool,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    dataset: PersonalDataset | None = None,
    beside: Sequence[Path] = (),
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
        dataset: Where the episode is from: grounders answer again, to show how they came to their answers; None leaves
            that out.
        beside: Folders that hold the run folders: maps that grounders answered on lie there too.

    Returns:
        `out`.

    Raises:
        RecordingError: No run has the episode, runs and scene differ in kind or version, or `out` is no .rrd file or
            cannot be written.
    """
    _require_rrd(out)
    traces = select_traces(runs, episode.key)
    require_same_home(traces, scene)
    regrounded = [] if dataset is None else reground(traces, episode, dataset, beside=beside)
    may_show = scene.kind != "scan" or with_pixels
    if not may_show:  # maps of a scan come from its pictures
        regrounded = [item for item in regrounded if item.map_file is None]
    shown_by = renderer if may_show else None
    _write(
        traces, regrounded, episode=episode, scene=scene, out=out, renderer=shown_by, may_show=may_show, camera=camera
    )
    return out


def _write(
    traces: Sequence[Trace],
    regrounded: Sequence[Regrounded],
    *,
    episode: Episode,
    scene: Scene,
    out: Path,
    renderer: Renderer | None,
    may_show: bool,
    camera: Camera,
) -> None:
    """The recording's parts in the order in which a viewer that reads on is to show them."""
    goal = goal_region(episode, scene.navigation)
    maps = [storey_map(scene.navigation, index) for index in _floors_shown(traces, goal, scene)]
    best = best_two(traces)
    divergence = _divergence(traces, goal, best)
    memories = named_memories([item.map_file for item in regrounded if item.map_file]) if may_show else []
    with open_recording(out, episode.key) as stream:
        # viewers show what they have while they read on; without a blueprint they arrange it by themselves, and play it
        stream.send_blueprint(comparison_blueprint(traces, maps, shown=best, regrounded=regrounded, memories=memories))
        stream.flush()
        log_identity(stream, episode, scene)
        log_task(
            stream,
            episode,
            scene,
            traces,
            has_scan_pixels=scene.kind == "scan" and may_show,
            divergence=divergence,
            more=[*reground_markdown(regrounded), *(memory_markdown(item.name, item.memory) for item in memories)],
        )
        if may_show:
            _log_home(stream, scene, maps)
        for item in memories:
            log_memory(stream, item.name, item.memory, maps)
        stream.flush()
        later = _log_walks(stream, traces, episode, renderer, camera, best)
        _log_answers(stream, traces)
        _log_on_maps(stream, traces, maps, scene)
        log_divergence(stream, traces, divergence, maps=maps, navigation=scene.navigation)
        log_layers(stream, regrounded, maps, scene.navigation)
        _set_end(stream, traces)
        log_goal(stream, goal, maps)
        stream.flush()
        for trace, jpegs in later:
            log_pictures(stream, trace, jpegs, first=1)


def _require_rrd(out: Path) -> None:
    """The recording replaces its file, so a run file given by mistake would be lost."""
    if out.suffix != ".rrd":
        raise RecordingError(f"--out: found {str(out)!r}; expected a file that ends in .rrd. Give another name.")


def _floors_shown(traces: Sequence[Trace], goal: GoalRegion, scene: Scene) -> list[int]:
    """Storeys on which a run, an answer or a target is, from the lowest."""
    heights = np.concatenate([goal.floors_y, *(trace.positions[:, 1] for trace in traces)])
    return sorted(set(storeys_of(heights, scene.navigation).tolist()))


def _divergence(traces: Sequence[Trace], goal: GoalRegion, best: Sequence[Trace]) -> Divergence:
    """Where the runs leave the shortest path, and where the best two part."""
    pair = (traces.index(best[0]), traces.index(best[1])) if len(best) == 2 else None
    ways = [trace.positions if isinstance(trace.run, EpisodeRun) else None for trace in traces]
    return divergence_of(ways, goal.path, pair=pair)


def _log_home(stream: rr.RecordingStream, scene: Scene, maps: Sequence[StoreyMap]) -> None:
    log_scene(stream, scene, storeys=[storey.index for storey in maps])
    for storey in maps:
        log_map_picture(stream, storey)


def _log_walks(
    stream: rr.RecordingStream,
    traces: Sequence[Trace],
    episode: Episode,
    renderer: Renderer | None,
    camera: Camera,
    best: Sequence[Trace],
) -> list[tuple[Trace, list[bytes]]]:
    """All PAN runs, first pictures before all else, the shown ones' larger; returns the other pictures, for later."""
    walks = [(trace, trace.run) for trace in traces if isinstance(trace.run, EpisodeRun)]
    ways = [run.poses for _, run in walks]
    cameras = picture_cameras(ways, camera, is_shown=[trace in best for trace, _ in walks])
    pictures = [[]] * len(walks) if renderer is None else rendered_jpegs(renderer, ways, cameras)
    for (trace, _), jpegs in zip(walks, pictures, strict=True):
        if jpegs:
            log_pictures(stream, trace, jpegs[:1])
    is_timed = any(times(run) is not None for _, run in walks)
    for (trace, run), view in zip(walks, cameras, strict=True):
        log_run(stream, trace, targets=episode.targets, camera=view)
        if is_timed and times(run) is None:
            log_no_clock(stream, trace, view)
        log_record_start(stream, trace.label, trace.info, run.start)
        if run.steps:
            log_record_steps(stream, trace.label, run.steps, times=indexes(run, first=1))
        log_record_end(stream, trace.label, run.end)
    return [(trace, jpegs[1:]) for (trace, _), jpegs in zip(walks, pictures, strict=True) if jpegs[1:]]


def _log_answers(stream: rr.RecordingStream, traces: Sequence[Trace]) -> None:
    for trace in traces:
        if isinstance(trace.run, Answer):
            log_answer(stream, trace)
            log_record_answer(stream, trace.label, trace.info, trace.run)


def _log_on_maps(stream: rr.RecordingStream, traces: Sequence[Trace], maps: Sequence[StoreyMap], scene: Scene) -> None:
    for trace in traces:
        floors = storeys_of(trace.positions[:, 1], scene.navigation)
        log = log_answer_on_map if isinstance(trace.run, Answer) else log_run_on_map
        for storey in maps:
            log(stream, trace, storey, on_storey=floors == storey.index)


def _set_end(stream: rr.RecordingStream, traces: Sequence[Trace]) -> None:
    """The very end of every timeline: what a viewer sees before it, the runners could see too."""
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

"""Writes finished work into one .rrd file: any number of runs of one episode side by side, or a map of a home.

Run files hold no pictures, so the robots' views are rendered again from their poses.
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from grounding.maps.home_map import HomeMemory, Memory
from grounding.methods.free_text import Reply
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.frames import T_world_camera
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap, storey_map, storeys_of
from sim.render.raycast import own_cores
from sim.render.renderer import Renderer, jpeg_bytes
from sim.tasks.run_files import Answer, EpisodeRun, Run
from sim.types import Camera, Pose

from . import paths
from .blueprints import comparison_blueprint, map_blueprint
from .divergence import Divergence, divergence_of, log_divergence
from .episode import (
    ANSWER_STEP,
    CENTRE_DISTANCE,
    Walk,
    finished_walk,
    log_answer,
    log_figures,
    log_picture_note,
    log_pictures,
    log_plot_style,
    log_walk,
    set_moment,
)
from .layers import Regrounded, log_layers, reground, reground_markdown
from .memory import log_memory, log_replies, memory_markdown, named_memories, storey_at, storeys_of_memory
from .read import log_record_answer, log_record_end, log_record_start
from .scene import GoalRegion, goal_region, log_goal, log_identity, log_map_picture, log_storeys, log_up, may_be_shown
from .sinks import open_recording
from .texts import home_paragraphs, log_paragraphs, log_task
from .traces import Trace, best_two, require_same_home, select_traces

Way = Sequence[Pose]
PIXEL_BUDGET = 190_000_000
"""Largest number of pixels of all pictures in a recording, about 10 s of rendering on two cores: a person and an agent
of 500 steps fit at full size."""
VIEW_PIXELS = 12_000
"""Fixed cost of a view, as the number of pixels that take equally long to render."""
SIZES = ((4, 2), (4, 1), (3, 1), (2, 1))
"""Width and height of the pictures, in quarters of the camera's, of the runs shown at first and of the other runs; the
first pair that fits the budget is used, or else the last."""
_BATCH = 16
"""Number of views rendered at once, 3.4 MB each at 640 x 480; meanwhile the previous ones are encoded."""


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
    """Writes every run of one episode into one recording, for researchers: it shows the goal at its end. Returns `out`.

    Args:
        runs: Run folders of people, agents, grounders and imports; their other episodes are left out.
        out: The .rrd file; replaced if it exists.
        renderer: Renders the robots' views from their poses; None = no first-person pictures.
        with_pixels: Whether geometry and pictures of a licensed scan may be written; other homes always may.
        dataset: The episode's dataset, so that grounders can answer again and show how they found their answers; None
            leaves that out.
        beside: Folders that hold the run folders; the maps that grounders answered on are there too.

    Raises:
        RecordingError: No run has the episode, runs and scene differ in kind or version, or `out` is not an .rrd file
            or cannot be written.
    """
    require_rrd(out)
    traces = select_traces(runs, episode.key)
    require_same_home(traces, scene)
    regrounded = [] if dataset is None else reground(traces, episode, dataset, beside=beside)
    may_show = may_be_shown(scene, with_pixels=with_pixels)
    if not may_show:  # maps of a scan come from its pictures
        regrounded = [item for item in regrounded if item.map_file is None]
    shown_by = renderer if may_show else None
    _write(
        traces, regrounded, episode=episode, scene=scene, out=out, renderer=shown_by, may_show=may_show, camera=camera
    )
    return out


def record_memory(
    memory: HomeMemory,
    *,
    name: str,
    out: Path,
    scene: Scene | None,
    with_pixels: bool,
    asked: Sequence[Reply] = (),
    searched: Memory | None = None,
) -> Path:
    """Writes a map into a recording, which replaces `out`; returns `out`.

    Args:
        scene: The home in which the map was made; None = the map alone, as for a robot's recording.
        with_pixels: Whether a licensed scan's geometry and maps may be written; other homes always may.
        asked: Answers to free-text questions on the map, to be shown too.
        searched: The map that was asked, `Asker.memory`.

    Raises:
        RecordingError: `out` cannot be written, or the map is empty, in another frame than the home, or of a scan that
            may not be shown.
    """
    _require_shown(memory, name, scene, with_pixels=with_pixels)
    if scene is None:
        maps = storeys_of_memory(memory)
    else:
        every = [storey_map(scene.navigation, index) for index in range(len(scene.navigation.storey_heights))]
        maps = [shown for shown in every if storey_at(memory, shown) is not None]
    with open_recording(out, paths.MapKey(name)) as stream:
        stream.send_blueprint(map_blueprint(name, memory, maps, asked=[reply.query for reply in asked]))
        stream.send_recording_name(f"map {name}" + (f" in {scene.label}" if scene else ""))
        log_up(stream)
        about_home = [] if scene is None else home_paragraphs(scene, may_show=True)
        log_paragraphs(stream, [memory_markdown(name, memory), *about_home])
        if scene is not None:
            log_storeys(stream, scene, maps)
        else:
            for shown in maps:
                log_map_picture(stream, shown)
        log_memory(stream, name, memory, maps)
        if searched is not None:
            log_replies(stream, name, searched, asked, maps)
    return out


def require_rrd(out: Path) -> None:
    """Refuses a name that is not a recording's: the file is replaced, so a run file given by mistake would be lost.

    Raises:
        RecordingError: The name does not end in .rrd.
    """
    if out.suffix != ".rrd":
        raise RecordingError(f"--out: found {str(out)!r}; expected a file that ends in .rrd. Give another name.")


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
    """Writes the recording's parts in the order in which a viewer should show them while it reads."""
    goal = goal_region(episode, scene.navigation)
    maps = shown_storeys(traces, goal.floors_y, scene)
    best = best_two(traces)
    divergence = _divergence(traces, goal, best)
    memories = named_memories([item.map_file for item in regrounded if item.map_file]) if may_show else []
    walks = walks_of(traces, best, camera, scene)
    with open_recording(out, episode.key) as stream:
        # viewers show data while they read on; without a blueprint they choose their own layout and start playing
        stream.send_blueprint(comparison_blueprint(traces, maps, shown=best, regrounded=regrounded, memories=memories))
        stream.flush()
        log_identity(stream, episode.key, scene)
        log_task(
            stream,
            episode,
            scene,
            traces,
            may_show=may_show,
            edition=traces[0].info.edition,
            divergence=divergence,
            more=[*reground_markdown(regrounded), *(memory_markdown(item.name, item.memory) for item in memories)],
        )
        if may_show:
            log_storeys(stream, scene, maps)
        for item in memories:
            log_memory(stream, item.name, item.memory, maps)
        stream.flush()
        pictures = pictures_of(walks, renderer)
        for walk, jpegs in zip(walks, pictures, strict=True):
            if jpegs:
                log_pictures(stream, walk.walker, walk.rows[:1], jpegs[:1])
        for walk in walks:
            _log_walk(stream, walk, maps, goal, has_clocks=any(other.walker.is_timed for other in walks))
        for trace in traces:
            if isinstance(trace.run, Answer):
                log_answer(stream, trace, maps, scene.navigation)
                log_record_answer(stream, trace.label, trace.info, trace.run)
        log_divergence(stream, traces, walks, divergence, maps)
        log_layers(stream, regrounded, maps, scene.navigation)
        _set_end(stream, traces, walks)
        log_goal(stream, goal, maps)
        stream.flush()
        for walk, jpegs in zip(walks, pictures, strict=True):
            if jpegs[1:]:
                log_pictures(stream, walk.walker, walk.rows[1:], jpegs[1:])


def shown_storeys(traces: Sequence[Trace], floors_y: NDArray[np.float64], scene: Scene) -> list[StoreyMap]:
    """Storeys on which a run, an answer or a target is, from the lowest; `floors_y` are heights of targets' floors."""
    heights = np.concatenate([floors_y, *(trace.positions[:, 1] for trace in traces)])
    return [
        storey_map(scene.navigation, index) for index in sorted(set(storeys_of(heights, scene.navigation).tolist()))
    ]


def _divergence(traces: Sequence[Trace], goal: GoalRegion, best: Sequence[Trace]) -> Divergence:
    """Where the runs leave the shortest path, and where the best two part."""
    pair = (traces.index(best[0]), traces.index(best[1])) if len(best) == 2 else None
    ways = [trace.positions if isinstance(trace.run, EpisodeRun) else None for trace in traces]
    return divergence_of(ways, goal.path, pair=pair)


def walks_of(traces: Sequence[Trace], best: Sequence[Trace], camera: Camera, scene: Scene) -> list[Walk]:
    """The PAN runs, each with the camera of its pictures: larger for runs that are shown at first."""
    walking = [(trace, trace.run.poses) for trace in traces if trace.is_walk and not isinstance(trace.run, Answer)]
    shown = [trace in best for trace, _ in walking]
    cameras = picture_cameras([way for _, way in walking], camera, is_shown=shown)
    return [finished_walk(trace, view, scene.navigation) for (trace, _), view in zip(walking, cameras, strict=True)]


def pictures_of(walks: Sequence[Walk], renderer: Renderer | None) -> list[list[bytes]]:
    """JPEGs of each robot's view at each row; none without a renderer."""
    if renderer is None:
        return [[] for _ in walks]
    ways = [[row.pose for row in walk.rows] for walk in walks]
    return rendered_jpegs(renderer, ways, [walk.walker.camera for walk in walks])


def _log_walk(
    stream: rr.RecordingStream, walk: Walk, maps: Sequence[StoreyMap], goal: GoalRegion, *, has_clocks: bool
) -> None:
    """Logs a PAN run without its pictures; `has_clocks` says whether any run measures seconds."""
    trace, walker, rows = walk.trace, walk.walker, walk.rows
    assert isinstance(trace.run, EpisodeRun)
    log_record_start(stream, trace.label, trace.info, trace.run.start)
    log_walk(stream, walk, maps)
    log_plot_style(stream, walker, CENTRE_DISTANCE, words=trace.title, rgb=trace.rgb)
    log_figures(stream, walker, rows, CENTRE_DISTANCE, goal.apart(trace.positions).min(axis=1))
    # the last picture stays, and other runs may go on much longer
    set_moment(stream, walker, rows[-1])
    log_picture_note(stream, walker, "ended", _ending(trace.run))
    if has_clocks and not walker.is_timed:
        stream.reset_time()
        stream.set_time(paths.TIME_S, duration=0.0)
        log_picture_note(stream, walker, "no_clock", "measured no time: choose the timeline step or path_m")
    stream.reset_time()
    log_record_end(stream, trace.label, trace.run.end)


def _ending(run: EpisodeRun) -> str:
    how = {"stop": "stopped", "steps": "out of steps", "giveup": "gave up"}.get(run.end.reason, run.end.reason)
    paper = run.end.measures.rules["paper"] if run.end.measures else None
    outcome = "" if paper is None else ": success" if paper.success else ": no success"
    return f"{how} after {len(run.steps)} steps{outcome}"


def _set_end(stream: rr.RecordingStream, traces: Sequence[Trace], walks: Sequence[Walk]) -> None:
    """Sets every timeline to its very end; before it, viewers see nothing that was hidden from the runners."""
    last = [walk.rows[-1] for walk in walks]
    answers = [trace.run for trace in traces if isinstance(trace.run, Answer)]
    seconds = [row.step.t_s for walk, row in zip(walks, last, strict=True) if walk.walker.is_timed and row.step]
    seconds += [answer.t_s for answer in answers if answer.t_s is not None]
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=max([row.number for row in last] + [ANSWER_STEP + 1] * len(answers)))
    if walks:
        stream.set_time(paths.PATH_M, duration=max(row.path_m for row in last))
    if seconds:
        stream.set_time(paths.TIME_S, duration=max(seconds))


def _require_shown(memory: HomeMemory, name: str, scene: Scene | None, *, with_pixels: bool) -> None:
    if not memory.storeys:
        raise RecordingError(f"{name}: found a map without storeys; expected at least one. Explore the home again.")
    if scene is not None and memory.frame != "world":
        raise RecordingError(
            f"{name}: is in frame {memory.frame!r}; expected 'world' to be shown in a home. Leave the home out."
        )
    if scene is not None and not may_be_shown(scene, with_pixels=with_pixels):
        raise RecordingError(
            f"{name}: is a map of a licensed scan; expected leave to write it. Give --with-pixels if you may "
            "keep such a file."
        )


def picture_cameras(ways: Sequence[Way], camera: Camera, *, is_shown: Sequence[bool]) -> list[Camera]:
    """A camera per run with the robot's field of view and no more pixels than the budget allows.

    Runs that are shown at first get the larger pictures.
    """
    cameras: list[Camera] = []
    for shown, others in SIZES:
        cameras = [_sized(camera, shown if is_large else others) for is_large in is_shown]
        views = {(view, pose) for way, view in zip(ways, cameras, strict=True) for pose in way}
        if sum(view.width * view.height + VIEW_PIXELS for view, _ in views) <= PIXEL_BUDGET:
            break
    return cameras


def rendered_jpegs(renderer: Renderer, ways: Sequence[Way], cameras: Sequence[Camera]) -> list[list[bytes]]:
    """JPEGs of each robot's view at each of its poses, through its camera.

    Equal poses with equal cameras are rendered once: starts, blocked steps, and ways that several runs share.
    """
    views = dict.fromkeys((camera, pose) for way, camera in zip(ways, cameras, strict=True) for pose in way)
    encoded: dict[tuple[Camera, Pose], Future[bytes]] = {}
    with ThreadPoolExecutor(own_cores(), thread_name_prefix="jpeg") as pool:
        for camera in dict.fromkeys(cameras):
            poses = [pose for view, pose in views if view == camera]
            for first in range(0, len(poses), _BATCH):
                batch = poses[first : first + _BATCH]
                frames = renderer.render_batch(np.array([T_world_camera(pose, camera) for pose in batch]), camera)
                for pose, frame in zip(batch, frames, strict=True):
                    encoded[camera, pose] = pool.submit(jpeg_bytes, frame.rgb)
    return [[encoded[camera, pose].result() for pose in way] for way, camera in zip(ways, cameras, strict=True)]


def _sized(camera: Camera, quarters: int) -> Camera:
    return replace(camera, width=camera.width * quarters // 4, height=camera.height * quarters // 4)

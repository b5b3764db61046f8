"""Writes runs of one home sequence into one .rrd file: messages, who owns what, each search's way and its marks.

On the timeline `together` every run begins a search at the same moment, so messages and owners change for all at once.
On the other timelines they change where the first PAN run came to them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from sim.episodes.sequence_files import HomeSequence
from sim.episodes.sequences import Edge
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap
from sim.render.renderer import Renderer
from sim.sequences.runs import SearchEnd, SearchReason, SequenceRun
from sim.sequences.scoring import marking_steps
from sim.sequences.searches import old_target, search_episode, sequence_key, told_before
from sim.tasks.rules import reaches_target
from sim.tasks.run_files import RunInfo
from sim.types import Camera, EpisodeKey
from sim.walk.navigation_map import NavigationMap

from .. import paths
from ..blueprints import sequence_blueprint
from ..episode import (
    CENTRE_DISTANCE,
    FOUND_MARKS,
    OUTCOMES,
    Row,
    Walk,
    log_figures,
    log_pictures,
    log_plot_style,
    log_points,
    log_walk,
    set_moment,
)
from ..read import log_record_end, log_record_start
from ..replay import pictures_of, require_rrd, shown_storeys, walks_of
from ..scene import (
    LIFT,
    OLD_RGB,
    POINT,
    GoalRegion,
    goal_region,
    log_goal,
    log_identity,
    log_old_object,
    log_storeys,
    may_be_shown,
)
from ..sinks import open_recording
from ..texts import home_paragraphs, log_paragraphs, plain_text, table
from ..traces import RUN_COLORS, Rgb, Trace, best_two, require_same_home, rgba_u32, select_sequence_traces

Outcome = Literal["right", "wrong", "at the old object"]
OUTCOME_RGB: Mapping[Outcome, Rgb] = {"right": (40, 170, 80), "wrong": (220, 40, 60), "at the old object": OLD_RGB}
PERSON_RGB: Rgb = (86, 140, 210)
THING_RGB: Rgb = (130, 130, 130)
TOLD_RGB: Rgb = (170, 125, 0)
_ROW, _ACROSS = 44.0, 260.0
"""Distances of the graph's nodes, in units of the graph's view."""
_NODE = 140.0
"""Room for half of the longest usual label, in the same units."""
_HOW: Mapping[SearchReason, str] = {
    "found": "",
    "steps": "out of steps, ",
    "stop": "STOP, ",
    "giveup": "gave up, ",
    "timeout": "out of time, ",
}
_NOTE = (
    "The timeline _together_ counts actions; on it every run begins a search at the same moment, and the faster ones "
    "wait. Each search's way has its own colour. Marks at each FOUND: green right, red wrong, orange at the object "
    "that was right before the change. In the graph, things that have just changed hands are orange. "
    "Right objects are shown from the beginning of each search: for researchers."
)


@dataclass(frozen=True, slots=True)
class _Search:
    """One search of the sequence as the recording shows it."""

    number: int
    """From 1."""
    begins: int
    """Its place on the timeline `together`."""
    goal: GoalRegion
    rgb: Rgb


def log_sequence(
    runs: Sequence[tuple[RunInfo, Sequence[SequenceRun]]],
    *,
    sequence: HomeSequence,
    scene: Scene,
    out: Path,
    renderer: Renderer | None,
    with_pixels: bool,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
) -> Path:
    """Writes every run of one home sequence into one recording, for researchers: it shows the truth. Returns `out`.

    Args:
        runs: Facts and sequences of run folders; other sequences are left out.
        sequence: The sequence with its truth.
        scene: Its home.
        out: The .rrd file; replaced if it exists.
        renderer: Renders the robots' views from their poses; None = no first-person pictures.
        with_pixels: Whether geometry and pictures of a licensed scan may be written; other homes always may.
        camera: The robots' camera.

    Raises:
        RecordingError: No run has the sequence, runs and scene differ in kind or version, or `out` is not an .rrd file
            or cannot be written.
    """
    require_rrd(out)
    key = sequence_key(sequence)
    traces = select_sequence_traces(runs, key)
    require_same_home(traces, scene)
    may_show = may_be_shown(scene, with_pixels=with_pixels)
    searches = _searches(sequence, traces, scene.navigation)
    maps = shown_storeys(traces, np.concatenate([search.goal.floors_y for search in searches]), scene)
    best = best_two(traces)
    walks = [_in_searches(walk, searches) for walk in walks_of(traces, best, camera, scene)]
    with open_recording(out, paths.SequenceRecordingKey(key)) as stream:
        stream.send_blueprint(sequence_blueprint(traces, maps, shown=best, graph=_bounds(_places(sequence))))
        stream.flush()
        log_identity(stream, key, scene, what="sequence")
        log_paragraphs(stream, _paragraphs(sequence, key, scene, traces, may_show=may_show))
        if may_show:
            log_storeys(stream, scene, maps)
        stream.flush()
        _log_story(stream, sequence, searches, walks[0] if walks else None, maps)
        for walk in walks:
            _log_run(stream, walk, sequence, searches, maps)
        for trace in traces:
            if not trace.is_walk:
                _log_points(stream, trace, searches, maps, scene.navigation)
        stream.flush()
        for walk, jpegs in zip(walks, pictures_of(walks, renderer if may_show else None), strict=True):
            if jpegs:
                log_pictures(stream, walk.walker, walk.rows, jpegs)
    return out


def outcome_of(search: SearchEnd) -> Outcome:
    """What came of one search by rule `paper`."""
    return "right" if search.succeeds("paper") else "at the old object" if search.is_at_old else "wrong"


def _searches(sequence: HomeSequence, traces: Sequence[Trace], navigation: NavigationMap) -> list[_Search]:
    """The searches; each begins one moment after the longest of the runs has ended the one before."""
    found, begins = [], 0
    for index in range(len(sequence.record.subtasks)):
        goal = replace(goal_region(search_episode(sequence, index), navigation), path=None)
        found.append(_Search(index + 1, begins, goal, RUN_COLORS[index % len(RUN_COLORS)]))
        spans = [_run(trace).spans[index] for trace in traces]
        begins += max(1, *(end - first for first, end in spans)) + 1
    return found


def _run(trace: Trace) -> SequenceRun:
    assert isinstance(trace.run, SequenceRun)
    return trace.run


def _in_searches(walk: Walk, searches: Sequence[_Search]) -> Walk:
    """The walk with each row in its search and at its place on the timeline `together`."""
    rows = [replace(walk.rows[0], search=0, together=0)]
    for index, (search, (first, end)) in enumerate(zip(searches, _run(walk.trace).spans, strict=True)):
        for row in walk.rows[first + 1 : end + 1]:
            rows.append(replace(row, search=index, together=search.begins + row.number - first))
    walker = replace(walk.walker, search_rgbs=tuple(search.rgb for search in searches))
    return replace(walk, walker=walker, rows=tuple(rows))


def _begin(walk: Walk, search: _Search) -> Row | None:
    """The moment at which a run was told of a search; None if it never came to it."""
    first, end = _run(walk.trace).spans[search.number - 1]
    return replace(walk.rows[first], together=search.begins) if end > first else None


def _log_story(
    stream: rr.RecordingStream,
    sequence: HomeSequence,
    searches: Sequence[_Search],
    lead: Walk | None,
    maps: Sequence[StoreyMap],
) -> None:
    """Logs what belongs to the sequence and to no run: messages, queries, owners, right objects."""
    record, before = sequence.record, frozenset[Edge]()
    places = _places(sequence)
    for index, (search, subtask) in enumerate(zip(searches, record.subtasks, strict=True)):
        begin = None if lead is None else _begin(lead, search)
        if lead is not None and begin is not None:
            set_moment(stream, lead.walker, begin)
        else:
            _set_together(stream, search.begins, has_steps=lead is None)
        for kind, text in told_before(record, index):
            stream.log(paths.TOLD, rr.TextLog(f"{kind}: {text}", level="WARN", color=rgba_u32(TOLD_RGB)))
        asked = f"search {search.number} ({subtask.kind}): {subtask.query[0]}"
        stream.log(paths.TOLD, rr.TextLog(asked, level="INFO", color=rgba_u32(search.rgb)))
        edges = frozenset(sequence.ownership[index])
        _log_owners(stream, before, edges, places)
        before = edges
        log_goal(stream, search.goal, maps)
        log_old_object(stream, old_target(sequence, index), maps, int(search.goal.storeys[0]))
    stream.reset_time()


def _set_together(stream: rr.RecordingStream, moment: int, *, has_steps: bool = True) -> None:
    """Sets the timelines of POG runs, whose steps are counted on the timeline `together`, to a moment."""
    stream.reset_time()
    stream.set_time(paths.TOGETHER, sequence=moment)
    if has_steps:
        stream.set_time(paths.STEP, sequence=moment)


def _places(sequence: HomeSequence) -> dict[str, tuple[float, float]]:
    """Where each person and each thing of any time stands in the graph."""
    edges = list(dict.fromkeys(edge for owned in sequence.ownership for edge in owned))
    people = list(dict.fromkeys(edge.owner for edge in edges))
    things = list(dict.fromkeys(edge.object_name for edge in edges))
    height = max(len(people), len(things))
    found = {}
    for names, x in ((people, 0.0), (things, _ACROSS)):
        found |= {name: (x, _ROW * height * (place + 0.5) / len(names)) for place, name in enumerate(names)}
    return found


def _bounds(places: Mapping[str, tuple[float, float]]) -> rrb.VisualBounds2D:
    """The part of the graph's plane in which all nodes stand."""
    bottom = max(y for _, y in places.values()) + _ROW
    return rrb.VisualBounds2D(x_range=[-_NODE / 2, _ACROSS + _NODE], y_range=[-_ROW, bottom])


def _log_owners(
    stream: rr.RecordingStream,
    before: frozenset[Edge],
    edges: frozenset[Edge],
    places: Mapping[str, tuple[float, float]],
) -> None:
    """Logs who owns what; things that changed hands are orange."""
    new = edges - before if before else frozenset()
    gone = before - edges
    changed = {edge.object_name for edge in new | gone}
    people = {edge.owner for edge in edges | before}
    names = [name for name in places if name in people | {edge.object_name for edge in edges | before}]
    labels = []
    for name in names:
        were = sorted(edge.owner for edge in gone if edge.object_name == name)
        labels.append(f"{name} (was {', '.join(were)}'s)" if were else name)
    colors = [PERSON_RGB if name in people else OLD_RGB if name in changed else THING_RGB for name in names]
    positions = [places[name] for name in names]
    stream.log(paths.OWNERS, rr.GraphNodes(names, positions=positions, labels=labels, colors=colors))
    stream.log(paths.OWNERS, rr.GraphEdges([(owner, name) for owner, name in sorted(edges)], graph_type="directed"))


def _log_run(
    stream: rr.RecordingStream,
    walk: Walk,
    sequence: HomeSequence,
    searches: Sequence[_Search],
    maps: Sequence[StoreyMap],
) -> None:
    """Logs one PAN run without its pictures."""
    run, trace, walker = _run(walk.trace), walk.trace, walk.walker
    log_record_start(stream, trace.label, trace.info, run.start)
    log_walk(stream, walk, maps)
    apart = np.empty(len(walk.rows))
    for place, row in enumerate(walk.rows):
        apart[place] = searches[row.search or 0].goal.apart(np.array([row.pose.position])).min()
    log_plot_style(stream, walker, CENTRE_DISTANCE, words=trace.title, rgb=trace.rgb)
    log_figures(stream, walker, walk.rows, CENTRE_DISTANCE, apart)
    for index, (search, end, (first, last)) in enumerate(zip(searches, run.end.searches, run.spans, strict=True)):
        if end.reason == "unreached":
            continue
        is_for_all = sequence.record.subtasks[index].mode == "all"
        steps = marking_steps(run.steps[first:last], ends_with_two=is_for_all and end.reason == "found")
        for step in steps:
            _log_mark(
                stream,
                walk,
                walk.rows[first + step + 1],
                _mark_outcome(sequence, index, walk, first + step),
                search,
                maps,
            )
        row = walk.rows[last]  # a search that was given up at once ends where it begins
        set_moment(stream, walker, row if first < last else replace(row, together=search.begins))
        told = f"{trace.title}, search {search.number}: {_result(end)}"
        stream.log(walker.entity(OUTCOMES), rr.TextLog(told, color=rgba_u32(OUTCOME_RGB[outcome_of(end)])))
    stream.reset_time()
    log_record_end(stream, trace.label, run.end)


def _mark_outcome(sequence: HomeSequence, index: int, walk: Walk, step: int) -> Outcome:
    """Whether a FOUND is at a right object, at the old one or at neither, by rule `paper`."""
    place, old = walk.rows[step + 1].pose.position, old_target(sequence, index)
    if any(reaches_target(place, target) for target in sequence.targets[index]):
        return "right"
    return "at the old object" if old is not None and reaches_target(place, old) else "wrong"


def _log_mark(
    stream: rr.RecordingStream, walk: Walk, row: Row, outcome: Outcome, search: _Search, maps: Sequence[StoreyMap]
) -> None:
    """Logs the mark of one FOUND at the robot's feet, in the home and on its storey's map."""
    set_moment(stream, walk.walker, row)
    feet, label, rgb = np.array([row.pose.position]), f"{search.number} {outcome}", OUTCOME_RGB[outcome]
    ball = rr.Points3D(feet + np.array([0.0, LIFT, 0.0]), colors=[rgb], radii=0.12, labels=[label])
    stream.log(walk.walker.entity(FOUND_MARKS), ball)
    for storey in maps:
        if storey.index == row.storey:
            spot = rr.Points2D(storey.pixels(feet), colors=[rgb], radii=POINT, labels=[label], draw_order=50.0)
            stream.log(walk.walker.entity("map", storey.name, FOUND_MARKS), spot)


def _log_points(
    stream: rr.RecordingStream,
    trace: Trace,
    searches: Sequence[_Search],
    maps: Sequence[StoreyMap],
    navigation: NavigationMap,
) -> None:
    """Logs the answers of a POG run; each appears a moment after its search has begun, and goes with the next one."""
    run = _run(trace)
    log_record_start(stream, trace.label, trace.info, run.start)
    for number, (search, end) in enumerate(zip(searches, run.end.searches, strict=True), start=1):
        if number > 1:
            _set_together(stream, search.begins)
            stream.log(paths.run_path(trace.label, "candidates"), rr.Points3D(np.empty((0, 3))))
            log_points(stream, trace, np.empty((0, 3)), maps, navigation)
        _set_together(stream, search.begins + 1)
        points: NDArray[np.float64] = np.array(end.points, float).reshape(-1, 3)
        log_points(stream, trace, points, maps, navigation, first=f": {outcome_of(end)}")
        told = f"{trace.title}, search {number}: {_result(end)}"
        line = rr.TextLog(told, color=rgba_u32(OUTCOME_RGB[outcome_of(end)]))
        stream.log(paths.run_path(trace.label, OUTCOMES), line)
    stream.reset_time()
    log_record_end(stream, trace.label, run.end)


def _result(end: SearchEnd) -> str:
    """What came of a search, in a few words."""
    if end.reason == "unreached":
        return "not reached"
    parts = [_HOW[end.reason] + outcome_of(end)]
    if end.measures is not None:
        parts.append(f"{end.measures.num_steps} steps, {end.measures.path_m:.1f} m")
    if end.all is not None:
        parts.append(f"{end.all.recall:.0%} of all")
    return ", ".join(parts)


def _paragraphs(
    sequence: HomeSequence, key: EpisodeKey, scene: Scene, traces: Sequence[Trace], *, may_show: bool
) -> list[str]:
    """The text that the researcher reads beside the views."""
    record = sequence.record
    names = ("search", "kind", "asked", *(plain_text(trace.title) for trace in traces))
    rows = []
    for index, subtask in enumerate(record.subtasks):
        results = [_result(_run(trace).end.searches[index]) for trace in traces]
        rows.append((str(index + 1), subtask.kind, plain_text(subtask.query[0]), *results))
    edition = traces[0].info.edition
    return [
        table(names, rows),
        _NOTE,
        plain_text(record.messages[0].text),
        f"Edition of the episodes: {edition}." if edition else "",
        *home_paragraphs(scene, may_show=may_show, what=f"sequence {key}, "),
    ]

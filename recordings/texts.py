"""Logs the task, and tables of each run's results and detours, as one text."""

import math
from collections.abc import Sequence

import rerun as rr

from sim.episodes.schema import Episode
from sim.homes.kind import scene_label
from sim.mesh import Scene
from sim.tasks.run_files import Answer, EpisodeRun
from sim.walk.ways import LIMIT, Departure, parting_decision

from . import paths
from .divergence import Divergence
from .traces import Trace

NOTICE = (
    "This recording holds pictures of a scan under HM3D's terms of use: keep it to yourself and to people who have "
    "accepted the same terms."
)
MARKS = f"On floor and map a cross marks where a run first is more than {LIMIT:.0f} m off the shortest path, a diamond \
where the ways of the two shown runs part. DTW: dynamic time warping to the shortest path, metres per place; nDTW: 1 \
on it, towards 0 far from it."


def log_task(
    stream: rr.RecordingStream,
    episode: Episode,
    scene: Scene,
    traces: Sequence[Trace],
    *,
    may_show: bool,
    edition: str,
    divergence: Divergence | None = None,
    more: Sequence[str] = (),
) -> None:
    """Logs the text that the researcher reads beside the views of an episode.

    Args:
        traces: The runs in the tables of measures.
        may_show: Whether pictures are shown; pictures of a scan need a notice about its terms of use.
        edition: Edition of the episodes.
        divergence: How closely the runs, in the order of `traces`, keep to the shortest path; None leaves it out.
        more: Paragraphs of Markdown to add after the tables.
    """
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    answers = [trace for trace in traces if isinstance(trace.run, Answer)]
    parts = [
        f"**Query:** {plain_text(episode.record.query[0])}",
        _walk_table(walks) if walks else "",
        *([] if divergence is None else [_stray_table(traces, divergence), _parting_text(traces, divergence)]),
        _answer_table(answers) if answers else "",
        *more,
        plain_text(episode.record.summary),
        f"Edition of the episodes: {edition}." if edition else "",
    ]
    log_paragraphs(stream, [*parts, *home_paragraphs(scene, may_show=may_show, what=f"episode {episode.key}, ")])


def log_paragraphs(stream: rr.RecordingStream, parts: Sequence[str]) -> None:
    """Logs paragraphs of Markdown as the recording's text; empty ones are left out."""
    text = "\n\n".join(part for part in parts if part)
    stream.log(paths.TASK, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def home_paragraphs(scene: Scene, *, may_show: bool, what: str = "") -> list[str]:
    """Paragraphs with the home's name and kind, and the notice that pictures of a scan need.

    `what` is named beside the home.
    """
    label = scene_label(scene.kind)
    return [
        f"{plain_text(scene.label)}, {what}scene digest {scene.digest[:12]}",
        f"**{label}.**" if label else "",
        f"_{NOTICE}_" if scene.kind == "scan" and may_show else "",
    ]


def table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; cells are Markdown already, and every row has a cell per name."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (names, *rows)]
    return "\n".join([lines[0], "|---" * len(names) + "|", *lines[1:]])


def _walk_table(traces: Sequence[Trace]) -> str:
    names = ("run", "success", "SPL", "soft SPL", "to goal", "end", "steps", "path", "blocked")
    rows = []
    for trace in traces:
        run = trace.run
        assert isinstance(run, EpisodeRun)
        measures = run.end.measures
        paper = measures.rules["paper"] if measures else None
        cells = (
            plain_text(trace.title),
            "-" if paper is None else "yes" if paper.success else "no",
            "-" if paper is None else f"{paper.spl:.2f}",
            "-" if paper is None else f"{paper.soft_spl:.2f}",
            "-" if paper is None else "unreachable" if paper.dtg is None else f"{paper.dtg:.2f} m",
            run.end.reason,
            str(len(run.steps)),
            "-" if measures is None else f"{measures.path_m:.1f} m",
            "-" if measures is None else str(measures.collisions),
        )
        rows.append(cells)
    return table(names, rows)


def _stray_table(traces: Sequence[Trace], divergence: Divergence) -> str:
    names = ("run", "leaves the shortest path", "strays at most", "DTW", "nDTW", "end from its end")
    rows = []
    for trace, stray in zip(traces, divergence.strays, strict=True):
        if stray is None:
            continue
        furthest = float(stray.deviation.max())
        left = "never" if stray.departure is None else _place_text(stray.departure)
        strays = f"{furthest:.1f} m" if math.isfinite(furthest) else "to another storey"
        figures = (f"{stray.apart.dtw_m:.2f} m", f"{stray.apart.ndtw:.2f}", f"{stray.apart.end_m:.2f} m")
        rows.append((plain_text(trace.title), left, strays, *figures))
    return f"{table(names, rows)}\n\n{MARKS}" if rows else ""


def _parting_text(traces: Sequence[Trace], divergence: Divergence) -> str:
    if divergence.pair is None:
        return ""
    pair = tuple(traces[index] for index in divergence.pair)
    first, second = (plain_text(trace.title) for trace in pair)
    decision = _decision_text(pair)
    if divergence.parted is None:
        return f"The ways of {first} and {second} do not part: one goes along the other's to its end. {decision}"
    here, there = divergence.parted
    told = f"{first} {_place_text(here)}, {second} {_place_text(there)}"
    return f"The ways of {first} and {second} part: {told}. {decision}"


def _decision_text(traces: Sequence[Trace]) -> str:
    """The first decision in which two runs differ, in a sentence."""
    first, second = (trace.run.decisions for trace in traces if isinstance(trace.run, EpisodeRun))
    number = parting_decision(first, second)
    return "They did the same throughout." if number is None else f"Their first different decision is number {number}."


def _place_text(place: Departure) -> str:
    return f"after {place.path_m:.1f} m (step {place.row})"


def _answer_table(traces: Sequence[Trace]) -> str:
    names = ("answer", "success", "top 3", "planar distance", "time")
    rows = []
    for trace in traces:
        answer = trace.run
        assert isinstance(answer, Answer)
        measures = answer.measures
        planar = measures.planar_distance if measures else None
        cells = (
            plain_text(trace.title),
            "-" if measures is None else "yes" if measures.success else "no",
            "-" if measures is None else "yes" if measures.top3_success else "no",
            "-" if planar is None else f"{planar:.2f} m",
            "-" if answer.t_s is None else f"{answer.t_s:.1f} s",
        )
        rows.append(cells)
    return table(names, rows)


def plain_text(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    return "".join("\\" + char if char in "\\`*_{}[]<>#|~" else char for char in " ".join(text.split()))

"""Log the task and a table of what each run reached, as one text."""

import math
from collections.abc import Sequence

import rerun as rr

from sim.episodes.schema import Episode
from sim.scenes.scene import Scene
from sim.tasks.run_files import Answer, EpisodeRun

from . import paths
from .log_run import Trace

NOTICE = (
    "This recording holds pictures of a scan under HM3D's terms of use: keep it to yourself and to people who have "
    "accepted the same terms."
)


def log_task(
    stream: rr.RecordingStream, episode: Episode, scene: Scene, traces: Sequence[Trace], *, has_scan_pixels: bool
) -> None:
    """Logs description, query and the table of measures."""
    text = task_markdown(episode, scene, traces, has_scan_pixels=has_scan_pixels)
    stream.log(paths.TASK, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def task_markdown(episode: Episode, scene: Scene, traces: Sequence[Trace], *, has_scan_pixels: bool) -> str:
    """What the researcher reads beside the views."""
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    answers = [trace for trace in traces if isinstance(trace.run, Answer)]
    parts = [
        f"**Query:** {_plain(episode.record.query[0])}",
        _walk_table(walks) if walks else "",
        _answer_table(answers) if answers else "",
        _plain(episode.record.summary),
        f"{_plain(scene.label)}, episode {episode.key}, scene digest {scene.digest[:12]}",
        f"_{NOTICE}_" if has_scan_pixels else "",
    ]
    return "\n\n".join(part for part in parts if part)


def _walk_table(traces: Sequence[Trace]) -> str:
    rows = ["| run | success | SPL | distance to goal | end | steps | path |", "|---|---|---|---|---|---|---|"]
    for trace in traces:
        run = trace.run
        assert isinstance(run, EpisodeRun)
        measures = run.end.measures
        paper = measures.rules.get("paper") if measures else None
        path_m = measures.path_m if measures else math.nan
        cells = (
            _plain(trace.title),
            "-" if paper is None else "yes" if paper.success else "no",
            "-" if paper is None else f"{paper.spl:.2f}",
            "-" if paper is None else "unreachable" if paper.dtg is None else f"{paper.dtg:.2f} m",
            run.end.reason,
            str(len(run.steps)),
            "-" if math.isnan(path_m) else f"{path_m:.1f} m",
        )
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _answer_table(traces: Sequence[Trace]) -> str:
    rows = ["| answer | success | top 3 | planar distance | time |", "|---|---|---|---|---|"]
    for trace in traces:
        answer = trace.run
        assert isinstance(answer, Answer)
        measures = answer.measures
        planar = measures.planar_distance if measures else None
        cells = (
            _plain(trace.title),
            "-" if measures is None else "yes" if measures.success else "no",
            "-" if measures is None else "yes" if measures.top3_success else "no",
            "-" if planar is None else f"{planar:.2f} m",
            "-" if answer.t_s is None else f"{answer.t_s:.1f} s",
        )
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _plain(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    return "".join("\\" + char if char in "\\`*_{}[]<>#|~" else char for char in " ".join(text.split()))

"""Chooses the runs of an episode that a recording shows, their names and colours, and the two that it shows largest."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import RecordingError
from sim.mesh import Scene
from sim.tasks.run_files import Answer, EpisodeRun, Run, RunInfo
from sim.types import EpisodeKey

Rgb = tuple[int, int, int]
RUN_COLORS: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (240, 228, 66),
    (213, 94, 0),
    (0, 114, 178),
    (150, 90, 220),
)
"""Okabe and Ito's palette, which colour-blind people can tell apart, and a violet; further runs start again."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One run of one person or agent as the recording shows it."""

    label: str
    """Unique in the recording; names the run's entities."""
    title: str
    """The run's name in views and tables."""
    rgb: Rgb
    info: RunInfo
    run: EpisodeRun | Answer

    @property
    def positions(self) -> NDArray[np.float64]:
        """World points: (T + 1, 3) feet of a PAN run, (K, 3) candidates of a POG answer."""
        points = [pose.position for pose in self.run.poses] if isinstance(self.run, EpisodeRun) else self.run.candidates
        return np.array(points, float).reshape(-1, 3)


def select_traces(runs: Sequence[Run], key: EpisodeKey) -> list[Trace]:
    """Every run and answer of one episode, each with its own label, title and colour.

    Raises:
        RecordingError: No run holds the episode.
    """
    found = [(run.info, item) for run in runs for item in (*run.episodes, *run.answers) if item.key == key]
    if not found:
        names = ", ".join(run.info.run_id for run in runs) or "no run"
        raise RecordingError(
            f"{names}: found no run of episode {key}; expected at least one. Choose another --episode."
        )
    names = [
        names_of(info, item.start.participant if isinstance(item, EpisodeRun) else item.participant)
        for info, item in found
    ]
    labels, titles = _distinct([label for label, _ in names]), _distinct([title for _, title in names])
    return [
        Trace(label, title, RUN_COLORS[index % len(RUN_COLORS)], info, item)
        for index, (label, title, (info, item)) in enumerate(zip(labels, titles, found, strict=True))
    ]


def names_of(info: RunInfo, participant: str | None) -> tuple[str, str]:
    """Label and title of a run; the title of an agent named `package.module:factory` names only the module."""
    plugin = re.fullmatch(r"(?:\w+\.)*(\w+):\w+", info.who)
    code = f"-{participant}" if participant else ""
    return f"{info.run_id}{code}", f"{plugin[1] if plugin else info.who}{code}"


def common_episode(runs: Sequence[Run]) -> EpisodeKey:
    """The only episode that all runs hold.

    Raises:
        RecordingError: The runs have no episode in common, or several.
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


def best_two(traces: Sequence[Trace]) -> tuple[Trace, ...]:
    """The PAN runs whose cameras are shown: the best person, then the best agent, or else the two best runs.

    A run is better if it succeeds, then if its SPL is larger, then if its distance to the goal is smaller, then if it
    has fewer steps (rule `paper`). Runs without measures come last; the first given wins a tie.
    """
    walks = sorted((trace for trace in traces if isinstance(trace.run, EpisodeRun)), key=_badness)
    people = [trace for trace in walks if trace.info.who_kind == "human"]
    agents = [trace for trace in walks if trace.info.who_kind == "agent"]
    return (people[0], agents[0]) if people and agents else tuple(walks[:2])


def require_same_home(traces: Sequence[Trace], scene: Scene) -> None:
    """Refuses runs from homes of another kind or from other versions of the home: they would walk through its walls.

    Answers on oracle maps fit any home, and answers name no version.

    Raises:
        RecordingError: A run is from another kind of home or another version.
    """
    for trace in traces:
        kind = trace.info.scene_kind
        if kind not in (scene.kind, "oracle-map"):
            raise RecordingError(
                f"{trace.info.run_id}: was made on a home of kind {kind!r}, {scene.name} is opened as {scene.kind!r}; "
                "expected one kind in a recording. Leave the run out, or give (leave out) --scenes-dir."
            )
        measures = trace.run.end.measures if isinstance(trace.run, EpisodeRun) else None
        if measures is not None and measures.scene_digest != scene.digest:
            raise RecordingError(
                f"{trace.info.run_id}: was made on {scene.name} with scene_digest {measures.scene_digest[:12]!r}, the "
                f"home opened now has {scene.digest[:12]!r}; expected the same version of the home. Give the "
                "--dataset and --evidence, or the --scenes-dir of the run, or leave the run out."
            )


def _badness(trace: Trace) -> tuple[bool, bool, float, float, int]:
    assert isinstance(trace.run, EpisodeRun)
    measures = trace.run.end.measures
    paper = measures.rules["paper"] if measures else None
    if paper is None:
        return True, True, 0.0, math.inf, len(trace.run.steps)
    distance = math.inf if paper.dtg is None else paper.dtg
    return False, not paper.success, -paper.spl, distance, len(trace.run.steps)


def _distinct(names: Sequence[str]) -> list[str]:
    """The names; repeated ones get -2, -3, ... after them."""
    taken: list[str] = []
    for name in names:
        number, candidate = 1, name
        while candidate in taken:
            number += 1
            candidate = f"{name}-{number}"
        taken.append(candidate)
    return taken


def path_lengths(run: EpisodeRun) -> NDArray[np.float64]:
    """Metres walked at the start and after each step; (T + 1,)."""
    positions = np.array([pose.position for pose in run.poses])
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))


def times(run: EpisodeRun) -> NDArray[np.float64] | None:
    """Seconds at the start and after each step, (T + 1,); None if the run measured no time."""
    seconds = np.array([0.0, *(step.t_s for step in run.steps)])
    return seconds if seconds.any() else None


def dimmed(rgb: Rgb) -> Rgb:
    """The colour of a run's whole way, darker than that of the part walked so far."""
    return (rgb[0] // 2, rgb[1] // 2, rgb[2] // 2)


def rgba_u32(rgb: Rgb) -> int:
    """Rerun's packed opaque colour."""
    return (rgb[0] << 24) | (rgb[1] << 16) | (rgb[2] << 8) | 255

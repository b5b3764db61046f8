"""Chooses the runs of an episode that a recording shows, their names and colours, and the two that it shows largest."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import RecordingError
from sim.mesh import Scene
from sim.sequences.runs import SequenceRun
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
    run: EpisodeRun | Answer | SequenceRun

    @property
    def is_walk(self) -> bool:
        """Whether it is a PAN run."""
        return self.run.start.task == "pan" if isinstance(self.run, SequenceRun) else isinstance(self.run, EpisodeRun)

    @property
    def positions(self) -> NDArray[np.float64]:
        """World points: (T + 1, 3) feet of a PAN run, (K, 3) candidates of POG answers."""
        if isinstance(self.run, Answer):
            points = self.run.candidates
        elif isinstance(self.run, SequenceRun) and not self.is_walk:
            points = [point for search in self.run.end.searches for point in search.points]
        else:
            points = [pose.position for pose in self.run.poses]
        return np.array(points, float).reshape(-1, 3)

    @property
    def digests(self) -> set[str]:
        """Digests of the home in which it was scored; none for answers and runs that do not say."""
        match self.run:
            case EpisodeRun(end=end):
                measured = [end.measures]
            case SequenceRun(end=end):
                measured = [search.measures for search in end.searches]
            case _:
                measured = []
        return {measures.scene_digest for measures in measured if measures is not None}


def select_traces(runs: Sequence[Run], key: EpisodeKey) -> list[Trace]:
    """Every run and answer of one episode, each with its own label, title and colour.

    Raises:
        RecordingError: No run holds the episode.
    """
    found = [(run.info, item) for run in runs for item in (*run.episodes, *run.answers) if item.key == key]
    if not found:
        raise _none_of("episode", key, [run.info for run in runs])
    return _traces(
        [
            (info, names_of(info, item.start.participant if isinstance(item, EpisodeRun) else item.participant), item)
            for info, item in found
        ]
    )


def select_sequence_traces(runs: Sequence[tuple[RunInfo, Sequence[SequenceRun]]], key: EpisodeKey) -> list[Trace]:
    """Every run of one home sequence; titles name the condition too, such as `messages ignored`.

    Raises:
        RecordingError: No run holds the sequence.
    """
    found = [(info, run) for info, own in runs for run in own if run.key == key]
    if not found:
        raise _none_of("sequence", key, [info for info, _ in runs])
    named = []
    for info, run in found:
        label, title = names_of(info, run.start.participant)
        named.append((info, (label, title if info.condition == "none" else f"{title}, {info.condition}"), run))
    return _traces(named)


def _none_of(what: str, key: EpisodeKey, infos: Sequence[RunInfo]) -> RecordingError:
    names = ", ".join(info.run_id for info in infos) or "no run"
    return RecordingError(f"{names}: found no run of {what} {key}; expected at least one. Choose another --episode.")


def _traces(
    found: Sequence[tuple[RunInfo, tuple[str, str], EpisodeRun | Answer | SequenceRun]],
) -> list[Trace]:
    """Traces of runs with their labels and titles, which become distinct."""
    labels, titles = (_distinct([names[place] for _, names, _ in found]) for place in (0, 1))
    return [
        Trace(label, title, RUN_COLORS[index % len(RUN_COLORS)], info, item)
        for index, (label, title, (info, _, item)) in enumerate(zip(labels, titles, found, strict=True))
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
    return _only_common([(run.info, {item.key for item in (*run.episodes, *run.answers)}) for run in runs], "episode")


def common_sequence(runs: Sequence[tuple[RunInfo, Sequence[SequenceRun]]]) -> EpisodeKey:
    """The only home sequence that all runs hold.

    Raises:
        RecordingError: The runs have no sequence in common, or several.
    """
    return _only_common([(info, {run.key for run in own}) for info, own in runs], "sequence")


def _only_common(held: Sequence[tuple[RunInfo, set[EpisodeKey]]], what: str) -> EpisodeKey:
    common = sorted(set.intersection(*(keys for _, keys in held))) if held else []
    if len(common) == 1:
        return common[0]
    names = ", ".join(info.run_id for info, _ in held) or "no run"
    if common:
        some = ", ".join(str(key) for key in common[:5])
        found, more = f"{len(common)} {what}s that all hold", f": {some}{', ...' if len(common) > 5 else ''}"
    else:
        some = ", ".join(f"{info.run_id} has {len(keys)}" for info, keys in held)
        found, more = f"no {what} that all hold", f" ({some})"
    raise RecordingError(f"{names}: found {found}{more}; expected one. Choose it with --episode SPLIT/SCENE/ID.")


def best_two(traces: Sequence[Trace]) -> tuple[Trace, ...]:
    """The PAN runs whose cameras are shown: the best person, then the best agent, or else the two best runs.

    A run is better if it succeeds, then if its SPL is larger, then if its distance to the goal is smaller, then if it
    has fewer steps (rule `paper`). Of sequences, the one with more right searches is better, then with fewer steps.
    Runs without measures come last; the first given wins a tie.
    """
    walks = sorted((trace for trace in traces if trace.is_walk), key=_badness)
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
        for digest in trace.digests - {scene.digest}:
            raise RecordingError(
                f"{trace.info.run_id}: was made on {scene.name} with scene_digest {digest[:12]!r}, the "
                f"home opened now has {scene.digest[:12]!r}; expected the same version of the home. Give the "
                "--dataset and --evidence, or the --scenes-dir of the run, or leave the run out."
            )


def _badness(trace: Trace) -> tuple[bool, bool, float, float, int]:
    assert not isinstance(trace.run, Answer)
    if isinstance(trace.run, SequenceRun):
        num_right = sum(bool(search.succeeds("paper")) for search in trace.run.end.searches)
        return False, False, -num_right, 0.0, len(trace.run.steps)
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


def times(run: EpisodeRun | SequenceRun) -> NDArray[np.float64] | None:
    """Seconds at the start and after each step, (T + 1,); None if the run measured no time."""
    seconds = np.array([0.0, *(step.t_s for step in run.steps)])
    return seconds if seconds.any() else None


def dimmed(rgb: Rgb) -> Rgb:
    """The colour of a run's whole way, darker than that of the part walked so far."""
    return (rgb[0] // 2, rgb[1] // 2, rgb[2] // 2)


def rgba_u32(rgb: Rgb) -> int:
    """Rerun's packed opaque colour."""
    return (rgb[0] << 24) | (rgb[1] << 16) | (rgb[2] << 8) | 255

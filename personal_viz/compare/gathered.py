"""Run folders -> one `Trial` per run of an episode, in figures, and the runs themselves split by scene on disk.

A study of 2,000 episodes has millions of steps, so run folders are read one at a time, and a worker process reads only
the runs of its own scene.
"""

import hashlib
import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.errors import RunFileError
from sim.tasks.run_files import Answer, EpisodeRun, Run, RunInfo, run_texts
from sim.tasks.run_folders import read_runs, with_controls
from sim.types import ClutterLevel, EndReason, EpisodeKey, SceneKind, TaskKind, WhoKind
from sim.walk.ways import apart
from sim.words.english import how_many

_CLUTTER: Mapping[str, ClutterLevel] = {"0": 0, "1": 1, "2": 2}
_REASONS = {"steps": "out of steps", "giveup": "gave up", "timeout": "out of time", "technical": "technical failure"}
"""How runs ended, in words."""


@dataclass(frozen=True, slots=True, order=True)
class Setting:
    """The homes in which runs were made; results of different settings never share a table."""

    kind: SceneKind
    clutter: ClutterLevel = 0
    labels: bool = False
    """Whether the robots' pictures named the category of each object in view."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run or answer of one person or agent, in figures."""

    key: EpisodeKey
    task: TaskKind
    setting: Setting | None
    """None = an answer on an oracle map."""
    who: str
    who_kind: WhoKind
    condition: str
    participant: str | None
    run_id: str
    reason: EndReason
    success: bool | None
    """Rule `paper` (PAN) or planar distance (POG); None = not scored: a technical failure, or no usable point."""
    spl: float | None
    """0-1; None for answers and where `success` is None."""
    steps: int | None
    """None for answers."""
    time_s: float | None
    """Seconds from start to end; None where no time was measured."""
    distance_m: float | None
    """Metres to the goal at the end (PAN, geodesic) or of the first candidate from the nearest target (POG, planar)."""
    scene_digest: str | None
    """Version of the home; answers name none."""
    digest: str
    """sha256 of the run's lines and of its `run.json`."""
    beside: tuple[str, ...] = ()
    """Conditions of the people beside whom an agent stands that ran on their study; () = any."""
    from_people_m: float | None = None
    """Mean DTW from the ways of people at the episode, metres per place (docs/metrics.md): from other people in its
    condition, or for an agent from those beside whom it stands. None for answers, and where there is nobody."""

    @property
    def row_name(self) -> str:
        """Who, and the condition: the name of a row in the paper's tables."""
        return self.who if self.condition == "none" else f"{self.who} ({self.condition})"

    @property
    def name(self) -> str:
        """The participant, or the agent and its condition."""
        if self.who_kind == "agent":
            return self.row_name
        return f"{self.who} {self.participant}" if self.participant else self.who

    @property
    def facts(self) -> str:
        """The figures in words, and how the run ended unless it was with STOP or a click."""
        words = [] if self.spl is None else [f"SPL {100 * self.spl:.0f}"]
        words += [] if self.steps is None else [how_many(self.steps, "step")]
        words += [f"{self.distance_m:.2f} m"] if self.task == "pog" and self.distance_m is not None else []
        words += [] if self.time_s is None else [f"{self.time_s:.1f} s"]
        others = "other people's ways" if self.who_kind == "human" else "people's ways"
        words += [] if self.from_people_m is None else [f"{self.from_people_m:.2f} m from {others}"]
        words += [] if self.reason in ("stop", "click") else [_REASONS.get(self.reason, self.reason)]
        return ", ".join(words)


@dataclass(frozen=True, slots=True)
class Gathered:
    """All runs of a comparison."""

    trials: tuple[Trial, ...]
    """In the order of the run folders; in each folder those of PAN come first."""
    runs: tuple[Run, ...]
    """For metrics: every run without its steps."""


def gather(
    folders: Sequence[Path], *, dataset_digest: str, episodes: Mapping[EpisodeKey, Episode], into: Path
) -> Gathered:
    """Reads run folders, and writes each scene's part of each run below `into`.

    Args:
        folders: Run folders, or folders of run folders.
        dataset_digest: Digest of the episode files that the runs must be on.
        into: An empty folder; `scene_runs` reads it.

    Raises:
        RunFileError: A run is damaged, empty, on other episode files or of an episode that the dataset does not hold.
    """
    trials: list[Trial] = []
    ways: list[NDArray[np.float64] | None] = []
    runs: list[Run] = []
    for number, folder in enumerate(with_controls(folders)):
        run = read_runs([folder])[0]
        _require_dataset(run, dataset_digest, episodes)
        for item in (*run.episodes, *run.answers):
            trials.append(_trial(run.info, item))
            ways.append(np.array([pose.position for pose in item.poses]) if isinstance(item, EpisodeRun) else None)
        _split(run, into, number)
        light = tuple(item.model_copy(update={"steps": ()}) for item in run.episodes)
        runs.append(run.model_copy(update={"episodes": light}))
    _require_one_version(trials)
    _require_one_study([run.info for run in runs])
    return Gathered(tuple(_beside_people(trials, ways)), tuple(runs))


def scene_runs(into: Path, scene: str) -> list[Run]:
    """The runs of one scene that `gather` wrote, in the order of the run folders."""
    folders = sorted(path for path in (into / scene).glob("*") if path.is_dir())
    return read_runs(folders) if folders else []


def setting_of(info: RunInfo) -> Setting | None:
    """The run's setting; None = an oracle map."""
    if info.scene_kind == "oracle-map":
        return None
    return Setting(info.scene_kind, _CLUTTER.get(str(info.config.get("clutter", 0)), 0), info.labels)


def beside_of(info: RunInfo) -> tuple[str, ...]:
    """The conditions of the people beside whom an agent stands that ran on their study; () = any."""
    told = str(info.config.get("study_conditions") or "") if info.who_kind == "agent" else ""
    return tuple(told.split(",")) if told else ()


def _require_one_study(infos: Sequence[RunInfo]) -> None:
    """Refuses agents that ran on another study than that of the people."""
    people = {str(info.config.get("study_version", "")) for info in infos if info.who_kind == "human"}
    for info in infos:
        version = str(info.config.get("study_version", ""))
        if info.who_kind == "agent" and version and people and version not in people:
            known = ", ".join(sorted(each[:12] or "none" for each in people))
            raise RunFileError(
                f"{info.run_id}: ran on study version {version[:12]}; expected {known}, that of the people. Run it "
                "again with --study, or leave it out."
            )


def _require_dataset(run: Run, dataset_digest: str, episodes: Mapping[EpisodeKey, Episode]) -> None:
    if run.info.dataset_digest != dataset_digest:
        raise RunFileError(
            f"{run.info.run_id}: dataset_digest is {run.info.dataset_digest[:12]!r}, that of --dataset "
            f"{dataset_digest[:12]!r}; expected runs on the same episode files. Give the --dataset and --evidence of "
            "the run, or leave the run out."
        )
    for item in (*run.episodes, *run.answers):
        if item.key not in episodes:
            raise RunFileError(
                f"{run.info.run_id}: found a run of {str(item.key)[:120]!r}, which --dataset does not hold; expected "
                "one of its episodes. Give the --dataset of the run, or leave the run out."
            )


def _require_one_version(trials: Sequence[Trial]) -> None:
    """Refuses runs on two versions of a home before any home is opened."""
    first: dict[tuple[Setting | None, str], Trial] = {}
    for trial in trials:
        if trial.scene_digest is None:
            continue
        other = first.setdefault((trial.setting, trial.key.scene), trial)
        if other.scene_digest != trial.scene_digest:
            assert other.scene_digest is not None
            raise RunFileError(
                f"{trial.run_id}: was made on {trial.key.scene} with scene_digest {trial.scene_digest[:12]!r}, "
                f"{other.run_id} with {other.scene_digest[:12]!r}; expected one version of each home. Compare the runs "
                "of one version, or run the others again."
            )


def _beside_people(trials: Sequence[Trial], ways: Sequence[NDArray[np.float64] | None]) -> list[Trial]:
    """The trials with `from_people_m`; `ways` are their feet (T + 1, 3), None for answers."""
    people: dict[tuple[Setting | None, EpisodeKey], list[int]] = defaultdict(list)
    for number, trial in enumerate(trials):
        if trial.who_kind == "human" and ways[number] is not None:
            people[trial.setting, trial.key].append(number)

    def from_people(number: int, trial: Trial) -> float | None:
        way, conditions = ways[number], (trial.condition,) if trial.who_kind == "human" else trial.beside
        if way is None:
            return None
        others = [
            ways[other]
            for other in people.get((trial.setting, trial.key), ())
            if other != number and (not conditions or trials[other].condition in conditions)
        ]
        found = [apart(way, other).dtw_m for other in others if other is not None]
        return statistics.fmean(found) if found else None

    return [replace(trial, from_people_m=from_people(number, trial)) for number, trial in enumerate(trials)]


def _split(run: Run, into: Path, number: int) -> None:
    for scene in {item.key.scene for item in (*run.episodes, *run.answers)}:
        episodes = tuple(item for item in run.episodes if item.key.scene == scene)
        answers = tuple(item for item in run.answers if item.key.scene == scene)
        folder = into / scene / f"{number:05d}"
        folder.mkdir(parents=True)
        for name, text in run_texts(run.model_copy(update={"episodes": episodes, "answers": answers})).items():
            (folder / name).write_text(text, encoding="utf-8")


def _trial(info: RunInfo, item: EpisodeRun | Answer) -> Trial:
    digest = hashlib.sha256(info.model_dump_json().encode())
    digest.update(item.model_dump_json().encode())
    names = (setting_of(info), info.who, info.who_kind, info.condition)
    if isinstance(item, Answer):
        measures = item.measures if item.reason != "technical" else None
        success = measures.success if measures else None
        distance = measures.planar_distance if measures else None
        return Trial(
            item.key, "pog", *names, item.participant, info.run_id, item.reason, success, None, None, item.t_s,
            distance, None, digest.hexdigest(), beside_of(info),
        )  # fmt: skip
    scored = item.end.measures if item.end.reason != "technical" else None
    rule = scored.rules["paper"] if scored else None
    time_s = item.steps[-1].t_s if item.steps else None
    return Trial(
        item.key, "pan", *names, item.start.participant, info.run_id, item.end.reason,
        rule.success if rule else None,
        rule.spl if rule else None,
        len(item.steps),
        time_s or None,  # runs that measured no time store 0
        rule.dtg if rule else None,
        item.end.measures.scene_digest if item.end.measures else None,
        digest.hexdigest(),
        beside_of(info),
    )  # fmt: skip

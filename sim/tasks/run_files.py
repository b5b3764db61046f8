"""Runs on disk and in memory: `EpisodeRun` (PAN) and `Answer` (POG), from agents, people and other simulators alike.

`runs/<run_id>/`: `run.json` (who and with what), `steps.jsonl` (one block of lines per PAN episode: `episode`,
`step`..., `end`), `answers.jsonl` (one line per POG answer). Blocks are appended whole; files are never edited.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.episodes.schema import Finite, Vector3
from sim.errors import RunFileError, line_from_validation_error
from sim.files import append_whole, write_whole
from sim.types import Action, EndReason, EpisodeKey, Pose, SceneKind, Split, SuccessRule, WhoKind

SCHEMA_VERSION = 1
RUN_ID = r"^[A-Za-z0-9_-][A-Za-z0-9._-]{0,79}$"
"""Pattern of a run's name, which is also its folder's: no slash, no leading dot."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class RunInfo(BaseModel):
    """`run.json`: who ran, on which data, with which program."""

    model_config = _MODEL
    schema_version: Literal[1] = SCHEMA_VERSION
    run_id: str = Field(pattern=RUN_ID)
    who: str = Field(min_length=1, max_length=80)
    """Row name in tables: an agent's or a grounder's name, or "human"."""
    who_kind: WhoKind
    condition: str = "none"
    """`none` or `memory` for PAN; map and encoder for POG."""
    scene_kind: SceneKind | Literal["oracle-map"]
    """Where the results hold; tables never mix kinds."""
    dataset_digest: str
    seed: int | None = None
    config: dict[str, str | int | float | bool | None] = {}
    """Options that the command was given."""
    versions: dict[str, str] = {}
    git_commit: str | None = None
    created_utc: str
    """ISO 8601."""


class Step(BaseModel):
    """One action and where it led."""

    model_config = _MODEL
    kind: Literal["step"] = "step"
    action: Action
    position: Vector3
    """Feet after the action, world metres."""
    yaw: Finite
    tilt: Finite = 0.0
    collided: bool = False
    t_s: Finite = 0.0
    """Seconds since the episode's start."""

    @property
    def pose(self) -> Pose:
        """Pose after the action."""
        return Pose(self.position, self.yaw, self.tilt)


class EpisodeStart(BaseModel):
    """First line of an episode's block."""

    model_config = _MODEL
    kind: Literal["episode"] = "episode"
    schema_version: Literal[1] = SCHEMA_VERSION
    split: Split
    scene: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    episode_id: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    position: Vector3
    yaw: Finite
    allow_sliding: bool = False
    participant: str | None = None
    """Public code of the person, None for agents."""


class RuleMeasures(BaseModel):
    """One success rule's figures for one run (rules: DESIGN.md)."""

    model_config = _MODEL
    success: bool
    spl: Finite
    soft_spl: Finite
    dtg: Finite | None
    """Geodesic metres to the rule's success region at the end, 0 inside; None when unreachable."""
    start_distance: Finite | None
    """L: the same at the start; None when unreachable."""


class Measures(BaseModel):
    """What the simulator computed when a run ended; a program outside never writes this."""

    model_config = _MODEL
    rules: dict[SuccessRule, RuleMeasures | None]
    """None = the rule has no usable point in this episode ("undefined")."""
    centre_distance: Finite
    """Planar metres from the last position to the nearest valid target's centre."""
    path_m: Finite
    """Sum of 3-D displacements."""
    num_steps: int
    collisions: int
    stored_geodesic: Finite
    """The dataset's own `info.geodesic_distance`, the named alternative for L."""
    scene_digest: str


class EpisodeEnd(BaseModel):
    """Last line of an episode's block."""

    model_config = _MODEL
    kind: Literal["end"] = "end"
    reason: EndReason
    measures: Measures | None = None
    """None in files that another simulator wrote, until `personal-viz import` has read them."""


class EpisodeRun(BaseModel):
    """One finished PAN episode of a person or an agent."""

    model_config = _MODEL
    start: EpisodeStart
    steps: tuple[Step, ...]
    end: EpisodeEnd

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.start.split, self.start.scene, self.start.episode_id)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Start pose and the pose after each step; len(steps) + 1."""
        return (Pose(self.start.position, self.start.yaw), *(step.pose for step in self.steps))


class AnswerMeasures(BaseModel):
    """How far a POG answer is from the truth (rule: DESIGN.md, planar distance on the target's storey)."""

    model_config = _MODEL
    success: bool
    top3_success: bool
    planar_distance: Finite | None
    """Metres to the nearest valid target's centre on the answer's storey; None when none is on it or no answer."""
    distance_3d: Finite | None


class ClickRay(BaseModel):
    """How a person pointed: the ray in the world and the camera it came from."""

    model_config = _MODEL
    origin: Vector3
    direction: Vector3
    camera_position: Vector3
    camera_wxyz: tuple[Finite, Finite, Finite, Finite]
    storey_y: Finite
    """Floor height of the storey that was shown."""


class Answer(BaseModel):
    """One POG answer of a person or a grounder; one line of `answers.jsonl`."""

    model_config = _MODEL
    kind: Literal["answer"] = "answer"
    schema_version: Literal[1] = SCHEMA_VERSION
    split: Split
    scene: str
    episode_id: str
    candidates: tuple[Vector3, ...]
    """World points, best first; empty = no answer. A person gives one."""
    scores: tuple[Finite, ...] = ()
    """One per candidate, higher is better; empty for people."""
    storey_given: bool = False
    """Whether the target's storey was told."""
    participant: str | None = None
    ray: ClickRay | None = None
    t_s: Finite | None = None
    """Seconds from the scene being shown to the answer."""
    reason: EndReason = "click"
    measures: AnswerMeasures | None = None

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)


class Run(BaseModel):
    """A whole run folder in memory."""

    model_config = _MODEL
    info: RunInfo
    episodes: tuple[EpisodeRun, ...] = ()
    answers: tuple[Answer, ...] = ()


_LINE_MODELS = {"episode": EpisodeStart, "step": Step, "end": EpisodeEnd, "answer": Answer}
_ADVICE = "Write the file again from its source, or delete the damaged line's episode block."


def read_lines(path: Path) -> Iterator[tuple[int, BaseModel]]:
    """(line number from 1, checked model) of each line of a steps or answers file.

    Raises:
        RunFileError: The file is unreadable or a line is not valid.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected JSON lines. Check the path.") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            raw = json.loads(line)
            kind = raw.get("kind") if isinstance(raw, dict) else None
        except ValueError:
            raise RunFileError(
                f"{path}:{number}: found text that is not JSON; expected one object. {_ADVICE}"
            ) from None
        if not isinstance(kind, str) or kind not in _LINE_MODELS:
            raise RunFileError(f"{path}:{number}: kind is {kind!r}; expected one of {list(_LINE_MODELS)}. {_ADVICE}")
        try:
            yield number, _LINE_MODELS[kind].model_validate_json(line, strict=True)
        except ValidationError as error:
            raise RunFileError(line_from_validation_error(f"{path}:{number}", error, advice=_ADVICE)) from None


def read_episode_runs(path: Path) -> Iterator[tuple[list[int], EpisodeRun]]:
    """(line numbers of start, each step and end; run) of each block; an incomplete last block is left out.

    Raises:
        RunFileError: A line is not valid or stands where it cannot.
    """
    numbers: list[int] = []
    start: EpisodeStart | None = None
    steps: list[Step] = []
    for number, line in read_lines(path):
        if isinstance(line, EpisodeStart) and start is None:
            numbers, start, steps = [number], line, []
        elif isinstance(line, Step) and start is not None:
            numbers.append(number)
            steps.append(line)
        elif isinstance(line, EpisodeEnd) and start is not None:
            yield [*numbers, number], EpisodeRun(start=start, steps=tuple(steps), end=line)
            start = None
        else:
            expected = "'episode'" if start is None else "'step' or 'end'"
            raise RunFileError(f"{path}:{number}: kind is {line.kind!r}; expected {expected} here. {_ADVICE}")  # type: ignore[attr-defined]


def read_run(folder: Path) -> Run:
    """A run folder.

    Raises:
        RunFileError: `run.json` is missing or any file is damaged.
    """
    info = read_run_info(folder)
    steps, answers = folder / "steps.jsonl", folder / "answers.jsonl"
    runs = tuple(run for _, run in read_episode_runs(steps)) if steps.is_file() else ()
    found = []
    for number, line in read_lines(answers) if answers.is_file() else ():
        if not isinstance(line, Answer):
            raise RunFileError(f"{answers}:{number}: expected only lines of kind 'answer'. {_ADVICE}")
        found.append(line)
    return Run(info=info, episodes=runs, answers=tuple(found))


def read_run_info(folder: Path) -> RunInfo:
    """`run.json` of a run folder.

    Raises:
        RunFileError: It is missing or damaged.
    """
    path = folder / "run.json"
    if not path.is_file():
        raise RunFileError(
            f"{folder}: found no run.json; expected a folder written by personal-viz run, ground, import or "
            "study export. Give the folder that holds run.json."
        )
    try:
        return RunInfo.model_validate_json(path.read_bytes(), strict=True)
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(path, error, advice="Restore the file.")) from None


class RunWriter:
    """Appends finished episodes and answers to a run folder; a killed run resumes where it stopped."""

    def __init__(self, folder: Path, info: RunInfo) -> None:
        """Opens the folder; an incomplete tail left by a kill is cut off. A new run is written with its first result.

        Raises:
            RunFileError: The folder cannot be written, or holds a run of another configuration.
        """
        self.folder = folder
        self._info = info
        self.done: set[EpisodeKey] = set()
        """Episodes that the folder already holds."""
        self._scene_digests: dict[str, str] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / "run.json").exists():
                self._require_same_run(read_run_info(folder), info)
                for name in ("steps.jsonl", "answers.jsonl"):
                    _cut_incomplete_tail(folder / name)
                run = read_run(folder)
                self.done |= {item.key for item in (*run.episodes, *run.answers)}
                for episode in run.episodes:
                    self._require_same_scene(episode)
        except OSError as error:
            raise self._unwritable(error) from None

    def add_episode(self, run: EpisodeRun) -> None:
        """Appends one block; it is on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written, or its episodes of this scene were run on another version of it.
        """
        self._require_same_scene(run)
        self._append("steps.jsonl", (run.start, *run.steps, run.end))
        self.done.add(run.key)

    def add_answers(self, answers: Sequence[Answer]) -> None:
        """Appends one line each; they are on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written.
        """
        self._append("answers.jsonl", answers)
        self.done.update(answer.key for answer in answers)

    def _append(self, name: str, lines: Sequence[BaseModel]) -> None:
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        try:
            if not (self.folder / "run.json").exists():
                write_whole(self.folder / "run.json", self._info.model_dump_json(indent=2) + "\n")
            append_whole(self.folder / name, text)
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> RunFileError:
        return RunFileError(
            f"{self.folder}: cannot be written ({error}); expected a folder with space that you can write. "
            "Give another --out, or make room and run again: finished episodes are kept."
        )

    def _require_same_run(self, found: RunInfo, wanted: RunInfo) -> None:
        for field in ("who", "condition", "scene_kind", "dataset_digest", "seed", "config"):
            was, now = getattr(found, field), getattr(wanted, field)
            if was != now:
                raise RunFileError(
                    f"{self.folder / 'run.json'}: {field} is {was!r}, this run has {now!r}; "
                    "expected the same to resume. Give another --out or --run-id."
                )

    def _require_same_scene(self, run: EpisodeRun) -> None:
        """Distances on two versions of a home never share a folder; a run without measures says nothing of its home."""
        if run.end.measures is None:
            return
        scene, now = run.key.scene, run.end.measures.scene_digest
        was = self._scene_digests.setdefault(scene, now)
        if was != now:
            raise RunFileError(
                f"{self.folder / 'steps.jsonl'}: scene_digest of {scene} is {was[:12]!r}, {run.key} has {now[:12]!r}; "
                "expected one version of the home per run. Give another --out or --run-id."
            )


def _cut_incomplete_tail(path: Path) -> None:
    """Drop lines after the last complete block or answer (left by a kill in the middle of a write)."""
    if not path.is_file():
        return
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
    whole = len(lines)
    while whole and not (lines[whole - 1].endswith("\n") and _closes_a_block(lines[whole - 1])):
        whole -= 1
    if whole < len(lines):
        write_whole(path, "".join(lines[:whole]))


def _closes_a_block(line: str) -> bool:
    try:
        raw = json.loads(line)
    except ValueError:
        return False
    return isinstance(raw, dict) and raw.get("kind") in ("end", "answer")

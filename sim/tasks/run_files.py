"""Runs on disk and in memory: `EpisodeRun` (PAN) and `Answer` (POG), from agents, people and other simulators alike.

`runs/<run_id>/`: `run.json` (who and with what), `steps.jsonl` (one block of lines per PAN episode: `episode`,
`step`..., `end`), `answers.jsonl` (one line per POG answer), `reported.jsonl` (one line per PAN episode whose figures
another program reported), `chat.jsonl` (chat_turns.py). Blocks are appended whole; files are never edited.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.episodes.editions import edition_of
from sim.episodes.schema import Finite, Vector3
from sim.errors import RunFileError, line_from_validation_error
from sim.files import bounded_json, bounded_lines
from sim.homes.kind import scene_label, scene_terms
from sim.types import SUCCESS_RULES, Action, EndReason, EpisodeKey, Pose, SceneKind, Split, SuccessRule, WhoKind

Length = Annotated[Finite, Field(ge=0)]
Share = Annotated[Finite, Field(ge=0, le=1)]
SCHEMA_VERSION = 3
"""Version of `run.json` and of an episode's block. Older ones still read: version 2 had no `labels`, and version 1
neither `paper-strict` nor `made_for`."""
FAR_FROM_VIEW = 1.0
"""Metres of walking to the nearest view point beyond which a success by `paper` is called far from view."""
RUN_ID = r"^[A-Za-z0-9_-][A-Za-z0-9._-]{0,79}$"
"""Pattern of a run's name, which is also the name of its folder: no slash, no leading dot."""
MAX_NAME = 80
"""Most characters of a run's name and of a row's name."""
_MODEL = ConfigDict(frozen=True, extra="forbid")
_Line = TypeVar("_Line", bound=BaseModel)


_NO_CONTROLS = r"^[^\x00-\x1f\x7f-\x9f]*$"
"""Pattern of a name in tables: one line without control characters."""


class RunInfo(BaseModel):
    """`run.json`: the agent or person, the data and the program of a run."""

    model_config = _MODEL
    schema_version: Literal[1, 2, 3] = SCHEMA_VERSION
    run_id: str = Field(pattern=RUN_ID)
    who: str = Field(min_length=1, max_length=MAX_NAME, pattern=_NO_CONTROLS)
    """Row name in tables: an agent's or a grounder's name, or "human"."""
    who_kind: WhoKind
    condition: str = Field(default="none", pattern=_NO_CONTROLS)
    """`none` or `memory` for PAN; map and encoder for POG."""
    scene_kind: SceneKind | Literal["oracle-map"]
    """Kind of homes for which the results hold; tables never mix kinds."""
    dataset_digest: str
    """`PersonalDataset.digest`: the episode files, and the evidence from which homes without a scan were recovered."""
    seed: int | None = None
    config: dict[str, str | int | float | bool | None] = {}
    """Options of the command."""
    versions: dict[str, str] = {}
    git_commit: str | None = None
    created_utc: str
    """Time in ISO 8601."""
    made_for: SuccessRule | None = None
    """Rule that an agent with ground truth was made for, or that people were told; None = none, or not known."""
    scene_label: str = ""
    """The label of results in homes of this kind; follows from `scene_kind`, empty for scans."""
    scene_terms: str = ""
    """Terms of use that may apply to this kind of homes; from `scene_kind`, empty for invented homes and scans."""
    edition: str = ""
    """Name of the edition of the episodes; from `dataset_digest`, and tables never mix editions."""
    labels: bool = False
    """Whether the robot's pictures named the category of each object in view; PAN only, and tables never mix both."""

    @model_validator(mode="before")
    @classmethod
    def _read_older(cls, raw: Any) -> Any:
        """Reads version 1, which had no label and one agent with ground truth, made for rule `paper`, and version 2, in
        which all PAN pictures of schematic homes named the objects."""
        if not isinstance(raw, dict):
            return raw
        version, kind = raw.get("schema_version"), str(raw.get("scene_kind"))
        is_first = version == 1 and raw.get("who") == "shortest-path"
        older: dict[str, Any] = {"made_for": "paper"} if is_first else {}
        older |= {"labels": _had_labels(raw)} if version in (1, 2) else {}
        derived = {"scene_label": scene_label(kind), "scene_terms": scene_terms(kind)}
        return older | raw | derived | {"edition": edition_of(str(raw.get("dataset_digest")))}


def _had_labels(raw: dict[str, Any]) -> bool:
    """Whether the pictures of a run of version 1 or 2 named the objects; imported runs had other pictures."""
    is_pan = str(raw.get("condition", "none")).startswith(("none", "clutter ", "memory_"))
    config = raw.get("config")
    is_imported = isinstance(config, dict) and "imported" in config
    return raw.get("scene_kind") == "schematic" and is_pan and not is_imported


class Step(BaseModel):
    """One action and its result."""

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
    schema_version: Literal[1, 2, 3] = SCHEMA_VERSION
    split: Split
    scene: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    episode_id: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    position: Vector3
    yaw: Finite
    allow_sliding: bool = False
    motion: Literal["paper", "free"] = "paper"
    """`free`: poses of a robot with other actions than PersONAL's; its steps' actions are the nearest names."""
    participant: str | None = None
    """Public code of the person, None for agents."""


class RuleMeasures(BaseModel):
    """Figures of one success rule for one run (rules: DESIGN.md)."""

    model_config = _MODEL
    success: bool
    spl: Share
    soft_spl: Share
    dtg: Length | None
    """Geodesic metres to the rule's success region at the end, 0 inside; None when unreachable."""
    start_distance: Length | None
    """L: the same distance at the start; None when unreachable."""


class Measures(BaseModel):
    """Measures that the simulator computed when a run ended; other programs never write them."""

    model_config = _MODEL
    rules: dict[SuccessRule, RuleMeasures | None]
    """Measures by each rule; None ("undefined") = the rule has no usable point in this episode, or the program that
    computed the measures did not know the rule (`paper-strict`)."""
    centre_distance: Length
    """Planar metres from the last position to the nearest valid target's centre."""
    path_m: Length
    """Sum of 3-D displacements."""
    num_steps: int = Field(ge=0)
    collisions: int = Field(ge=0)
    stored_geodesic: Length
    """The dataset's own `info.geodesic_distance`, the named alternative for L."""
    scene_digest: str

    @model_validator(mode="before")
    @classmethod
    def _read_version_1(cls, raw: Any) -> Any:
        """Reads runs and studies of version 1, which store too little for the distances of `paper-strict`."""
        rules = raw.get("rules") if isinstance(raw, dict) else None
        if isinstance(rules, dict) and "paper-strict" not in rules:
            return {**raw, "rules": {**rules, "paper-strict": None}}
        return raw

    @property
    def ends_far_from_view(self) -> bool | None:
        """Whether a success by `paper` ends more than `FAR_FROM_VIEW` of walking from every view point of a target.

        None = no success, or the targets have no view point on their storey. An end without a path to one is far.
        """
        paper, habitat = self.rules["paper"], self.rules["habitat"]
        if paper is None or habitat is None or not paper.success:
            return None
        return habitat.dtg is None or habitat.dtg > FAR_FROM_VIEW

    @model_validator(mode="after")
    def _every_rule_once(self) -> "Measures":
        if set(self.rules) != set(SUCCESS_RULES):
            raise ValueError(f"rules {list(SUCCESS_RULES)}, found {list(self.rules)}")
        return self


class EpisodeEnd(BaseModel):
    """Last line of an episode's block."""

    model_config = _MODEL
    kind: Literal["end"] = "end"
    reason: EndReason
    measures: Measures | None = None
    """Measures of the run; None in files of another simulator until `personal-viz import` has read them."""


class EpisodeRun(BaseModel):
    """One finished PAN episode of a person or an agent."""

    model_config = _MODEL
    start: EpisodeStart
    steps: tuple[Step, ...]
    end: EpisodeEnd

    @model_validator(mode="after")
    def _as_many_steps_as_measured(self) -> "EpisodeRun":
        measures = self.end.measures
        if measures is not None and measures.num_steps != len(self.steps):
            raise ValueError(f"{measures.num_steps} step lines as measures.num_steps says, found {len(self.steps)}")
        return self

    @model_validator(mode="after")
    def _is_no_sequence(self) -> "EpisodeRun":
        if any(step.action is Action.FOUND for step in self.steps):
            raise ValueError("no action 'found', which home sequences have")
        return self

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.start.split, self.start.scene, self.start.episode_id)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Start pose and the pose after each step; len(steps) + 1."""
        return (Pose(self.start.position, self.start.yaw), *(step.pose for step in self.steps))

    @property
    def decisions(self) -> tuple[tuple[Action | None, Pose], ...]:
        """The start without an action, then each action with the pose after it; len(steps) + 1."""
        return tuple(zip((None, *(step.action for step in self.steps)), self.poses, strict=True))


class AnswerMeasures(BaseModel):
    """Distances of a POG answer from the target (rule: DESIGN.md, planar distance on the target's storey)."""

    model_config = _MODEL
    success: bool
    top3_success: bool
    planar_distance: Length | None
    """Metres to the nearest valid target's centre on the answer's storey; None without such a target or answer."""
    distance_3d: Length | None
    planar_distances: tuple[Length | None, ...] | None = None
    """`planar_distance` of each of the first three candidates; None in files of versions that did not store them."""
    on_object: bool | None = None
    """Whether a person pointed at the target itself: the confirmed click met it. None for grounders, where it is not
    known which object a click met, and in files of versions that did not store it."""


class ClickRay(BaseModel):
    """A person's click: the ray in the world and its camera."""

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
    schema_version: Literal[1, 2] = 2
    split: Split
    scene: str
    episode_id: str
    candidates: tuple[Vector3, ...]
    """World points, best first; empty = no answer. A person gives one."""
    scores: tuple[Finite, ...] = ()
    """One per candidate, higher is better; empty for people."""
    storey_given: bool = False
    """Whether the target's storey was given."""
    participant: str | None = None
    ray: ClickRay | None = None
    t_s: Finite | None = None
    """Seconds from showing the texts to the answer; an earlier look at the home is not counted."""
    reason: EndReason = "click"
    fell_back: bool = Field(default=False, validation_alias=AliasChoices("fell_back", "phrases_fell_back"))
    """Whether the language model in run.json gave nothing that can be used: rules read the phrases, or a method without
    a model answered. Version 1 called it `phrases_fell_back`."""
    measures: AnswerMeasures | None = None

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)


class Reported(BaseModel):
    """The figures of one PAN episode as another program reported them; one line of `reported.jsonl`.

    Nothing about them was checked or recomputed.
    """

    model_config = _MODEL
    kind: Literal["reported"] = "reported"
    schema_version: Literal[1] = 1
    split: Split
    scene: str
    episode_id: str
    success: bool
    spl: Share | None = None
    dtg: Length | None = None
    """Metres to the goal at the end, by the program's own definition; None = not told, or no path."""
    num_steps: int | None = Field(default=None, ge=0)
    stopped: bool | None = None

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)


REPORTED = "reported, not recomputed"
"""Condition of runs whose figures another program reported."""


class Run(BaseModel):
    """A whole run folder in memory."""

    model_config = _MODEL
    info: RunInfo
    episodes: tuple[EpisodeRun, ...] = ()
    answers: tuple[Answer, ...] = ()
    reported: tuple[Reported, ...] = ()


def fitting_run_id(name: str) -> str:
    """The name in a form for a run's folder; a name that fits stays as it is.

    Characters that a folder's name may not have become `-`, and `fitting_name` shortens the rest; a digest keeps
    changed names apart.
    """
    if re.fullmatch(RUN_ID, name):
        return name
    kept = re.sub(r"[^A-Za-z0-9._-]+", "-", name).lstrip(".-") or "run"
    return kept[: MAX_NAME - 9] + _digest_of(name)


def fitting_name(name: str) -> str:
    """The name; a longer one is shortened to `MAX_NAME` characters and ends with a digest of the whole name."""
    return name if len(name) <= MAX_NAME else name[: MAX_NAME - 9] + _digest_of(name)


def _digest_of(name: str) -> str:
    return "-" + hashlib.sha256(name.encode(errors="backslashreplace")).hexdigest()[:8]


_LINE_MODELS = {"episode": EpisodeStart, "step": Step, "end": EpisodeEnd, "answer": Answer, "reported": Reported}
_ADVICE = "Write the file again from its source, or delete the damaged line's episode block."


def read_lines(
    path: Path, models: Mapping[str, type[BaseModel]] = MappingProxyType(_LINE_MODELS)
) -> Iterator[tuple[int, BaseModel]]:
    """(line number from 1, checked model) of each line of a file of steps, answers or reported figures.

    Args:
        path: The file.
        models: The model of each kind of line.

    Raises:
        RunFileError: The file is unreadable or a line is not valid.
    """
    for number, line in _text_lines(path):
        if not line.strip():
            continue
        try:
            raw = json.loads(line)
            kind = raw.get("kind") if isinstance(raw, dict) else None
        except (ValueError, RecursionError):
            raise RunFileError(
                f"{path}:{number}: found text that is not JSON; expected one object. {_ADVICE}"
            ) from None
        if not isinstance(kind, str) or kind not in models:
            raise RunFileError(f"{path}:{number}: kind is {kind!r}; expected one of {list(models)}. {_ADVICE}")
        try:
            yield number, models[kind].model_validate_json(line, strict=True)
        except ValidationError as error:
            raise RunFileError(line_from_validation_error(f"{path}:{number}", error, advice=_ADVICE)) from None


def _text_lines(path: Path) -> Iterator[tuple[int, str]]:
    """(line number from 1, text) of each line, read one after the other.

    Raises:
        RunFileError: The file cannot be read, is not UTF-8, or has a longer line than our programs write.
    """
    try:
        for number, line in enumerate(bounded_lines(path), start=1):
            yield number, line.decode("utf-8-sig" if number == 1 else "utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected JSON lines. Check the path.") from None


def read_episode_runs(path: Path) -> Iterator[tuple[list[int], EpisodeRun]]:
    """(line numbers of start, each step and end; run) of each block; an incomplete last block is left out.

    Raises:
        RunFileError: A line is not valid or is in the wrong place.
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
            try:
                run = EpisodeRun(start=start, steps=tuple(steps), end=line)
            except ValidationError as error:
                found = error.errors()[0]["msg"]
                raise RunFileError(f"{path}:{number}: the block is not whole: {found}. {_ADVICE}") from None
            yield [*numbers, number], run
            start = None
        else:
            expected = "'episode'" if start is None else "'step' or 'end'"
            raise RunFileError(f"{path}:{number}: kind is {line.kind!r}; expected {expected} here. {_ADVICE}")  # type: ignore[attr-defined]


def read_run(folder: Path, *, with_reported: bool = False) -> Run:
    """A run folder.

    Args:
        folder: The folder.
        with_reported: Whether it may hold figures that another program reported. They are no trials to show or pair.

    Raises:
        RunFileError: `run.json` is missing, any file is damaged, or the folder holds only reported figures.
    """
    info = read_run_info(folder)
    steps = folder / "steps.jsonl"
    runs = tuple(run for _, run in read_episode_runs(steps)) if steps.is_file() else ()
    answers = _read_all(folder / "answers.jsonl", Answer)
    reported = _read_all(folder / "reported.jsonl", Reported)
    if reported and not with_reported:
        raise RunFileError(
            f"{folder}: holds figures that were {REPORTED}; expected runs whose steps were checked here. Import "
            "the steps or poses of that program, or leave it out; personal-viz metrics shows such figures."
        )
    return Run(info=info, episodes=runs, answers=answers, reported=reported)


def _read_all(path: Path, model: type[_Line]) -> tuple[_Line, ...]:
    """The lines of a file that holds one kind of them; () where there is no file."""
    found = []
    for number, line in read_lines(path) if path.is_file() else ():
        if not isinstance(line, model):
            kind = model.model_fields["kind"].default
            raise RunFileError(f"{path}:{number}: found a line of another kind; expected {kind!r}. {_ADVICE}")
        found.append(line)
    return tuple(found)


def run_texts(run: Run) -> dict[str, str]:
    """The text of each file of a run folder, by name; `read_run` reads the same run from them."""
    lines = [line for walk in run.episodes for line in (walk.start, *walk.steps, walk.end)]
    texts = {"run.json": run.info.model_dump_json(indent=2) + "\n"}
    texts |= {"steps.jsonl": _text_of(lines)} if run.episodes else {}
    texts |= {"answers.jsonl": _text_of(run.answers)} if run.answers else {}
    return texts | ({"reported.jsonl": _text_of(run.reported)} if run.reported else {})


def _text_of(lines: Iterable[BaseModel]) -> str:
    return "".join(f"{line.model_dump_json()}\n" for line in lines)


def read_run_info(folder: Path) -> RunInfo:
    """`run.json` of a run folder.

    Raises:
        RunFileError: The file is missing or damaged.
    """
    path = folder / "run.json"
    if not path.is_file():
        raise RunFileError(
            f"{folder}: found no run.json; expected a folder written by personal-viz run, ground, import or "
            "study export. Give the folder that holds run.json."
        )
    try:
        return RunInfo.model_validate_json(bounded_json(path), strict=True)
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected a run's settings. Restore the file.") from None
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(path, error, advice="Restore the file.")) from None

"""`study.yaml`: the choices of a study. Frozen after planning; its hash names every record of the study."""

import dataclasses
import datetime
import hashlib
import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from sim import files
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError, line_from_validation_error
from sim.homes.storey_names import StoreyNaming
from sim.sequences.searches import sequence_task
from sim.types import (
    CAMERA_HEIGHT,
    MAX_STEPS,
    PAPER4,
    PAPER6,
    SPLITS,
    Action,
    Camera,
    ClutterLevel,
    SceneKind,
    Split,
    SuccessRule,
    Task,
    TaskKind,
)

from ..private_files import make_private
from .analysis import require_hypothesis
from .study_yaml import commented_yaml, json_from_yaml, schema_of

STUDY_FILE = "study.yaml"
SCHEMA_FILE = "study.schema.json"
"""The form of a study file, for editors that help while one types."""
_HEAD = f"""# yaml-language-server: $schema={SCHEMA_FILE}
# A study: change the values, then run personal-viz study plan, which freezes them.

"""
MAX_STUDY_NAME = 32
"""Most characters of a study's name."""
_MODEL = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)
_ADVICE = "Correct the field; personal-viz study init writes a valid file."
OTHER_PROGRAM = "It was written by another version of personal-viz: use that one."
Seconds = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
PanCondition = Literal["none", "topdown", "glb"]
PogCondition = Literal["map_first", "map_open", "map_2d"]
HistoryCondition = Literal["history_visible", "history_hidden"]
Condition = PanCondition | PogCondition | HistoryCondition
"""A participant's view of the home besides the task itself. PAN: `none`, or before walking its `topdown` map or its 3-D
model (`glb`). POG: pointing after a look at the home (`map_first`), with text and home side by side (`map_open`), or on
the agents' own top-down map (`map_2d`). In studies of home sequences: whether earlier messages can be read again
(`history_visible`) or only those of the present search (`history_hidden`); the view of the home is then one for all."""
NamesShown = Literal["off", "on", "demand"]
"""Names in a home: not at all, always, or as long as the participant wants them (a button)."""
Pointing = Literal["free", "snap"]
"""Where a mark goes: to the clicked point, or to the middle of the object there."""
HomeView = Literal["browser", "server"]
"""Where the pictures of a 3-D home are made: in the browser, which then has its geometry, or on the server."""
Language = Literal["en", "de"]
"""A language of `texts/languages`."""
FlowStep = Literal["device", "consent", "instructions", "quiz"]
SurveyTopic = Literal["age", "gender", "education", "language", "games", "expertise", "ai_tools", "other_help", "homes"]
"""Topics of the questions that may be asked after the last search; `texts/survey.py` has their words."""


def _as_tuple(value: object) -> object:
    if isinstance(value, str):
        return (value,)
    return tuple(value) if isinstance(value, list) else value


_NO_TEXT = {"", "no", "none", "nothing", "n/a", "na", "null", "nein", "kein", "keine", "keins", "nichts"}
"""Answers, without marks around them, that mean an empty field and that participants would read as they are."""


def _text_to_read(text: str) -> str:
    """The text itself. Raises ValueError for a word that only says that there is none."""
    if text and text.strip(" .-–—\"'").casefold() in _NO_TEXT:
        raise ValueError("a text that participants can read; leave it empty if there is none")
    return text


def _require_order(least_s: float, most_s: float | None, least: str, most: str) -> None:
    """Raises ValueError for a look whose shortest time exceeds its longest time."""
    if most_s is not None and least_s > most_s:
        raise ValueError(f"{least} at most {most}, found {least_s:g} and {most_s:g}")


class StudyDataset(BaseModel):
    """Rules for drawing the episodes."""

    model_config = _MODEL
    sha256: str = Field(min_length=1)
    """Digest of the dataset and of its evidence (`PersonalDataset.digest`)."""
    splits: dict[Split, Annotated[int, Field(ge=1)] | Literal["all"]] = dict.fromkeys(SPLITS, 50)
    """Number of episodes of each split."""
    scenes: tuple[str, ...] = ()
    """Homes that are used; () = all."""
    stratify: Literal["scene", "none"] = "scene"
    """`scene`: as evenly over the homes as possible."""
    max_per_scene: Annotated[int, Field(ge=1)] | None = 5
    """Most episodes of one home, over all splits; None = any number."""
    seed: Count = 0
    """Seed of the draw, and of everything else in the plan."""


class StudyDesign(BaseModel):
    """Rules for distributing episodes over people."""

    model_config = _MODEL
    kind: Literal["house-once", "crossed"] = "house-once"
    """`house-once`: nobody meets a home twice without memory. `crossed`: everybody does every episode (the paper)."""
    raters_per_episode: Annotated[int, Field(ge=1)] = 5
    """People per episode and condition."""
    trials_per_person: Annotated[int, Field(ge=1)] | None = None
    """Counted trials; None = as many as the design gives (crossed: all)."""
    overbook: Annotated[float, Field(ge=1, le=3)] = 1.0
    """1.15 makes 15 % more links than needed; the people who use them get the trials that others leave."""


class StudyMemory(BaseModel):
    """PAN participants' look at a home before they walk in it."""

    model_config = _MODEL
    arms: Annotated[tuple[PanCondition, ...], Field(min_length=1)] = ("none",)
    """The looks that the study compares: none, the map from above, or the 3-D model."""
    by: Literal["scene_half"] = "scene_half"
    """Homes are split into as many groups as arms; the arms of the groups are counterbalanced over people."""
    min_s: Seconds = 0.0
    """Shortest look, seconds."""
    max_s: Annotated[float, Field(gt=0)] | None = 60.0
    """Longest look, seconds; None = no limit."""

    @model_validator(mode="after")
    def _can_be_left(self) -> "StudyMemory":
        _require_order(self.min_s, self.max_s, "min_s", "max_s")
        return self


class StudyPog(BaseModel):
    """POG participants' view of the home and the text."""

    model_config = _MODEL
    conditions: Annotated[tuple[PogCondition, ...], Field(min_length=1)] = ("map_first",)
    """The views that the study compares: the home first and then the text, both side by side, or the agents' map."""
    look_min_s: Seconds = 0.0
    """Shortest look at the home before the text, in `map_first`, seconds."""
    look_max_s: Annotated[float, Field(gt=0)] | None = 120.0
    """Longest look at the home before the text, in `map_first`, seconds; None = no limit."""
    answer_max_s: Annotated[float, Field(gt=0)] | None = None
    """Longest time from the text to the confirmed mark, seconds; then the trial ends as `timeout`."""
    pointing: Pointing = "free"
    """`free`: the clicked point is the mark (the paper). `snap`: the mark goes to the middle of the clicked object,
    which is outlined and named by its category."""
    room_names: NamesShown = "off"
    """Names of rooms in the 3-D home; scans have none."""
    object_names: NamesShown | Literal["auto"] = "auto"
    """Categories of objects in the 3-D home. `auto`: off in scans and on in other homes, whose plain shapes are hard to
    tell apart. They give away what is what: the text then only has to be matched with words. Not for maps, which name
    every object but a scan's, nor for the look at a 3-D home before PAN, which has `auto`."""

    @property
    def has_names_on_demand(self) -> bool:
        """Whether participants have a button for names."""
        return "demand" in (self.room_names, self.object_names)

    @model_validator(mode="after")
    def _can_be_left(self) -> "StudyPog":
        _require_order(self.look_min_s, self.look_max_s, "look_min_s", "look_max_s")
        return self


class StudySequences(BaseModel):
    """Home sequences in place of episodes: each trial is one sequence (docs/home-sequences.md)."""

    model_config = _MODEL
    sha256: str = Field(min_length=1)
    """Digest of the set of sequences (`SequenceSet.digest`)."""
    number: Annotated[int, Field(ge=1)] | Literal["all"] = "all"
    """Number of sequences, drawn as evenly over the homes as `dataset` asks; its `splits` do not count."""
    history: Literal["visible", "hidden", "both"] = "both"
    """Messages that can be read: all so far (`visible`), or only those told before the present search (`hidden`).
    `both`: homes are split into two groups, and the groups' histories are counterbalanced over people."""

    @property
    def conditions(self) -> tuple[HistoryCondition, ...]:
        """The conditions of the trials."""
        both: tuple[HistoryCondition, ...] = ("history_visible", "history_hidden")
        return tuple(name for name in both if self.history in ("both", name.removeprefix("history_")))


class StudyPractice(BaseModel):
    """Trials on homes outside the pool that are never counted."""

    model_config = _MODEL
    pan: Annotated[int, Field(ge=0, le=10)] = 2
    """Practice trials of a participant who walks (PAN)."""
    pog: Annotated[int, Field(ge=0, le=10)] = 2
    """Practice trials of a participant who points (POG)."""


class StudyChecks(BaseModel):
    """Trials with a target in plain view, which test attention."""

    model_config = _MODEL
    every: Annotated[int, Field(ge=2)] | None = 15
    """One attention trial after this many counted trials; None = none."""


class StudyBreaks(BaseModel):
    """Breaks of participants."""

    model_config = _MODEL
    every: Annotated[int, Field(ge=1)] | None = 10
    """A break is offered after this many counted trials."""
    sitting_max: Annotated[int, Field(ge=1)] | None = 30
    """After this many counted trials in one sitting the participant is asked to come back later."""
    sitting_gap_s: Seconds = 3600.0
    """Least time before the next sitting, seconds."""


class StudyAggregate(BaseModel):
    """Averaging rules of the report."""

    model_config = _MODEL
    total: Literal["mean_of_splits", "pooled", "dataset_weighted"] = "mean_of_splits"
    """The row Total: mean of the splits' figures, all trials alike, or splits weighted as in the dataset."""
    weight: Literal["trials", "participants"] = "trials"
    """Whether each trial counts alike, or each participant."""
    intervals: Literal["homes", "episodes"] = "episodes"
    """What intervals take for random beside people: homes with the episodes in them, or episodes alone, which holds for
    other episodes of the same homes only. New studies say `homes`; files without the field are of earlier ones."""


class StudyPrivacy(BaseModel):
    """Rules for keeping data about people."""

    model_config = _MODEL
    platform_id: Literal["none", "hmac"] = "none"
    """`hmac` keeps the ids of a recruiting platform for paying people, apart from the records; see `purge-ids`."""
    retention: datetime.date | None = None
    """Day on which the records are deleted."""
    on_withdraw: Literal["delete", "keep"] = "delete"
    """`delete` shreds the key of everything that the person did."""


class StudyRecruit(BaseModel):
    """Recruitment of participants."""

    model_config = _MODEL
    kind: Literal["local", "link", "prolific"] = "local"
    """`local`: one personal link each. `link`: one open link. `prolific`: an open link with Prolific's parameters."""


class StudyEthics(BaseModel):
    """Facts for the sheets for participants and the ethics board; a main study is served only with an `irb`."""

    model_config = _MODEL
    irb: str = ""
    """Id of the approval, or of the exemption."""
    institution: str = ""
    """The institution that is responsible for the study, as participants read it."""
    contact: str = ""
    """A person for questions, with an address or a number."""
    pay: str = ""
    """What participants get, and when: one sentence."""
    pay_if_leaving: str = ""
    """Pay of people who stop early, withdraw or cannot take part after the consent form, as participants read it."""
    insurance: str = ""
    """The insurance of participants, or that there is none, as participants read it."""
    data_protection_officer: str = ""
    """Name or office, with an address."""
    legal_basis: str = ""
    """Legal basis for storing the data, such as `your consent, Art. 6 (1) (a) GDPR`."""
    complaint_body: str = ""
    """The office to which people can complain about the use of their data."""
    language_model: Annotated[str, AfterValidator(_text_to_read)] = ""
    """Which data of people goes to which language model, and who runs it where, as participants read it. Leave it empty
    if nothing goes to one: the texts then say that the study's program sends nothing of theirs to one."""
    duration_min: Annotated[int, Field(ge=1)] | None = None
    """Duration announced to participants, minutes; None = estimated from the plan."""


EligibilitySentence = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_text_to_read)]


class StudySurvey(BaseModel):
    """Questions to people about themselves. Every answer is optional, chosen from a few, and encrypted."""

    model_config = _MODEL
    eligibility: Annotated[tuple[EligibilitySentence, ...], Field(max_length=8)] = ()
    """Sentences that people must confirm to take part. Several stand in quotes, in brackets, with commas between them:
    `["I have not seen these homes before.", "I am 18 or older."]`"""
    questions: tuple[SurveyTopic, ...] = ()
    """Asked after the last search, before the completion code."""


class StudyReporting(BaseModel):
    """Facts for the report's checklist that only researchers know. Participants do not read them.

    They may be written or corrected at any time, in the study's own folder: no hash of the study holds them.
    """

    model_config = _MODEL
    population: str = ""
    """The people for whom the results are to hold, such as `adults in Italy who read English well`."""
    sampling: str = ""
    """How people are found: crowdworkers, people at hand, a random or a stratified sample."""
    inclusion: str = ""
    """Who may take part and who may not, and how that is found out."""
    expertise: str = ""
    """Experience that people have or need, such as with robots or 3-D games."""
    team: str = ""
    """Whether authors or members of the team take part."""
    exposure: str = ""
    """How people who know the homes or the episodes are kept out."""
    tools: str = ""
    """Tools that people may use, AI programs with their versions included, and how this is watched."""
    parity: str = ""
    """Why the tasks favour neither people nor agents, and what agents get that people do not."""
    pretest: str = ""
    """Pretests and pilots, and what was changed after them."""
    item_checks: str = ""
    """How the episodes were checked for errors before people did them."""
    invited: Annotated[int, Field(ge=1)] | None = None
    """Number of invited people; None = not known."""
    incentive: str = ""
    """A bonus and what it depends on, and whether everybody is paid alike."""
    place: str = ""
    """Where people take part, such as `a room of the university` or `at home`."""
    preregistration: str = ""
    """Address of the registration."""
    published: str = ""
    """Where data, materials and the code of the analysis are published, or why they are not."""
    failures: str = ""
    """Where the failures of people and agents are described."""


class StudyCamera(BaseModel):
    """The robot's camera for people."""

    model_config = _MODEL
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    """Pixels."""
    height: Annotated[int, Field(ge=16, le=4096)] = 480
    """Pixels."""
    hfov_deg: Annotated[float, Field(gt=0, lt=180)] = 79.0
    """Horizontal field of view, degrees; the paper's by default."""
    mount_height: Annotated[float, Field(gt=0)] = CAMERA_HEIGHT
    """Height above the floor, metres; the paper's by default."""


class StudyConfig(BaseModel):
    """All choices of a study that can change a result."""

    model_config = _MODEL
    study: str = Field(pattern=rf"^[A-Za-z0-9_-]{{1,{MAX_STUDY_NAME}}}$")
    """Public name, part of every run id."""
    version: Literal[1] = 1
    """Version of this format."""
    dataset: StudyDataset
    task: Annotated[
        tuple[TaskKind, ...],
        BeforeValidator(_as_tuple, json_schema_input_type=TaskKind | tuple[TaskKind, ...]),
        Field(min_length=1),
    ]
    """`pan`, `pog`, or both: then every participant does one of them, in turns."""
    actions: Literal["paper4", "paper6"] = "paper4"
    """Actions that people have in PAN. `paper4`: forward, left, right, stop; `paper6` adds looking up and down."""
    steps: Annotated[int, Field(ge=1, le=MAX_STEPS)] = MAX_STEPS
    """Most actions of a PAN trial; then it ends as `steps`."""
    pan_max_s: Annotated[float, Field(gt=0)] | None = None
    """Longest PAN trial, seconds; then it ends as `timeout`; None = no limit."""
    sequences: StudySequences | None = None
    """Home sequences in place of episodes; then `steps` and the limits of time hold for each search of a sequence."""
    language: Language = "en"
    """Language of every text for participants besides the episodes' own."""
    query_index: Count = 0
    """Index of the query's paraphrase that everybody reads."""
    success: SuccessRule = "paper"
    """The rule that the report shows first; all are stored."""
    design: StudyDesign = StudyDesign()
    memory: StudyMemory = StudyMemory()
    pog: StudyPog = StudyPog()
    pog_view: HomeView | Literal["auto"] = "auto"
    """Where pictures of a 3-D home are made. `auto`: on the server for scans that are served beyond this machine."""
    storey_names: StoreyNaming = "numbers"
    """Names of storeys where participants see a home: storey 1 of 2 (`numbers`), ground floor and first floor
    (`british`), first floor and second floor (`american`), or as each home's own descriptions say (`texts`)."""
    flow: tuple[FlowStep, ...] = ("device", "consent", "instructions", "quiz")
    """Pages before practice, in this order."""
    practice: StudyPractice = StudyPractice()
    checks: StudyChecks = StudyChecks()
    breaks: StudyBreaks = StudyBreaks()
    confidence: bool = False
    """Whether participants rate after each trial, with one key, how sure they are."""
    comments: bool = False
    """Whether participants may write a comment at the end; it is stored encrypted and exported to a file of its own."""
    resume_within_s: Seconds = 600.0
    """Seconds of absence after which the trial has ended as `abandoned`."""
    hidden_max_s: Seconds | None = 60.0
    """A trial whose page was in the background for more seconds is flagged, and still counts; None = no flags."""
    lease_s: Annotated[float, Field(gt=0)] = 900.0
    """Seconds of absence in the middle of the study after which the remaining trials go to others."""
    camera: StudyCamera = StudyCamera()
    clutter: ClutterLevel = 0
    """Amount of furniture without a caption in schematic and invented homes."""
    labels: bool = False
    """Whether the robot's picture names the category of each object in view; agents beside people need the same."""
    transition: Literal["none"] = "none"
    """Pictures between two poses: there are none, so that people see the same pictures as an agent."""
    display_scale: Annotated[float, Field(gt=0, le=4)] = 2.0
    """The robot's picture fills the window up to this many times its size."""
    information: tuple[Literal["rgb", "compass", "depth", "map"], ...] = ("rgb",)
    """Information that people have, printed beside every comparison with agents."""
    aggregate: StudyAggregate = StudyAggregate()
    exclusions: dict[str, str] = {}
    """Your own rules that leave trials or people out: id to text, written down before the first trial."""
    primary: Annotated[tuple[Annotated[str, AfterValidator(require_hypothesis)], ...], Field(max_length=3)] = ()
    """At most three hypotheses, named before the first trial, such as human_minus_agent_SR or memory_effect_SPL."""
    smallest_effect: Annotated[float, Field(gt=0, le=100)] | None = None
    """Smallest difference between success rates that would matter, percentage points; needed to preregister."""
    sample_size_reason: str = ""
    """Why this many people and trials, such as the power that `study plan --power` gives; needed to preregister."""
    privacy: StudyPrivacy = StudyPrivacy()
    recruit: StudyRecruit = StudyRecruit()
    ethics: StudyEthics = StudyEthics()
    survey: StudySurvey = StudySurvey()
    reporting: StudyReporting = StudyReporting()

    @model_validator(mode="after")
    def _each_once(self) -> "StudyConfig":
        named = {
            "task": self.task,
            "memory.arms": self.memory.arms,
            "pog.conditions": self.pog.conditions,
            "flow": self.flow,
            "survey.questions": self.survey.questions,
            "dataset.scenes": self.dataset.scenes,
        }
        for field, names in named.items():
            if len(set(names)) != len(names):
                raise ValueError(f"each of {field} once, found {list(names)}")
        asked = [name for name, value in self.survey if value]
        if asked and "consent" not in self.flow:
            raise ValueError(f"survey.{asked[0]} only with consent in flow, found flow {list(self.flow)}")
        return self

    @model_validator(mode="after")
    def _suits_sequences(self) -> "StudyConfig":
        if self.sequences is None:
            return self
        for field, views in (("memory.arms", self.memory.arms), ("pog.conditions", self.pog.conditions)):
            if len(views) > 1:
                raise ValueError(f"one of {field} beside sequences, found {list(views)}")
        if self.confidence:
            raise ValueError("confidence: false beside sequences, whose trials have several answers")
        if self.primary:
            raise ValueError("no primary beside sequences, whose report has no hypotheses")
        return self

    @property
    def study_version(self) -> str:
        """sha256 of the canonical JSON: 64 hex digits."""
        return hashlib.sha256(self.canonical_json().encode()).hexdigest()

    @property
    def action_set(self) -> tuple[Action, ...]:
        """The actions that people have in PAN; in home sequences FOUND in place of STOP."""
        actions = PAPER4 if self.actions == "paper4" else PAPER6
        if self.sequences is None:
            return actions
        return tuple(Action.FOUND if action is Action.STOP else action for action in actions)

    @property
    def robot_camera(self) -> Camera:
        """The camera as a `Camera` of the simulator."""
        return Camera(self.camera.width, self.camera.height, self.camera.hfov_deg, self.camera.mount_height)

    def view_of(self, kind: SceneKind, *, public: bool) -> HomeView:
        """Where the pictures of a 3-D home of this kind are made; `public` = beyond this machine."""
        if self.pog_view != "auto":
            return self.pog_view
        return "server" if kind == "scan" and public else "browser"

    def conditions(self, task: TaskKind) -> tuple[Condition, ...]:
        """The conditions of a task."""
        return self._views(task) if self.sequences is None else self.sequences.conditions

    def view_in(self, task: TaskKind, condition: Condition) -> PanCondition | PogCondition:
        """The view of the home in one of a task's conditions; of home sequences it is the same in each."""
        if self.sequences is not None:
            return self._views(task)[0]
        assert condition != "history_visible" and condition != "history_hidden", condition  # noqa: PT018 - for types
        return condition

    def _views(self, task: TaskKind) -> tuple[PanCondition | PogCondition, ...]:
        return self.memory.arms if task == "pan" else self.pog.conditions

    def canonical_json(self) -> str:
        """The same text for the same choices: sorted keys, no spaces, only values that differ from the defaults.

        So a new field in a later version does not change the hash of a running study; a changed default does.
        `reporting` is no choice: some of it is known only after the study.
        """
        choices = self.model_dump(mode="json", exclude_defaults=True, exclude={"reporting"})
        return json.dumps(choices, sort_keys=True, separators=(",", ":"), ensure_ascii=False)

    def task_for(self, episode: Episode, kind: TaskKind) -> Task:
        """The part of the episode that a participant may see.

        Raises:
            StudyError: The episode has no query with the study's `query_index`.
        """
        num_queries = len(episode.record.query)
        if self.query_index >= num_queries:
            raise StudyError(
                f"study {self.study}: query_index is {self.query_index}, but episode {episode.key} has {num_queries} "
                f"queries; expected 0 to {num_queries - 1}. Make a study with a smaller query_index."
            )
        task = episode.task(kind, query_index=self.query_index, actions=self.action_set)
        return dataclasses.replace(task, max_steps=self.steps)

    def sequence_task_for(self, sequence: HomeSequence, kind: TaskKind) -> Task:
        """The part of a sequence that a participant may see before its first search."""
        told = {"query_index": self.query_index, "max_steps": self.steps, "actions": self.action_set}
        return dataclasses.replace(sequence_task(sequence, **told), kind=kind)


def save_study(folder: Path, config: StudyConfig) -> Path:
    """Writes `study.yaml`, commented, and its schema once; writing the same study again changes `reporting` at most.

    Returns:
        The path of `study.yaml`.

    Raises:
        StudyError: The folder holds another study, or cannot be written.
    """
    path = folder / STUDY_FILE
    if path.exists():
        found = load_study(folder)
        if found.study_version != config.study_version:
            raise StudyError(
                f"{path}: found study_version {found.study_version[:12]}; expected {config.study_version[:12]}. "
                "A study never changes: give the new one another folder."
            )
        if found == config:
            return path
    write_whole(folder / SCHEMA_FILE, json.dumps(schema_of(StudyConfig), indent=1) + "\n")
    write_whole(path, _HEAD + commented_yaml(config))
    make_private(folder)
    return path


def load_study(folder: Path) -> StudyConfig:
    """Reads `study.yaml` of a study folder.

    Raises:
        StudyError: The file is missing or not a valid study.
    """
    path = folder / STUDY_FILE
    if not path.exists() and (folder / "study.json").exists():
        raise StudyError(
            f"{folder / 'study.json'}: is of an earlier version; expected {STUDY_FILE}. Its records can be read: "
            "personal-viz study check-db, then export and report. Continue in a new study."
        )
    try:
        text = json_from_yaml(path, expected="fields such as study: and task:", advice=_ADVICE)
        return StudyConfig.model_validate_json(text, strict=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected a study file. Run personal-viz study init first."
        ) from None
    except ValidationError as error:
        is_other = any(problem["loc"] == ("version",) for problem in error.errors())
        advice = OTHER_PROGRAM if is_other else _ADVICE
        raise StudyError(line_from_validation_error(path, error, advice=advice, model=StudyConfig)) from None


def write_whole(path: Path, text: str) -> None:
    """Writes a text file that is never half-written, and makes its folder.

    Raises:
        StudyError: The folder cannot be written.
    """
    try:
        files.write_whole(path, text)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written ({error.strerror}); expected a folder that you can write. Give another folder."
        ) from None

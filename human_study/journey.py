"""Where a participant is in a study. Pages, dashboard, `study status` and leases all ask this module.

Nothing else decides it. The answer follows only from stored facts: the study file, the stages that the participant
reached, and the participant's trials. So a reload, a restart or another clock changes nothing.
"""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Any, Literal, get_args

from sim.types import EpisodeKey, TaskKind

from .design.plan import Phase, Slot
from .design.study import Condition, FlowStep, StudyConfig

Stage = Literal[
    "arrived",
    "device_ok",
    "device_failed",
    "consented",
    "declined",
    "instructed",
    "quiz_passed",
    "quiz_failed",
    "keys_changed",
    "sitting_started",
    "break_started",
    "break_ended",
    "survey_begun",
    "survey_ended",
    "finished",
    "withdrawn",
    "screened_out",
    "dropped_out",
    "returned",
    "full",
]
WayOut = Literal["declined", "withdrawn", "screened_out", "full"]
"""Stages after which a participant does nothing more."""
OUT: tuple[WayOut, ...] = get_args(WayOut)
QUIZ_ROUNDS = 2
"""Rounds with a wrong answer after which the instructions come again."""
Place = Literal[
    "not_arrived",
    "device",
    "consent",
    "instructions",
    "quiz",
    "practice",
    "trial",
    "break",
    "pause",
    "ending",
    "survey",
    "finished",
    "dropped_out",
    "declined",
    "withdrawn",
    "screened_out",
    "full",
]
"""`practice`, `trial`: in such a trial, or before the next one (`trial`: a counted or an attention trial); `break`: a
rest is due or under way; `pause`: the sitting is over; `ending`: all assigned trials are over, and the store may assign
more; `survey`: questions after the last search; `dropped_out`: other people got the trials; a participant who comes
back goes on."""
GONE: tuple[Place, ...] = ("finished", "dropped_out", "declined", "withdrawn", "screened_out", "full")
"""Places at which the study no longer waits for the participant."""
End = Literal["done", "technical", "abandoned"]
"""How a trial ended, without its success, which nobody may see while a study runs."""


@dataclass(frozen=True, slots=True)
class StageEntry:
    """A stage that a participant reached."""

    stage: Stage
    detail: dict[str, Any]
    """Answers of the quiz, the coarse profile of the device and similar facts."""
    at_ns: int
    """Server's wall clock."""


@dataclass(frozen=True, slots=True)
class ConsentEntry:
    """An answer to the question for consent."""

    text_hash: str
    """sha256 of the text that was shown."""
    given: bool


@dataclass(frozen=True, slots=True)
class AssignedTrial:
    """An assigned trial and its newest attempt; never how well it went."""

    order_no: int
    phase: Phase
    task: TaskKind
    condition: Condition
    key: EpisodeKey
    rep: int = 0
    is_released: bool = False
    """Whether it was given back to others."""
    is_begun: bool = False
    """Whether there is an attempt, perhaps one that waits to be opened after a failure of ours."""
    is_open: bool = False
    """Whether somebody opened the newest attempt."""
    end: End | None = None
    """None while the newest attempt has not ended."""
    ended_ns: int | None = None

    @property
    def is_due(self) -> bool:
        """Whether the participant still has to do or finish it."""
        return self.end is None and not self.is_released

    @property
    def is_done(self) -> bool:
        """Whether it ended with a countable result and was kept."""
        return self.end == "done" and not self.is_released

    @property
    def slot(self) -> Slot:
        """The episode and condition, which different people may hold one after the other."""
        return Slot(self.task, self.condition, self.key, self.rep)


@dataclass(frozen=True, slots=True)
class Person:
    """A participant; the stored facts say where in the study the participant is."""

    code: str
    """Public code, such as p01."""
    task: TaskKind
    is_claimed: bool
    """Whether the participant got this place through an open link."""
    stages: tuple[StageEntry, ...]
    """Oldest first."""
    trials: tuple[AssignedTrial, ...]
    """In the participant's order, including those that were given back."""
    arm: int = 0
    consent: ConsentEntry | None = None
    """The last answer to the question for consent."""

    @property
    def has_come(self) -> bool:
        """Whether somebody opened this personal link, or got this place through an open link."""
        return self.is_claimed or bool(self.stages)

    @property
    def is_withdrawn(self) -> bool:
        """Whether the participant withdrew."""
        return has_reached(self.stages, "withdrawn")

    @property
    def kept(self) -> tuple[AssignedTrial, ...]:
        """The trials that are still the participant's."""
        return tuple(trial for trial in self.trials if not trial.is_released)

    @property
    def due(self) -> AssignedTrial | None:
        """The next trial to do, or to finish."""
        return next((trial for trial in self.trials if trial.is_due), None)


@dataclass(frozen=True, slots=True)
class Journey:
    """Where a participant is, with the numbers that pages and operators show."""

    place: Place
    num_done: int = 0
    """Counted trials that are over and kept."""
    num_all: int = 0
    """Counted trials that the participant has."""
    failed_rounds: int = 0
    """Rounds of the quiz with a wrong answer since the instructions."""
    rest: StageEntry | None = None
    """The stage that began the present break or pause; None outside one, and before its beginning is stored."""


def journey_of(config: StudyConfig, person: Person) -> Journey:
    """Where a participant of this study is."""
    counted = [trial for trial in person.kept if trial.phase == "main"]
    num_done = sum(not trial.is_due for trial in counted)
    place = _place(config, person, num_done)
    began = next((entry for entry in reversed(person.stages) if entry.stage == "break_started"), None)
    is_resting = place in ("break", "pause") and began is not None and began.detail.get("done") == num_done
    return Journey(place, num_done, len(counted), _failed_rounds(person.stages), began if is_resting else None)


def has_reached(entries: Sequence[StageEntry], stage: Stage) -> bool:
    """Whether the stage is among the entries."""
    return any(entry.stage == stage for entry in entries)


def way_out(entries: Sequence[StageEntry]) -> WayOut | None:
    """The stage by which the participant left for good; None if there is none."""
    return next((entry.stage for entry in entries if entry.stage in OUT), None)


def is_refused(reached: Set[str]) -> bool:
    """Whether the device check kept out a participant who reached these stages, in `study status` and in the report.

    Going away since, or telling a panel that the device cannot be changed, does not alter it; leaving otherwise does.
    """
    return "device_failed" in reached and reached.isdisjoint(("device_ok", "declined", "withdrawn", "full"))


def has_dropped_out(entries: Sequence[StageEntry]) -> bool:
    """Whether the participant's trials were given to others and the participant has not returned since."""
    moves = [entry.stage for entry in entries if entry.stage in ("dropped_out", "returned")]
    return bool(moves) and moves[-1] == "dropped_out"


def last_detail(entries: Sequence[StageEntry], stage: Stage) -> dict:
    """The details stored with the newest entry of a stage; {} where there is none."""
    return next((entry.detail for entry in reversed(entries) if entry.stage == stage), {})


def ended_trial(person: Person, order_no: int) -> AssignedTrial | None:
    """The trial at this place of the order, once the store has its outcome."""
    return next((trial for trial in person.kept if trial.order_no == order_no and not trial.is_due), None)


def trial_before(person: Person) -> AssignedTrial | None:
    """The trial that ended just before the due one; None where there is none, or where the due trial has begun."""
    due = person.due
    if due is None or due.is_begun:
        return None
    over = [trial for trial in person.kept if not trial.is_due and trial.order_no < due.order_no]
    return over[-1] if over else None


def has_rested(person: Person, journey: Journey) -> bool:
    """Whether the participant last went on from a break, and has done no counted trial since."""
    return journey.num_done > 0 and _rested_at(person.stages) == journey.num_done


def _place(config: StudyConfig, person: Person, num_done: int) -> Place:
    stages = person.stages
    out = way_out(stages)
    if out is not None:
        return out
    if has_reached(stages, "finished"):
        return "finished"
    if has_dropped_out(stages):
        return "dropped_out"
    if not person.has_come and not any(trial.is_begun for trial in person.trials):
        return "not_arrived"
    before: FlowStep | None = next((step for step in config.flow if not _is_passed(step, config, person)), None)
    if before is not None:
        return before
    due = person.due
    if due is None:
        is_asked = has_reached(stages, "survey_begun") and not has_reached(stages, "survey_ended")
        return "survey" if is_asked else "ending"
    if due.phase == "practice":
        return "practice"
    return "trial" if due.is_begun else _rest(config, stages, num_done)


def _is_passed(step: FlowStep, config: StudyConfig, person: Person) -> bool:
    stages = person.stages
    match step:
        case "device":
            return has_reached(stages, "device_ok")
        case "consent":
            return has_reached(stages, "consented")
        case "instructions":
            has_read = has_reached(stages, "instructed") or any(trial.is_begun for trial in person.kept)
            return has_read and ("quiz" not in config.flow or _failed_rounds(stages) < QUIZ_ROUNDS)
        case "quiz":
            return has_reached(stages, "quiz_passed")


def _failed_rounds(stages: Sequence[StageEntry]) -> int:
    """Rounds of the quiz with a wrong answer since the instructions were read last."""
    num = 0
    for entry in stages:
        if entry.stage in ("instructed", "quiz_passed"):
            num = 0
        num += entry.stage == "quiz_failed"
    return num


def _rest(config: StudyConfig, stages: Sequence[StageEntry], num_done: int) -> Place:
    """`trial`, or the break or the end of the sitting that comes before the next trial."""
    breaks = config.breaks
    if breaks.sitting_max is not None and num_done - _done_at(stages, "sitting_started") >= breaks.sitting_max:
        return "pause"
    if breaks.every is not None and num_done - _rested_at(stages) >= breaks.every:
        return "break"
    return "trial"


def _rested_at(stages: Sequence[StageEntry]) -> int:
    """Number of counted trials done at the last break or at the beginning of the sitting."""
    return max(_done_at(stages, "sitting_started"), _done_at(stages, "break_ended"))


def _done_at(stages: Sequence[StageEntry], stage: Stage) -> int:
    """Number of counted trials done when the stage was entered last."""
    done = last_detail(stages, stage).get("done", 0)
    return done if isinstance(done, int) else 0

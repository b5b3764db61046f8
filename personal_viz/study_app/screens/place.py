"""Which page a participant sees now, from the stored stages and trials alone: a reload or a restart changes nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from human_study.design.study import FlowStep, StudyConfig
from human_study.store.stages import Stage, StageEntry, has_reached, way_out

from ..store_link import PersonPlace, TrialPlace
from .pauses import MachineTime, pause_left_s

QUIZ_ROUNDS = 2
"""After so many rounds with a wrong answer the instructions come again."""
StepKind = Literal[
    "device",
    "consent",
    "instructions",
    "quiz",
    "practice",
    "trial",
    "break",
    "pause",
    "none_due",
    "finished",
    "declined",
    "withdrawn",
    "screened_out",
    "full",
]
"""`practice` and `trial` are the next trial of that kind; `pause` ends a sitting until `back_in_s` have passed;
`none_due`: all assigned trials are over, but the store may have more to give; `finished` is stored."""
PARTS: dict[str, str] = {
    "device": "Check",
    "consent": "Consent",
    "instructions": "Instructions",
    "quiz": "Questions",
    "practice": "Practice",
    "trial": "Study",
    "finished": "End",
}
"""The parts of the way as participants read them."""


@dataclass(frozen=True, slots=True)
class FlowPlace:
    """Where a participant is."""

    step: StepKind
    num_done: int = 0
    """Counted trials that are over."""
    num_all: int = 0
    """Counted trials in all."""
    back_in_s: float = 0.0
    """How long a pause still lasts; 0 = the participant can go on."""
    failed_rounds: int = 0
    """Rounds of the quiz with a wrong answer since the instructions."""


def flow_place(config: StudyConfig, person: PersonPlace, *, now: MachineTime) -> FlowPlace:
    """The participant's next step.

    Args:
        config: The study.
        person: What is stored.
        now: The server's clocks, which the stages' times are of.
    """
    stages = person.stages
    counted = [trial for trial in person.trials if trial.phase == "main"]
    num_done = sum(trial.is_over for trial in counted)
    failed_rounds = _failed_rounds(stages)

    def place(step: StepKind, *, back_in_s: float = 0.0) -> FlowPlace:
        return FlowPlace(step, num_done, len(counted), back_in_s, failed_rounds)

    out = way_out(stages)
    if out is not None:
        return place(_OUT[out])
    if has_reached(stages, "finished"):
        return place("finished")
    before: FlowStep | None = next((step for step in config.flow if not _is_passed(step, config, person)), None)
    if before is not None:
        return place(before)
    due = next((trial for trial in person.trials if not trial.is_over), None)
    if due is None:
        return place("none_due")
    if due.phase == "practice":
        return place("practice")
    if due.is_begun:
        return place("trial")
    return _rest(config, stages, place("trial"), now)


def parts_of(config: StudyConfig, person: PersonPlace) -> tuple[str, ...]:
    """Names of the parts of this participant's way; () where the way is only one page and the trials."""
    if config.flow == ("instructions",):
        return ()
    has_practice = any(trial.phase == "practice" for trial in person.trials)
    steps = [*config.flow, *(["practice"] if has_practice else []), "trial", "finished"]
    return tuple(PARTS[step] for step in steps)


def ended_trial(person: PersonPlace, order_no: int) -> TrialPlace | None:
    """The trial at this place of the order, once the store has its outcome."""
    return next((trial for trial in person.trials if trial.order_no == order_no and trial.is_over), None)


def trial_before(person: PersonPlace) -> TrialPlace | None:
    """The trial that ended just before the one that is due; None where none did, or where that one has begun."""
    due = next((trial for trial in person.trials if not trial.is_over), None)
    if due is None or due.is_begun:
        return None
    return next((trial for trial in reversed(person.trials) if trial.is_over and trial.order_no < due.order_no), None)


def has_rested(person: PersonPlace, place: FlowPlace) -> bool:
    """Whether the last thing that the participant went on from was a break, after as many trials as now."""
    return place.num_done > 0 and _rested_at(person.stages) == place.num_done


def trial_name(person: PersonPlace, trial: TrialPlace) -> str:
    """Which trial it is, counted within its phase; attention trials look like any other."""
    alike = [other for other in person.trials if (other.phase == "practice") == (trial.phase == "practice")]
    number = 1 + sum(other.order_no < trial.order_no for other in alike)
    return f"{'Practice' if trial.phase == 'practice' else 'Trial'} {number} of {len(alike)}"


def last_detail(stages: Sequence[StageEntry], stage: Stage) -> dict:
    """What was stored with the newest entry of a stage; {} where there is none."""
    return next((entry.detail for entry in reversed(stages) if entry.stage == stage), {})


_OUT: dict[str, StepKind] = {
    "declined": "declined",
    "withdrawn": "withdrawn",
    "screened_out": "screened_out",
    "full": "full",
}


def _is_passed(step: FlowStep, config: StudyConfig, person: PersonPlace) -> bool:
    stages = person.stages
    match step:
        case "device":
            return has_reached(stages, "device_ok")
        case "consent":
            return has_reached(stages, "consented")
        case "instructions":
            has_read = has_reached(stages, "instructed") or any(trial.is_begun for trial in person.trials)
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


def _rest(config: StudyConfig, stages: Sequence[StageEntry], trial: FlowPlace, now: MachineTime) -> FlowPlace:
    """The trial, or the break or the end of the sitting that comes before it."""
    breaks = config.breaks
    began_sitting = _done_at(stages, "sitting_started")
    if breaks.sitting_max is not None and trial.num_done - began_sitting >= breaks.sitting_max:
        ended = next((entry for entry in reversed(stages) if entry.stage == "break_started"), None)
        if ended is None or ended.detail.get("done") != trial.num_done:
            back_in_s = breaks.sitting_gap_s
        else:
            back_in_s = pause_left_s(ended, breaks.sitting_gap_s, now)
        return FlowPlace("pause", trial.num_done, trial.num_all, back_in_s)
    if breaks.every is not None and trial.num_done - _rested_at(stages) >= breaks.every:
        return FlowPlace("break", trial.num_done, trial.num_all)
    return trial


def _rested_at(stages: Sequence[StageEntry]) -> int:
    """How many counted trials were done at the last break or at the beginning of the sitting."""
    return max(_done_at(stages, "sitting_started"), _done_at(stages, "break_ended"))


def _done_at(stages: Sequence[StageEntry], stage: Stage) -> int:
    """How many counted trials were done when the stage was entered last."""
    done = last_detail(stages, stage).get("done", 0)
    return done if isinstance(done, int) else 0

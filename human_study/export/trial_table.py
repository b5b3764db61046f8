"""Every attempt of every trial as one row of plain figures, to be exported, tabulated and compared with agents."""

from collections.abc import Sequence
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict

from sim.sequences.runs import SequenceEnd
from sim.tasks.run_files import EpisodeEnd
from sim.types import EndReason, EpisodeKey, SceneKind, Split, SuccessRule, TaskKind

from ..design.plan import Phase
from ..design.study import Condition, HistoryCondition, StudyConfig
from ..store.records import VerificationStatus
from ..trial.events import Act, Confidence, Event, MapOff, MapOn, Open, Shown
from ..trial.outcome import Outcome, has_begun, trial_end
from .data_dictionary import Unit

NOT_A_RESULT: tuple[EndReason, ...] = ("technical", "abandoned")
"""Ends that are not a person's result (HUMAN_STUDY.md, section 4): the trial is kept, but is in no run folder, and its
episode is given out again."""
Seconds = Annotated[float, Unit("s")]
Metres = Annotated[float, Unit("m")]


class TrialFigures(BaseModel):
    """Figures from a trial's events and outcome, without anything about the person."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    end_reason: EndReason | None
    """The end of the trial; empty while it has not ended."""
    success: bool | None
    """Under the success rule of the study file; empty without a result, or where the rule is undefined."""
    spl: Annotated[float, Unit("share")] | None
    """Success weighted by path length, 0 to 1; PAN only."""
    softspl: Annotated[float, Unit("share")] | None
    """Progress to the target weighted by path length, 0 to 1; PAN only."""
    dtg: Metres | None
    """Walking distance left to the rule's success region at the end, 0 inside; PAN only, empty when unreachable."""
    planar_distance: Metres | None
    """From the last position or the answer to the nearest valid target's middle, on the floor plan."""
    n_steps: Annotated[int, Unit("steps")] | None
    """Actions, STOP included; PAN only."""
    path_m: Metres | None
    """Length of the robot's way; PAN only."""
    t_total_s: Seconds | None
    """From the trial's start to its end, however it ended, without time away; includes the look at a map. The report's
    time to decision is this minus `t_look_s`."""
    t_look_s: Seconds | None
    """Time for which the map or home was shown before the task; empty without such a look."""
    t_hidden_s: Seconds
    """Time for which the page was in the background."""
    t_first_view_s: Seconds | None
    """From the trial's start to the robot's first picture; PAN only."""
    confidence: int | None
    """The participant's confidence: 1 (guessed) to 5 (certain); empty when not asked or not given."""
    on_object: bool | None = None
    """Whether the confirmed click met the target itself; no answer met none. POG only, empty where it is not known
    which object a click met, as in exports of older programs."""


class AttemptName(BaseModel):
    """The name of one attempt, the same in every table."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person; exports number people anew."""
    order_no: int
    """Place in the person's order over all phases, from 1."""
    attempt: int
    """From 1; 0 = never opened."""

    @property
    def place(self) -> dict[str, Any]:
        """The fields of the name."""
        return self.model_dump(include=set(AttemptName.model_fields))

    @property
    def attempt_name(self) -> str:
        """Participant, place and attempt as one text: p03/12/1."""
        return f"{self.participant}/{self.order_no}/{self.attempt}"


class _AskedTrial(AttemptName):
    """The task that the person was given: the first columns of a trial's row."""

    phase: Phase
    """`practice` is never counted, `check` shows attention, `main` is the study."""
    task: TaskKind
    """`pan`: steer the robot to the object. `pog`: point at it."""
    condition: Condition
    """The person's view of the home besides the task; in studies of home sequences, whether earlier messages could be
    read again."""
    split: Split
    """Difficulty of the episode in the dataset."""
    scene: str
    """Name of the home."""
    scene_kind: SceneKind
    """Source of the home; tables never mix kinds."""
    episode_id: str
    """Id in the dataset, unique within split and home."""
    rep: int
    """Number of the person among those with this episode and condition, from 1; 0 outside `main`."""


class TrialRow(TrialFigures, _AskedTrial):
    """One attempt at an assigned trial, or an assigned trial that was never opened."""

    prior_visits_scene: int | None
    """Attempts of this person at trials in this home before this one, of any phase and however they ended."""
    prior_visits_split: int | None
    """Attempts among these that were in the same split."""
    secs_in_scene_before: Seconds | None
    """Time that the person had spent in this home before."""
    is_long_hidden: bool
    """Whether the page was in the background for longer than the study file's `hidden_max_s`; leaves nothing out."""
    verification: VerificationStatus | None
    """The latest result of doing the trial again; empty where it was not done again."""
    excluded: tuple[str, ...]
    """Rules that leave this trial, or the whole person, out of the figures."""
    is_released: bool
    """Whether the person gave the episode back to others."""
    head_hash: str | None
    """Hash of the trial's last stored event, which stands for all before it."""
    scene_label: str = ""
    """Label that results in homes of this kind must carry; empty for scans, and in exports of older programs."""

    @property
    def key(self) -> EpisodeKey:
        """The trial's episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)

    @property
    def is_result(self) -> bool:
        """Whether it is a counted trial that the person ended; rules may still leave it out."""
        return self.phase == "main" and self.end_reason is not None and self.end_reason not in NOT_A_RESULT

    @property
    def is_never_ended(self) -> bool:
        """Whether it is a counted trial that somebody began and nobody has ended; true also while it still runs."""
        return self.phase == "main" and self.end_reason is None and self.head_hash is not None

    @property
    def left_out(self) -> str | None:
        """The reason why the trial is in no run folder; None = it is in one.

        Run folders hold counted results: episodes without those that a rule excludes, home sequences with them.
        """
        if self.phase != "main":
            return self.phase
        if self.end_reason is None:
            return "released" if self.is_released else "not begun" if self.attempt == 0 else "not finished"
        if self.end_reason in NOT_A_RESULT:
            return self.end_reason
        is_of_sequences = self.condition in get_args(HistoryCondition)
        return f"excluded: {', '.join(self.excluded)}" if self.excluded and not is_of_sequences else None


def is_long_hidden(t_hidden_s: float, config: StudyConfig) -> bool:
    """Whether a page was in the background for longer than the study allows without a flag."""
    return config.hidden_max_s is not None and t_hidden_s > config.hidden_max_s


def trial_figures(events: Sequence[Event], outcome: Outcome | None, *, rule: SuccessRule) -> TrialFigures:
    """The figures of one attempt.

    Args:
        events: All events of the attempt, in order; () when it was never opened. An attempt that failed before its
            first event `open` has no figures.
        outcome: The stored or recomputed outcome; None while the attempt has not ended.
        rule: Success rule of PAN.
    """
    acts = [event for event in events if isinstance(event, Act)]
    end = trial_end(events) if has_begun(events) and outcome is not None else None
    is_pan = bool(events) and isinstance(events[0], Open) and events[0].task == "pan"
    found = {
        "end_reason": outcome.reason if outcome is not None else None,
        "n_steps": len(acts) if is_pan else None,
        "t_total_s": end[0].t_s if end is not None else None,
        "t_look_s": _look_time(events),
        "t_hidden_s": _hidden_time(events),
        "t_first_view_s": next((event.t_s for event in events if isinstance(event, Shown)), None),
        "confidence": next((event.value for event in reversed(events) if isinstance(event, Confidence)), None),
    }
    nothing = dict.fromkeys(TrialFigures.model_fields)
    return TrialFigures.model_validate(nothing | found | measured(outcome, rule))


def measured(outcome: Outcome | None, rule: SuccessRule) -> dict[str, float | None]:
    """The figures that come from the outcome's measures; {} if it has none."""
    if isinstance(outcome, SequenceEnd):
        walks = [search.measures.path_m for search in outcome.searches if search.measures is not None]
        right = all(search.succeeds(rule) for search in outcome.searches)
        return {"success": right} | ({"path_m": sum(walks)} if walks else {})
    if outcome is None or outcome.measures is None:
        return {}
    if not isinstance(outcome, EpisodeEnd):
        found = outcome.measures
        return {"success": found.success, "planar_distance": found.planar_distance, "on_object": found.on_object}
    measures, ruled = outcome.measures, outcome.measures.rules[rule]
    by_rule = (
        {}
        if ruled is None
        else {"success": ruled.success, "spl": ruled.spl, "softspl": ruled.soft_spl, "dtg": ruled.dtg}
    )
    way = {"n_steps": measures.num_steps, "path_m": measures.path_m}
    return {"planar_distance": measures.centre_distance, **way, **by_rule}


def _look_time(events: Sequence[Event]) -> float | None:
    """Seconds for which a map was shown; a look that was cut off counts until its last event."""
    if not any(isinstance(event, MapOn) for event in events):
        return None
    ended = [event.look_s for event in events if isinstance(event, MapOff)]
    if ended:
        return sum(ended)
    times = [event.t_s for event in events if event.t_s is not None]
    first = next(event.t_s for event in events if isinstance(event, MapOn))
    return max(times) - first if first is not None else None


def _hidden_time(events: Sequence[Event]) -> float:
    """Seconds with the page in the background: from each `hidden` to the next event that needs the page, or the end."""
    total, since = 0.0, None
    for event in events:
        if event.t_s is None:
            continue
        if event.kind == "hidden":
            since = event.t_s if since is None else since
        elif since is not None and event.kind in ("visible", "reconnect", "abandoned"):
            total, since = total + event.t_s - since, None
    times = [event.t_s for event in events if event.t_s is not None]
    return total + (max(times) - since if since is not None else 0.0)

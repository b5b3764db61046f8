"""Repeats a trial's steps, and compares them with the record, and its outcome with the one that the record gives."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.episodes.schema import Episode
from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError, TaskStateError
from sim.frames import wrap_angle
from sim.sequences.runs import SequenceRun
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun
from sim.types import EndReason, EpisodeKey
from sim.walk.navigation_map import NavigationMap

from ..design.study import Condition
from ..store.records import VerificationStatus
from ..trial.events import Act, Error, Event
from ..trial.outcome import (
    ObjectAt,
    Outcome,
    PointAt,
    end_reason,
    episode_run,
    has_begun,
    largest_click_error,
    left_searches,
    opening,
    pan_outcome,
    pog_outcome,
    unscored_outcome,
)
from ..trial.searches import sequence_env, sequence_outcome

Result = EpisodeRun | SequenceRun | Outcome
"""A result as run files hold it, or the outcome alone of an unscored sequence."""
POSITION_TOLERANCE = 1e-4
"""Largest error in metres; the same program on the same scene agrees to the last bit, other builds of numpy almost."""
ANGLE_TOLERANCE = 1e-6
"""Largest error of an angle, radians."""
FAR_OFF = 1e6
"""Error in metres that stands for a click where only one of the two rays, stored and new, meets anything."""


@dataclass(frozen=True, slots=True)
class TrialHome:
    """A home with everything that is needed to do its trials again."""

    navigation: NavigationMap
    scene_digest: str
    storeys: Sequence[tuple[float, float]]
    """(lowest, highest) floor of each storey, from `sim.tasks.rules.scene_storeys`."""
    episode: Callable[[EpisodeKey], Episode]
    """An episode of this home, with its targets; raises DatasetError for an unknown one."""
    cast: PointAt | None = None
    """Where a click meets the home; None = rays are not cast again, and the stored points are believed."""
    object_at: ObjectAt | None = None
    """The object that a click meets; None = the stored names of objects are believed."""
    sequence: Callable[[EpisodeKey], HomeSequence] | None = None
    """A sequence of this home, in a study of home sequences; raises DatasetError for an unknown one."""

    def trial(self, key: EpisodeKey) -> Episode | HomeSequence:
        """What is done in a trial of this name; raises DatasetError for an unknown one."""
        return self.episode(key) if self.sequence is None else self.sequence(key)


@dataclass(frozen=True, slots=True)
class Verification:
    """The result of doing a trial again."""

    status: VerificationStatus
    """`verified`: all agrees. `drift`: a step or click leads elsewhere. `failed`: the events are impossible, or give
    another outcome than the stored one. `unsupported`: the trial was done on another scene."""
    max_position_error: float
    """Largest distance in metres between a stored and a simulated pose, or between the points of a click."""
    first_bad_step: int | None
    """First step that leads elsewhere, from 1, 0 = the start pose; None if there is none."""
    recomputed: Result | None
    """The result that the events give; None if they give none."""
    detail: str
    """One sentence about what differs; empty when verified."""


def verify_trial(
    events: Sequence[Event],
    outcome: Outcome,
    key: EpisodeKey,
    *,
    home: TrialHome,
    participant: str,
    condition: Condition | None = None,
) -> Verification:
    """Compares a finished trial with the result that all its events, in order, give.

    `condition` is the one that the trial should have; None = that of its events.

    Raises:
        DatasetError: The home has no such episode.
    """
    trial = home.trial(key)
    if outcome.reason == "technical" and not has_begun(events):  # it failed before anything was shown
        return Verification("verified", 0.0, None, None, "")
    try:
        opened = opening(events)
        if opened.scene_digest != home.scene_digest:
            text = f"done on scene {opened.scene_digest[:12]}, compared with {home.scene_digest[:12]}"
            return Verification("unsupported", 0.0, None, None, text)
        result = recompute(events, outcome, trial, home=home, participant=participant, condition=condition)
        error, bad_step = 0.0, None
        if opened.task == "pan":
            error, bad_step = replayed(events, _env_of(trial, home, opened.max_steps))
        elif home.cast is not None:
            error = min(largest_click_error(events, home.cast, home.object_at), FAR_OFF)
    except (StudyError, TaskStateError) as problem:
        return Verification("failed", 0.0, None, None, str(problem))
    if bad_step is not None:
        return Verification("drift", error, bad_step, result, f"step {bad_step} leads elsewhere than stored")
    if error > POSITION_TOLERANCE:
        return Verification("drift", error, None, result, "a click meets the home elsewhere than stored")
    return _compared(result, outcome, error)


def recompute(
    events: Sequence[Event],
    outcome: Outcome,
    trial: Episode | HomeSequence,
    *,
    home: TrialHome,
    participant: str,
    condition: Condition | None = None,
) -> Result:
    """The result that all events of a finished trial give.

    The stored outcome is used only to tell a technical failure, which has no measures; `condition` is that of
    `verify_trial`.

    Raises:
        StudyError: The events are not those of a finished trial of this episode or sequence, in this condition.
        TaskStateError: There are steps after the end of a sequence.
    """
    opened, reason = opening(events), end_reason(events)
    found = opened.condition or ("none" if opened.task == "pan" else "map_open")  # records of the first version
    if condition not in (None, found):
        raise StudyError(
            f"trial of {opened.task} {opened.key}: was opened in condition {found}; expected {condition}, as planned. "
            "Run personal-viz study check-db."
        )
    is_failure = reason is None or any(isinstance(event, Error) and event.is_fatal for event in events)
    is_failure = is_failure and outcome.reason == "technical"
    if isinstance(trial, HomeSequence):
        storeys, names = home.storeys, {"navigation": home.navigation, "participant": participant}
        run = None if is_failure else sequence_outcome(events, trial, storeys=storeys, **names)
        why = "technical" if is_failure or reason is None else reason
        return run or unscored_outcome(opened.key, opened.task, reason=why, participant=participant)
    return _episode_result(events, trial, home=home, participant=participant, is_failure=is_failure)


def _episode_result(
    events: Sequence[Event], episode: Episode, *, home: TrialHome, participant: str, is_failure: bool
) -> EpisodeRun | Answer:
    task = opening(events).task
    if is_failure:
        end = unscored_outcome(episode.key, task, reason="technical", participant=participant)
        if isinstance(end, EpisodeEnd):
            return episode_run(events, end=end, participant=participant)
        assert isinstance(end, Answer)
        return end
    if task == "pog":
        return pog_outcome(events, episode, storeys=home.storeys, participant=participant)
    return pan_outcome(events, episode, navigation=home.navigation, participant=participant)


def _env_of(trial: Episode | HomeSequence, home: TrialHome, max_steps: int) -> PanEnv:
    if isinstance(trial, HomeSequence):
        return sequence_env(trial, home.navigation, max_steps=max_steps)
    return PanEnv(trial.start, home.navigation, renderer=None, max_steps=max_steps)


def replayed(events: Sequence[Event], env: PanEnv) -> tuple[float, int | None]:
    """Largest position error in metres, and the first step (from 1; 0 = the start) that leads elsewhere.

    Raises:
        TaskStateError: There are steps after the end.
    """
    env.reset()
    start = opening(events).start
    errors = [math.inf if start is None else math.dist(start.position, env.pose.position)]
    bad = None if start is not None and errors[0] <= POSITION_TOLERANCE else 0
    left = dict[int, list[EndReason]]()
    for num_steps, reason in left_searches(events):
        left.setdefault(num_steps, []).append(reason)
    for number, act in enumerate((event for event in events if isinstance(event, Act)), start=1):
        for reason in left.get(number - 1, ()):
            env.end_search(reason)
        env.step(act.action)
        step = env.steps[-1]
        errors.append(math.dist(step.position, act.position))
        angle = max(abs(wrap_angle(step.yaw - act.yaw)), abs(wrap_angle(step.tilt - act.tilt)))
        is_same = errors[-1] <= POSITION_TOLERANCE and angle <= ANGLE_TOLERANCE and step.collided == act.collided
        bad = number if bad is None and not is_same else bad
    return max(errors), bad


def _compared(recomputed: Result, stored: Outcome, max_position_error: float) -> Verification:
    """`verified` when the stored outcome is the recomputed one, else `failed` with the first field that differs."""
    result = recomputed.end if isinstance(recomputed, EpisodeRun | SequenceRun) else recomputed
    if isinstance(result, EpisodeEnd) and isinstance(stored, EpisodeEnd):
        result = end_as_known(result, stored)
    difference = first_difference(stored.model_dump(mode="json"), result.model_dump(mode="json"), "outcome")
    status: VerificationStatus = "failed" if difference else "verified"
    return Verification(status, max_position_error, None, recomputed, difference or "")


def end_as_known(found: EpisodeEnd, stored: EpisodeEnd) -> EpisodeEnd:
    """`found` without the rule `paper-strict` where the program that wrote `stored` did not compute it."""
    if found.measures is None or stored.measures is None or stored.measures.rules["paper-strict"] is not None:
        return found
    rules = {**found.measures.rules, "paper-strict": None}
    return found.model_copy(update={"measures": found.measures.model_copy(update={"rules": rules})})


def run_as_known(found: EpisodeRun, stored: EpisodeRun) -> EpisodeRun:
    """`found` with the schema version of `stored`, and without a rule that the program of `stored` did not compute."""
    start = found.start.model_copy(update={"schema_version": stored.start.schema_version})
    return found.model_copy(update={"start": start, "end": end_as_known(found.end, stored.end)})


def first_difference(stored: object, found: object, where: str) -> str | None:
    """The place where two JSON values differ by more than rounding, with both values; None when they agree."""
    if isinstance(stored, dict) and isinstance(found, dict) and stored.keys() == found.keys():
        pairs = [(stored[key], found[key], f"{where}.{key}") for key in stored]
    elif isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
        pairs = [(a, b, f"{where}[{index}]") for index, (a, b) in enumerate(zip(stored, found, strict=True))]
    elif isinstance(stored, float) and isinstance(found, float):
        is_close = math.isclose(stored, found, rel_tol=1e-6, abs_tol=POSITION_TOLERANCE)
        return None if is_close else f"{where} is stored as {stored!r}, recomputed as {found!r}"
    else:
        return None if stored == found else f"{where} is stored as {stored!r}, recomputed as {found!r}"
    return next((text for a, b, place in pairs if (text := first_difference(a, b, place))), None)

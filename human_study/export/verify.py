"""Repeats a trial's steps, and compares them with the record, and its outcome with the one that the record gives."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.episodes.schema import Episode
from sim.errors import StudyError, TaskStateError
from sim.frames import wrap_angle
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun
from sim.types import EpisodeKey
from sim.walk.navigation_map import NavigationMap

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
    opening,
    pan_outcome,
    pog_outcome,
    unscored_outcome,
)

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
    recomputed: EpisodeRun | Answer | None
    """The result that the events give; None if they give none."""
    detail: str
    """One sentence about what differs; empty when verified."""


def verify_trial(
    events: Sequence[Event], outcome: Outcome, key: EpisodeKey, *, home: TrialHome, participant: str
) -> Verification:
    """Compares a finished trial with the result that all its events, in order, give.

    Raises:
        DatasetError: The home has no such episode.
    """
    episode = home.episode(key)
    if outcome.reason == "technical" and not has_begun(events):  # it failed before anything was shown
        return Verification("verified", 0.0, None, None, "")
    try:
        opened = opening(events)
        if opened.scene_digest != home.scene_digest:
            text = f"done on scene {opened.scene_digest[:12]}, compared with {home.scene_digest[:12]}"
            return Verification("unsupported", 0.0, None, None, text)
        result = recompute(events, outcome, episode, home=home, participant=participant)
        error, bad_step = 0.0, None
        if isinstance(result, EpisodeRun):
            env = PanEnv(episode.start, home.navigation, renderer=None, max_steps=opened.max_steps)
            error, bad_step = replayed(events, env)
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
    events: Sequence[Event], outcome: Outcome, episode: Episode, *, home: TrialHome, participant: str
) -> EpisodeRun | Answer:
    """The result that all events of a finished trial give.

    The stored outcome is used only to tell a technical failure, which has no measures.

    Raises:
        StudyError: The events are not those of a finished trial of this episode.
    """
    task = opening(events).task
    is_failure = end_reason(events) is None or any(isinstance(event, Error) and event.is_fatal for event in events)
    if outcome.reason == "technical" and is_failure:
        end = unscored_outcome(episode.key, task, reason="technical", participant=participant)
        return end if isinstance(end, Answer) else episode_run(events, end=end, participant=participant)
    if task == "pog":
        return pog_outcome(events, episode, storeys=home.storeys, participant=participant)
    return pan_outcome(events, episode, navigation=home.navigation, participant=participant)


def replayed(events: Sequence[Event], env: PanEnv) -> tuple[float, int | None]:
    """Largest position error in metres, and the first step (from 1; 0 = the start) that leads elsewhere.

    Raises:
        TaskStateError: There are steps after the end.
    """
    env.reset()
    start = opening(events).start
    errors = [math.inf if start is None else math.dist(start.position, env.pose.position)]
    bad = None if start is not None and errors[0] <= POSITION_TOLERANCE else 0
    for number, act in enumerate((event for event in events if isinstance(event, Act)), start=1):
        env.step(act.action)
        step = env.steps[-1]
        errors.append(math.dist(step.position, act.position))
        angle = max(abs(wrap_angle(step.yaw - act.yaw)), abs(wrap_angle(step.tilt - act.tilt)))
        is_same = errors[-1] <= POSITION_TOLERANCE and angle <= ANGLE_TOLERANCE and step.collided == act.collided
        bad = number if bad is None and not is_same else bad
    return max(errors), bad


def _compared(recomputed: EpisodeRun | Answer, stored: Outcome, max_position_error: float) -> Verification:
    """`verified` when the stored outcome is the recomputed one, else `failed` with the first field that differs."""
    result = recomputed.end if isinstance(recomputed, EpisodeRun) else recomputed
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

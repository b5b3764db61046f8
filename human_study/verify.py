"""Do a trial's steps again and compare: is the record what the simulator does, and the outcome what the record says?"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from sim.episodes.schema import Episode
from sim.errors import StudyError, TaskStateError
from sim.frames import wrap_angle
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, EpisodeRun
from sim.world.navigation_map import NavigationMap

from .events import Act, Event
from .outcome import Outcome, opening, pan_outcome, pog_outcome

POSITION_TOLERANCE = 1e-4
"""Metres; the same program on the same scene agrees to the last bit, other builds of numpy to far less than this."""
ANGLE_TOLERANCE = 1e-6
"""Radians."""
Status = Literal["verified", "drift", "failed", "unsupported"]


@dataclass(frozen=True, slots=True)
class Verification:
    """What doing a trial again found."""

    status: Status
    """`verified`: all agrees. `drift`: a step leads elsewhere. `failed`: the events are impossible, or the stored
    outcome is not theirs. `unsupported`: the trial was done on another scene."""
    max_position_error: float
    """Largest distance in metres between a stored and a simulated pose; 0 in POG."""
    first_bad_step: int | None
    """From 1, 0 = the start pose; None unless `drift`."""
    recomputed: EpisodeRun | Answer | None
    """The result that the events give; None when they give none."""
    detail: str
    """One sentence about what differs; empty when verified."""


def verify_trial(
    events: Sequence[Event],
    outcome: Outcome,
    episode: Episode,
    *,
    navigation: NavigationMap,
    scene_digest: str,
    storeys: Sequence[tuple[float, float]],
    participant: str,
) -> Verification:
    """Compare a finished trial with what its events lead to.

    Args:
        events: All of the trial, in order.
        outcome: What the store says.
        episode: The trial's episode, with its targets.
        navigation: Of the scene.
        scene_digest: Of the scene.
        storeys: (lowest, highest) floor of each storey, from `sim.tasks.rules.scene_storeys`; used in POG.
        participant: Public code.
    """
    try:
        opened = opening(events)
        if opened.scene_digest != scene_digest:
            text = f"done on scene {opened.scene_digest[:12]}, compared with {scene_digest[:12]}"
            return Verification("unsupported", 0.0, None, None, text)
        if opened.task == "pog":
            answer = pog_outcome(events, episode, storeys=storeys, participant=participant)
            return _compared(answer, answer, outcome, 0.0)
        run = pan_outcome(events, episode, navigation=navigation, participant=participant)
        error, bad_step = _replayed(
            events, PanEnv(episode.start, navigation, renderer=None, max_steps=opened.max_steps)
        )
    except (StudyError, TaskStateError) as problem:
        return Verification("failed", 0.0, None, None, str(problem))
    if bad_step is not None:
        return Verification("drift", error, bad_step, run, f"step {bad_step} leads elsewhere than stored")
    return _compared(run, run.end, outcome, error)


def _replayed(events: Sequence[Event], env: PanEnv) -> tuple[float, int | None]:
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


def _compared(
    recomputed: EpisodeRun | Answer, result: Outcome, stored: Outcome, max_position_error: float
) -> Verification:
    """`verified` when the stored outcome is the recomputed one, else `failed` with the first field that differs."""
    difference = _first_difference(stored.model_dump(mode="json"), result.model_dump(mode="json"), "outcome")
    status: Status = "failed" if difference else "verified"
    return Verification(status, max_position_error, None, recomputed, difference or "")


def _first_difference(stored: object, found: object, where: str) -> str | None:
    """Where two JSON values differ by more than rounding; None when they agree."""
    if isinstance(stored, dict) and isinstance(found, dict) and stored.keys() == found.keys():
        pairs = [(stored[key], found[key], f"{where}.{key}") for key in stored]
    elif isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
        pairs = [(a, b, f"{where}[{index}]") for index, (a, b) in enumerate(zip(stored, found, strict=True))]
    elif isinstance(stored, float) and isinstance(found, float):
        is_close = math.isclose(stored, found, rel_tol=1e-6, abs_tol=POSITION_TOLERANCE)
        return None if is_close else f"{where} is stored as {stored!r}, recomputed as {found!r}"
    else:
        return None if stored == found else f"{where} is stored as {stored!r}, recomputed as {found!r}"
    return next((text for a, b, place in pairs if (text := _first_difference(a, b, place))), None)

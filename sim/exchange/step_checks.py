"""Checks that a robot of the paper could have made each step of an imported run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.episodes.schema import Episode
from sim.errors import RunFileError
from sim.frames import forward_from_yaw, wrap_angle
from sim.types import FORWARD_STEP, MAX_STEPS, TURN_STEP, Action, Pose
from sim.walk.navigation_map import NavigationMap

from ..tasks.run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Step

START_TOLERANCE = 0.01
"""A run starts at most this far (metres) from its episode's start."""
ANGLE_TOLERANCE = math.radians(0.5)
"""Tolerance for the start's yaw and for every turn and look; Habitat's float32 rotations stay within 0.001 degrees."""
POSITION_TOLERANCE = 1e-3
"""Metres of rounding allowed in any step; forwards in Habitat's golden runs are off by 3e-6 at most."""
MAX_RISE = 0.45
"""Most that one forward can climb or fall (metres): 0.25 on Habitat's steepest slope (45 degrees) plus a climb."""
SNAP_SIDEWAYS = 0.25
"""Most metres by which the first forward may leave its line sideways when the start is off the other simulator's mesh.

Episode starts were drawn on a mesh for radius 0.10, but Habitat 0.2.5 plays on one for 0.20. They differ by 0.1 m and
up to a cell of rounding on each side; in the golden runs the first forward leaves its line by up to 0.20 m.
"""
SNAP_HEIGHT = 0.5
"""The same upwards or downwards; Habitat counts places farther away as not navigable."""
MAP_TOLERANCE = 0.25
"""Most metres by which a position may lie outside our own free floor: each map rounds walls by a cell or two."""

_BODY_ADVICE = "Give the body's pose after the action (agent_state, not a sensor)."


@dataclass(frozen=True, slots=True)
class CheckedRun:
    """A run whose steps are possible, with its episode."""

    episode: Episode
    run: EpisodeRun
    """Measures dropped, `collided` computed from the positions, the episode's id as in the dataset.

    habitat-lab replaces ids by the place in the content file; such a number is accepted when the start fits.
    """
    wheres: tuple[str, ...]
    """`file:line` of start, each step and end."""
    ignored: tuple[str, ...] = ()
    """Columns of its file that we do not use."""


def start_problem(start: EpisodeStart, episode: Episode) -> str | None:
    """The difference between a run's start and its episode's, in words, or None."""
    wanted = episode.start
    apart, turned = math.dist(start.position, wanted.position), abs(wrap_angle(start.yaw - wanted.yaw))
    if apart <= START_TOLERANCE and turned <= ANGLE_TOLERANCE:
        return None
    return (
        f"begins {apart:.3f} m and {math.degrees(turned):.1f} degrees from its start; expected at most "
        f"{START_TOLERANCE} m and {math.degrees(ANGLE_TOLERANCE):.1f} degrees"
    )


def with_own_facts(run: EpisodeRun, episode: Episode) -> EpisodeRun:
    """The run without its own claims: no measures, collisions by habitat-sim's rule, the dataset's id.

    In free motion the wanted length of a move is unknown, so no collision is found.
    """
    is_paper = run.start.motion == "paper"
    steps = tuple(
        step.model_copy(update={"collided": is_paper and step.action is Action.FORWARD and _collided(before, step)})
        for before, step in zip(run.poses, run.steps, strict=False)
    )
    start = run.start.model_copy(update={"episode_id": episode.key.episode_id})
    return EpisodeRun(start=start, steps=steps, end=EpisodeEnd(reason=run.end.reason))


def check_steps(wheres: Sequence[str], run: EpisodeRun, *, rounding: float = POSITION_TOLERANCE) -> None:
    """Refuses a run that no robot of the paper could have made, apart from `rounding` (metres) in any step.

    `wheres` is the `file:line` of the start, each step and the end.

    Raises:
        RunFileError: A step is impossible; the message names its place from `wheres`.
    """
    poses = run.poses
    has_moved = False
    for index, step in enumerate(run.steps):
        where = wheres[index + 1]
        if index >= MAX_STEPS:
            raise RunFileError(f"{where}: found step {index + 1}; expected at most {MAX_STEPS}. Stop at the limit.")
        if index and run.steps[index - 1].action is Action.STOP:
            raise RunFileError(
                f"{where}: found action {step.action.value!r} after 'stop'; expected 'end'. End the episode after STOP."
            )
        problem = _step_problem(
            poses[index], step, allow_sliding=run.start.allow_sliding, may_snap=not has_moved, rounding=rounding
        )
        if problem:
            raise RunFileError(f"{where}: action {step.action.value!r} {problem}")
        has_moved = has_moved or math.dist(poses[index].position, step.position) > rounding
    _check_end(wheres[-1], run, max_steps=MAX_STEPS)


def check_free_motion(
    wheres: Sequence[str], run: EpisodeRun, *, max_move: float, max_turn: float, max_steps: int
) -> None:
    """Refuses a run of a robot with other actions that exceeds the declared move (metres) or turn (radians) from pose
    to pose, or the number of steps.

    `wheres` is the `file:line` of the start, each step and the end.

    Raises:
        RunFileError: A step is impossible; the message names its place from `wheres`.
    """
    for index, (before, step) in enumerate(zip(run.poses, run.steps, strict=False)):
        moved, turned = math.dist(before.position, step.position), abs(wrap_angle(step.yaw - before.yaw))
        if index >= max_steps:
            raise RunFileError(
                f"{wheres[index + 1]}: found step {index + 1}; expected at most {max_steps}. "
                "Give the budget that the robot had with --max-steps."
            )
        if moved > max_move + POSITION_TOLERANCE or turned > max_turn + ANGLE_TOLERANCE:
            raise RunFileError(
                f"{wheres[index + 1]}: moved {moved:.3f} m and turned {math.degrees(turned):.1f} degrees; expected at "
                f"most {max_move:g} m and {math.degrees(max_turn):.1f} degrees. "
                "Give the robot's bounds with --max-move and --max-turn-deg."
            )
    _check_end(wheres[-1], run, max_steps=max_steps)


def check_places(checked: CheckedRun, navigation: NavigationMap) -> None:
    """Refuses a run that leaves the scene's floor: through a wall, into the air, off the home.

    Raises:
        RunFileError: The message names the line of the first such place.
    """
    before = checked.run.start.position
    for where, step in zip(checked.wheres[1:], checked.run.steps, strict=False):
        if math.dist(before, step.position) > POSITION_TOLERANCE:
            place = navigation.snap(np.array(step.position))
            aside = math.inf if place is None else math.hypot(place[0] - step.position[0], place[2] - step.position[2])
            rise = math.inf if place is None else abs(place[1] - step.position[1])
            if aside > MAP_TOLERANCE or rise > SNAP_HEIGHT:
                raise RunFileError(
                    f"{where}: position {[round(value, 2) for value in step.position]} is {aside:.2f} m "
                    f"aside and {rise:.2f} m above or below the nearest floor; expected at most {MAP_TOLERANCE} and "
                    f"{SNAP_HEIGHT}. Give the scenes on which the run was made."
                )
        before = step.position


def _step_problem(before: Pose, step: Step, *, allow_sliding: bool, may_snap: bool, rounding: float) -> str | None:
    """The reason why a step that began at `before` is impossible, or None."""
    turn = {Action.LEFT: TURN_STEP, Action.RIGHT: -TURN_STEP}.get(step.action, 0.0)
    look = {Action.LOOK_UP: TURN_STEP, Action.LOOK_DOWN: -TURN_STEP}.get(step.action, 0.0)
    for what, found, wanted in (("yaw", step.yaw - before.yaw, turn), ("tilt", step.tilt - before.tilt, look)):
        if abs(wrap_angle(found - wanted)) > ANGLE_TOLERANCE:
            found_deg, wanted_deg = math.degrees(wrap_angle(found)), math.degrees(wanted)
            return f"changed {what} by {found_deg:.1f} degrees; expected {wanted_deg:.0f}. {_BODY_ADVICE}"
    if step.action is Action.FORWARD:
        return _forward_problem(before, step, allow_sliding=allow_sliding, may_snap=may_snap, rounding=rounding)
    moved = math.dist(before.position, step.position)
    if moved > rounding:
        return f"moved the robot {moved:.3f} m; expected no displacement. {_BODY_ADVICE}"
    return None


def _forward_problem(before: Pose, step: Step, *, allow_sliding: bool, may_snap: bool, rounding: float) -> str | None:
    """The reason why a forward cannot have ended here, or None.

    Without sliding Habitat stops on the line to the wanted end. With sliding it ends at the point of the mesh's border
    nearest to the wanted end; the start itself was a candidate, so the result is within one step of the wanted end.
    """
    forward = forward_from_yaw(before.yaw)
    moved = np.subtract(step.position, before.position)
    ahead, aside, rise = float(moved @ forward), float(moved[0] * -forward[2] + moved[2] * forward[0]), float(moved[1])
    beyond = ahead - FORWARD_STEP
    off_line = math.hypot(aside, max(0.0, beyond, -ahead))
    allowed = rounding + (SNAP_SIDEWAYS if may_snap else 0.0)
    possible = math.hypot(beyond, aside) <= FORWARD_STEP + allowed if allow_sliding else off_line <= allowed
    if possible and abs(rise) <= (SNAP_HEIGHT if may_snap else MAX_RISE):
        return None
    limit = "0.25 m from the wanted end" if allow_sliding else "0 to 0.25 m straight ahead"
    advice = (
        ""
        if allow_sliding
        else " If the simulator slides along walls, say so with allow_sliding=True (or --allow-sliding)."
    )
    return (
        f"ended {ahead:.3f} m ahead, {abs(aside):.3f} m aside and {rise:.3f} m up; expected {limit} and at most "
        f"{MAX_RISE} m up or down. {_BODY_ADVICE}{advice}"
    )


def _check_end(where: str, run: EpisodeRun, *, max_steps: int) -> None:
    stopped = bool(run.steps) and run.steps[-1].action is Action.STOP
    at_limit = len(run.steps) == max_steps and not stopped
    reason = run.end.reason
    if (reason == "stop") != stopped or (reason == "steps") != at_limit or reason == "click":
        expected = "'stop'" if stopped else "'steps'" if at_limit else "'giveup', 'timeout', 'technical' or 'abandoned'"
        last = run.steps[-1].action.value if run.steps else None
        raise RunFileError(
            f"{where}: reason is {reason!r} after {len(run.steps)} steps, the last of which is {last!r}; expected "
            f"{expected}. habitat_writer fills it in: end_episode() without a reason."
        )


def _collided(before: Pose, step: Step) -> bool:
    """Whether a forward was shortened (habitat-sim: |moved|^2 + 1e-5 < |wanted|^2)."""
    return math.dist(before.position, step.position) ** 2 + 1e-5 < FORWARD_STEP**2

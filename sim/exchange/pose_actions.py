"""Turns a sequence of poses into a run: with the file's actions, or the only actions that fit from pose to pose."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from sim.errors import RunFileError, short
from sim.frames import wrap_angle
from sim.types import MAX_STEPS, PAPER6, TURN_STEP, Action, EndReason, EpisodeKey, Pose

from ..tasks.run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Step
from .pose_files import PoseReading, tells_tilt
from .pose_tables import PoseTable, number_of, truth_of
from .step_checks import ANGLE_TOLERANCE

_LAB_NAMES = {
    "move_forward": "forward",
    "turn_left": "left",
    "turn_right": "right",
}
_STILL = 1e-6
"""Metres and radians below which a robot has not moved."""


class _Walk(NamedTuple):
    """The states of a robot, and the actions between them."""

    states: list[tuple[Pose, int]]
    """Each pose with its row; one more than there are actions."""
    actions: list[Action]


def run_from_poses(
    table: PoseTable, reading: PoseReading, poses: Sequence[Pose], *, key: EpisodeKey, start: Pose
) -> tuple[tuple[str, ...], EpisodeRun]:
    """`file:line` of the start, each step and the end, and the run of the poses, unchecked.

    `start` is the episode's start pose, for files whose first row is after the first action.

    Raises:
        RunFileError: An action is unknown or missing, no action leads from one pose to the next, or it is unknown
            whether the run stopped.
    """
    actions = _given_actions(table)
    if reading.free is not None:
        walk = _free_walk(poses, stops=bool(actions) and actions[-1] is Action.STOP)
    elif actions is None:
        found = [
            _inferred(table.wheres[row], *poses[row - 1 : row + 1], rounding=reading.rounding)
            for row in range(1, len(poses))
        ]
        walk = _Walk(_states(poses), found)
    else:
        walk = _given_walk(table, reading, poses, actions, start)
    if not tells_tilt(table, reading):
        walk = _with_counted_tilt(walk)
    walk = _ended(table, reading, walk, is_told=actions is not None)
    (first, _), *states = walk.states
    max_steps = reading.free.max_steps if reading.free else MAX_STEPS
    has_stopped = walk.actions[-1:] == [Action.STOP]
    reason: EndReason = "stop" if has_stopped else "steps" if len(walk.actions) == max_steps else "abandoned"
    sliding = table.facts.get("allow_sliding")
    times = _times(table)
    run = EpisodeRun(
        start=EpisodeStart(
            split=key.split,
            scene=key.scene,
            episode_id=key.episode_id,
            position=first.position,
            yaw=first.yaw,
            motion="free" if reading.free else "paper",
            allow_sliding=reading.allow_sliding if sliding is None else truth_of(table.where, "allow_sliding", sliding),
        ),
        steps=tuple(
            Step(action=action, position=pose.position, yaw=pose.yaw, tilt=pose.tilt, t_s=times[row])
            for action, (pose, row) in zip(walk.actions, states, strict=True)
        ),
        end=EpisodeEnd(reason=reason),
    )
    return (table.wheres[0], *(table.wheres[row] for _, row in states), table.wheres[-1]), run


def _given_actions(table: PoseTable) -> list[Action | None] | None:
    """The file's actions, None for empty ones; None when it has none at all."""
    if table.actions is None or all(value in (None, "") for value in table.actions):
        return None
    found: list[Action | None] = []
    for row, value in enumerate(table.actions):
        where = table.wheres[min(row, len(table.wheres) - 1)]
        found.append(None if value in (None, "", "none") else action_of(where, value))
    return found


def action_of(where: str, value: object) -> Action:
    """The action that a number of Habitat's or a name stands for.

    Raises:
        RunFileError: It stands for none.
    """
    number = number_of(value)
    if number is not None and number.is_integer() and 0 <= number < len(PAPER6):
        return PAPER6[int(number)]
    if isinstance(value, str):
        name = _LAB_NAMES.get(value.strip().lower(), value.strip().lower())
        if name in PAPER6:
            return Action(name)
    raise RunFileError(
        f"{where}: action is {short(value)}; expected 0-5 or one of {', '.join(PAPER6)} (or habitat-lab's names). "
        "Runs with other actions are imported with --motion free."
    )


def _given_walk(
    table: PoseTable, reading: PoseReading, poses: Sequence[Pose], actions: list[Action | None], start: Pose
) -> _Walk:
    """The walk of a file with actions; the row without an action shows whether poses are before or after actions."""
    count = len(poses)
    if len(actions) not in (count - 1, count):
        raise RunFileError(
            f"{table.where}: found {len(actions)} actions and {count} poses; expected one action per pose, or one "
            "action fewer (the first pose is the start). Write the file again."
        )
    is_full = len(actions) == count
    rows = reading.rows
    if is_full and (actions[0] is None) != (actions[-1] is None):
        told = "after-action" if actions[0] is None else "before-action"
        if rows not in (None, told):
            raise RunFileError(
                f"{table.where}: the {'first' if actions[0] is None else 'last'} row has no action, so poses are "
                f"{told}; found --rows {rows}. Leave --rows out."
            )
        actions = actions[1:] if actions[0] is None else actions[:-1]
        is_full = False
    named = [action for action in actions if action is not None]
    if len(named) != len(actions):
        row = actions.index(None)
        raise RunFileError(
            f"{table.wheres[row]}: found no action; expected one in every row but the first (pose after the action) or "
            "the last (pose before it). Write the row again."
        )
    states = _states(poses)
    if not is_full:
        return _Walk(states, named)
    if rows == "after-action":
        return _Walk([(start, 0), *states], named)
    if rows is None:
        raise RunFileError(
            f"{table.where}: every row has an action, and nothing says whether a row's pose is before or after it; "
            "expected a declaration. Give --rows before-action or --rows after-action."
        )
    if named[-1] is not Action.STOP:
        raise RunFileError(
            f"{table.wheres[-1]}: the last action is {named[-1].value!r} and the pose after it is missing; expected "
            "'stop', or one more row. Leave the last action empty to end the run before it."
        )
    return _Walk([*states, states[-1]], named)


def _states(poses: Sequence[Pose]) -> list[tuple[Pose, int]]:
    return [(pose, row) for row, pose in enumerate(poses)]


def _inferred(where: str, before: Pose, after: Pose, *, rounding: float) -> Action:
    """The only action that can lead from one pose to the next.

    A robot that does not move has walked against a wall: every other action that poses can show changes the pose.
    (Looks show only where the file has the tilt.) `check_steps` checks whether a move is possible.
    """
    moved = math.dist(before.position, after.position)
    turned, tilted = wrap_angle(after.yaw - before.yaw), wrap_angle(after.tilt - before.tilt)
    for action, turn, tilt in (
        (Action.FORWARD, 0.0, 0.0),
        (Action.LEFT, TURN_STEP, 0.0),
        (Action.RIGHT, -TURN_STEP, 0.0),
        (Action.LOOK_UP, 0.0, TURN_STEP),
        (Action.LOOK_DOWN, 0.0, -TURN_STEP),
    ):
        is_turned = max(abs(wrap_angle(turned - turn)), abs(wrap_angle(tilted - tilt))) <= ANGLE_TOLERANCE
        if is_turned and (action is Action.FORWARD or moved <= rounding):
            return action
    raise RunFileError(
        f"{where}: moved {moved:.3f} m, turned {math.degrees(turned):.1f} and tilted {math.degrees(tilted):.1f} "
        "degrees since the row before; expected one action: a move of 0.25 m or less, or a turn or look of 30 degrees. "
        "Runs with other actions are imported with --motion free."
    )


def _free_walk(poses: Sequence[Pose], *, stops: bool) -> _Walk:
    """The nearest actions for moves of another action space: forward for a move or no motion, else a turn."""
    actions = []
    for before, after in pairwise(poses):
        turned = wrap_angle(after.yaw - before.yaw)
        is_turn = math.dist(before.position, after.position) < _STILL and abs(turned) >= _STILL
        actions.append((Action.LEFT if turned > 0 else Action.RIGHT) if is_turn else Action.FORWARD)
    walk = _Walk(_states(poses), actions)
    return _with_stop(walk, may_rename=True) if stops else walk


def _ended(table: PoseTable, reading: PoseReading, walk: _Walk, *, is_told: bool) -> _Walk:
    """The walk, with STOP as its last action where the file or the person says that it stopped."""
    has_stopped = walk.actions[-1:] == [Action.STOP]
    fact = table.facts.get("stopped")
    stopped = reading.stopped if fact is None else truth_of(table.where, "stopped", fact)
    if fact is None and has_stopped:
        return walk
    if stopped is None:
        if is_told:
            return walk
        raise RunFileError(
            f"{table.where}: nothing says whether the run ended with STOP; expected an action column, a 'stopped' "
            "field or a declaration. Give --stopped yes or --stopped no."
        )
    if not stopped and reading.free and reading.rows == "before-action" and len(table.wheres) == reading.free.max_steps:
        return _Walk([*walk.states, walk.states[-1]], [*walk.actions, Action.FORWARD])  # its result was never written
    if has_stopped and not stopped:
        raise RunFileError(
            f"{table.where}: stopped is false, but the last action is 'stop'; expected them to agree. Correct one."
        )
    return _with_stop(walk, may_rename=not is_told) if stopped and not has_stopped else walk


def _with_stop(walk: _Walk, *, may_rename: bool) -> _Walk:
    """The walk with STOP at its end, in a new row or in a last row that repeats its predecessor and has no action."""
    states, actions = walk
    if may_rename and len(states) > 1 and _is_same(states[-2][0], states[-1][0]):
        return _Walk(states, [*actions[:-1], Action.STOP])
    return _Walk([*states, states[-1]], [*actions, Action.STOP])


def _is_same(one: Pose, other: Pose) -> bool:
    turned, tilted = wrap_angle(one.yaw - other.yaw), wrap_angle(one.tilt - other.tilt)
    return math.dist(one.position, other.position) < _STILL and abs(turned) < _STILL and abs(tilted) < _STILL


def _with_counted_tilt(walk: _Walk) -> _Walk:
    """The walk with the tilt as the sum of its looks."""
    tilt, states = 0.0, walk.states[:1]
    for action, (pose, row) in zip(walk.actions, walk.states[1:], strict=True):
        tilt += TURN_STEP * ((action is Action.LOOK_UP) - (action is Action.LOOK_DOWN))
        states.append((Pose(pose.position, pose.yaw, tilt), row))
    return _Walk(states, walk.actions)


def _times(table: PoseTable) -> list[float]:
    """Seconds since the start of each row; zeros where the file has none."""
    name = next((name for name in ("t_s", "timestamp") if table.has(name)), None)
    if name is None:
        return [0.0] * len(table.wheres)
    times = table.numbers(name)[:, 0]
    if name == "timestamp":
        times = times - times[0]
    for row in range(len(times)):
        if times[row] < (times[row - 1] if row else 0.0):
            raise RunFileError(
                f"{table.wheres[row]}: {name} is {times[row]:.3f}, before the row above (or negative); expected "
                "increasing seconds. Write the row again."
            )
    return times.tolist()

"""Positions without headings and a list of all actions, as VLFM writes them: the heading follows from start and turns.

VLFM writes positions per episode (`trajectory/<number>_<scene>.txt`: `step, x, y, z` after each action), and one list
of the actions of all episodes (`VLFM_RECORD_ACTIONS_DIR`). No file says where an episode begins in the list, so each
episode is the one stretch of it that leads along its positions.

Two rows are special, because habitat-lab begins the next episode at once: the row after STOP is missing, or shows where
the next episode starts; the row after the last step of the budget is missing.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.errors import RunFileError
from sim.types import MAX_STEPS, PAPER6, TURN_STEP, Action, EndReason

from ..tasks.run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Step
from .pose_actions import action_of
from .pose_files import PoseReading, world_positions
from .pose_tables import PoseTable, read_text
from .step_checks import check_steps


def read_action_list(path: Path) -> tuple[Action, ...]:
    """The actions in a file with one number or name a line.

    Raises:
        RunFileError: The file cannot be read, holds no action, or a line is no action.
    """
    lines = [(number, line.strip()) for number, line in enumerate(read_text(path).splitlines(), start=1)]
    actions = tuple(action_of(f"{path}:{number}", line) for number, line in lines if line)
    if not actions:
        raise RunFileError(f"{path}: holds no action; expected one a line, 0 (stop) to 5. Check the path.")
    return actions


def run_along_positions(table: PoseTable, reading: PoseReading, episode: Episode) -> tuple[tuple[str, ...], EpisodeRun]:
    """`file:line` of the start, each step and the end, and the run whose actions lead along the table's positions.

    Raises:
        RunFileError: The steps are not counted from 1, no stretch of the action list leads along the positions, or
            several that differ do.
    """
    assert reading.actions is not None
    _require_counted(table)
    positions = world_positions(table, reading, episode.start)[0]
    found: dict[tuple[Action, ...], tuple[tuple[str, ...], EpisodeRun]] = {}
    for count in (len(positions), len(positions) - 1):  # the last row is missing, or is the next episode's start
        for actions in _stretches(reading.actions, episode.start.position, positions[:count], reading.rounding):
            made = _run(table, reading, episode, positions[:count], actions)
            if made is not None:
                found[actions] = made
        if found:
            break
    if len(found) != 1:
        what = f"{len(found)} different stretches lead" if found else "no stretch leads"
        raise RunFileError(
            f"{table.where}: {what} from the start of {episode.key} along its {len(positions)} positions in the list "
            "of actions; expected one. Give the list of the very evaluation, and --rounding if positions are rounded."
        )
    return next(iter(found.values()))


def _require_counted(table: PoseTable) -> None:
    """Refuses rows of two runs in one file: an evaluation that skips a finished episode adds a row to its file."""
    if not table.has("step"):
        return
    for row, step in enumerate(table.numbers("step")[:, 0], start=1):
        if step != row:
            raise RunFileError(
                f"{table.wheres[row - 1]}: step is {step:g}; expected {row}, one row per step from 1. "
                "Delete the rows that another run added."
            )


def _stretches(
    actions: Sequence[Action], start: Sequence[float], positions: NDArray[np.float64], rounding: float
) -> Iterator[tuple[Action, ...]]:
    """Stretches of the list with one action more than there are positions, whose moves are forwards.

    They end with the only STOP or at the end of the budget.
    """
    listed = np.array([PAPER6.index(action) for action in actions])
    count = len(positions)
    places = np.arange(len(listed) - count)
    is_stop = listed[places + count] == PAPER6.index(Action.STOP)
    places = places[is_stop | (count + 1 == MAX_STEPS)]
    has_moved = np.linalg.norm(np.diff(positions, axis=0, prepend=np.array([start])), axis=1) > rounding
    for step in range(count):
        allowed = [Action.FORWARD] if has_moved[step] else [action for action in PAPER6 if action is not Action.STOP]
        places = places[np.isin(listed[places + step], [PAPER6.index(action) for action in allowed])]
    yield from dict.fromkeys(tuple(actions[place : place + count + 1]) for place in places)


def _run(
    table: PoseTable,
    reading: PoseReading,
    episode: Episode,
    positions: NDArray[np.float64],
    actions: Sequence[Action],
) -> tuple[tuple[str, ...], EpisodeRun] | None:
    """The run with these actions and its places in the file; None where a step is impossible.

    The position after the last action is unknown, so it is the one before: STOP moves nobody, and the last step of the
    budget moves 0.25 m at most. Of the success rules only `authors`, which asks for no STOP, could tell the difference.
    """
    yaw, tilt, steps = episode.start.yaw, 0.0, []
    for action, position in zip(actions, [*positions, positions[-1:].reshape(-1)], strict=True):
        yaw += TURN_STEP * ((action is Action.LEFT) - (action is Action.RIGHT))
        tilt += TURN_STEP * ((action is Action.LOOK_UP) - (action is Action.LOOK_DOWN))
        x, y, z = position if len(position) else episode.start.position
        place = (float(x), float(y), float(z))
        steps.append(Step(action=action, position=place, yaw=math.remainder(yaw, math.tau), tilt=tilt))
    reason: EndReason = "stop" if actions[-1] is Action.STOP else "steps"
    split, scene, episode_id = episode.key
    start = EpisodeStart(
        split=split,
        scene=scene,
        episode_id=episode_id,
        position=episode.start.position,
        yaw=episode.start.yaw,
        allow_sliding=reading.allow_sliding,
    )
    run = EpisodeRun(start=start, steps=tuple(steps), end=EpisodeEnd(reason=reason))
    last = table.wheres[-1]
    wheres = (table.wheres[0], *table.wheres[: len(positions)], last, last)
    try:
        check_steps(wheres, run, rounding=reading.rounding)
    except RunFileError:
        return None
    return wheres, run

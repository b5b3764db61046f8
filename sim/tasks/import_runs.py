"""Bring PAN runs of another simulator in: check every step, compute all measures here, write an ordinary run folder.

Files come from `recordings/habitat_writer.py`. Nothing that a file says about its own success, measures or collisions
is used; a file with an impossible step is refused with its line number, and then nothing at all is written.
"""

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError, RunFileError, line_from_validation_error
from sim.frames import forward_from_yaw, wrap_angle
from sim.scenes.kind import common_kind
from sim.types import FORWARD_STEP, MAX_STEPS, TURN_STEP, Action, EpisodeKey, Pose, SceneKind
from sim.world.navigation_map import NavigationMap

from .provenance import make_run_info
from .rules import score_run
from .run_files import EpisodeEnd, EpisodeRun, EpisodeStart, RunInfo, Step, read_episode_runs
from .run_writer import RunWriter

START_TOLERANCE = 0.01
"""A run starts at most this far (metres) from its episode's start."""
ANGLE_TOLERANCE = math.radians(0.5)
"""For the start's yaw and for every turn and look; Habitat's float32 rotations stay within 0.001 degrees."""
POSITION_TOLERANCE = 1e-3
"""Metres of rounding allowed in any step; of the 3,926 forwards in the golden runs none is off by more than 3e-6."""
MAX_RISE = 0.45
"""Most that one forward can climb or fall (metres): 0.25 on Habitat's steepest slope (45 degrees) plus a climb."""
SNAP_SIDEWAYS = 0.25
"""How far sideways the first forward may leave its line when the start is off the other simulator's mesh (metres).

Episode starts were drawn on a mesh for radius 0.10, Habitat 0.2.5 plays on one for 0.20: 0.1 m, rotated by up to a cell
on each side; the golden steps from off-mesh starts reach 0.20.
"""
SNAP_HEIGHT = 0.5
"""... and how far up or down (metres); farther, the place counts as not navigable in Habitat."""
MAP_TOLERANCE = 0.25
"""How far (metres) a position may lie outside our own free floor: both maps round walls, by a cell or two each."""

_BODY_ADVICE = "Give habitat_writer the body's pose after the action (agent_state, not a sensor)."


@dataclass(frozen=True, slots=True)
class CheckedRun:
    """A possible run with the episode that it belongs to."""

    episode: Episode
    run: EpisodeRun
    """Measures dropped, `collided` computed from the positions, the episode's id as in the dataset.

    habitat-lab overwrites ids by the place in the content file; such a number is understood when the start fits.
    """
    path: Path
    """The file it was read from."""
    lines: tuple[int, ...]
    """Line numbers of start, each step and end."""

    @property
    def where(self) -> str:
        """`file:line` of its first line."""
        return f"{self.path}:{self.lines[0]}"


def import_runs(
    files: Sequence[Path],
    *,
    dataset: PersonalDataset,
    scenes_dir: Path | None,
    out: Path,
    who: str,
    run_id: str | None = None,
    allow_schematic: bool = False,
) -> list[Path]:
    """Check files that another simulator wrote, score their runs and write them as run folders below `out`.

    Args:
        files: Steps files, read as one run (an evaluation may write one file per worker).
        dataset: The episodes that were played.
        scenes_dir: Folder with the scans; None only for invented homes, whose plan lies beside the episodes.
        out: Folder that gets `<run_id>/`.
        who: The agent's name in tables.
        run_id: Name of the folder; None = `who` and the digest of the files. Importing the same files again resumes.
        allow_schematic: Score on homes recovered from the episodes; their distances are not those of the scans.

    Returns:
        The folder written.

    Raises:
        RunFileError: A line is damaged, a step is impossible, an episode is unknown or comes twice, or `out` cannot be
            written.
        SceneError: The scenes are of several kinds, or one cannot be opened.
    """
    checked = [run for path in files for run in check_file(path, dataset=dataset)]
    _require_some_and_no_twins(checked, files)
    kind = common_kind(dataset, {item.episode.key.scene for item in checked}, scenes_dir)
    if kind == "schematic" and not allow_schematic:
        raise RunFileError(
            f"{dataset.root}: there are neither scans nor plans of its homes, only schematic homes, which another "
            "simulator did not use; expected the scenes that were played. Give --scenes-dir the folder of their GLBs."
        )
    info = _run_info(files, dataset=dataset, kind=kind, who=who, run_id=run_id)
    scored = _score(checked, dataset=dataset, scenes_dir=scenes_dir)
    writer = RunWriter(out / info.run_id, info)
    for run in scored:
        if run.key not in writer.done:
            writer.add_episode(run)
    return [writer.folder]


def check_file(path: Path, *, dataset: PersonalDataset) -> Iterator[CheckedRun]:
    """Each complete run of a file, once all its steps are found possible.

    Raises:
        RunFileError: A line is damaged or a step is impossible; the message begins with `file:line`.
    """
    for lines, run in read_episode_runs(path):
        episode = _find_episode(f"{path}:{lines[0]}", run.start, dataset)
        check_steps(path, lines, run)
        yield CheckedRun(episode, _with_own_facts(run, episode), path, tuple(lines))


def check_steps(path: Path, lines: Sequence[int], run: EpisodeRun) -> None:
    """Refuses a run that no robot of the paper could have made.

    Raises:
        RunFileError: Says at which line of `lines` (start, steps, end) what is wrong.
    """
    poses = run.poses
    has_moved = False
    for index, step in enumerate(run.steps):
        where = f"{path}:{lines[index + 1]}"
        if index >= MAX_STEPS:
            raise RunFileError(f"{where}: found step {index + 1}; expected at most {MAX_STEPS}. Stop at the limit.")
        if index and run.steps[index - 1].action is Action.STOP:
            raise RunFileError(
                f"{where}: found action {step.action.value!r} after 'stop'; expected 'end'. "
                "Call end_episode after STOP."
            )
        problem = _step_problem(poses[index], step, allow_sliding=run.start.allow_sliding, may_snap=not has_moved)
        if problem:
            raise RunFileError(f"{where}: action {step.action.value!r} {problem}")
        has_moved = has_moved or math.dist(poses[index].position, step.position) > POSITION_TOLERANCE
    _check_end(f"{path}:{lines[-1]}", run)


def check_places(checked: CheckedRun, navigation: NavigationMap) -> None:
    """Refuses a run that leaves the scene's floor: through a wall, into the air, off the home.

    Raises:
        RunFileError: Says at which line the first such place is.
    """
    before = checked.run.start.position
    for line, step in zip(checked.lines[1:], checked.run.steps, strict=False):
        if math.dist(before, step.position) > POSITION_TOLERANCE:
            place = navigation.snap(np.array(step.position))
            aside = math.inf if place is None else math.hypot(place[0] - step.position[0], place[2] - step.position[2])
            rise = math.inf if place is None else abs(place[1] - step.position[1])
            if aside > MAP_TOLERANCE or rise > SNAP_HEIGHT:
                raise RunFileError(
                    f"{checked.path}:{line}: position {[round(value, 2) for value in step.position]} is {aside:.2f} m "
                    f"aside and {rise:.2f} m above or below the nearest floor; expected at most {MAP_TOLERANCE} and "
                    f"{SNAP_HEIGHT}. Give the scenes on which the run was made."
                )
        before = step.position


def _step_problem(before: Pose, step: Step, *, allow_sliding: bool, may_snap: bool) -> str | None:
    """What is impossible about a step that began at `before`, or None."""
    turn = {Action.LEFT: TURN_STEP, Action.RIGHT: -TURN_STEP}.get(step.action, 0.0)
    look = {Action.LOOK_UP: TURN_STEP, Action.LOOK_DOWN: -TURN_STEP}.get(step.action, 0.0)
    for what, found, wanted in (("yaw", step.yaw - before.yaw, turn), ("tilt", step.tilt - before.tilt, look)):
        if abs(wrap_angle(found - wanted)) > ANGLE_TOLERANCE:
            found_deg, wanted_deg = math.degrees(wrap_angle(found)), math.degrees(wanted)
            return f"changed {what} by {found_deg:.1f} degrees; expected {wanted_deg:.0f}. {_BODY_ADVICE}"
    if step.action is Action.FORWARD:
        return _forward_problem(before, step, allow_sliding=allow_sliding, may_snap=may_snap)
    moved = math.dist(before.position, step.position)
    if moved > POSITION_TOLERANCE:
        return f"moved the robot {moved:.3f} m; expected no displacement. {_BODY_ADVICE}"
    return None


def _forward_problem(before: Pose, step: Step, *, allow_sliding: bool, may_snap: bool) -> str | None:
    """What is impossible about where a forward ended, or None.

    Without sliding Habitat stops on the line to the wanted end. With sliding it ends at the point of the mesh's border
    nearest to the wanted end; the start itself was a candidate, so the result is within one step of the wanted end.
    """
    forward = forward_from_yaw(before.yaw)
    moved = np.subtract(step.position, before.position)
    ahead, aside, rise = float(moved @ forward), float(moved[0] * -forward[2] + moved[2] * forward[0]), float(moved[1])
    beyond = ahead - FORWARD_STEP
    off_line = math.hypot(aside, max(0.0, beyond, -ahead))
    allowed = POSITION_TOLERANCE + (SNAP_SIDEWAYS if may_snap else 0.0)
    possible = math.hypot(beyond, aside) <= FORWARD_STEP + allowed if allow_sliding else off_line <= allowed
    if possible and abs(rise) <= (SNAP_HEIGHT if may_snap else MAX_RISE):
        return None
    limit = "0.25 m from the wanted end" if allow_sliding else "0 to 0.25 m straight ahead"
    advice = "" if allow_sliding else " If the simulator slides along walls, say so with allow_sliding=True."
    return (
        f"ended {ahead:.3f} m ahead, {abs(aside):.3f} m aside and {rise:.3f} m up; expected {limit} and at most "
        f"{MAX_RISE} m up or down. {_BODY_ADVICE}{advice}"
    )


def _check_end(where: str, run: EpisodeRun) -> None:
    stopped = bool(run.steps) and run.steps[-1].action is Action.STOP
    at_limit = len(run.steps) == MAX_STEPS and not stopped
    reason = run.end.reason
    if (reason == "stop") != stopped or (reason == "steps") != at_limit or reason == "click":
        expected = "'stop'" if stopped else "'steps'" if at_limit else "'giveup', 'timeout', 'technical' or 'abandoned'"
        last = run.steps[-1].action.value if run.steps else None
        raise RunFileError(
            f"{where}: reason is {reason!r} after {len(run.steps)} steps, the last of which is {last!r}; expected "
            f"{expected}. Let habitat_writer fill it in: end_episode() without a reason."
        )


def _find_episode(where: str, start: EpisodeStart, dataset: PersonalDataset) -> Episode:
    """The dataset's episode that the run names, by its id or by its place in the content file, and where it starts."""
    if (start.split, start.scene) not in dataset.files:
        known = ", ".join(scene for split, scene in dataset.files if split == start.split) or "no scene"
        raise RunFileError(
            f"{where}: scene {start.scene!r} is not in split {start.split!r} of {dataset.root}; expected one of: "
            f"{known}. Give --dataset the episodes that were played."
        )
    try:
        episodes = list(dataset.episodes(splits=(start.split,), scenes=(start.scene,)))
    except DatasetError as error:
        raise RunFileError(f"{where}: its episode cannot be read: {error}") from None
    by_id = next((episode for episode in episodes if episode.key.episode_id == start.episode_id), None)
    if by_id and _start_problem(start, by_id) is None:
        return by_id
    place = int(start.episode_id) if start.episode_id.isdecimal() else len(episodes)
    if place < len(episodes) and _start_problem(start, episodes[place]) is None:
        return episodes[place]
    key = EpisodeKey(start.split, start.scene, start.episode_id)
    if by_id is None:
        raise RunFileError(
            f"{where}: found no episode {key} in {dataset.root}, and none in that place of its file that starts here; "
            "expected an id of the content file. Give --dataset the episodes that were played."
        )
    raise RunFileError(f"{where}: episode {key} {_start_problem(start, by_id)}. Reset to the episode's start pose.")


def _start_problem(start: EpisodeStart, episode: Episode) -> str | None:
    wanted = episode.start
    apart, turned = math.dist(start.position, wanted.position), abs(wrap_angle(start.yaw - wanted.yaw))
    if apart <= START_TOLERANCE and turned <= ANGLE_TOLERANCE:
        return None
    return (
        f"begins {apart:.3f} m and {math.degrees(turned):.1f} degrees from its start; expected at most "
        f"{START_TOLERANCE} m and {math.degrees(ANGLE_TOLERANCE):.1f} degrees"
    )


def _with_own_facts(run: EpisodeRun, episode: Episode) -> EpisodeRun:
    """The run without what it claims: no measures, collisions by habitat-sim's rule, the dataset's id."""
    steps = tuple(
        step.model_copy(update={"collided": step.action is Action.FORWARD and _collided(before, step)})
        for before, step in zip(run.poses, run.steps, strict=False)
    )
    start = run.start.model_copy(update={"episode_id": episode.key.episode_id})
    return EpisodeRun(start=start, steps=steps, end=EpisodeEnd(reason=run.end.reason))


def _collided(before: Pose, step: Step) -> bool:
    """Whether a forward was shortened (habitat-sim: |moved|^2 + 1e-5 < |wanted|^2)."""
    return math.dist(before.position, step.position) ** 2 + 1e-5 < FORWARD_STEP**2


def _require_some_and_no_twins(checked: Sequence[CheckedRun], files: Sequence[Path]) -> None:
    if not checked:
        names = ", ".join(str(path) for path in files) or "no file"
        raise RunFileError(
            f"{names}: found no finished episode; expected at least one. Give files of habitat_writer.py."
        )
    first: dict[EpisodeKey, str] = {}
    for run in checked:
        if run.episode.key in first:
            raise RunFileError(
                f"{run.where}: episode {run.episode.key} comes a second time (first at {first[run.episode.key]}); "
                "expected once per run. Import repeated runs one by one, each with its own --run-id."
            )
        first[run.episode.key] = run.where


def _score(checked: Sequence[CheckedRun], *, dataset: PersonalDataset, scenes_dir: Path | None) -> list[EpisodeRun]:
    """Every run with its measures, in the order given; one scene is open at a time."""
    from sim.scenes.sources import open_scene

    scored: dict[EpisodeKey, EpisodeRun] = {}
    for name in sorted({item.episode.key.scene for item in checked}):
        scene = open_scene(dataset, name, scenes_dir=scenes_dir)
        for item in checked:
            if item.episode.key.scene != name:
                continue
            check_places(item, scene.navigation)
            measures = score_run(
                item.episode,
                item.run.poses,
                stopped=item.run.end.reason == "stop",
                navigation=scene.navigation,
                collisions=sum(step.collided for step in item.run.steps),
                scene_digest=scene.digest,
            )
            end = EpisodeEnd(reason=item.run.end.reason, measures=measures)
            scored[item.episode.key] = item.run.model_copy(update={"end": end})
    return [scored[item.episode.key] for item in checked]


def _run_info(
    files: Sequence[Path], *, dataset: PersonalDataset, kind: SceneKind, who: str, run_id: str | None
) -> RunInfo:
    digest = _digest(files)
    slug = re.sub(r"[^A-Za-z0-9._-]+", "-", who).strip("-")[:60] or "run"
    try:
        return make_run_info(
            run_id or f"{slug}-{digest[:8]}",
            who=who,
            who_kind="agent",
            scene_kind=kind,
            dataset_digest=dataset.digest(),
            config={"imported": " ".join(path.name for path in files), "imported_digest": digest},
        )
    except ValidationError as error:
        advice = "Give another --run-id (letters, digits, '.', '_', '-') or --who."
        raise RunFileError(line_from_validation_error("import", error, advice=advice)) from None


def _digest(files: Sequence[Path]) -> str:
    """sha256 over the bytes of all files, in the order given."""
    total = hashlib.sha256()
    for path in files:
        try:
            total.update(path.read_bytes())
        except OSError as error:
            raise RunFileError(f"{path}: cannot be read ({error}); expected JSON lines. Check the path.") from None
    return total.hexdigest()

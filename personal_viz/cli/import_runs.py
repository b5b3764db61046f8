"""Worker of `personal-viz import`: runs of another simulator become a run folder."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.exchange.import_runs import import_runs
from sim.exchange.pose_files import MAX_ROUNDING, FreeMotion, PoseReading
from sim.frames import CameraAxes, PoseFrame
from sim.tasks.run_files import Measures, Run, read_run
from sim.tasks.step_checks import POSITION_TOLERANCE
from sim.types import MAX_STEPS

from ..study_app.checked_options import check_options, key_from_text


def import_files(
    *,
    files: tuple[Path, ...],
    dataset: Path,
    scenes_dir: Path | None,
    out: Path,
    who: str,
    run_id: str | None = None,
    allow_schematic: bool = False,
    frame: PoseFrame | None = None,
    quaternion: Literal["xyzw", "wxyz"] | None = None,
    poses: Literal["body", "camera"] = "body",
    camera_axes: CameraAxes | None = None,
    columns: str | None = None,
    rows: Literal["after-action", "before-action"] | None = None,
    stopped: Literal["yes", "no"] | None = None,
    allow_sliding: bool = False,
    episode: str | None = None,
    rounding: float = POSITION_TOLERANCE,
    motion: Literal["paper", "free"] = "paper",
    max_move: float | None = None,
    max_turn_deg: float | None = None,
    max_steps: int = MAX_STEPS,
) -> int:
    """Checks and scores files of another simulator, prints where the run was written.

    Options are those of the command line (`personal_viz.cli.options_runs.Import`); `allow_schematic` scores on
    schematic homes all the same.

    Returns:
        0; problems are raised as one-line errors.
    """
    check_options(run_id=run_id)
    free = _free_motion(motion, max_move=max_move, max_turn_deg=max_turn_deg, max_steps=max_steps)
    reading = _reading(
        frame,
        quaternion=quaternion,
        poses=poses,
        camera_axes=camera_axes,
        columns=columns,
        rows=rows,
        stopped=stopped,
        allow_sliding=allow_sliding,
        episode=episode,
        rounding=rounding,
        free=free,
    )
    folders = import_runs(
        files,
        dataset=PersonalDataset(dataset),
        scenes_dir=scenes_dir,
        out=out,
        who=who,
        run_id=run_id,
        allow_schematic=allow_schematic,
        reading=reading,
    )
    for folder in folders:
        _print_run(folder, read_run(folder), who, is_free=free is not None)
    return 0


def _reading(
    frame: PoseFrame | None,
    *,
    quaternion: Literal["xyzw", "wxyz"] | None,
    poses: Literal["body", "camera"],
    camera_axes: CameraAxes | None,
    columns: str | None,
    rows: Literal["after-action", "before-action"] | None,
    stopped: Literal["yes", "no"] | None,
    allow_sliding: bool,
    episode: str | None,
    rounding: float,
    free: FreeMotion | None,
) -> PoseReading | None:
    """How pose files are to be read; None = the files are steps files.

    Raises:
        PersonalVizError: Options of pose files stand without the frame, the rounding is no rounding, or the episode's
            name is none.
    """
    _require_rounding(rounding)
    others = (quaternion, camera_axes, columns, rows, stopped, episode, free, allow_sliding, poses == "camera")
    _require_frame(frame, others)
    if frame is None:
        return None
    return PoseReading(
        frame=frame,
        quaternion=quaternion,
        poses=poses,
        camera_axes=camera_axes,
        columns=tuple(name.strip() for name in columns.split(",")) if columns else (),
        rows=rows,
        stopped=None if stopped is None else stopped == "yes",
        allow_sliding=allow_sliding,
        episode=None if episode is None else key_from_text(episode),
        rounding=rounding,
        free=free,
    )


def _require_rounding(rounding: float) -> None:
    if not 0 < rounding <= MAX_ROUNDING:
        raise PersonalVizError(
            f"--rounding is {rounding}; expected more than 0 and at most {MAX_ROUNDING} (metres). "
            "Write positions with more decimals."
        )


def _require_frame(frame: PoseFrame | None, others: Sequence[object]) -> None:
    """Refuses other options of pose files without the frame, which they all need."""
    if frame is None and any(others):
        raise PersonalVizError(
            "--frame is missing beside other options of pose files; expected world, zup, ros, start, start-ros or gps. "
            "Give it; steps files (.jsonl) need none of these options."
        )


def _free_motion(
    motion: str, *, max_move: float | None, max_turn_deg: float | None, max_steps: int
) -> FreeMotion | None:
    """The declared bounds, None for robots of the paper.

    Raises:
        PersonalVizError: A bound is missing, no length, angle or count, or given without `--motion free`.
    """
    if motion == "paper":
        if max_move is not None or max_turn_deg is not None or max_steps != MAX_STEPS:
            raise PersonalVizError(
                "--max-move, --max-turn-deg or --max-steps stands beside --motion paper, whose steps are known; "
                "expected --motion free. Add it, or leave them out."
            )
        return None
    if max_move is None or max_turn_deg is None or not (0 < max_move <= 2 and 0 < max_turn_deg <= 180):
        raise PersonalVizError(
            f"--motion free: --max-move is {max_move} and --max-turn-deg is {max_turn_deg}; expected metres up to 2 "
            "and degrees up to 180 from row to row. Give both, such as --max-move 0.15 --max-turn-deg 9 for OneMap."
        )
    if not 1 <= max_steps <= 100_000:
        raise PersonalVizError(f"--max-steps is {max_steps}; expected 1 to 100000. Give the robot's budget.")
    return FreeMotion(max_move=max_move, max_turn_deg=max_turn_deg, max_steps=max_steps)


def _print_run(folder: Path, run: Run, who: str, *, is_free: bool) -> None:
    unreachable = sum(_is_unreachable(episode.end.measures) for episode in run.episodes)
    checked = "free motion: places and speed checked, no actions" if is_free else "every step checked"
    print(f"{folder}: {len(run.episodes)} episodes of {who!r} on {run.info.scene_kind} homes, {checked}.")
    if ignored := run.info.config.get("ignored_columns"):
        print(f"Columns that mean nothing here were left out: {ignored}.")
    if unreachable:
        print(f"{unreachable} of them have a target that cannot be reached from the start on the scene as built here.")


def _is_unreachable(measures: Measures | None) -> bool:
    rules = measures.rules.values() if measures else ()
    return any(rule is not None and rule.start_distance is None for rule in rules)

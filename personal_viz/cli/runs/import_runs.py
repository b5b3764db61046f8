"""Verb `import`: makes a run folder from another simulator's runs."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.errors import PersonalVizError
from sim.exchange.action_lists import read_action_list
from sim.exchange.episode_names import NumberedBy
from sim.exchange.import_runs import import_runs
from sim.exchange.pose_files import MAX_ROUNDING, FreeMotion, PoseReading
from sim.exchange.reported import import_reported
from sim.frames import CameraAxes, PoseFrame
from sim.tasks.run_files import REPORTED, Measures, Run, read_run
from sim.types import MAX_STEPS, SPLITS, Split

from ..options import Dataset, RunId, ScenesDir
from ..refusals import check_options


@dataclass
class Import:
    """Read runs of another simulator, check every step and compute all distances.

    Files of recordings/habitat_writer.py say themselves how to read them. Pose lists (CSV, TUM, JSON, npz) need
    --frame, and everything else that the files do not say: nothing is guessed. OneMap's poses need --numbered-by
    onemap, VLFM's positions --actions. --reported takes a program's own figures as they are; tables say so.
    """

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(help="Steps files (.jsonl), or .csv, .tsv, .tum, .json, .npz; or folders of them."),
    ]
    dataset: Dataset
    who: Annotated[str, arg(help="Row name in tables.")]
    scenes_dir: ScenesDir = None
    out: Path = Path("runs")
    run_id: RunId = None
    frame: Annotated[
        PoseFrame | None,
        arg(
            help="Frame of pose lists: world = Habitat, y up, -z ahead; zup = HM3D's files, world (x, -z, y); "
            "ros = world (-z, -x, y), as OneMap logs; start, start-ros = world, ros from the start pose; "
            "gps = (forward, right) and compass."
        ),
    ] = None
    quaternion: Annotated[
        Literal["xyzw", "wxyz"] | None, arg(help="Order of quaternions whose parts the file does not name.")
    ] = None
    poses: Annotated[
        Literal["body", "camera"], arg(help="Poses of the robot's feet, or of the camera 0.88 m above them.")
    ] = "body"
    camera_axes: Annotated[
        CameraAxes | None, arg(help="opencv: z ahead, y down; opengl: -z ahead, y up (Habitat); flu: x ahead, z up.")
    ] = None
    columns: Annotated[
        str | None, arg(help="Names of CSV columns in their order, such as x,y,z,yaw; - leaves a column out.")
    ] = None
    rows: Annotated[
        Literal["after-action", "before-action"] | None,
        arg(help="Whether a row's pose is after or before its action, where every row has one."),
    ] = None
    stopped: Annotated[
        Literal["yes", "no"] | None, arg(help="Whether the runs ended with STOP, where files do not say.")
    ] = None
    allow_sliding: Annotated[bool, arg(help="The robot slid along walls, where files do not say.")] = False
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID of the file, where neither it nor its name says.")] = None
    split: Annotated[Split | None, arg(help="The split that was played, where names of files hold none.")] = None
    numbered_by: Annotated[
        NumberedBy | None,
        arg(
            help="What numbers of episodes count: id = the dataset's ids; place = the place in the scene's file, as in "
            "habitat-lab; onemap = OneMap's running index over a split (poses_N.csv, with state/state_N.txt beside)."
        ),
    ] = None
    actions: Annotated[
        Path | None,
        arg(help="List of all actions, one a line, for files with positions only (VLFM's trajectory/N_SCENE.txt)."),
    ] = None
    reported: Annotated[
        bool, arg(help="Take the figures of VLFM's N_SCENE.json or of a table as reported; recompute nothing.")
    ] = False
    rounding: Annotated[float, arg(help="Metres by which positions are rounded, up to 0.01.")] = 0.001
    motion: Annotated[
        Literal["paper", "free"],
        arg(help="free: the robot had other actions; only --max-move, --max-turn-deg and the floor are checked."),
    ] = "paper"
    max_move: Annotated[float | None, arg(help="Metres from row to row at most, for --motion free.")] = None
    max_turn_deg: Annotated[float | None, arg(help="Degrees from row to row at most, for --motion free.")] = None
    max_steps: Annotated[int, arg(help="Step budget that the robot had, for --motion free.")] = 500

    def run(self) -> int:
        check_options(self)
        dataset = PersonalDataset(self.dataset)
        splits = SPLITS if self.split is None else (self.split,)
        if self.reported:
            self._require_no_reading()
            (folder,) = import_reported(
                self.files,
                dataset=dataset,
                out=self.out,
                who=self.who,
                run_id=self.run_id,
                numbered_by=self.numbered_by,
                splits=splits,
            )
            print(
                f"{folder}: {len(read_run(folder, with_reported=True).reported)} episodes of {self.who!r}, {REPORTED}."
            )
            return 0
        reading = self._reading(splits)
        folders = import_runs(
            self.files,
            dataset=dataset,
            scenes_dir=self.scenes_dir,
            out=self.out,
            who=self.who,
            run_id=self.run_id,
            reading=reading,
        )
        for folder in folders:
            _print_run(folder, read_run(folder), self.who, is_free=self.motion == "free")
        return 0

    def _require_no_reading(self) -> None:
        """Refuses options about poses and homes beside `--reported`, which uses none."""
        used = ("files", "dataset", "who", "out", "run_id", "split", "numbered_by", "reported")
        given = [
            each.name for each in fields(self) if each.name not in used and getattr(self, each.name) != each.default
        ]
        given += ["numbered-by onemap"] if self.numbered_by == "onemap" else []
        if given:
            raise PersonalVizError(
                f"--{given[0].replace('_', '-')}: stands beside --reported, which takes figures as they are; expected "
                "one of them. Leave --reported out to import poses and compute the figures."
            )

    def _reading(self, splits: tuple[Split, ...]) -> PoseReading | None:
        """How to read pose files; None = the files are steps files.

        Raises:
            PersonalVizError: Options of pose files are given without the frame, which all of them need, or the rounding
                or the episode's name is not valid.
        """
        free = self._free_motion()
        if not 0 < self.rounding <= MAX_ROUNDING:
            raise PersonalVizError(
                f"--rounding is {self.rounding}; expected more than 0 and at most {MAX_ROUNDING} (metres). "
                "Write positions with more decimals."
            )
        if self.actions is not None and (free is not None or self.numbered_by == "onemap"):
            other = "--motion free" if free is not None else "--numbered-by onemap"
            raise PersonalVizError(
                f"--actions stands beside {other}; expected one of them, since the list holds PersONAL's actions. "
                "Leave one out."
            )
        frame, columns, rows = self.frame, self.columns, self.rows
        if self.numbered_by == "onemap":
            frame, columns, rows = frame or "ros", columns or "x,y,z,yaw", rows or "before-action"
        elif self.actions is not None:
            frame, columns = frame or "world", columns or "step,x,y,z"
        named = (self.episode, self.split, self.numbered_by)
        others = (self.quaternion, self.camera_axes, columns, rows, self.stopped, free, *named)
        if frame is None:
            if any(others) or self.allow_sliding or self.poses == "camera":
                raise PersonalVizError(
                    "--frame is missing beside other options of pose files; expected world, zup, ros, start, start-ros "
                    "or gps. Give it; steps files (.jsonl) need none of these options."
                )
            return None
        return PoseReading(
            frame=frame,
            quaternion=self.quaternion,
            poses=self.poses,
            camera_axes=self.camera_axes,
            columns=tuple(name.strip() for name in columns.split(",")) if columns else (),
            rows=rows,
            stopped=None if self.stopped is None else self.stopped == "yes",
            allow_sliding=self.allow_sliding,
            episode=None if self.episode is None else key_from_text(self.episode, where="--episode"),
            rounding=self.rounding,
            free=free,
            numbered_by=self.numbered_by,
            splits=splits,
            actions=None if self.actions is None else read_action_list(self.actions),
        )

    def _free_motion(self) -> FreeMotion | None:
        """The declared bounds; None for robots that move as in the paper.

        Raises:
            PersonalVizError: A bound is missing or out of range, or is given without `--motion free`.
        """
        move, turn_deg = self.max_move, self.max_turn_deg
        if self.motion == "paper":
            if move is not None or turn_deg is not None or self.max_steps != MAX_STEPS:
                raise PersonalVizError(
                    "--max-move, --max-turn-deg or --max-steps stands beside --motion paper, whose steps are known; "
                    "expected --motion free. Add it, or leave them out."
                )
            return None
        if move is None or turn_deg is None or not (0 < move <= 2 and 0 < turn_deg <= 180):
            raise PersonalVizError(
                f"--motion free: --max-move is {move} and --max-turn-deg is {turn_deg}; expected metres up to 2 and "
                "degrees up to 180 from row to row. Give both, such as --max-move 0.15 --max-turn-deg 9 for OneMap."
            )
        if not 1 <= self.max_steps <= 100_000:
            raise PersonalVizError(f"--max-steps is {self.max_steps}; expected 1 to 100000. Give the robot's budget.")
        return FreeMotion(max_move=move, max_turn_deg=turn_deg, max_steps=self.max_steps)


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

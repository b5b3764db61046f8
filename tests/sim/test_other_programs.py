"""Runs as OneMap and VLFM write them: numbers instead of ids, positions without headings, and reported figures."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import sim
from sim.episodes.dataset import PersonalDataset
from sim.episodes.editions import edition_of
from sim.errors import RunFileError
from sim.exchange.action_lists import read_action_list
from sim.exchange.import_runs import check_file
from sim.exchange.pose_files import FreeMotion, PoseReading
from sim.exchange.reported import import_reported
from sim.tasks.run_files import EpisodeRun, read_run
from sim.tasks.run_folders import read_runs
from sim.types import EpisodeKey, Split

from .foreign_runs import quat, two_starts
from .synthetic import example_content, example_episode, example_goal, write_dataset

START = (1.0, 0.2, -2.0)
ONEMAP = PoseReading(
    "ros",
    columns=("x", "y", "z", "yaw"),
    rows="before-action",
    numbered_by="onemap",
    free=FreeMotion(0.15, 9.0, max_steps=4),
)
FIGURES = {"success": 1.0, "spl": 0.5, "distance_to_goal": 0.25, "num_steps": 31, "stop_called": True}


@pytest.fixture
def flat(tmp_path: Path) -> PersonalDataset:
    """Episodes 40 and 41 of easy/Flat, which start at START looking along -z and along -x."""
    return two_starts(tmp_path / "data", START, yaws_deg=(0, 90))


def trajectory(path: Path, positions: Sequence[Sequence[float]]) -> Path:
    """Positions as VLFM's trainer writes them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = (", ".join(map(str, (step, *position))) for step, position in enumerate(positions, start=1))
    path.write_text("".join(f"{row}\n" for row in rows))
    return path


def listed(path: Path, actions: Sequence[int]) -> PoseReading:
    """How to read trajectories beside a list of these actions."""
    path.write_text("".join(f"{action}\n" for action in actions))
    return PoseReading("world", columns=("step", "x", "y", "z"), actions=read_action_list(path))


def only_run(path: Path, dataset: PersonalDataset, reading: PoseReading) -> EpisodeRun:
    (checked,) = check_file(path, dataset=dataset, reading=reading)
    return checked.run


def refusal(path: Path, dataset: PersonalDataset, reading: PoseReading) -> str:
    with pytest.raises(RunFileError) as error:
        list(check_file(path, dataset=dataset, reading=reading))
    assert "\n" not in str(error.value)
    return str(error.value)


AHEAD = (1.0, 0.2, -2.25)
AT_WALL = (0.95, 0.2, -2.25 - 0.05 * math.sqrt(3))
"""0.1 m farther, 30 degrees to the left."""
WALK = [AHEAD, AHEAD, AT_WALL, AT_WALL]
"""Positions after forward, left, a forward that a wall stops, and right; then STOP."""
ACTIONS = [2, 2, 0, 1, 2, 1, 3, 0, 1, 0]
"""Those actions between two other episodes."""


@pytest.mark.parametrize("rows_after_stop", [[], [(7.0, 0.2, 3.0)]], ids=["none", "start-of-the-next-episode"])
def test_headings_follow_from_the_start_and_the_one_stretch_of_actions_that_fits(
    rows_after_stop: list[tuple[float, float, float]], flat: PersonalDataset, tmp_path: Path
) -> None:
    path = trajectory(tmp_path / "trajectory" / "40_Flat.txt", [*WALK, *rows_after_stop])
    run = only_run(path, flat, listed(tmp_path / "actions.txt", ACTIONS))
    assert run.key == EpisodeKey("easy", "Flat", "40")
    assert [step.action for step in run.steps] == ["forward", "left", "forward", "right", "stop"]
    assert [round(math.degrees(step.yaw)) for step in run.steps] == [0, 30, 30, 0, 0]
    assert [step.position for step in run.steps] == [*WALK, AT_WALL]
    assert [step.collided for step in run.steps] == [False, False, True, False, False]
    assert run.end.reason == "stop"


def test_a_number_that_is_no_id_is_the_place_in_the_file_as_habitat_lab_counts(
    flat: PersonalDataset, tmp_path: Path
) -> None:
    reading = listed(tmp_path / "actions.txt", ACTIONS)
    assert only_run(trajectory(tmp_path / "0_Flat.txt", WALK), flat, reading).key.episode_id == "40"
    assert "is not a run of easy/Flat/41" in refusal(trajectory(tmp_path / "1_Flat.txt", WALK), flat, reading)


def test_a_run_that_used_all_steps_has_500_actions_and_499_positions(flat: PersonalDataset, tmp_path: Path) -> None:
    path = trajectory(tmp_path / "40_Flat.txt", [AHEAD] + 498 * [AHEAD])
    run = only_run(path, flat, listed(tmp_path / "actions.txt", [1, *(499 * [2]), *ACTIONS]))
    assert len(run.steps) == 500
    assert run.end.reason == "steps"


def test_positions_that_no_stretch_or_several_stretches_explain_are_refused(
    flat: PersonalDataset, tmp_path: Path
) -> None:
    path = trajectory(tmp_path / "40_Flat.txt", WALK)
    assert "no stretch leads" in refusal(path, flat, listed(tmp_path / "a.txt", [1, 3, 1, 3, 0]))
    still = trajectory(tmp_path / "41_Flat.txt", [START])
    assert "2 different stretches lead" in refusal(still, flat, listed(tmp_path / "b.txt", [2, 0, 3, 0]))
    assert only_run(still, flat, listed(tmp_path / "c.txt", [2, 0, 2, 0])).steps[0].action == "left"


def test_rows_that_another_evaluation_added_are_refused_with_their_line(flat: PersonalDataset, tmp_path: Path) -> None:
    path = trajectory(tmp_path / "40_Flat.txt", WALK)
    path.write_text(path.read_text() + "30, 1.0, 0.2, -2.0\n")
    assert f"{path}:5: step is 30; expected 5" in refusal(path, flat, listed(tmp_path / "actions.txt", ACTIONS))


def test_a_list_of_actions_names_its_bad_line(tmp_path: Path) -> None:
    path = tmp_path / "actions.txt"
    path.write_text("1\n\n9\n")
    with pytest.raises(RunFileError, match=r"actions\.txt:3: action is '9'; expected 0-5"):
        read_action_list(path)
    path.write_text("\n")
    with pytest.raises(RunFileError, match="holds no action"):
        read_action_list(path)


@pytest.fixture
def split_of_three(tmp_path: Path) -> PersonalDataset:
    """As OneMap counts the easy split: Alpha/1, beta/2, beta/4; beta/3 has two targets. Episode n starts at x = n."""

    def content(scene: str, numbers: Sequence[int]) -> dict[str, Any]:
        goals = [example_goal(object_id=i, object_name=f"coffee table_{i}") for i in (7, 8)]
        episodes = [
            example_episode(
                scene=scene,
                episode_id=str(number),
                start_position=[float(number), 0.0, 3.0],
                start_rotation=quat(0),
                object_id=["coffee table_7", "coffee table_8"] if number == 3 else "coffee table_7",
                description=[["a table"], ["a desk"]] if number == 3 else ["a table", "", ""],
            )
            for number in numbers
        ]
        return example_content(
            scene=scene, episodes=episodes, goals_by_category={f"{scene}.basis.glb_coffee table": goals}
        )

    contents: dict[tuple[Split, str], Any] = {
        ("easy", "beta"): content("beta", (2, 3, 4)),
        ("easy", "Alpha"): content("Alpha", (1,)),
        ("medium", "beta"): content("beta", (5, 2)),
    }
    return PersonalDataset(write_dataset(tmp_path / "data", contents))


def onemap_run(folder: Path, number: int, x: float, *, state: str | None, rows: int = 3) -> Path:
    """Poses (-z, -x, y, yaw) before each action, which is 0.1 m ahead."""
    path = folder / "trajectories" / f"poses_{number}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{-3.0 + 0.1 * row},{-x},0.0,0.0\n" for row in range(rows)))
    if state is not None:
        (folder / "state").mkdir(exist_ok=True)
        (folder / "state" / f"state_{number}.txt").write_text(state)
    return path


def test_onemaps_numbers_count_episodes_with_one_target_over_files_sorted_regardless_of_case(
    split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    paths = [onemap_run(tmp_path / "onemap", number, x, state="1") for number, x in enumerate((1, 2, 4))]
    easy = replace(ONEMAP, splits=("easy",))
    keys = [only_run(path, split_of_three, easy).key for path in paths]
    assert [str(key) for key in keys] == ["easy/Alpha/1", "easy/beta/2", "easy/beta/4"]
    shifted = onemap_run(tmp_path / "shifted", 1, 4, state="1")
    assert "is not a run of easy/beta/2: begins 2.000 m" in refusal(shifted, split_of_three, easy)
    beyond = onemap_run(tmp_path / "beyond", 3, 4, state="1")
    assert "its name is 'poses_3.csv'" in refusal(beyond, split_of_three, easy)


def test_a_number_that_fits_two_splits_is_refused_until_the_split_is_told(
    split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    path = onemap_run(tmp_path / "onemap", 1, 2, state="1")
    assert "may be easy/beta/2 or medium/beta/2" in refusal(path, split_of_three, ONEMAP)
    told = replace(ONEMAP, splits=("medium",))
    assert str(only_run(path, split_of_three, told).key) == "medium/beta/2"


@pytest.mark.parametrize(("state", "reason"), [("1", "stop"), ("2", "stop"), ("5", "stop"), ("3", "abandoned")])
def test_onemaps_state_says_whether_the_robot_stopped(
    state: str, reason: str, split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    run = only_run(onemap_run(tmp_path / "onemap", 0, 1, state=state), split_of_three, ONEMAP)
    assert run.end.reason == reason
    assert len(run.steps) == (3 if reason == "stop" else 2)


def test_a_onemap_run_with_as_many_rows_as_steps_used_up_its_steps(
    split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    run = only_run(onemap_run(tmp_path / "onemap", 0, 1, state="4", rows=4), split_of_three, ONEMAP)
    assert run.end.reason == "steps"
    assert len(run.steps) == 4


def test_a_damaged_state_is_refused_and_a_missing_one_has_to_be_declared(
    split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    damaged = onemap_run(tmp_path / "damaged", 0, 1, state="7")
    assert "state_0.txt: found '7'; expected 1 to 6" in refusal(damaged, split_of_three, ONEMAP)
    missing = onemap_run(tmp_path / "missing", 0, 1, state=None)
    assert "--stopped yes or --stopped no" in refusal(missing, split_of_three, ONEMAP)


def vlfm_figures(folder: Path, name: str, **changes: Any) -> Path:
    """One episode's file as VLFM's `log_episode_stats` writes it, shortened."""
    folder.mkdir(exist_ok=True)
    path = folder / name
    number, scene = path.stem.split("_")
    path.write_text(json.dumps({"episode_id": number, "scene_id": scene, "failure_cause": "x", **FIGURES, **changes}))
    return path


def test_reported_figures_stand_in_metrics_under_their_own_condition(flat: PersonalDataset, tmp_path: Path) -> None:
    vlfm_figures(tmp_path / "vlfm", "40_Flat.json")
    vlfm_figures(tmp_path / "vlfm", "1_Flat.json", success=0.0, spl=0.0, distance_to_goal=math.inf)
    options = {"dataset": flat, "out": tmp_path / "runs", "who": "VLFM"}
    (folder,) = import_reported([tmp_path / "vlfm"], **options)
    assert import_reported([tmp_path / "vlfm"], **options) == [folder]
    run = read_run(folder, with_reported=True)
    assert [(str(item.key), item.success, item.dtg) for item in run.reported] == [
        ("easy/Flat/41", False, None),
        ("easy/Flat/40", True, 0.25),
    ]
    row, total = sim.metrics([folder])
    assert (row.condition, row.rule, row.scene_kind) == ("reported, not recomputed", "reported", "scan")
    assert (row.n, row.k, row.sr, row.spl, row.dtg) == (2, 1, 50.0, 25.0, 0.25)
    assert (row.paper_strict, row.far_from_view, total.split) == (None, None, "total")
    for read in (read_run, lambda folder: read_runs([folder])):
        with pytest.raises(RunFileError, match="reported, not recomputed; expected runs whose steps were checked"):
            read(folder)


def test_a_table_of_any_program_may_leave_out_all_but_success(flat: PersonalDataset, tmp_path: Path) -> None:
    path = tmp_path / "figures.csv"
    path.write_text("split,scene_id,episode_id,success,num_steps\neasy,Flat,40,1,12\neasy,Flat,41,0,\n")
    (folder,) = import_reported([path], dataset=flat, out=tmp_path / "runs", who="mine")
    row = sim.metrics([folder])[0]
    assert (row.sr, row.spl, row.dtg) == (50.0, None, None)
    assert [item.num_steps for item in read_run(folder, with_reported=True).reported] == [12, None]


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ("split,scene,episode_id\neasy,Flat,40\n", "figures.csv:2: found no success"),
        ("split,scene,episode_id,success\neasy,Flat,40\n", "figures.csv:2: found 3 cells; expected 4"),
        ("split,scene,episode_id,success\neasy,Flat,40,perhaps\n", "success is 'perhaps'; expected true or false"),
        ("split,scene,episode_id,success,spl\neasy,Flat,40,1,7\n", "figures.csv:2: spl"),
        ("split,scene,episode_id,success,spl\neasy,Flat,40,1,high\n", "spl is 'high'; expected a number"),
        ("split,scene,episode_id,success\neasy,Flat,9,1\n", "found no episode easy/Flat/9"),
        ("split,scene,episode_id,success\neasy,Flat,40,1\neasy,Flat,40,1\n", "easy/Flat/40 comes a second time"),
        ("", "found no header"),
        ("split,scene,episode_id,success\n", "figures.csv: found no episode; expected success"),
    ],
)
def test_damaged_tables_of_figures_are_refused_and_nothing_is_written(
    rows: str, found: str, flat: PersonalDataset, tmp_path: Path
) -> None:
    path = tmp_path / "figures.csv"
    path.write_text(rows)
    with pytest.raises(RunFileError) as error:
        import_reported([path], dataset=flat, out=tmp_path / "runs", who="mine")
    assert found in str(error.value)
    assert not (tmp_path / "runs").exists()


def test_a_reported_number_that_may_be_two_episodes_is_refused(split_of_three: PersonalDataset, tmp_path: Path) -> None:
    path = vlfm_figures(tmp_path / "vlfm", "2_beta.json")  # the id of a second place, and the place of a third
    options = {"dataset": split_of_three, "out": tmp_path / "runs", "who": "VLFM"}
    with pytest.raises(RunFileError, match="may be easy/beta/2 or easy/beta/4 or medium/beta/2; expected one"):
        import_reported([path], **options)
    (folder,) = import_reported([path], numbered_by="place", splits=("easy",), **options)
    assert [str(item.key) for item in read_run(folder, with_reported=True).reported] == ["easy/beta/4"]


def test_a_name_or_a_field_with_the_whole_key_leaves_no_doubt(split_of_three: PersonalDataset, tmp_path: Path) -> None:
    named = vlfm_figures(tmp_path / "vlfm", "2_beta.json").rename(tmp_path / "vlfm" / "medium-beta-2.json")
    (tmp_path / "table.csv").write_text("episode,success\neasy/beta/2,1\n")
    (folder,) = import_reported([named, tmp_path / "table.csv"], dataset=split_of_three, out=tmp_path / "runs", who="x")
    found = read_run(folder, with_reported=True).reported
    assert [str(item.key) for item in found] == ["medium/beta/2", "easy/beta/2"]


def test_a_folder_without_such_files_is_refused(flat: PersonalDataset, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunFileError, match=r"found no file \*\.json or \*\.csv"):
        import_reported([tmp_path / "empty"], dataset=flat, out=tmp_path / "runs", who="VLFM")


def test_the_authors_lists_without_episodes_of_several_targets_load_as_an_edition_of_their_own(
    split_of_three: PersonalDataset, tmp_path: Path
) -> None:
    """`test_baselines` of the authors: the content files alone, episodes with several targets removed."""
    contents = {}
    for split, scene in split_of_three.files:
        content = split_of_three.content(split, scene)
        raw = json.loads(content.model_dump_json(by_alias=True))
        raw["episodes"] = [episode for episode in raw["episodes"] if isinstance(episode["object_id"], str)]
        contents[split, scene] = raw
    baselines = PersonalDataset(write_dataset(tmp_path / "test_baselines", contents))
    assert [str(episode.key) for episode in baselines.episodes(splits=("easy",))] == [
        "easy/Alpha/1",
        "easy/beta/2",
        "easy/beta/4",
    ]
    assert edition_of(baselines.digest()) == "own"

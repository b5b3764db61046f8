"""`validate`: every row of the anomaly table finds its anomaly, and damaged files do not stop the checks."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from personal_viz.cli.validate import Validate
from sim.episodes.validate import CheckResult, Measure, ValidationReport, validate_dataset
from sim.errors import DatasetError
from sim.types import SPLITS
from tests.sim.synthetic import (
    SCENE,
    Content,
    Contents,
    example_content,
    example_episode,
    example_goal,
    example_view_point,
    write_content,
    write_dataset,
)

KEY = f"{SCENE}.basis.glb_coffee table"


def check(report: ValidationReport, row: int) -> CheckResult:
    (found,) = [check for check in report.checks if check.row == row]
    return found


def counts(measure: Measure) -> tuple[int, ...]:
    return tuple(measure.per_split[split] for split in SPLITS)


def count_of(tmp_path: Path, row: int, contents: Contents) -> int:
    return check(validate_dataset(write_dataset(tmp_path, contents)), row).measure.count


def easy(**changes: Any) -> Contents:
    """A dataset of one easy episode with changed fields."""
    return {("easy", SCENE): example_content(episodes=[example_episode(**changes)])}


def easy_goals(*goals: Content, **changes: Any) -> Contents:
    """A dataset of one easy episode with these goals."""
    return {
        ("easy", SCENE): example_content(goals_by_category={KEY: list(goals)}, episodes=[example_episode(**changes)])
    }


def name(number: int) -> str:
    return f"coffee table_{number}"


def two_episodes(*episodes: Content) -> Contents:
    return {("easy", SCENE): example_content(episodes=list(episodes))}


def info(*, geodesic: float = 3.25, euclidean: float = 4.0) -> Content:
    return {"geodesic_distance": geodesic, "euclidean_distance": euclidean, "closest_goal_object_id": 7}


def sentences(*texts: str) -> Contents:
    return easy(extracted_summary=[*texts, "Bo owns a desk in the study"])


def goal_with_points(*points: Content) -> Content:
    return example_goal(view_points=[*example_goal()["view_points"], *points])


EXTRA = example_view_point(2.0, -0.5, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=None)
UPSTAIRS = example_view_point(2.0, -0.5, y=3.0, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=None)
FAR = example_view_point(2.0, 1.5, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=0.1)
BLIND = [{key: value for key, value in point.items() if key != "iou"} for point in example_goal()["view_points"]]
SECOND = example_goal(object_name="coffee table_8", object_id=8)
HIGH = [
    example_goal(
        object_name=name(number),
        object_id=number,
        floor_id=label,
        view_points=[example_view_point(2.0, 0.0, y=y, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=0.5)],
    )
    for number, label, y in ((10, "0", 0.0), (11, "0", 0.1), (12, "1", 3.0), (13, "1", 3.1), (14, "0", 3.0))
]
TWINS = ("Ada owns a coffee table in the den", "Cy owns the coffee table in the den")
OTHER_STORY = example_episode(
    episode_id="4", owner="Cy", summary="Cy owns it.", extracted_summary=["Cy owns a low oak coffee table in the den"]
)


def two_splits(**hard: Any) -> Contents:
    return {("easy", SCENE): example_content(), ("hard", SCENE): {**example_content(), **hard}}


# Row, a dataset with its anomaly, and the count that it finds; in the plain example the count is `PLAIN.get(row, 0)`.
CASES: list[tuple[int, Contents, int]] = [
    (1, two_splits(), 2),
    (3, easy(object_id="coffee table_70"), 1),
    (3, easy(object_category="sofa"), 1),
    (3, easy_goals(example_goal(), example_goal()), 1),
    (4, easy_goals(example_goal(view_points=[])), 1),
    (5, easy_goals(example_goal(view_points=BLIND)), 1),
    (6, easy_goals(example_goal(), SECOND), 1),
    (7, easy_goals(example_goal(), SECOND), 1),
    (9, easy_goals(example_goal(), SECOND, object_id=[name(7), name(8)], description=[["a"], ["b"]]), 1),
    (10, easy_goals(example_goal(object_name="low table_7"), object_id="low table_7"), 1),
    (11, easy(description=["", "a table", ""]), 1),
    (12, easy(description=["NOTA: non lo vedo", "", ""]), 1),
    (12, easy(description=["a low oak table. Nota: the door was shut", "", ""]), 1),
    (13, easy(description=["low oak coffee table", "", ""]), 1),
    (14, easy(owner="Cy", summary="Ada owns the table.", extracted_summary=["Cy owns a table in the den"]), 1),
    (14, easy(owner="Cy", summary="Cy is here.", extracted_summary=["Ada owns a table in the den"]), 1),
    (15, easy(summary="Ada owns the table, <person2> a desk, Bo another."), 1),
    (15, sentences("Ada owns a low oak coffee table in the lounge", "person3 owns a rug in the hall"), 1),
    (16, two_episodes(example_episode(summary="Ada, Bo and Cy."), OTHER_STORY), 1),
    (17, easy(owner="Bo", description=["low oak coffee table", "", ""],
              extracted_summary=["Ada owns a low oak coffee table in the lounge", "Bo owns a desk in the study"]), 1),
    (18, sentences(*["Ada owns a low oak coffee table in the lounge"] * 2), 1),
    (19, sentences(*TWINS), 1),
    (19, {("hard", SCENE): sentences(*TWINS)[("easy", SCENE)]}, 0),
    (20, sentences("Ada owns a low oak plank on legs in the lounge"), 1),
    (21, sentences("Ada owns a coffee table in the den", "Ada owns two coffee tables near a sofa in the hall"), 1),
    (22, sentences("Ada owns a coffee table in the lounge."), 1),
    (23, sentences("Ada owns a coffee table in the lounge, by the door"), 1),
    (24, sentences("Ada owns a coffee table on the Floor in the lounge"), 1),
    (25, easy(query=["Find Ada's coffee table"]), 1),
    (25, easy(query=[text.replace("coffee table", "sofa") for text in example_episode()["query"]]), 1),
    (26, {("easy", SCENE): example_content(), ("easy", "Other"): example_content(scene="Other")}, 2),
    (27, easy(extracted_summary=["Ada owns a coffee table in the den", "Adam owns a rug in the hall"]), 1),
    (28, easy(summary="Ada’s table, and Bo."), 1),
    (29, easy(info=info(euclidean=4.0001)), 1),
    (30, easy(info=info(geodesic=4.0)), 0),
    (31, easy(info=info(geodesic=3.24)), 1),
    (32, easy(info=info(geodesic=4.1)), 1),
    (33, easy(start_rotation=[0.0, 0.0, 0.0, 1.0]), 0),
    (34, easy_goals(goal_with_points(UPSTAIRS)), 1),
    (35, easy_goals(goal_with_points(UPSTAIRS, UPSTAIRS)), 2),
    (36, easy_goals(example_goal(view_points=[*example_goal()["view_points"][:2], EXTRA])), 0),
    (37, easy_goals(goal_with_points(FAR)), 1),
    (38, easy(start_position=[2.0, 0.0, -0.1]), 1),
    (39, easy(start_position=[2.0, 0.0, 0.7]), 1),
    (40, easy_goals(example_goal(), *HIGH), 1),
    (41, easy_goals(goal_with_points({**FAR, "iou": 1.2})), 1),
    (42, two_splits(category_to_task_category_id={"coffee table": 4}), 1),
    (43, two_splits(), 1),
    (44, two_episodes(example_episode(), example_episode(episode_id="4", owner="Eve")), 1),
    (46, easy_goals(example_goal(radius=0.5)), 5),
    (47, easy_goals(example_goal(), example_goal(object_name="coffee table_8", room_name="lounge")), 1),
]  # fmt: skip
PLAIN = {1: 1, 30: 1, 33: 1, 36: 1, 46: 6}


@pytest.mark.parametrize(
    ("row", "contents", "expected"), CASES, ids=[f"row{case[0]}-{i}" for i, case in enumerate(CASES)]
)
def test_a_row_finds_its_anomaly(tmp_path: Path, row: int, contents: Contents, expected: int) -> None:
    assert count_of(tmp_path, row, contents) == expected


def test_the_plain_example_has_only_known_notes_and_the_report_has_one_check_per_row(tmp_path: Path) -> None:
    report = validate_dataset(write_dataset(tmp_path))
    assert report.num_errors == 0
    assert report.problems == ()
    assert {check.row: check.measure.count for check in report.checks if check.measure.count} == PLAIN
    assert [check.row for check in report.checks] == list(range(1, 48))
    slugs = [check.measure.slug for check in report.checks]
    assert len(set(slugs)) == 47
    assert all(slug == slug.lower() and " " not in slug and "_" not in slug for slug in slugs)


def test_names_and_counts_per_split_show_where_an_anomaly_is(tmp_path: Path) -> None:
    content = sentences("Ada owns a coffee table in the lounge.", "Cy owns a rug. it is red. in the hall.")[
        ("easy", SCENE)
    ]
    found = check(validate_dataset(write_dataset(tmp_path, {("medium", SCENE): content})), 22)
    assert found.measure.names == ("medium/Zz0ExampleZ/3",)
    assert counts(found.measure) == (0, 2, 0)
    assert found.measure.population == {"easy": 0, "medium": 3, "hard": 0}
    assert [(also.slug, counts(also)) for also in found.also] == [("sentence-period-inside", (0, 1, 0))]


def test_an_object_in_two_splits_counts_once_in_the_total(tmp_path: Path) -> None:
    content = easy(description=["a table", "", ""])[("easy", SCENE)]
    found = check(validate_dataset(write_dataset(tmp_path, {("easy", SCENE): content, ("hard", SCENE): content})), 13)
    assert (found.measure.count, counts(found.measure)) == (1, (1, 0, 1))
    assert found.measure.names == ("Zz0ExampleZ/coffee table_7",)


@pytest.mark.parametrize(
    ("content", "relation"), [(example_content(), "same"), (example_content(episodes=[]), "OTHER")]
)
def test_a_plain_twin_is_reported_as_same_or_other_content(tmp_path: Path, content: Content, relation: str) -> None:
    write_dataset(tmp_path)
    write_content(tmp_path, "easy", content, plain=True)
    found = check(validate_dataset(tmp_path), 45)
    assert found.measure.names == (f"easy/content/{SCENE}.json ({relation} content)",)


def broken(text: str) -> Callable[[Path], int]:
    return lambda path: path.write_bytes(gzip.compress(text.encode()))


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-30]), "cannot be read"),
        (lambda path: path.write_bytes(b"plain text"), "cannot be read"),
        (broken('{"episodes": ['), "text that is not JSON"),
        (broken("[]"), "(top level) is []"),
        (broken("[" * 100_000), "text that is not JSON"),
        (broken(json.dumps(example_content()).replace('"owner": "Ada"', '"owner": 5')), "episodes.0.owner is 5"),
        (broken(json.dumps(example_content()).replace('"owner": "Ada", ', "")), "episodes.0.owner is nothing"),
        (broken(json.dumps(example_content()).replace("3.25", "1" + "0" * 400)), "info.geodesic_distance is 1000"),
        (broken(json.dumps(example_content()).replace("-0.25", "1e300")), "agent_state.position.2 is 1e+300"),
        (broken(json.dumps(example_content()).replace("[0.0, 1.0, 0.0, 0.0]", "[0, 0, 0, 0]")), "its norm is 0, not 1"),
        (broken(json.dumps(example_content()).replace('"episode_id": "3"', '"episode_id": "3 a"')), "id is '3 a'"),
        (broken(json.dumps(example_content()).replace('"Find Ada\'s coffee table"', '""')), "episodes.0.query.0 is ''"),
    ],
)
def test_a_damaged_file_is_an_error_and_the_rest_is_still_checked(
    tmp_path: Path, damage: Callable[[Path], int], expected: str
) -> None:
    write_dataset(tmp_path, {("easy", SCENE): example_content(), ("hard", "Other"): example_content(scene="Other")})
    path = tmp_path / "easy" / "content" / f"{SCENE}.json.gz"
    damage(path)
    report = validate_dataset(tmp_path)
    assert report.num_episodes == {"easy": 0, "medium": 0, "hard": 1}
    assert check(report, 2).measure.names == (f"easy/content/{SCENE}.json.gz",)
    assert check(report, 33).measure.names == ("hard/Other/3",)
    (line,) = report.problems
    assert line.startswith(f"{path}: ")
    assert expected in line
    assert "\n" not in line
    assert len(line) < len(str(path)) + 300
    assert report.num_errors == 1


def test_a_file_with_a_wrong_scene_name_is_an_error(tmp_path: Path) -> None:
    write_content(tmp_path, "easy", example_content(), scene="Zz0 copy")
    report = validate_dataset(tmp_path)
    assert check(report, 2).measure.names == ("easy/content/Zz0 copy.json.gz",)
    assert "the scene's name is 'Zz0 copy'" in report.problems[0]


def test_a_start_far_from_every_view_point_is_a_defect_with_any_stored_distance(tmp_path: Path) -> None:
    contents = easy(start_position=[2.0, 0.0, 500.0], info=info(geodesic=3.9, euclidean=501.0))
    found = check(validate_dataset(write_dataset(tmp_path, contents)), 32)
    assert found.level == "defect"
    assert [(also.slug, also.count, also.names) for also in found.also] == [
        ("start-beyond-limits", 1, ("easy/Zz0ExampleZ/3",))
    ]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("number", [0.0, -1.0, 1e4, 1e308])
def test_extreme_numbers_raise_no_warning(tmp_path: Path, number: float) -> None:
    content = json.dumps(example_content())
    for value in ("0.41", "3.25", "4.0", "2.0", "-0.25", "0.45"):
        write_content(tmp_path, "easy", content.replace(value, repr(number)))
        is_refused = number == 1e308 and value != "0.41"
        assert bool(validate_dataset(tmp_path).num_errors) == is_refused


def test_a_wrong_ownership_sentence_does_not_stop_the_checks(tmp_path: Path) -> None:
    found = validate_dataset(write_dataset(tmp_path, sentences("Ada has " + "x" * 500, "Cy owns .")))
    assert check(found, 2).measure.count == 2
    assert all(len(line) < len(str(tmp_path)) + 250 for line in found.problems)


def test_every_problem_of_a_file_is_listed(tmp_path: Path) -> None:
    episodes = [example_episode(owner=5), example_episode(episode_id=7, summary="")]
    write_content(tmp_path, "easy", example_content(episodes=episodes))
    problems = validate_dataset(tmp_path).problems
    assert [line.split(": ")[1].split(" is ")[0] for line in problems] == [
        "episodes.0.owner",
        "episodes.1.episode_id",
        "episodes.1.summary",
    ]


def test_numbers_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    text = json.dumps(example_content()).replace("0.41", "NaN").replace("3.25", "1e999")
    write_content(tmp_path, "easy", text)
    report = validate_dataset(tmp_path)
    assert check(report, 8).measure.count == 2
    assert check(report, 2).measure.count == 2


@pytest.mark.parametrize(
    ("episodes", "expected"),
    [
        ([example_episode(scene="Other")], "episodes.0.scene_id is 'hm3d_v0.2/val/00000-Other/Other.basis.glb'"),
        ([example_episode(), example_episode()], "episodes.1.episode_id is '3', as in episodes.0"),
        ([example_episode(extracted_summary=["Ada has a rug"])], "episodes.0.extracted_summary.0 is 'Ada has a rug'"),
    ],
)
def test_mistakes_that_the_schema_cannot_see_are_errors(tmp_path: Path, episodes: list[Content], expected: str) -> None:
    report = validate_dataset(write_dataset(tmp_path, {("easy", SCENE): example_content(episodes=episodes)}))
    assert check(report, 2).measure.count == 1
    assert expected in report.problems[0]


@pytest.mark.parametrize(
    "data",
    [b"?", gzip.compress(b"{", mtime=0), gzip.compress(b"[]", mtime=0), gzip.compress(b'{"episodes": [1]}', mtime=0)],
)
def test_a_damaged_index_is_an_error(tmp_path: Path, data: bytes) -> None:
    write_dataset(tmp_path)
    (tmp_path / "easy" / "easy.json.gz").write_bytes(data)
    report = validate_dataset(tmp_path)
    assert check(report, 2).measure.names == ("easy/easy.json.gz",)
    assert report.num_episodes["easy"] == 1


def test_an_unresolved_target_is_named_with_its_reason(tmp_path: Path) -> None:
    report = validate_dataset(write_dataset(tmp_path, easy(object_id="coffee table_70")))
    assert check(report, 3).measure.names == ("easy/Zz0ExampleZ/3",)
    assert "episodes.0: object_id ['coffee table_70'] resolves to []" in report.problems[0]


def test_a_folder_without_episodes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="found no episode file"):
        Validate(dataset=tmp_path, json=False).run()


def test_the_command_prints_a_table_or_one_json_document_and_exits_1_on_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Validate(dataset=write_dataset(tmp_path), json=False).run() == 0
    text = capsys.readouterr().out
    assert "1 episodes (easy 1, medium 0, hard 0)" in text
    assert "start-looks-away" in text
    assert "0 errors" in text
    assert Validate(dataset=write_dataset(tmp_path, easy(owner=5)), json=False).run() == 1
    assert "episodes.0.owner is 5; expected: Input should be a valid string" in capsys.readouterr().out
    assert Validate(dataset=write_dataset(tmp_path, easy(object_id="coffee table_70")), json=True).run() == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["episodes"], document["per_split"]) == (1, {"easy": 1, "medium": 0, "hard": 0})
    assert document["errors"] == 1
    assert len(document["checks"]) == 47
    third = document["checks"][2]
    assert {key: third[key] for key in ("row", "slug", "level", "count", "per_split", "episodes")} == {
        "row": 3,
        "slug": "target-not-resolved",
        "level": "error",
        "count": 1,
        "per_split": {"easy": 1, "medium": 0, "hard": 0},
        "episodes": ["easy/Zz0ExampleZ/3"],
    }

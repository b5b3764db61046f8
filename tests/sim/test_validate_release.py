"""`validate` on the released episodes: the counts of DATA_FORMAT.md section 8 and the ids of anomaly_ids.json."""

import json
from pathlib import Path

import pytest

from personal_viz.cli.validate import Validate
from sim.episodes.validate import CheckResult, Measure, ValidationReport, validate_dataset
from sim.types import SPLITS

pytestmark = pytest.mark.release

PER_SPLIT = dict.fromkeys((2, 3, 4, 8, 11, 14, 15, 25, 26, 29, 32, 44, 47), (0, 0, 0)) | {
    1: (600, 700, 700), 5: (0, 2, 1), 6: (293, 358, 377), 7: (65, 191, 601), 9: (0, 15, 20), 10: (27, 26, 32),
    12: (0, 0, 2), 16: (0, 0, 1), 17: (0, 0, 1), 18: (0, 0, 2), 19: (2, 0, 0), 20: (14, 26, 41), 21: (0, 12, 11),
    22: (753, 0, 0), 23: (15, 20, 27), 24: (10, 48, 63), 27: (5, 0, 7), 28: (26, 111, 108), 30: (341, 253, 185),
    31: (9, 3, 0), 33: (600, 700, 700), 34: (318, 352, 369), 35: (2124, 2963, 7125), 38: (5, 3, 0), 39: (141, 24, 12),
    45: (0, 1, 0),
}  # fmt: skip
# Further measurements of a row.
ALSO = {
    "sentence-period-inside": (118, 313, 2186),
    "sentence-without-room": (6, 14, 24),
    "query-naive-plural": (0, 15, 20),
    "start-beyond-limits": (0, 0, 0),
    "goal-with-such-view-point": (251, 349, 577),
    "start-near-view-point-of-any-target": (141, 27, 13),
}
# Row: count over all splits, for rows without counts per split in the table.
TOTAL = {13: 4, 40: 10, 41: 2327, 42: 92, 43: 2}
# Row: key of anomaly_ids.json.
IDS = {
    5: "target has no original (iou) view point",
    6: "goal key holds extra same-category instances that are not targets",
    9: "object_id is list",
    10: "object_id prefix != object_category",
    16: "name in summary but owns nothing in extracted",
    17: "owner does not own the target in the text",
    18: "duplicate sentence in one extracted_summary (episodes)",
    19: "two objects one sentence",
    20: "no extracted sentence of the owner mentions the category word",
    21: "single-target query but owner has >=2 sentences whose head mentions the category",
    22: "extracted sentence ends with period",
    23: 'extracted sentence lacks "in [the] room" tail',
    24: "extracted sentence mentions floor",
    27: "owner name is prefix of another owner name (episodes)",
    28: "summary non-ascii",
}


@pytest.fixture(scope="module")
def report(dataset_root: Path) -> ValidationReport:
    return validate_dataset(dataset_root)


@pytest.fixture(scope="module")
def anomaly_ids(dataset_root: Path) -> dict[str, list[str]]:
    return json.loads((dataset_root.parent / "anomaly_ids.json").read_text())


def check(report: ValidationReport, row: int) -> CheckResult:
    return report.checks[row - 1]


def counts(measure: Measure) -> tuple[int, ...]:
    return tuple(measure.per_split[split] for split in SPLITS)


@pytest.mark.parametrize("row", PER_SPLIT)
def test_counts_per_split_equal_the_table(report: ValidationReport, row: int) -> None:
    found = check(report, row)
    assert found.row == row
    assert counts(found.measure) == PER_SPLIT[row]
    assert found.measure.count == sum(PER_SPLIT[row])


@pytest.mark.parametrize("slug", ALSO)
def test_further_counts_equal_the_table(report: ValidationReport, slug: str) -> None:
    (found,) = [measure for result in report.checks for measure in result.also if measure.slug == slug]
    assert counts(found) == ALSO[slug]


@pytest.mark.parametrize("row", TOTAL)
def test_total_counts_equal_the_table(report: ValidationReport, row: int) -> None:
    assert check(report, row).measure.count == TOTAL[row]


@pytest.mark.parametrize("row", IDS)
def test_found_episodes_equal_the_anomaly_list(
    report: ValidationReport, anomaly_ids: dict[str, list[str]], row: int
) -> None:
    assert sorted(check(report, row).measure.names) == sorted(anomaly_ids[IDS[row]])


def test_shares_of_view_points_equal_the_table(report: ValidationReport) -> None:
    def percent(measure: Measure) -> list[float]:
        assert measure.population is not None
        return [round(100 * measure.per_split[split] / measure.population[split], 1) for split in SPLITS]

    assert percent(check(report, 36).measure) == [93.8, 93.8, 93.9]
    assert percent(check(report, 37).measure) == [30.3, 27.9, 28.7]
    assert percent(check(report, 37).also[0]) == [69.3, 68.7, 68.2]


def test_populations_have_the_documented_sizes(report: ValidationReport) -> None:
    expected = {
        7: (473, 688, 1118),
        22: (2363, 3999, 10511),
        35: (5670, 8265, 20115),
        37: (18745, 27054, 48882),
        41: (13075, 18789, 28767),
    }
    for row, population in expected.items():
        assert tuple((check(report, row).measure.population or {}).values()) == population


def test_known_cases_are_found_and_ids_occur_in_several_splits(report: ValidationReport) -> None:
    assert set(check(report, 12).measure.names) == {"hard/MHPLjHsuG27/1467", "hard/q3zU7Yy5E5s/515"}
    assert check(report, 45).measure.names == ("medium/content/4ok3usBNeis.json (same content)",)
    assert "DYehNKdT76V/shower dial_118" in check(report, 13).measure.names
    wrong_storey = set(check(report, 40).measure.names)
    assert {"y9hTuugGdiq/bathtub_414", "y9hTuugGdiq/mirror_358", "XB4GS9ShBRE/stairs railing_200"} <= wrong_storey
    assert {"radius", "room_id", "room_name", "start_room"} <= set(check(report, 46).measure.names)
    assert [(measure.slug, measure.count) for measure in check(report, 26).also] == [
        ("episode-id-in-several-splits", 426)
    ]


def test_released_episodes_have_no_error(
    report: ValidationReport, dataset_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report.num_errors == 0
    assert report.problems == ()
    assert Validate(dataset=dataset_root, json=True).run() == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["episodes"], document["errors"]) == (2000, 0)
    assert document["per_split"] == {"easy": 600, "medium": 700, "hard": 700}

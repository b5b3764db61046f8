"""The POG table: separate rows and tables, figures computed by hand, differences, curves, refusals."""

import numpy as np
import pytest

from grounding.report.rows import RADII, method_trials
from grounding.report.table import PAPER_POG, TOTAL, PogReport, PogRow, PogTable, pog_report
from sim.errors import RunFileError
from sim.types import EpisodeKey

from .pog_runs import answer_to, keys, run_of

EASY, HARD = keys("easy", 6, 2), keys("hard", 6, 1)


def answers(right: int) -> list:
    """Answers 0.4 m off in the first `right` easy episodes, 1.6 m in the others, on another storey in hard ones."""
    easy = [answer_to(key, 0.4 if index < right else 1.6, top3=True) for index, key in enumerate(EASY)]
    return easy + [answer_to(key, None) for key in HARD]


def only(report: PogReport) -> PogTable:
    (table,) = report.tables
    return table


def row(table: PogTable, name: str) -> PogRow:
    return next(item for item in table.rows if item.name == name)


@pytest.fixture(scope="module")
def table() -> PogTable:
    return only(pog_report([run_of("rpg", answers(9), config={"phrases": "dataset"}), run_of("qs", answers(6))]))


def test_splits_and_their_plain_mean_equal_those_computed_by_hand_and_stand_beside_the_papers(table: PogTable) -> None:
    assert [item.name for item in table.rows] == ["qs", "rpg (phrases dataset)"]
    assert row(table, "qs").paper == (15.4, 12.7, 8.6, 11.9) == PAPER_POG["qs"]
    assert row(table, "qs").commits == ("abc",)
    cells = {cell.split: cell for cell in row(table, "qs").cells}
    assert list(cells) == ["easy", "hard", TOTAL]
    assert (cells["easy"].k, cells["easy"].n, cells["easy"].sr) == (6, 12, 50.0)
    assert (cells["hard"].k, cells["hard"].n, cells["hard"].sr) == (0, 6, 0.0)
    assert (cells[TOTAL].k, cells[TOTAL].n, cells[TOTAL].sr) == (6, 18, 25.0)
    assert cells["easy"].top3 == 100.0
    assert cells[TOTAL].top3 == 50.0
    assert cells["easy"].by_episode == pytest.approx((25.4, 74.6), abs=0.1)
    assert cells["hard"].by_home is None
    assert cells["easy"].by_home is not None
    assert cells["easy"].num_homes == 6


def test_the_curve_rises_at_the_distances_of_answers_and_top3_needs_those_of_three_candidates(table: PogTable) -> None:
    curve = {point.metres: point.sr for point in row(table, "qs").curve}
    assert len(curve) == 41
    assert (curve[0.0], curve[0.25], curve[0.5], curve[1.0], curve[1.5], curve[1.75]) == (0, 0, 25, 25, 25, 50)
    assert curve[10.0] == 50
    assert {point.top3 for point in row(table, "qs").curve} == {None}
    resumed = [answer_to(EASY[0], 0.4, others=(2.0,)), answer_to(EASY[1], 0.4)]
    assert row(only(pog_report([run_of("qs", resumed)])), "qs").curve[-1].top3 is None
    clicks = [answer_to(EASY[0], 0.4, others=(), participant="P01")]
    people = run_of("human", clicks, config={}, who_kind="human", scene_kind="invented", seed=None)
    assert only(pog_report([people])).rows[0].curve[-1].top3 is None


def test_the_curve_of_three_candidates_uses_the_nearest_and_equals_top3_at_one_metre() -> None:
    shown = [
        answer_to(EASY[0], 3.0, others=(0.4, 7.0), top3=True),
        answer_to(EASY[1], 2.0, others=(None, 8.0)),
        answer_to(EASY[2], None, others=(9.0, 6.0)),
        answer_to(EASY[3], 0.2, others=()),
    ]
    found = row(only(pog_report([run_of("qs", shown)])), "qs")
    curve = {point.metres: point.top3 for point in found.curve}
    assert (curve[0.25], curve[0.5], curve[1.0], curve[2.0], curve[5.75], curve[6.0]) == (25, 50, 50, 75, 75, 100)
    assert curve[1.0] == found.cells[-1].top3
    assert [point.sr for point in found.curve if point.metres in (1.0, 3.0, 10.0)] == [25, 75, 75]


def test_the_curve_of_three_candidates_has_intervals_by_home() -> None:
    shown = [answer_to(key, 5.0, others=(0.5 if index % 3 else 4.0,)) for index, key in enumerate(EASY)]
    points = {point.metres: point for point in row(only(pog_report([run_of("qs", shown)])), "qs").curve}
    interval = points[1.0].top3_by_home
    assert interval is not None
    assert interval.low < points[1.0].top3 < interval.high
    assert points[1.0].by_home is None, "no first candidate is within 1 m in any home"


def test_differences_are_paired_on_common_episodes(table: PogTable) -> None:
    (difference,) = table.differences
    assert (difference.first, difference.second, difference.n) == ("rpg (phrases dataset)", "qs", 18)
    assert difference.first_minus_second == pytest.approx(100 * (3 / 12) / 2)
    assert (difference.only_first, difference.only_second) == (3, 0)
    assert difference.by_home is not None
    assert difference.by_home.low >= 0
    part = run_of("qs", answers(6)[:4])
    (difference,) = only(pog_report([run_of("rpg", answers(9)), part])).differences
    assert difference.n == 4
    assert difference.first_minus_second == 0.0


def test_answers_by_rules_are_counted_seeds_averaged_and_missing_defaults_need_no_other_table() -> None:
    shown = answers(9)
    shown[0] = shown[0].model_copy(update={"fell_back": True})
    assert row(only(pog_report([run_of("rpg", shown)])), "rpg").num_fallbacks == 1
    runs = [run_of("random", answers(12), seed=0), run_of("random", answers(0), seed=1)]
    found = row(only(pog_report(runs)), "random")
    assert found.seeds == (0, 1)
    assert found.num_trials == 36
    cells = {cell.split: cell for cell in found.cells}
    assert (cells["easy"].n, cells["easy"].k, cells["easy"].sr) == (12, 6.0, 50.0)
    newer = run_of("rpg", answers(9), config={"cell_noise": 0.0, "layout": "grid", "features": "patches"})
    assert len(only(pog_report([run_of("qs", answers(6)), newer])).rows) == 2


def test_kinds_of_homes_encoders_and_noise_never_share_a_table() -> None:
    explored = {"map": "explore"}
    runs = [
        run_of("qs", answers(6)),
        run_of("qs", answers(6), config={"encoder": "minilm"}),
        run_of("qs", answers(6), config={"cell_noise": 0.1}),
        run_of("qs", answers(6), config={"all_storeys": True}),
        run_of("qs", answers(6), config=explored, scene_kind="schematic"),
        run_of("qs", answers(6), config=explored, scene_kind="invented", dataset_digest="e"),
    ]
    report = pog_report(runs)
    assert [len(table.rows) for table in report.tables] == [1] * 6
    assert [table.scene_kind for table in report.tables] == ["oracle-map"] * 4 + ["schematic", "invented"]
    assert len({table.title for table in report.tables}) == 6
    assert not [table for table in report.tables if table.differences]


def test_an_object_map_is_a_row_beside_the_grid_map_of_the_same_homes() -> None:
    explored = {"map": "explore"}
    runs = [
        run_of("rpg", answers(3), config=explored, scene_kind="invented"),
        run_of("object-phrase", answers(9), config=explored | {"layout": "objects"}, scene_kind="invented"),
    ]
    assert [item.name for item in only(pog_report(runs)).rows] == ["rpg", "object-phrase (objects)"]


def test_people_are_listed_only_beside_maps_of_their_kind_of_homes() -> None:
    clicks = [answer_to(key, 0.2, participant=code) for key in EASY for code in ("P01", "P02")]
    people = run_of("human", clicks, config={}, who_kind="human", scene_kind="invented", seed=None)
    explored = run_of("rpg", answers(3), config={"map": "explore"}, scene_kind="invented")
    report = pog_report([people, explored, run_of("qs", answers(6))])
    by_kind = {table.scene_kind: [item.name for item in table.rows] for table in report.tables}
    assert by_kind == {"oracle-map": ["qs"], "invented": ["rpg", "human"]}
    human = report.tables[1].rows[1]
    assert human.num_trials == 24
    assert human.cells[0].n == 12
    assert human.cells[0].top3 is None
    assert human.paper == PAPER_POG["human"]
    alone = only(pog_report([people]))
    assert alone.title == "People in invented homes (not HM3D)"


def test_a_curve_over_an_option_needs_runs_that_differ_only_in_it() -> None:
    runs = [
        run_of("qs", answers(right), config={"cell_noise": noise}) for noise, right in ((0.0, 12), (0.1, 6), (0.2, 0))
    ]
    other = run_of("qs", answers(3), config={"cell_noise": 0.1, "blur": 1.0, "encoder": "minilm"})
    (curve,) = pog_report([*runs, other]).curves
    assert (curve.knob, curve.name, curve.dataset_digest) == ("cell_noise", "qs", "d")
    assert [(point.n, point.num_homes, point.top3) for point in curve.points] == [(18, 6, 50.0)] * 3
    assert curve.points[1].by_home is not None
    assert "cell noise 0.1" in curve.points[1].table
    assert [(point.value, point.sr) for point in curve.points] == [(0.0, 50.0), (0.1, 25.0), (0.2, 0.0)]


def test_explored_maps_of_oracle_perception_say_so_and_kinds_of_homes_have_separate_curves() -> None:
    runs = [
        run_of(
            who, answers(right), config={"map": "explore", "paraphrase": level}, scene_kind=kind, dataset_digest=kind
        )
        for kind in ("schematic", "invented")
        for level, right in ((0, 12), (3, 3))
        for who in ("qs", "rpg")
    ]
    report = pog_report(runs)
    assert {(curve.title, curve.name) for curve in report.curves} == {
        (f"Maps explored in {kind} homes (not HM3D), oracle perception (hashed words), storey given", who)
        for kind in ("schematic", "invented")
        for who in ("qs", "rpg")
    }
    assert [(point.value, point.sr) for point in report.curves[0].points] == [(0.0, 50.0), (3.0, 12.5)]
    assert {point.table for curve in report.curves for point in curve.points} == {t.title for t in report.tables}


def test_a_trial_that_occurs_twice_is_refused() -> None:
    with pytest.raises(RunFileError, match="a second time"):
        pog_report([run_of("qs", answers(6)), run_of("qs", answers(6), run_id="again")])


def test_unscored_answers_and_runs_without_answers_are_refused_and_technical_failures_left_out() -> None:
    whole = answers(6)
    unscored = whole[0].model_copy(update={"measures": None})
    with pytest.raises(RunFileError, match="holds no measures for easy/Home0/0"):
        pog_report([run_of("qs", [unscored])])
    technical = unscored.model_copy(update={"reason": "technical"})
    assert row(only(pog_report([run_of("qs", [technical, *whole[1:]])])), "qs").cells[0].n == 11
    with pytest.raises(RunFileError, match="holds no POG answer"):
        pog_report([run_of("qs", [])])


def test_the_report_is_always_the_same_with_episodes_in_order_of_their_numbers() -> None:
    runs = [run_of("rpg", answers(9)), run_of("qs", answers(6))]
    assert pog_report(runs).model_dump_json() == pog_report(runs[::-1]).model_dump_json()
    shuffled = [answer_to(EpisodeKey("easy", "Home0", name), 0.5) for name in ("10", "9", "2")]
    (trials,) = method_trials([run_of("qs", shuffled)])
    assert [key.episode_id for key in trials.keys] == ["2", "9", "10"]
    assert trials.within[0].tolist() == (np.array(RADII) >= 0.5).tolist()

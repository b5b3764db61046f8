"""The report of a study: people and agents on the same episodes, each number with its interval, same bytes twice."""

import csv
import io
from collections.abc import Callable, Sequence

import pytest

from human_study.report.figures import outcome_matrix_svg, person_dots_svg
from human_study.report.render import csv_text, latex, markdown
from human_study.report.report import StudyReport, report_groups, study_report
from human_study.report.rows import require_totals
from human_study.report.source import source_of
from human_study.report.statistics import wilson_interval
from sim.errors import RunFileError, StudyError
from sim.tasks.metrics import metric_rows
from sim.tasks.run_files import Answer, AnswerMeasures, EpisodeEnd, Run
from sim.types import SPLITS, EndReason, EpisodeKey, Split

from .report_examples import pan_episode, run_info

EPISODES = [(split, str(k)) for split in SPLITS for k in range(4)]
Succeeds = Callable[[Split, str], bool]


def pan(split: Split, episode: str, *, success: bool, steps: int, code: str | None, reason: EndReason = "stop"):
    """An episode of `steps` steps, a second each; the episodes of a split are in different homes."""
    key = EpisodeKey(split, f"Home{episode}", episode)
    return pan_episode(key, success=success, steps=steps, code=code, path=16, reason=reason)


def pan_run(
    run_id: str, who: str, succeeds: Succeeds, *, steps: int = 40, code: str | None = None, **more: object
) -> Run:
    episodes = [pan(split, name, success=succeeds(split, name), steps=steps, code=code) for split, name in EPISODES]
    return Run(info=run_info(run_id, who, **more), episodes=tuple(episodes))


def people(succeeds: Sequence[Succeeds]) -> list[Run]:
    return [
        pan_run(f"study-p{k:02d}-pan", "human", one, code=f"p{k:02d}", steps=30 + k)
        for k, one in enumerate(succeeds, start=1)
    ]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Three people, of whom one fails everywhere in hard, and an agent with two seeds."""
    found = people([lambda s, e: True, lambda s, e: e != "0", lambda s, e: s != "hard"])
    found += [
        pan_run("walker-0", "walker", lambda s, e: e == "1", seed=0),
        pan_run("walker-1", "walker", lambda s, e: e in "12", seed=1),
    ]
    return found


@pytest.fixture(scope="module")
def found(runs: list[Run]) -> StudyReport:
    return study_report(runs)


def row(found: StudyReport, who: str, split: str, measure: str, *, task: str = "pan"):
    rows = [r for r in found.rows if (r.task, r.who, r.split, r.measure) == (task, who, split, measure)]
    (only,) = rows
    return only


def test_peoples_rates_are_those_of_metrics_with_intervals_around_them(found: StudyReport, runs: list[Run]) -> None:
    for known in (r for r in metric_rows(runs) if r.who == "human"):
        ours = row(found, "human", known.split, "sr")
        assert ours.value == pytest.approx(known.sr)
        assert (ours.k, ours.n) == (known.k, known.n)
        assert ours.low < ours.value < ours.high or known.sr == 100
        assert row(found, "human", known.split, "spl").value == pytest.approx(known.spl)
        assert row(found, "human", known.split, "dtg").value == pytest.approx(known.dtg)
    total = row(found, "human", "total", "sr")
    assert (total.num_participants, total.num_episodes) == (3, 12)
    assert row(found, "human", "easy", "t_s").value == pytest.approx(32)


def test_steps_limit_the_anytime_rate(found: StudyReport) -> None:
    assert row(found, "human", "total", "sr_within_25").value == 0
    assert row(found, "human", "total", "sr_within_50").value == row(found, "human", "total", "sr").value


def test_an_agents_runs_are_averaged_and_differences_are_trial_by_trial(found: StudyReport) -> None:
    agent = row(found, "walker", "total", "sr")
    assert agent.value == pytest.approx(100 * (1 + 0.5) / 4)
    assert (agent.k, agent.n, agent.num_participants, agent.num_episodes) == (9, 24, 1, 12)
    apart = row(found, "human - walker", "total", "sr")
    assert apart.kind == "difference"
    assert apart.value == pytest.approx(row(found, "human", "total", "sr").value - agent.value)
    assert (apart.k, apart.n) == (None, 36)
    assert row(found, "human - walker", "hard", "steps").value == pytest.approx(32 - 40)
    assert not [r for r in found.rows if r.who == "human - walker" and r.measure == "t_s"]  # agents have no clock


def test_agents_of_two_conditions_have_their_own_differences(runs: list[Run]) -> None:
    more = pan_run("walker-map", "walker", lambda s, e: True, condition="map")
    found = study_report([*runs, more])
    assert row(found, "human - walker (map)", "total", "sr").value == pytest.approx(
        row(found, "human", "total", "sr").value - 100
    )
    assert row(found, "human - walker", "total", "sr").value > 0


def test_an_agent_is_shown_on_the_peoples_episodes_only(runs: list[Run]) -> None:
    few = [run.model_copy(update={"episodes": run.episodes[:5]}) for run in runs[:3]]
    once = study_report([*few, runs[3]])
    agent = row(once, "walker", "total", "sr")
    assert agent.n == 5
    assert agent.value == pytest.approx((25 + 0) / 2)
    easy = row(once, "walker", "easy", "sr")
    wilson = wilson_interval(1, 4)
    assert (easy.low, easy.high) == pytest.approx((100 * wilson.low, 100 * wilson.high))
    others = runs[3].model_copy(update={"episodes": runs[3].episodes[5:]})
    (left,) = study_report([*few, others]).left_out_runs
    assert (left.run, left.reason) == ("walker-0", "did none of the 5 episodes that people did")


def test_runs_of_agents_that_do_not_fit_are_left_out_and_named(runs: list[Run], found: StudyReport) -> None:
    pointed = answers("p01", (2.0, 3.0), success=True)
    unfit = {
        "pog": (pointed, {"who": "qs", "who_kind": "agent"}, "POG run in a PAN report"),
        "made": (runs[3], {"scene_kind": "invented"}, "was made in homes of kind invented, people were in scan"),
        "other": (runs[3], {"dataset_digest": "e" * 64}, "is on other episode files (eeeeeeeeeeee) than people (dddd"),
        "named": (runs[3], {"labels": True}, "its pictures had the categories written on objects, people's did not"),
    }
    agents = [
        run.model_copy(update={"info": run.info.model_copy(update={"run_id": name, **fields})})
        for name, (run, fields, _) in unfit.items()
    ]
    unscored = runs[3].episodes[0].model_copy(update={"end": EpisodeEnd(reason="stop")})
    agents.append(Run(info=run_info("raw", "walker"), episodes=(unscored,)))
    with_them = study_report([*runs, *agents])
    reasons = {left.run: left.reason for left in with_them.left_out_runs}
    assert list(reasons) == sorted([*unfit, "raw"])
    for name, (_, _, reason) in unfit.items():
        assert reasons[name].startswith(reason)
    assert reasons["raw"] == "steps.jsonl holds no measures for easy/Home0/0"
    assert with_them.model_copy(update={"left_out_runs": ()}) == found
    assert "| run pog |  | POG run in a PAN report | all |" in markdown(with_them)


def test_trials_that_do_not_count_are_listed(runs: list[Run]) -> None:
    broken = pan("easy", "0", success=False, steps=3, code="p09", reason="technical")
    added = Run(info=run_info("study-p09-pan", "human"), episodes=(broken,))
    found = study_report([*runs, added])
    assert [(cell.who, cell.reason, cell.n) for cell in found.left_out] == [("human", "technical failure", 1)]
    assert row(found, "human", "total", "sr").n == 36
    assert "| human | PAN | technical failure | 1 |" in markdown(found)


def test_runs_that_cannot_stand_side_by_side_are_refused(runs: list[Run]) -> None:
    with pytest.raises(StudyError, match="none of people"):
        study_report(runs[3:])
    with pytest.raises(RunFileError, match="expected one kind"):
        study_report([*runs[:3], pan_run("w", "human", lambda s, e: True, code="p09", scene_kind="invented")])
    with pytest.raises(RunFileError, match="second time"):
        study_report([*runs, runs[0]])


def test_a_total_that_is_no_mean_of_its_cells_is_refused(found: StudyReport) -> None:
    wrong = [r.model_copy(update={"value": r.value + (r.split == "total")}) for r in found.rows]
    with pytest.raises(StudyError, match=r"expected .* the mean of easy, medium, hard"):
        require_totals(wrong)


def answers(code: str, xz: tuple[float, float], *, success: bool) -> Run:
    measures = AnswerMeasures(
        success=success, top3_success=success, planar_distance=0.5 if success else 4.0, distance_3d=None
    )
    one = Answer(
        split="easy",
        scene="Home",
        episode_id="7",
        candidates=((xz[0], 1.0, xz[1]),),
        participant=code,
        t_s=9.0,
        measures=measures,
    )
    return Run(info=run_info(f"study-{code}-pog", "human"), answers=(one,))


def test_conditions_of_pointing_are_rows_of_their_own_and_compared_within_people() -> None:
    runs = []
    for condition, hits in (("map_first", (0, 0, 1)), ("map_open", (1, 0, 1))):
        for code, hit in zip(("p01", "p02", "p03"), hits, strict=True):
            run = answers(code, (2.0 * hit, 3.0), success=bool(hit))
            fields = {"condition": condition, "run_id": f"s-{code}-{condition}", "config": {"study": "s"}}
            runs.append(run.model_copy(update={"info": run.info.model_copy(update=fields)}))
    report = study_report(runs)
    text = markdown(report)
    assert "\n| Human (home first, then text) | 33.3 " in text
    assert "\n| Human (home and text together) | 66.7 " in text
    (effect,) = [row.effect for row in report.memory if (row.split, row.measure) == ("all", "sr")]
    assert report.memory[0].what == "map_open - map_first"
    assert effect.value == pytest.approx(100 / 3)  # p01 only
    assert (effect.num_participants, effect.n) == (3, 6)
    (first, _) = report.places
    assert first.spread_median == pytest.approx((2 / 3 + 2 / 3 + 4 / 3) / 3)  # x: 0, 0, 2


def test_clicks_on_the_object_stand_beside_the_papers_measure_where_they_are_known() -> None:
    known = []
    for code, hit, on_object in (("p01", True, True), ("p02", False, True), ("p03", False, False)):
        run = answers(code, (2.0, 3.0), success=hit)
        measures = run.answers[0].measures.model_copy(update={"on_object": on_object})
        known.append(run.model_copy(update={"answers": (run.answers[0].model_copy(update={"measures": measures}),)}))
    rows = {(row.measure, row.split): row for row in study_report(known).rows}
    assert (rows["sr", "total"].k, rows["on_object", "total"].k, rows["on_object", "total"].n) == (1, 2, 3)
    assert "clicks on the object itself (%)" in markdown(study_report(known))
    older = study_report([answers("p01", (2.0, 3.0), success=True)])
    assert not [row for row in older.rows if row.measure == "on_object"]


def test_people_who_agree_on_a_wrong_place_make_an_episode_suspect() -> None:
    near = [("p01", (2.0, 3.0)), ("p02", (2.4, 3.0)), ("p03", (2.0, 3.5)), ("p04", (2.1, 2.8))]
    wrong = [answers(code, xz, success=False) for code, xz in near]
    (suspect,) = study_report([*wrong, answers("p05", (9.0, 9.0), success=True)]).suspects
    assert (suspect.num_agreeing, suspect.num_people) == (4, 5)
    assert suspect.xz == pytest.approx((2.0, 3.0), abs=0.5)
    assert not study_report([*wrong[:3], answers("p05", (9.0, 9.0), success=True)]).suspects  # three of four
    assert not study_report(wrong[:2]).suspects


def test_the_same_runs_give_the_same_bytes_in_any_order(found: StudyReport, runs: list[Run]) -> None:
    again = study_report(runs[::-1])
    assert again.model_dump_json() == found.model_dump_json()
    for text in (markdown, csv_text, latex):
        assert text(again) == text(found)
    one, other = (report_groups(source_of(order)) for order in (runs, runs[::-1]))
    for picture in (person_dots_svg, outcome_matrix_svg):
        assert picture((*one.people, *one.averaged), "pan") == picture((*other.people, *other.averaged), "pan")


def test_tables_hold_every_number_and_are_safe_in_a_spreadsheet(found: StudyReport, runs: list[Run]) -> None:
    total = row(found, "human", "total", "sr")
    assert f"{total.value:.1f} [{total.low:.1f}, {total.high:.1f}] {total.k}/{total.n}" in markdown(found)
    lines = list(csv.DictReader(io.StringIO(csv_text(found))))
    assert len(lines) == len(found.rows)
    assert [float(line["value"]) for line in lines] == [r.value for r in found.rows]
    named = study_report([*runs[:3], pan_run("w", "=walker", lambda s, e: True)])
    assert "'=walker" in csv_text(named)
    assert r"Human - walker" in latex(found)
    assert latex(found).count(r"\begin{tabular}{lcccccccccccc}") == 1


def test_other_homes_are_no_human_baseline(runs: list[Run], found: StudyReport) -> None:
    assert "no human baseline" not in markdown(found)
    invented = [run.model_copy(update={"info": run.info.model_copy(update={"scene_kind": "invented"})}) for run in runs]
    assert "no human baseline" in markdown(study_report(invented))


def test_the_report_has_paper_strict_and_the_share_far_from_view_beside_paper_and_warns(runs: list[Run]) -> None:
    def measured(run: Run) -> Run:
        """Episodes alternate: right by both rules beside a view point, or right by `paper` only and far from it."""
        found = []
        for number, item in enumerate(run.episodes):
            measures = item.end.measures
            rule = measures.rules["paper"]
            is_far = number % 2 == 1
            rules = {
                **measures.rules,
                "paper": rule.model_copy(update={"success": True}),
                "paper-strict": rule.model_copy(update={"success": not is_far}),
                "habitat": rule.model_copy(update={"success": False, "dtg": 1.2 if is_far else 0.3}),
            }
            end = item.end.model_copy(update={"measures": measures.model_copy(update={"rules": rules})})
            found.append(item.model_copy(update={"end": end}))
        info = run.info.model_copy(update={"made_for": "habitat" if run.info.who != "human" else "paper"})
        return run.model_copy(update={"episodes": tuple(found), "info": info})

    report = study_report([measured(run) for run in runs])
    people = [row for row in report.rows if row.kind == "human"]
    strict, far = (row(report, "human", "total", name) for name in ("sr_strict", "far_from_view"))
    assert (strict.k, far.k, strict.n, far.n) == (strict.n // 2, far.n // 2, far.n, strict.n)
    assert (strict.low or 0) < strict.value < (strict.high or 0)
    assert {r.measure for r in people} >= {"sr_strict", "far_from_view"}
    assert not [r for r in report.rows if r.kind == "difference" and r.measure == "far_from_view"]
    text = markdown(report)
    assert "| SR by rule paper-strict (%) |" in text
    assert "| successes by rule paper that end more than 1 m of walking from every view point (%) |" in text
    assert "rule paper = our reading of the PersONAL paper" in text
    agents = {run.info.who for run in runs if run.info.who != "human"}
    assert len(report.warnings) == len(agents)
    assert all("was made for rule habitat, and is counted here by paper" in line for line in report.warnings)
    assert all(f"**{line}**" in text for line in report.warnings)
    assert "Warning: " in latex(report)
    assert study_report(runs).warnings == ()


def test_runs_on_several_versions_of_a_home_are_named_in_one_line(runs: list[Run]) -> None:
    agent = next(run for run in runs if run.info.who != "human" and run.episodes)
    first, *others = agent.episodes
    assert first.end.measures is not None
    end = first.end.model_copy(update={"measures": first.end.measures.model_copy(update={"scene_digest": "newer"})})
    moved = agent.model_copy(update={"episodes": (first.model_copy(update={"end": end}), *others)})
    (line,) = study_report([moved if run is agent else run for run in runs]).warnings
    assert line.startswith("Warning: runs in 1 home are on several versions of the home, whose distances may differ;")
    assert f"newer ({agent.info.run_id})" in line

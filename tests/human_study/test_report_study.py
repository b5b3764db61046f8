"""The report of a whole study from its export: conditions, order, exclusions, flow, hypotheses, same bytes twice."""

import csv
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from human_study.design.study import Condition, StudyAggregate
from human_study.export.runs import study_facts
from human_study.export.trial_table import TrialRow
from human_study.report.counts import flow_counts
from human_study.report.figures import person_dots_svg
from human_study.report.render import csv_text, html_text, markdown, summary
from human_study.report.report import NOBODY_YET, StudyReport, report_groups, report_of, study_report
from human_study.report.source import StudyRecords, own_agents, read_source, source_of
from human_study.report.trials import trial_groups
from personal_viz.cli.study.report import StudyReportVerb
from sim.errors import PersonalVizError, RunFileError, StudyError
from sim.tasks.run_files import Answer, Run

from .report_examples import (
    KEYS,
    PEOPLE,
    agent_run,
    example_rows,
    participant_row,
    people_runs,
    study_config,
    trial_row,
    write_export,
    write_runs,
)

pytestmark = pytest.mark.slow  # a whole report takes seconds
CONFIG = study_config()
AGENTS = [agent_run("walker", 0, CONFIG, rate=0.4), agent_run("seer", 0, CONFIG, rate=0.3)]


def made(rows: Sequence[TrialRow], **more) -> StudyReport:
    records = StudyRecords(CONFIG, tuple(rows), **more)
    return study_report([*people_runs(rows, CONFIG), *AGENTS], records=records)


@pytest.fixture(scope="module")
def rows() -> list[TrialRow]:
    """72 trials; one excluded, one technical failure that was done again, one abandoned, one practice trial."""
    found = example_rows()
    found[4] = found[4].model_copy(update={"excluded": ("disturbed",)})
    again = found[7]
    found[7] = again.model_copy(update={"attempt": 2})
    ended = {"success": None, "spl": None, "softspl": None, "dtg": None, "planar_distance": None}
    found.append(again.model_copy(update={"end_reason": "technical", **ended}))
    left = trial_row("p02", 13, KEYS[0], "none", success=False, steps=2, end_reason="abandoned")
    found.append(left.model_copy(update=ended))
    found.append(trial_row("p01", 14, KEYS[0], "none", success=True, steps=2, phase="practice", rep=0))
    return found


@pytest.fixture(scope="module")
def found(rows: list[TrialRow]) -> StudyReport:
    return made(rows, people=tuple(participant_row(code) for code in PEOPLE))


def value(found: StudyReport, who: str, condition: str, split: str = "total", measure: str = "sr"):
    names = (who, condition, split, measure)
    (row,) = [r for r in found.rows if (r.who, r.condition, r.split, r.measure) == names]
    return row


def ways_of(found: StudyReport, row: TrialRow) -> dict:
    """The ways to count people's trials in the condition of a row, by the text before the colon."""
    condition = "memory_topdown" if row.condition == "topdown" else "none"
    rows = [way for way in found.sensitivity if (way.who, way.condition) == ("human", condition)]
    return {way.way.partition(":")[0]: way for way in rows}


def counted(rows: Sequence[TrialRow], *conditions: str) -> list[TrialRow]:
    """Rows of counted trials with a result; of all conditions if none is named."""
    main = [row for row in rows if row.phase == "main" and row.end_reason == "stop"]
    return [row for row in main if row.condition in (conditions or (row.condition,))]


def test_both_human_conditions_stand_beside_agents_on_the_same_episodes(found: StudyReport) -> None:
    text = markdown(found)
    for label in ("Human", "Human with memory (top-down map)", "walker", "Human with memory (top-down map) - seer"):
        assert f"\n| {label} | " in text
    assert text.index("\n| Human | ") < text.index("\n| Human with memory")
    with_map, without = value(found, "human", "memory_topdown"), value(found, "human", "none")
    assert (with_map.n, without.n) == (36, 36)
    apart = value(found, "human - walker", "memory_topdown")
    assert apart.value == pytest.approx(with_map.value - value(found, "walker", "none").value)


def test_excluded_trials_count_in_the_tables_and_not_per_protocol(found: StudyReport, rows: list[TrialRow]) -> None:
    (excluded,) = [row for row in rows if row.excluded]
    ways = ways_of(found, excluded)
    assert ways["intention to treat (as in the tables)"].n == 36
    assert ways["per protocol"].n == 35
    (rule,) = found.exclusions
    assert (rule.rule_id, rule.num_trials, rule.num_participants) == ("disturbed", 1, 1)
    assert [(cell.reason, cell.n) for cell in found.left_out] == [("abandoned", 1), ("technical failure", 1)]


def test_under_another_rule_an_excluded_trial_is_left_out_and_said_so(rows: list[TrialRow]) -> None:
    other = study_report(people_runs(rows, CONFIG), rule="habitat", records=StudyRecords(CONFIG, tuple(rows)))
    counts = {cell.reason: cell.n for cell in other.left_out}
    assert counts["excluded; its row is under another success rule"] == 1
    assert sum(row.n for row in other.rows if (row.split, row.measure) == ("total", "sr")) == 71


def test_technical_failures_can_count_as_failures(found: StudyReport, rows: list[TrialRow]) -> None:
    (failed,) = [row for row in rows if row.end_reason == "technical"]
    ways = ways_of(found, failed)
    main, worst = ways["intention to treat (as in the tables)"], ways["technical failures as failures"]
    (again,) = [
        row for row in rows if (row.participant, row.order_no, row.attempt) == (failed.participant, failed.order_no, 2)
    ]
    assert worst.n == main.n  # the failure stands in place of the second attempt
    assert worst.k == main.k - bool(again.success)
    late = ways["without each person's first 10 trials"]
    assert late.n == sum(row.condition == failed.condition and row.order_no in (11, 12) for row in rows)


def test_trials_that_nobody_ended_are_left_out_and_count_as_abandoned(rows: list[TrialRow]) -> None:
    (left,) = [row for row in rows if row.end_reason == "abandoned"]
    empty = dict.fromkeys(("end_reason", "success", "spl", "softspl", "dtg", "planar_distance", "path_m", "t_total_s"))
    open_rows = [row.model_copy(update=empty) if row is left else row for row in rows]
    found = study_report(people_runs(open_rows, CONFIG), records=StudyRecords(CONFIG, tuple(open_rows)))
    counts = {cell.reason: cell.n for cell in found.left_out}
    assert counts == {"begun, never ended (taken as abandoned)": 1, "technical failure": 1}
    before = study_report(people_runs(rows, CONFIG), records=StudyRecords(CONFIG, tuple(rows)))
    way, main = "abandoned and never ended trials as failures", "intention to treat (as in the tables)"
    ways = ways_of(found, left)
    assert ways[way] == ways_of(before, left)[way]
    assert ways[way].value < ways[main].value


def test_time_to_decision_is_from_the_tasks_start_to_the_end_in_every_row(rows: list[TrialRow]) -> None:
    changed = [
        row.model_copy(update={"t_total_s": 30.0 + (row.t_look_s or 0.0), "end_reason": "giveup" if is_odd else "stop"})
        for number, row in enumerate(rows)
        for is_odd in (bool(number % 2) and row.end_reason == "stop",)
        if row.end_reason == "stop" and row.phase == "main"
    ]
    runs = people_runs(changed, CONFIG)  # given up and excluded trials have no run here: their rows count
    found = study_report(runs, records=StudyRecords(CONFIG, tuple(changed)))
    times = [row for row in found.rows if row.measure == "t_s" and row.kind == "human"]
    assert {row.condition for row in times} == {"none", "memory_topdown"}
    assert {row.value for row in times} == {30.0}
    assert sum(row.n for row in times if row.split == "total") == len(changed)


def test_without_records_a_trial_that_was_given_up_has_no_time_of_its_end(rows: list[TrialRow]) -> None:
    (run,) = people_runs(rows[:1], CONFIG)
    (walk,) = run.episodes
    given_up = run.model_copy(
        update={"episodes": (walk.model_copy(update={"end": walk.end.model_copy(update={"reason": "giveup"})}),)}
    )
    for one, time_s in ((run, walk.steps[-1].t_s), (given_up, None)):
        (group,), _ = trial_groups([one], "paper")
        (found,) = group.trials["t_s"]
        assert found == time_s if time_s is not None else np.isnan(found)


def test_pages_in_the_background_are_a_line_and_leave_nothing_out(rows: list[TrialRow], found: StudyReport) -> None:
    flagged = made([row.model_copy(update={"is_long_hidden": row.order_no == 5}) for row in rows])
    people = {row.participant for row in rows}
    done = counted(rows)
    hidden = flagged.hidden
    assert (hidden.limit_s, hidden.num_trials, hidden.num_people) == (60.0, len(done), len(people))
    line = f"more than 60 s: {hidden.num_flagged} of {len(done)} counted trials, of {len(people)} people"
    assert line in markdown(flagged)
    assert flagged.rows == found.rows
    assert "Page in the background" not in markdown(flagged.model_copy(update={"hidden": None}))


def test_the_memory_effect_is_found_within_people_and_is_primary(found: StudyReport, rows: list[TrialRow]) -> None:
    means = [100 * np.mean([bool(r.success) for r in counted(rows, c)]) for c in ("topdown", "none")]
    (effect,) = [row for row in found.memory if (row.split, row.measure) == ("all", "sr")]
    assert effect.what == "memory_topdown - none"
    assert effect.effect.value == pytest.approx(means[0] - means[1])  # balanced: everybody, every episode
    human, memory = found.hypotheses
    assert memory.value == effect.effect.value
    assert human.value == pytest.approx(value(found, "human - walker", "none").value)
    smaller, larger = sorted((human.p, memory.p))
    assert sorted(row.p_holm or 0 for row in (human, memory)) == pytest.approx(
        [min(1, 2 * smaller), max(2 * smaller, larger)]
    )


def test_intervals_take_homes_for_random_as_the_study_says_and_episodes_in_studies_without_the_field(
    rows: list[TrialRow], found: StudyReport
) -> None:
    config = study_config(aggregate=StudyAggregate(intervals="homes"))
    new = study_report(people_runs(rows, config), records=StudyRecords(config, tuple(rows)))
    main, other = "intention to treat (as in the tables)", "homes random too (three-way)"
    ends = {row.condition: (row.low, row.high) for row in found.sensitivity if (row.who, row.way) == ("human", other)}
    for condition, of_homes in ends.items():
        headline, alone = value(new, "human", condition), value(found, "human", condition)
        assert (headline.low, headline.high) == of_homes
        assert headline.num_homes == 2
        assert headline.num_episodes == 12
        assert "three-way" in headline.method
        ways = {row.way: row for row in new.sensitivity if (row.who, row.condition) == ("human", condition)}
        assert (ways[main].low, ways[main].high) == of_homes
        in_these = ways["in these homes only: people and episodes random (two-way)"]
        assert (in_these.low, in_these.high) == (alone.low, alone.high)
    assert "people, homes and the episodes in them for random" in markdown(new)
    assert "people and episodes for random (two-way; success rates on the logit scale), as the study file says;" in (
        markdown(found)
    )
    (effect,) = [row.effect for row in new.memory if (row.split, row.measure) == ("all", "sr")]
    assert "three-way" in effect.method
    steps = value(new, "human", "none", measure="steps")
    assert (steps.low or 0) * (steps.high or 0) == pytest.approx(steps.value**2)


def test_the_report_says_how_many_intervals_it_holds_and_gives_p_for_tests_only(found: StudyReport) -> None:
    text = markdown(found)
    _, _, after = text.partition("## How to read the numbers")  # the summary repeats some
    num_printed = len(re.findall(r" \[-?\d[\d.]*, -?\d[\d.]*\] ", after))
    assert f"holds {num_printed} intervals; they are not adjusted" in text
    tables = [line for line in text.splitlines() if " p |" in line or " p (" in line]
    assert all("p (Holm)" in line for line in tables)
    assert len(tables) == 2
    (pair,) = found.agent_pairs
    assert pair.p_holm == pair.p


def test_order_and_earlier_visits_have_tables_and_slopes(found: StudyReport, rows: list[TrialRow]) -> None:
    blocks = {(b.condition, b.by, b.block, b.measure): b for b in found.blocks}
    alone = counted(rows, "none")
    early = [row for row in alone if row.order_no <= 10]
    assert blocks["none", "order", "1-10", "sr"].n == len(early)
    assert blocks["none", "order", "1-10", "sr"].k == sum(bool(row.success) for row in early)
    assert blocks["none", "visits", "first visit", "sr"].n == sum(row.prior_visits_scene == 0 for row in alone)
    names = {(row.what, row.condition) for row in found.order}
    assert ("per 10 trials", "none") in names
    assert ("visited before", "memory_topdown") in names


def test_verification_stands_below_tables(found: StudyReport, rows: list[TrialRow]) -> None:
    without = next(row for row in found.verification if row.condition == "none")
    assert without.n == 36
    assert without.num_verified == sum(row.verification == "verified" for row in counted(rows, "none"))
    note = (
        f"Human: {without.num_verified} of 36 verified, 0 drift, 0 failed, 0 unsupported, {without.num_not_yet} not yet"
    )
    assert markdown(found).count(note) > 10


def test_the_flow_counts_how_far_people_came() -> None:
    stages = [
        ("arrived", "device_ok", "consented", "quiz_failed", "quiz_passed", "finished"),
        ("arrived", "declined"),
        ("arrived", "consented", "quiz_passed", "dropped_out"),
        ("arrived", "consented", "withdrawn"),
        (),
    ]
    people = [participant_row(f"p{n:02d}", found) for n, found in enumerate(stages, start=1)]
    row = trial_row("p01", 1, KEYS[0], "none", success=True, steps=3)
    counts = {c.point: c.n for c in flow_counts(people, [row], num_deleted=1)}
    assert counts == {
        "places in the plan": 6,
        "came": 4,
        "device refused": 0,
        "study was full": 0,
        "declined consent": 1,
        "consented": 3,
        "screened out": 0,
        "failed the quiz at least once": 1,
        "passed the quiz": 2,
        "began practice": 0,
        "began counted trials": 1,
        "dropped out": 1,
        "withdrew": 1,
        "withdrew, records deleted": 1,
        "finished": 1,
    }


def test_ends_and_attention_trials_are_counted(rows: list[TrialRow], found: StudyReport) -> None:
    ends = {(row.who, row.condition, row.reason): (row.k, row.n) for row in found.ends}
    without = value(found, "human", "none")
    assert ends["human", "none", "stop"] == (without.k, 36)
    assert ends["walker", "none", "stop"][1] == 12
    checks = [
        trial_row(code, 20 + n, KEYS[n], "none", success=hit, steps=3, phase="check", rep=0)
        for code, hits in (("p01", (True, True)), ("p02", (False, False)), ("p03", (True, False)))
        for n, hit in enumerate(hits)
    ]
    checked = made([*rows, *checks])
    (count,) = checked.attention
    assert (count.num_trials, count.num_passed, count.num_people, count.num_failing) == (6, 3, 3, 1)
    assert [row.n for row in checked.rows] == [row.n for row in found.rows]
    assert "3 of 6 passed; 1 of 3 people failed more than one" in markdown(checked)


def test_two_agents_of_one_run_are_compared_exactly(found: StudyReport) -> None:
    (pair,) = found.agent_pairs
    outcomes = {o.who: [] for o in found.outcomes if o.who != "human"}
    for outcome in sorted((o for o in found.outcomes if o.who != "human"), key=lambda o: o.episode):
        outcomes[outcome.who].append(outcome.success)
    first, second = np.array(outcomes[pair.first]), np.array(outcomes[pair.second])
    assert pair.num_only_first == int(((first == 1) & (second == 0)).sum())
    assert pair.n == 12
    assert pair.p is not None


def test_shuffled_records_give_the_same_report(rows: list[TrialRow], found: StudyReport) -> None:
    order = np.random.default_rng(8).permutation(len(rows))
    people = tuple(participant_row(code) for code in PEOPLE[::-1])
    assert made([rows[k] for k in order], people=people).model_dump_json() == found.model_dump_json()


def test_renamed_people_give_the_same_numbers(rows: list[TrialRow], found: StudyReport) -> None:
    names = dict(zip(PEOPLE, ["p31", "p07", "p99", "p12", "p55", "p20"], strict=True))
    renamed = made([row.model_copy(update={"participant": names[row.participant]}) for row in rows])
    for row, other in zip(found.rows, renamed.rows, strict=True):
        assert (row.who, row.condition, row.split, row.measure, row.k, row.n) == (
            *(other.who, other.condition, other.split, other.measure, other.k, other.n),
        )
        assert other.value == pytest.approx(row.value)
        assert (other.low, other.high) == pytest.approx((row.low, row.high))


def test_the_declared_total_is_used(rows: list[TrialRow]) -> None:
    config = study_config(aggregate=StudyAggregate(total="dataset_weighted"))
    runs = people_runs(rows, config)
    records = StudyRecords(config, tuple(rows))
    with pytest.raises(StudyError, match="Give --dataset"):
        study_report(runs, records=records)
    sizes = {"easy": 8, "medium": 1, "hard": 1}
    weighted = study_report(runs, records=records, split_sizes=sizes)
    cells = [value(weighted, "human", "none", split).value for split in ("easy", "medium", "hard")]
    assert value(weighted, "human", "none").value == pytest.approx(0.8 * cells[0] + 0.1 * cells[1] + 0.1 * cells[2])
    assert "by their size in the dataset" in markdown(weighted)


def test_an_export_folder_is_read_whole_and_twice_is_refused(tmp_path: Path, rows: list[TrialRow]) -> None:
    export, agents = tmp_path / "export", tmp_path / "agents"
    write_export(export, rows, CONFIG)
    write_runs(agents, AGENTS)
    source = read_source([export, agents])
    assert source.records.rows == tuple(rows)
    assert len(source.runs) == 14
    with pytest.raises(StudyError, match="expected one, because a trial counts once"):
        read_source([export, export])
    with pytest.raises(RunFileError, match="second time"):
        study_report([*source.runs, source.runs[0]], records=source.records)
    (export / "trials.jsonl").write_text('{"participant": "p01"}\n')
    with pytest.raises(StudyError, match=r"trials.jsonl:1"):
        read_source([export])


def test_the_command_writes_all_files_with_the_same_bytes_twice(
    tmp_path: Path, rows: list[TrialRow], capsys: pytest.CaptureFixture[str]
) -> None:
    write_export(tmp_path / "export", rows, CONFIG)
    write_runs(tmp_path / "agents", AGENTS)
    folders = [tmp_path / "export", tmp_path / "agents"]
    (tmp_path / "file").write_text("x")
    with pytest.raises(PersonalVizError, match=r"file: cannot be written \(.*expected a folder"):
        StudyReportVerb(runs=folders, out=tmp_path / "file").run()
    for out, json_too in (("one", True), ("two", False)):
        assert StudyReportVerb(runs=folders, out=tmp_path / out, json=json_too, overlays=True).run() == 0
        printed = capsys.readouterr().out
        if json_too:
            assert printed == (tmp_path / out / "report.json").read_text()
        else:
            assert max(map(len, printed.splitlines())) <= 80
            assert f"The whole report: {tmp_path / out / 'report.html'}" in printed.replace("\n", "")
    files = {path.name: path.read_bytes() for path in (tmp_path / "one").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "two").iterdir()}
    pictures = {"flow.svg", "pan-order.svg", "pan-people.svg", "pan-episodes.svg", "pan-effort.svg"}
    texts = {f"report.{end}" for end in ("md", "html", "csv", "tex", "json")} | {
        "pan-trials.csv",
        "pan-glmm.R",
        "pan-ways.csv",
    }
    overlays = set(files) - pictures - texts
    assert set(files) >= pictures | texts
    assert len({name for name in overlays if name.startswith("overlay-pan-")}) == len(overlays) == len(KEYS)
    document = json.loads(files["report.json"])
    assert document["study"] == "example"
    assert {"low", "high", "k", "n", "method"} <= set(document["rows"][0])
    page = files["report.html"].decode()
    assert page.count("<svg") == len(pictures | overlays)
    for outside in ("http://", "https://", "<script", "src="):
        assert outside not in page.replace("http://www.w3.org/", "").replace("https://matplotlib.org/", "").replace(
            "http://purl.org/", ""
        ).replace("http://creativecommons.org/", "")


def test_the_command_prints_the_summary_within_80_columns(
    tmp_path: Path, rows: list[TrialRow], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    write_export(tmp_path / "export", rows, CONFIG)
    pointed = agent_run("pointer", 0, CONFIG, rate=0.5)
    at = KEYS[0]._asdict()
    answer = Answer(**at, candidates=((0.0, 1.0, 0.0),), measures=None, reason="technical")
    pointed = pointed.model_copy(update={"episodes": (), "answers": (answer,)})
    part = agent_run("part-with-a-name-that-is-far-too-long-for-a-column-of-a-terminal", 0, CONFIG, rate=0.5)
    write_runs(tmp_path / "agents", [*AGENTS, pointed, part.model_copy(update={"episodes": part.episodes[:4]})])
    StudyReportVerb(runs=[tmp_path / "export", tmp_path / "agents"], out=tmp_path / "out").run()
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    report = study_report([*people_runs(rows, CONFIG), *AGENTS], records=StudyRecords(CONFIG, tuple(rows)))
    told = summary(report)
    for row in told.rows:
        assert row[1] in printed
    assert "Left out: pointer-0: POG run in a PAN report." in printed
    assert "no total: 1 of 3 splits" in printed
    assert "human_minus_walker_SR: " in printed
    text = (tmp_path / "out" / "report.md").read_text()
    assert text.index("## Summary") < text.index("## How to read the numbers") < text.index("## Primary hypotheses")


def test_totals_of_part_of_the_splits_stand_nowhere_beside_those_of_all(rows: list[TrialRow]) -> None:
    part = agent_run("walker", 0, CONFIG, rate=0.5)
    easy = part.model_copy(update={"episodes": tuple(item for item in part.episodes if item.key.split == "easy")})
    checked = [row.model_copy(update={"verification": "verified" if row.split == "easy" else None}) for row in rows]
    records = StudyRecords(CONFIG, tuple(checked))
    source = source_of([*people_runs(checked, CONFIG), easy, AGENTS[1]], records)
    groups = report_groups(source)
    report = report_of(source, groups)
    ways = {(way.who, way.condition, way.way): way for way in report.sensitivity}
    whole, apart = (ways[who, "none", "intention to treat (as in the tables)"] for who in ("human", "human - walker"))
    assert whole.value is not None
    only_easy = ways["human", "none", "verified trials only"]
    for way in (apart, only_easy):
        assert (way.value, way.low, way.method) == (None, None, "no total: lacks medium, hard")
    assert only_easy.k is not None
    human = next(row for row in report.hypotheses if row.name == "human_minus_walker_SR")
    assert human.splits == ("easy",)
    assert any("walker_SR: " in line and " shown in easy; " in line for line in summary(report).remarks)
    lines = list(csv.DictReader(io.StringIO(csv_text(report))))
    totals = {"walker": set(), "human - walker": set(), "seer": {"total"}, "human": {"total"}}
    for who, expected in totals.items():
        assert {line["split"] for line in lines if line["who"] == who} - {"easy", "medium", "hard"} == expected
    _, _, spreads = markdown(report).partition("### Spread")
    spreads, _, _ = spreads.partition("###")
    whole = {line.split(" | ")[0] for line in spreads.splitlines() if " | all | " in line}
    assert whole == {"| Human", "| Human with memory (top-down map)", "| seer"}
    assert "| walker | steps to decision | easy | " in spreads
    picture = person_dots_svg((*groups.people, *groups.averaged), "pan")
    assert ("walker" in picture, "seer" in picture) == (False, True)


def test_no_split_says_that_it_lacks_a_total() -> None:
    """Where no row name has all splits, there is no total at all."""
    have = {"none": ("easy", "medium"), "topdown": ("medium", "hard")}
    some = [row for row in example_rows() if row.split in have[row.condition]]
    report = study_report(people_runs(some, CONFIG), records=StudyRecords(CONFIG, tuple(some)))
    lines = markdown(report).splitlines()
    at = lines.index("| SR (%) | easy | medium | hard | total |")
    assert len(lines[at + 2].split("no total: 2 of 3 splits")) == 2
    assert lines[at + 2].split(" | ")[3:] == ["no such trials", "no total: 2 of 3 splits |"]


def test_one_unfit_folder_of_an_agent_stops_no_report(tmp_path: Path, rows: list[TrialRow]) -> None:
    write_export(tmp_path / "export", rows, CONFIG)
    runs = tmp_path / "runs"
    bad = [agent_run("walker", seed, CONFIG, rate=0.5) for seed in range(4)]
    info = bad[2].info.model_copy(update={"config": {"beside": "control-9"}})
    write_runs(runs, [AGENTS[1], *bad[1:2], bad[2].model_copy(update={"info": info}), bad[3]])
    (runs / bad[0].info.run_id).mkdir()  # stopped before its first episode ended
    (runs / bad[0].info.run_id / "run.json").write_text(bad[0].info.model_dump_json())
    steps = runs / bad[1].info.run_id / "steps.jsonl"
    steps.write_text(steps.read_text()[:-40] + "\n{}\n")
    (runs / bad[3].info.run_id / "run.json").write_text("{")
    source = read_source([tmp_path / "export", runs])
    assert [run.info.run_id for run in source.runs if run.info.who_kind == "agent"] == [AGENTS[1].info.run_id]
    reasons = {left.run: left.reason for left in source.left_out}
    assert list(reasons) == [run.info.run_id for run in bad]
    assert reasons["walker-0"] == "holds no finished episode or answer"
    assert reasons["walker-1"].startswith("steps.jsonl")
    assert reasons["walker-2"] == "found no run control-9 beside it"
    assert reasons["walker-3"].startswith("run.json")
    assert str(tmp_path) not in str(reasons)
    with pytest.raises(RunFileError, match="missing"):
        read_source([tmp_path / "export", tmp_path / "missing"])
    people = next((tmp_path / "export").glob("*/run.json")).parent
    (people / "steps.jsonl").write_text("{}\n")
    with pytest.raises(RunFileError, match=r"steps\.jsonl"):
        read_source([path.parent for path in (tmp_path / "export").glob("*/run.json")])


def test_pilots_and_studies_that_still_run_are_labelled(rows: list[TrialRow], found: StudyReport) -> None:
    assert (found.num_open, found.is_pilot) == (0, False)
    for label in ("Interim", "Pilot:", "no human baseline"):
        assert label not in markdown(found)
    blank = dict.fromkeys(("end_reason", "success", "spl", "softspl", "dtg", "planar_distance", "head_hash"))
    waiting = trial_row("p01", 15, KEYS[0], "none", success=False, steps=1, attempt=0).model_copy(update=blank)
    running = made([*rows, waiting], is_pilot=True)
    assert running.num_open == 1
    assert [row.n for row in running.rows] == [row.n for row in found.rows]
    for text in (markdown(running), html_text(running, {})):
        assert "Interim: 1 counted trials are not done" in text
        assert "Pilot: served without an ethics id" in text


def test_people_of_two_studies_are_refused(rows: list[TrialRow]) -> None:
    other = study_config(query_index=1)
    runs = people_runs([row for row in rows if row.participant == "p01"], other)
    mixed = [*runs, *people_runs([row for row in rows if row.participant == "p02"], CONFIG)]
    with pytest.raises(StudyError, match="expected one, because people's codes"):
        study_report(mixed)


def on_study(run: Run, *conditions: Condition, condition: str = "none", version: str | None = None) -> Run:
    """The run of an agent as `run --study` writes it."""
    facts = study_facts(CONFIG, conditions) | ({"study_version": version} if version else {})
    return run.model_copy(update={"info": run.info.model_copy(update={"condition": condition, "config": facts})})


def test_agents_that_ran_on_the_study_stand_beside_the_people_of_their_condition_only(rows: list[TrialRow]) -> None:
    blind = agent_run("walker", 0, CONFIG, rate=0.5)
    seeing, unlike = agent_run("mapper", 0, CONFIG, rate=0.5), agent_run("mapper", 1, CONFIG, rate=0.5)
    agents = [
        on_study(blind, "none", "topdown"),
        on_study(seeing, "none"),
        on_study(unlike, "topdown", condition="memory_topdown"),
    ]
    report = study_report([*people_runs(rows, CONFIG), *agents], records=StudyRecords(CONFIG, tuple(rows)))
    pairs = {(row.who, row.condition): row for row in report.rows if (row.split, row.measure) == ("total", "sr")}
    assert {names for names in pairs if " - " in names[0]} == {
        ("human - walker", "none"),
        ("human - walker (no exposure)", "memory_topdown"),
        ("human - mapper", "none"),
        ("human - mapper (memory_topdown)", "memory_topdown"),
    }
    for agent, people in (("human - mapper", "none"), ("human - mapper (memory_topdown)", "memory_topdown")):
        assert pairs[agent, people].n == pairs["human", people].n
        assert pairs[agent, people].num_episodes == pairs["human", people].num_episodes == 12
    other = study_report([*people_runs(rows, CONFIG), on_study(blind, "none", version="f" * 64)])
    (left,) = other.left_out_runs
    assert (left.run, left.reason[:34]) == ("walker-0", "ran on study version ffffffffffff,")
    assert {row.who for row in other.rows} == {"human"}


def test_agents_in_a_condition_that_nobody_has_done_yet_are_left_out_and_said_so(rows: list[TrialRow]) -> None:
    agents = [on_study(agent_run("walker", 0, CONFIG, rate=0.5), "glb", condition="memory_glb")]
    report = study_report([*people_runs(rows, CONFIG), *agents], records=StudyRecords(CONFIG, tuple(rows)))
    assert [(left.who, left.n) for left in report.left_out if left.reason == NOBODY_YET] == [("walker", 12)]
    assert not any("walker" in row.who for row in report.rows)


def test_a_studys_own_runs_of_agents_are_read_unless_some_are_named(tmp_path: Path) -> None:
    run = agent_run("walker", 0, CONFIG, rate=0.5)
    assert own_agents(tmp_path, []) is None
    write_runs(tmp_path / "runs", [run])
    assert own_agents(tmp_path, [tmp_path / "elsewhere"]) == tmp_path / "runs"
    assert own_agents(tmp_path, [tmp_path / "runs"]) is None
    assert own_agents(tmp_path, [tmp_path / "runs" / run.info.run_id]) is None

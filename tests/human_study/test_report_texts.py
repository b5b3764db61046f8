"""The parts of a report beside its tables: the script for R, the checklist, hypotheses by name, pages and cells."""

import csv
import io
import re
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from human_study.design.study import StudyEthics, StudyReporting
from human_study.export.runs import study_facts
from human_study.export.survey import SurveyRow
from human_study.export.text_tables import csv_lines
from human_study.report.checklist import NOT_ANSWERED, ChecklistItem, checklist, survey_words
from human_study.report.counts import FlowCount
from human_study.report.effects import memory_effects
from human_study.report.figures import flow_svg
from human_study.report.glmm import glmm_csv, glmm_script
from human_study.report.hypotheses import hypothesis_rows
from human_study.report.page import html_page, interval_text
from human_study.report.report import report_groups, study_report
from human_study.report.rows import Aggregate, ReportRow
from human_study.report.source import ReportSource, StudyRecords
from human_study.store.records import StudyDates
from sim.tasks.run_files import Run

from .report_examples import agent_run, example_rows, people_runs, study_config

CONFIG = study_config()
ROWS = example_rows()
RUNS = (*people_runs(ROWS, CONFIG), agent_run("walker", 0, CONFIG, rate=0.4), agent_run("seer", 0, CONFIG, rate=0.3))
FLOW = {"places in the plan": 20, "came": 15, "device refused": 1, "consented": 12, "screened out": 1, "finished": 10}
GROUPS = report_groups(ReportSource(RUNS, StudyRecords(CONFIG, tuple(ROWS))), rule="paper")


def test_the_data_for_r_are_one_line_per_trial() -> None:
    lines = list(csv.DictReader(io.StringIO(glmm_csv(GROUPS.people, "pan"))))
    assert len(lines) == 72
    first = next(row for row in ROWS if (row.participant, row.order_no) == ("p01", 1))
    (line,) = [line for line in lines if (line["participant"], line["order"]) == ("example/p01", "1")]
    assert line["episode"] == f"{first.split}/{first.scene}/{first.episode_id}"
    assert line["success"] == str(int(bool(first.success)))
    assert (line["house"], line["prior_visits"]) == (first.scene, "0")


def test_the_model_for_r_has_the_terms_that_vary() -> None:
    script = glmm_script(GROUPS.people, "pan")
    assert (
        "success ~ condition * split + scale(order) + scale(prior_visits) + (1 | participant) + (1 | episode) + "
        "(1 | house)" in script
    )
    assert 'd$condition <- factor(d$condition, levels = c("none", "memory_topdown"))' in script
    assert '"pan-trials.csv"' in script
    alone = glmm_script([group for group in GROUPS.people if group.condition == "none"], "pan")
    assert "success ~ split + scale(order)" in alone
    assert "Left out, because they do not vary here: condition." in alone


def hypotheses_named(*names: str):
    memory = memory_effects(GROUPS.people, Aggregate())
    return hypothesis_rows(names, GROUPS.differences, memory, Aggregate())


def test_hypotheses_are_found_by_their_names() -> None:
    named, with_map, memory = hypotheses_named(
        "human_minus_seer_SR", "pan_human_memory_topdown_minus_walker_SPL", "memory_topdown_effect_steps"
    )
    assert named.method.startswith("human - seer, pan, none, easy and medium and hard: paired")
    assert with_map.method.startswith("human - walker, pan, memory_topdown")
    assert memory.method.startswith("memory_topdown - none, pan, easy and medium and hard:")
    assert named.splits == memory.splits == ("easy", "medium", "hard")
    assert all(
        row.p_holm is not None and row.p is not None and row.p_holm >= row.p for row in (named, with_map, memory)
    )


def test_a_hypothesis_that_cannot_be_tested_says_why_and_still_counts_in_holm() -> None:
    several, unknown, one = hypotheses_named("human_minus_agent_SR", "people are better", "human_minus_seer_SR")
    assert several.p is None
    assert "exactly one comparison, found pan human - seer (none), pan human - walker (none)" in several.method
    assert "such as human_minus_agent_SR" in unknown.method
    assert one.p is not None
    assert one.p_holm == pytest.approx(min(1, 3 * one.p))


def answers_of(
    records: StudyRecords, *, flow: Sequence[FlowCount] = (), rows: Sequence[ReportRow] = (), runs: Sequence[Run] = ()
) -> dict[str, ChecklistItem]:
    found = checklist(records, rows=rows, flow=flow, exclusions=(), is_pilot=False, runs=runs)
    return {item.question: item for item in found}


def test_the_checklist_answers_what_the_study_file_says() -> None:
    items = answers_of(StudyRecords(config=study_config(ethics=StudyEthics(irb="2026-17"))))
    assert items["1.9 Ethics review?"].answer == "2026-17"
    assert items["2.7 Pay?"].answer == NOT_ANSWERED
    assert "human_minus_walker_SR, memory_effect_SR" in items["Fixed before the first trial?"].answer
    assert items["0.9-0.10 How many items did AI do, and how often?"].answer == "no agent is in this report"
    assert all(item.answered_from and item.answer and "|" not in item.question for item in items.values())


def test_each_number_of_the_list_of_wei_et_al_has_its_question() -> None:
    named = [
        item.question.split()[0]
        for item in answers_of(StudyRecords(config=study_config())).values()
        if item.question[0].isdigit()
    ]
    have = set()
    for number in named:
        first, _, last = number.partition("-")
        part, least = first.split(".")
        have |= {f"{part}.{each}" for each in range(int(least), int((last or first).split(".")[1]) + 1)}
    sizes = {"1": 10, "2": 7, "3": 6, "4": 6, "5": 4}  # 0.1 to 0.4 name the paper itself
    assert have == {f"0.{at}" for at in range(5, 11)} | {
        f"{part}.{at}" for part, size in sizes.items() for at in range(1, size + 1)
    }


def test_each_reporting_field_answers_a_question() -> None:
    empty = answers_of(StudyRecords(config=study_config()))
    for name in StudyReporting.model_fields:
        if name == "invited":
            continue
        told = answers_of(
            StudyRecords(config=study_config(reporting=StudyReporting.model_validate({name: "Told here."})))
        )
        changed = [item for question, item in told.items() if item != empty[question]]
        assert changed, name
        for item in changed:
            assert empty[item.question].answer == NOT_ANSWERED, name
            assert "Told here." in item.answer
            assert f"reporting.{name}" in item.answered_from


def test_the_checklist_counts_answers_to_the_survey_and_hides_small_numbers() -> None:
    rows = [SurveyRow(participant=f"p{at:02}", topic="age", answer="25_34") for at in range(5)]
    rows += [SurveyRow(participant="p06", topic="age", answer="65_or_older")]
    rows += [SurveyRow(participant="p06", topic="ai_tools", answer="no")]
    items = answers_of(StudyRecords(config=study_config(), survey=tuple(rows)))
    assert items["5.1 Demographics of the people?"].answer == "age: 25_34 at least 5, 65_or_older under 5"
    assert items["3.5 Which tools were allowed, AI included, and who watched?"].answer == "ai_tools: no under 5"


def test_the_checklist_gives_the_response_rate_and_the_days() -> None:
    flow = [FlowCount(point=point, n=n, is_aside=False) for point, n in FLOW.items()]
    dates = StudyDates("2027-01-10", 40, "2027-01-12", "2027-02-03")
    told = StudyReporting(place="A room of the university.")
    items = answers_of(StudyRecords(config=study_config(reporting=told), dates=dates), flow=flow)
    asked = "5.1 Response rate: invited, consented, finished?"
    assert items[asked].answer == "20 links, 15 came, 12 consented, 10 finished"
    invited = study_config(reporting=StudyReporting(invited=16))
    assert answers_of(StudyRecords(config=invited), flow=flow)[asked].answer == (
        "16 invited, 15 came, 12 consented, 10 finished (62 % of the invited finished)"
    )
    assert "from 2027-01-12 to 2027-02-03" in items["When and where?"].answer
    assert "since 2027-01-10, first counted trial on 2027-01-12" in items["Fixed before the first trial?"].answer
    linked = answers_of(StudyRecords(config=study_config(recruit={"kind": "link"}), dates=dates), flow=flow)
    assert linked[asked].answer.startswith("15 came")
    assert linked["When and where?"].answer == "counted trials from 2027-01-12 to 2027-02-03; where: not answered"


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        ({"a": 12, "b": 3}, "a at least 5, b under 5"),  # else 15 people told that b was 3
        ({"a": 12, "b": 7, "c": 3}, "a 12, b at least 5, c under 5"),
        ({"a": 12, "b": 3, "c": 3}, "a 12, b under 5, c under 5"),
        ({"a": 12, "b": 1, "c": 1}, "a at least 5, b under 5, c under 5"),  # a sum of 2 is 1 and 1
        ({"a": 12, "b": 5}, "a 12, b 5"),
    ],
)
def test_a_small_number_cannot_be_computed_from_the_others(counts: dict[str, int], told: str) -> None:
    given = [answer for answer, num in counts.items() for _ in range(num)]
    rows = [
        SurveyRow.model_construct(participant=f"p{at}", topic="age", answer=answer) for at, answer in enumerate(given)
    ]
    assert survey_words(rows) == {"age": told}


def test_the_checklist_claims_for_agents_only_what_their_runs_say() -> None:
    strange = agent_run("walker", 0, CONFIG, rate=0.4)
    facts = study_facts(CONFIG, ("none",))
    own = strange.model_copy(update={"info": strange.info.model_copy(update={"config": facts})})
    report = study_report(RUNS, records=StudyRecords(CONFIG, tuple(ROWS)))
    names = (
        "3.3 Same interface for people and AI?",
        "3.4 Same instructions and information?",
        "Comparisons interleaved?",
    )
    for runs, is_known in (([own], True), ([own, strange], False)):
        items = answers_of(StudyRecords(config=CONFIG), rows=report.rows, runs=runs)
        for name in names:
            assert ("not known for walker, which did not run on the study" in items[name].answer) != is_known
        assert (
            items["3.4 Same instructions and information?"].answer.endswith("the same text, query and limits")
            == is_known
        )
        assert ("both are in the same simulator" in items["3.3 Same interface for people and AI?"].answer) == is_known


def test_the_checklist_says_what_the_study_does_not_do() -> None:
    usual = answers_of(StudyRecords(config=study_config()))
    other = answers_of(StudyRecords(config=study_config(hidden_max_s=None, comments=True, task=("pog",))))
    for question, words in (
        ("3.2 Quality control of people during the study?", "pages hidden for more than 60 s are flagged"),
        ("1.7 Equal effort and limits?", "success within a number of steps is tabulated"),
    ):
        assert words in usual[question].answer
        assert words not in other[question].answer
    assert "a comment in words at the end" in other["3.6 Explanations by people?"].answer
    assert "comment" not in usual["3.6 Explanations by people?"].answer


def test_a_text_with_lines_like_a_heading_makes_no_question() -> None:
    told = StudyReporting(pretest="## Changes\n## After it | x\n\n# More: of it")
    items = answers_of(StudyRecords(config=study_config(reporting=told)))
    assert set(items) == set(answers_of(StudyRecords(config=study_config())))
    name = "1.6 Developed in steps: pretests, checks of the items?"
    assert items[name].answer == "Changes ## After it | x # More: of it"


@pytest.mark.parametrize(
    ("reason", "effect", "answer"),
    [
        ("Power of 0.9 for 15 points.", 10.0, "Power of 0.9 for 15 points. Smallest effect of interest: 10 points."),
        ("All we can pay", 2.5, "All we can pay. Smallest effect of interest: 2.5 points."),
        ("", 10.0, "Size: not answered. Smallest effect of interest: 10 points."),
        ("All we can pay", None, "All we can pay"),
        ("", None, NOT_ANSWERED),
    ],
)
def test_the_size_of_the_sample_and_the_smallest_effect_are_sentences(
    reason: str, effect: float | None, answer: str
) -> None:
    config = study_config(sample_size_reason=reason, smallest_effect=effect)
    asked = "1.8 Size of the sample justified? Smallest effect?"
    assert answers_of(StudyRecords(config=config))[asked].answer == answer


def test_the_words_of_a_flow_of_many_people_fit_their_boxes() -> None:
    names = ("came", "failed the quiz at least once", "withdrew", "withdrew, records deleted")
    counts = [FlowCount(point=name, n=1000, is_aside=name != "came") for name in names]
    report: Any = SimpleNamespace(flow=counts, scene_labels=[])
    drawing = flow_svg(report)
    (whole,) = re.findall(r'viewBox="0 0 (\d+) ', drawing)
    boxes = re.findall(r'<rect x="(\d+)" y="\d+" width="(\d+)".*\n<text.*>(.*)</text>', drawing)
    assert [words for _, _, words in boxes] == [f"{name}: 1000" for name in names]
    ends = [int(x) + int(width) for x, width, _ in boxes]
    assert all(6 * len(words) < int(width) for _, width, words in boxes)  # a letter is up to 6 wide on average
    assert all(end < int(x) for end, x in zip(ends, [*(x for x, _, _ in boxes[1:]), whole], strict=True))


def test_markdown_becomes_one_safe_page() -> None:
    text = "# A <b>\n\n| h | i |\n|---|---|\n| a\\|b | <c> |\n\nsee <https://x.y>\n\n![P & q](p.svg)\n\n![Q](q.svg)\n"
    page = html_page(text, {"p.svg": '<?xml version="1.0"?>\n<svg id="s"></svg>'})
    assert "<title>A &lt;b&gt;</title>" in page
    assert "<h1>A &lt;b&gt;</h1>" in page
    assert "<th>a|b</th>\n<td>&lt;c&gt;</td>" in page
    assert '<figure><svg id="s"></svg><figcaption>P &amp; q</figcaption></figure>' in page
    assert "<figure>q.svg<figcaption>Q</figcaption></figure>" in page
    assert "<?xml" not in page
    assert "<p>see &lt;https://x.y&gt;</p>" in page


def test_numbers_of_a_column_stand_digit_below_digit_and_texts_stay() -> None:
    cells = ["9.0 [-1.5, 20.0] 9/20", "100.0 20/20", "45.5 [12.0, 8.0] 11/20", "p-1 and 2", "no such trials"]
    cells += ["2026-17", "2026-11-23"]
    text = "# T\n\n| h | i |\n|---|---|\n" + "".join(f"| r | {cell} |\n" for cell in cells)
    found = re.findall("<td>(.*)</td>", html_page(text, {}))
    space = "\u2007"
    assert found == [
        f"{2 * space}9.0 [\u22121.5, 20.0] {space}9/20",
        "100.0 20/20",
        f"{space}45.5 [12.0, {space}8.0] 11/20",
        *cells[3:],
    ]


def test_a_long_page_has_contents_after_its_first_section_and_prints_without_them() -> None:
    names = ["Summary", "Flow <of> people", "Tables", "Runs"]
    page = html_page("# T\n\n" + "".join(f"## {name}\n\ntext of {number}\n\n" for number, name in enumerate(names)), {})
    before, _, after = page.partition("<nav")
    assert "text of 0" in before
    assert '<h2 id="section-2">' in after.partition("</nav>")[2]
    assert re.findall('<a href="#(.*)">(.*)</a>', page) == [
        (f"section-{number}", name.replace("<", "&lt;").replace(">", "&gt;"))
        for number, name in enumerate(names, start=1)
    ]
    assert re.search(r"@media print \{.*nav \{ display: none; \}", page, re.DOTALL)
    assert "<nav" not in html_page("# T\n\n## One\n\n## Two\n", {})


def test_numbers_and_cells_are_written_safely() -> None:
    assert interval_text(SimpleNamespace(value=-0.04, low=-1.0, high=1.0)) == "0.0 [-1.0, 1.0]"
    assert interval_text(SimpleNamespace(value=3.14159, low=None, high=None), 2) == "3.14"
    assert csv_lines(["a", "b"], [("=1+1", 0.1), (None, -2)]) == "a,b\n'=1+1,0.1\n,-2\n"

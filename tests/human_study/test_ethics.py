"""Texts for participants and documents for an ethics board: complete, true for the study file, open places marked."""

import datetime
import re
from pathlib import Path

import pytest

from human_study.design.study import StudyConfig, StudyPrivacy
from human_study.store.records import StudyDates, read_study
from human_study.texts.documents import ethics_documents, hypothesis_sentence, sample_of
from human_study.texts.estimate import announced_minutes, estimate_time
from human_study.texts.participants import instruction_texts
from human_study.texts.words import filled, filled_text, open_places, words_of, wrapped

from .small_world import FILLED, paged_study, plan, study
from .stores import begin_next
from .stores import filled as filled_store

WHOLE = FILLED | {"primary": ("human_minus_agent_SR", "memory_effect_SR")}


def consent_text(config: StudyConfig) -> str:
    return filled("consent.md", words_of(config))


def test_a_complete_study_file_leaves_nothing_open() -> None:
    config = paged_study(**WHOLE)
    documents = ethics_documents(config, plan(config))
    assert list(documents) == [
        "protocol.md",
        "information_sheet.md",
        "consent.md",
        "data_flow.md",
        "retention.md",
        "time_and_pay.md",
        "preregistration.md",
    ]
    assert {name: open_places(text) for name, text in documents.items()} == dict.fromkeys(documents, ())
    everything = "\n".join(documents.values())
    assert "study@anywhere.example" in everything
    assert not re.search(r"\{[a-z_]+\}|None|\(\)", everything)
    assert ".." not in everything.replace("...", "")


def test_empty_fields_are_marked_and_named() -> None:
    config = paged_study()
    assert set(open_places(consent_text(config))) == {
        "ethics.institution",
        "ethics.duration_min",
        "ethics.pay",
        "ethics.pay_if_leaving",
        "ethics.insurance",
        "ethics.data_protection_officer",
        "ethics.legal_basis",
        "ethics.complaint_body",
        "privacy.retention",
        "ethics.contact",
        "ethics.irb",
    }
    documents = ethics_documents(config, None)
    assert "plan.json" in open_places(documents["preregistration.md"])
    assert "primary" in open_places(documents["preregistration.md"])
    assert {"smallest_effect", "sample_size_reason"} <= set(open_places(documents["preregistration.md"]))
    assert "[to be filled in: privacy.retention]" in documents["retention.md"]


def test_a_mark_that_a_line_break_cuts_is_found() -> None:
    text = wrapped("word " * 20 + "[to be filled in: ethics.contact]")
    assert "\n" in text.strip()
    assert open_places(text) == ("ethics.contact",)


def test_the_consent_form_says_what_remains_after_a_withdrawal() -> None:
    deleted, kept = consent_text(paged_study()), consent_text(paged_study(privacy={"on_withdraw": "keep"}))
    flat = " ".join(deleted.split())
    assert "We then delete the key that your records are encrypted with" in flat
    for what in (
        "what the check of your browser found",
        "which keys you chose",
        "questions about the rules you got wrong",
    ):
        assert what in flat
    assert "recruiting platform remains" not in flat
    prolific = consent_text(paged_study(recruit={"kind": "prolific"}, privacy={"platform_id": "hmac"}))
    assert "A code made of your id on the recruiting platform remains too" in " ".join(prolific.split())
    assert "that it took place, how it ended, how many events of which kind" in flat
    assert "never their content" in flat
    assert "We then delete the key" not in " ".join(kept.split())
    assert "We keep what you have done until then and use it" in " ".join(kept.split())


@pytest.mark.parametrize(
    ("kind", "platform_id", "is_hashed", "is_kept"),
    [
        ("local", "none", False, False),
        ("local", "hmac", False, False),
        ("link", "none", False, False),
        ("link", "hmac", True, True),
        ("prolific", "none", True, False),
        ("prolific", "hmac", True, True),
    ],
)
def test_the_consent_form_tells_what_is_not_stored(kind: str, platform_id: str, is_hashed: bool, is_kept: bool) -> None:
    config = paged_study(privacy={"platform_id": platform_id}, recruit={"kind": kind})
    text = " ".join(consent_text(config).split())
    assert "We do **not** store your name, your e-mail address, your internet (IP) address" in text
    assert ("your id on the recruiting platform into a code" in text) == is_hashed
    assert ("in a file apart from your records" in text) == is_kept
    assert ("pay.db" in ethics_documents(config, None)["data_flow.md"]) == is_kept


def test_confidence_is_listed_where_the_study_asks_for_it() -> None:
    assert "how sure you say you are" in consent_text(paged_study(confidence=True))
    assert "how sure you say you are" not in consent_text(paged_study())


def test_instructions_fit_the_study_file() -> None:
    config = paged_study(
        actions="paper6",
        steps=300,
        pan_max_s=240.0,
        memory={"arms": ("none", "topdown"), "min_s": 10.0, "max_s": 90.0},
        pog={"conditions": ("map_first", "map_2d"), "look_max_s": 120.0, "answer_max_s": 300.0},
        checks={"every": 15},
    )

    def text_of(config: StudyConfig) -> str:
        pages = [page for task in config.task for page in instruction_texts(config, task, config.conditions(task))]
        return " ".join(" ".join(pages).split())

    for part in (
        "| `R` | Look up |",
        "after **300 steps** or after 4 minutes",
        "at least 10 seconds and at most 90 seconds",
        "see only the home**, for at most 2 minutes",
        "**map from above**",
        "A search ends by itself 5 minutes after the text appears",
        "Some questions about these rules come next.",
        "A few searches are easy on purpose",
        "twice within 2 seconds",
        "walks 25 cm forward",
        "turns 30 degrees to the left",
    ):
        assert part in text_of(config), part
    for part in ("Look up", "map of the home", "easy on purpose", "questions about these rules"):
        assert part not in text_of(paged_study(flow=("instructions",))), part


def test_the_time_is_the_sum_of_its_stated_parts() -> None:
    config = paged_study(
        task=("pan",),
        memory={"arms": ("none", "topdown"), "max_s": 20.0},
        practice={"pan": 2, "pog": 0},
        checks={"every": 15},
        breaks={"every": 10},
    )
    estimate = estimate_time(config, num_trials=30, task="pan")
    assert (estimate.num_checks, estimate.num_breaks, estimate.num_practice) == (2, 2, 2)
    assert (estimate.trials_s, estimate.practice_s, estimate.breaks_s) == (32 * 130.0, 260.0, 240.0)
    assert estimate.total_s == 32 * 130.0 + 260.0 + 240.0 + 480.0  # 5140 s, 85.7 min
    assert estimate.minutes == 90


def test_an_attention_trial_of_home_sequences_is_one_search() -> None:
    config = paged_study(
        task=("pan",), sequences={"sha256": "0" * 64}, practice={"pan": 1, "pog": 0}, checks={"every": 2}
    )
    estimate = estimate_time(config, num_trials=4, task="pan")
    assert (estimate.num_checks, estimate.practice_s) == (2, 3 * 120.0)
    assert estimate.trials_s == 4 * 7 * 120.0 + 2 * 120.0


def test_the_survey_takes_its_time() -> None:
    usual, asked = (
        estimate_time(paged_study(survey={"questions": topics}), num_trials=3, task="pan") for topics in ((), ("age",))
    )
    assert asked.total_s == usual.total_s + 10.0
    text = ethics_documents(paged_study(survey={"questions": ("age",)}), None)["time_and_pay.md"]
    assert "10 s more for each question of the survey" in " ".join(text.split())


def test_the_announced_time_is_the_stated_one_or_the_longest_share() -> None:
    config = paged_study()
    assert announced_minutes(config) is None
    assert announced_minutes(config, plan(config)) == 15  # 3 PAN trials: 6 min, reading: 8 min
    assert announced_minutes(paged_study(design={"kind": "house-once", "trials_per_person": 30})) == 75
    assert announced_minutes(paged_study(ethics={"duration_min": 20}), plan(config)) == 20


def test_a_stated_time_that_is_too_short_is_called_out() -> None:
    config = paged_study(ethics={"duration_min": 5})
    assert "are less than the estimate of 15" in ethics_documents(config, plan(config))["time_and_pay.md"]
    assert "The stated 45 minutes cover" in ethics_documents(paged_study(**WHOLE), plan(config))["time_and_pay.md"]


def test_the_sample_is_counted_from_the_plan() -> None:
    config = paged_study(task=("pan",), memory={"arms": ("none", "topdown")})
    sample = sample_of(config, plan(config))
    assert (sample.num_people, sample.num_trials, sample.num_episodes, sample.most_visits) == (2, 6, 3, 3)
    assert (sample.by_split, sample.by_kind, sample.num_spare) == ({"easy": 3}, {"invented": 1}, 0)
    text = " ".join(ethics_documents(config, plan(config))["preregistration.md"].split())
    assert (
        "places for 2 people (2 people with 3 steering trials each), 6 trials in all, with 3 episodes (3 easy)" in text
    )


def test_hypotheses_are_sentences() -> None:
    assert hypothesis_sentence("human_minus_agent_SR") == (
        "`human_minus_agent_SR`: the success rate of people differs from that of the agent on the same episodes."
    )
    assert "agent `vlfm`" in hypothesis_sentence("pan_human_minus_vlfm_SPL")
    assert "having been shown the home before" in hypothesis_sentence("memory_effect_SR")
    assert "to be stated in words" in hypothesis_sentence("people_are_great")


def test_the_preregistration_names_study_plan_rules_and_analysis() -> None:
    config = paged_study(**WHOLE, aggregate={"total": "pooled", "weight": "participants"})
    drawn = plan(config)
    text = ethics_documents(config, drawn)["preregistration.md"]
    flat = " ".join(text.split())
    assert config.study_version in flat
    assert drawn.plan_version in flat
    assert "| `disturbed` | The person reported having been disturbed" in text
    assert "`attention`" not in text
    checked = ethics_documents(paged_study(checks={"every": 15}), None)["preregistration.md"]
    assert "| `attention` | The person failed more than one attention trial" in checked
    assert "the mean over all trials, whatever their split. Within a split every participant counts the same." in flat
    assert "a 95% interval that takes participants and episodes for random" in flat
    assert "family-wise level of 5%, adjusted after Holm" in flat


def test_the_preregistration_takes_its_date_from_the_records(tmp_path: Path) -> None:
    def text_of(dates: StudyDates | None) -> str:
        return " ".join(ethics_documents(config, plan(config), dates=dates)["preregistration.md"].split())

    config = study()
    unknown = text_of(None)
    assert unknown.startswith("# Plan of the analysis, to be registered: pilot")
    assert "This folder holds no records, so this text cannot say whether a trial was begun." in unknown
    assert "nobody" not in unknown.split("## 1.")[0]
    with filled_store(tmp_path, config) as store:
        with read_study(tmp_path) as reader:
            before = reader.dates()
        assert (before.num_begun, before.first) == (0, None)
        text = text_of(before)
        assert text.startswith("# Preregistration: pilot")
        assert f"were frozen in the study's records on {before.frozen}" in text
        assert "nobody had begun a counted trial" in text
        begin_next(store, "p02")
        with read_study(tmp_path) as reader:
            after = reader.dates()
    text = text_of(after)
    assert "# Preregistration" not in text
    assert text.startswith("# Plan of the analysis, written after the first trial: pilot")
    assert (
        f"**This was written after 1 counted trial was begun, the first on {after.first}; it is no preregistration.**"
        in text
    )
    assert "nobody" not in text.split("## 1.")[0]


def test_the_log_scale_is_named_for_the_measures_that_have_it() -> None:
    for task, told in (
        (("pan",), "for times, steps and paths on the log scale"),
        (("pog",), "for times and distances to a goal's centre on the log scale"),
    ):
        config = paged_study(task=task, aggregate={"intervals": "homes"})
        assert told in " ".join(ethics_documents(config, None)["preregistration.md"].split())


def test_a_study_of_home_sequences_registers_what_its_report_shows() -> None:
    config = paged_study(sequences={"sha256": "7" * 64}, checks={"every": 3})
    documents = {name: " ".join(text.split()) for name, text in ethics_documents(config, None).items()}
    text = documents["preregistration.md"]
    for told in (
        "from the set with digest `" + "7" * 64,
        "Success rate (SR) of all searches and of each kind (fresh, revisit, changed, stale)",
        "takes people and homes for random",
        "success with the history visible less that with it hidden, and success of people less that of each agent",
        "how often the message that decides the answer could be read",
    ):
        assert told in text
    for absent in (
        "Satterthwaite",
        "time to the answer",
        "25 to 500",
        "trial by trial",
        "Sensitivity",
        "Gwet",
        "Order",
    ):
        assert absent not in text
    assert "After every 3 homes one search with the object in plain view" in documents["protocol.md"]
    hidden = paged_study(sequences={"sha256": "7" * 64, "history": "hidden"})
    assert "history visible less" not in ethics_documents(hidden, None)["preregistration.md"]


def test_the_protocol_names_the_languages_that_people_read() -> None:
    for language, told in (
        ("en", "adults who read English and use"),
        ("de", "adults who read German, and English texts"),
    ):
        protocol = ethics_documents(paged_study(language=language), None)["protocol.md"]
        assert told in " ".join(protocol.split())


def test_a_trial_of_somebody_who_withdrew_still_counts_as_begun(tmp_path: Path) -> None:
    with filled_store(tmp_path) as store:
        begin_next(store, "p02")
        store.withdraw("p02")
        with read_study(tmp_path) as reader:
            assert reader.dates().num_begun == 1


def test_the_preregistration_names_the_smallest_effect_and_why_the_sample_has_its_size() -> None:
    text = " ".join(ethics_documents(paged_study(**WHOLE), None)["preregistration.md"].split())
    assert "Smallest effect of interest: a difference of 10 percentage points between success rates." in text
    assert "Reason for the size of the sample: Power of 0.9 for 15 points." in text


def test_the_board_reads_law_insurance_risks_and_pay_as_people_do() -> None:
    config = paged_study(**WHOLE)
    documents = {name: " ".join(text.split()) for name, text in ethics_documents(config, plan(config)).items()}
    for name in ("protocol.md", "information_sheet.md", "consent.md"):
        for part in (
            "dpo@anywhere.example",
            "Art. 6 (1) (a) GDPR",
            "the Data Protection Authority of Anywhere",
            "You are insured against accidents by the university.",
            "You get 12 EUR. If you stop early, you get 4 EUR for each quarter of an hour.",
            "make some people dizzy or slightly sick",
            "Tired eyes and hands",
            "If somebody broke into the computer",
            "language model",
        ):
            assert part in documents[name], (name, part)


def test_the_data_flow_lists_everything_with_its_end() -> None:
    config = paged_study(**WHOLE, recruit={"kind": "prolific"}).model_copy(
        update={"privacy": StudyPrivacy(platform_id="hmac", retention=datetime.date(2027, 12, 31))}
    )
    text = ethics_documents(config, None)["data_flow.md"]
    rows = [line for line in text.splitlines() if line.startswith("|")][2:]
    assert len(rows) == 14
    for row in rows:
        assert len(row.split(" | ")) == 5, row
        assert "2027-12-31" in row or "not at all, once it is published" in row
    for file in (
        "study.db",
        "keys.json",
        "secrets.json",
        "secrets.toml",
        "sessions.json",
        "pay.db",
        "backups",
        "exports",
        "plan.json",
    ):
        assert file in text


def test_marks_of_an_earlier_version_are_filled_in_and_own_words_stay(tmp_path: Path) -> None:
    text = consent_text(paged_study()) + "\nOur own sentence. [to be filled in: lunch]\n"
    config = paged_study(**(WHOLE | {"ethics": WHOLE["ethics"] | {"pay": ""}}))
    filled_in = filled_text(text, words_of(config), where=tmp_path)
    assert "Our own sentence." in filled_in
    assert "study@anywhere.example" in filled_in
    assert open_places(filled_in) == ("ethics.pay", "lunch")

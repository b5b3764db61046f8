"""People are told the rules that are scored: every rule, limit and key, in every text; which texts `plan` refuses."""

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pytest

from human_study.design.plan import StudyPlan
from human_study.design.study import Condition, PanCondition, PogCondition, StudyConfig, SurveyTopic
from human_study.texts.contradictions import disagreements
from human_study.texts.documents import ethics_documents
from human_study.texts.participants import (
    freeze_texts,
    instruction_texts,
    practice_text,
    told_name,
    told_text,
    welcome_text,
    write_texts,
)
from human_study.texts.quiz import questions_for
from human_study.texts.survey import SURVEY, questions_of
from human_study.texts.words import limits_m, open_places
from human_study.trial.terms import terms_of
from sim.episodes.schema import Episode, Goal
from sim.errors import StudyError
from sim.sequences.runs import SearchEnd, SequenceEnd, SequenceRun
from sim.tasks.rules import score_answer, score_run
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun
from sim.types import SUCCESS_RULES, Action, Pose, SuccessRule, TaskKind

from .small_world import FILLED, SCENE_DIGEST, SquareRoom, episode, paged_study, plan, study

STEP_M = 0.25
PAN_ARMS: tuple[tuple[PanCondition, ...], ...] = (("none",), ("topdown",), ("none", "topdown", "glb"))
POG_ARMS: tuple[tuple[PogCondition, ...], ...] = (("map_open",), ("map_2d",), ("map_first", "map_open", "map_2d"))
NEAR_M = 0.02
"""Distance on either side of a told limit at which an answer is scored, metres."""


def lengths_m(text: str) -> set[float]:
    """All lengths in a text but that of one step, metres."""
    found = re.findall(r"(\d+(?:\.\d+)?)\s+(metres?|m|centimetres?|cm)\b", text)
    return {round(float(number) * (0.01 if unit.startswith("c") else 1), 6) for number, unit in found} - {STEP_M}


def seen_from(metres: float) -> Episode:
    """The episode with the target's one view point at this distance from the target's middle."""
    whole = episode()
    target = whole.targets[0]
    point = target.view_points[0]
    place = point.agent_state.model_copy(update={"position": (target.position[0] + metres, 0.0, 0.0)})
    goal: Goal = target.model_copy(update={"view_points": (point.model_copy(update={"agent_state": place}),)})
    return Episode(whole.key, whole.record, (goal,))


def stops_at(of: Episode, x: float, rule: SuccessRule) -> bool:
    """Whether a robot that stops at x is scored as right."""
    poses = [Pose((0.0, 0.0, 0.0), 0.0), Pose((x, 0.0, 0.0), 0.0)]
    measures = score_run(
        of, poses, stopped=True, navigation=SquareRoom(), collisions=0, scene_digest=SCENE_DIGEST
    ).rules[rule]
    return measures.success


def decides(config: StudyConfig, task: TaskKind, limit: float) -> bool:
    """Whether an answer just inside this distance is scored as right, and one just outside as wrong."""
    middle = episode().targets[0].position[0]
    scored: Callable[[float], bool]
    if task == "pog":
        scored = lambda metres: score_answer(episode(), [(middle + metres, 0.0, 0.0)], storeys=[(0.0, 0.0)]).success  # noqa: E731
    elif config.success in ("paper", "paper-strict"):
        is_relaxed = config.success == "paper-strict" or limit != min(limits_m(config, task))
        of = seen_from(1.3 if is_relaxed else 0.75)
        scored = lambda metres: stops_at(of, middle + metres, config.success)  # noqa: E731
    else:
        of = seen_from(0.75)
        scored = lambda metres: stops_at(of, middle + 0.75 + metres, config.success)  # noqa: E731
    return scored(limit - NEAR_M) and not scored(limit + NEAR_M)


def ended(task: TaskKind, *, config: StudyConfig, is_right: bool) -> EpisodeRun | Answer:
    """A practice trial that ended right or wrong by the study's rule and by no other rule of PAN."""
    if task == "pog":
        x = episode().targets[0].position[0] + (0.5 if is_right else 2.0)
        measures = score_answer(episode(), [(x, 0.0, 0.0)], storeys=[(0.0, 0.0)])
        return Answer.model_construct(measures=measures)
    poses = [Pose((0.0, 0.0, 0.0), 0.0)] * 2
    run = score_run(episode(), poses, stopped=True, navigation=SquareRoom(), collisions=0, scene_digest=SCENE_DIGEST)
    rules = {
        name: figures.model_copy(update={"success": is_right if name == config.success else not is_right})
        for name, figures in run.rules.items()
        if figures is not None
    }
    return EpisodeRun.model_construct(end=EpisodeEnd(reason="stop", measures=run.model_copy(update={"rules": rules})))


def texts_that_tell_the_rule(config: StudyConfig, task: TaskKind, conditions: tuple[Condition, ...]) -> dict[str, str]:
    """Every text that tells people when an answer is right, by name."""
    name = "distance" if task == "pan" else "middle"
    question = next(question for question in questions_for(config, task, conditions) if question.name == name)
    documents = ethics_documents(config, plan(config))
    told = {
        "pages": "\n".join(instruction_texts(config, task, conditions)),
        "welcome": welcome_text(config, task),
        "right answer": question.answers[0],
        "why": question.because,
        **{name: documents[name] for name in ("information_sheet.md", "protocol.md", "preregistration.md")},
    }
    for is_right in (True, False):
        told[f"practice {is_right}"] = practice_text(config, task, ended(task, config=config, is_right=is_right))
    return told


@pytest.mark.slow
@pytest.mark.parametrize("rule", SUCCESS_RULES)
@pytest.mark.parametrize("task", get_args(TaskKind))
def test_every_text_tells_the_limits_that_are_scored_and_no_others(task: TaskKind, rule: SuccessRule) -> None:
    arms = PAN_ARMS if task == "pan" else POG_ARMS
    for keys, conditions in itertools.product(("paper4", "paper6"), arms):
        field = {"memory": {"arms": conditions}} if task == "pan" else {"pog": {"conditions": conditions}}
        config = paged_study(task=(task,), success=rule, actions=keys, **field)
        limits = set(limits_m(config, task))
        for name, text in texts_that_tell_the_rule(config, task, conditions).items():
            said = lengths_m(text)
            assert min(limits) in said, (name, keys, conditions, text)
            assert said <= limits, (name, keys, conditions, text)
        assert lengths_m(ethics_documents(config, plan(config))["consent.md"]) == set()
        assert all(decides(config, task, limit) for limit in limits)


def told_sequences(task: TaskKind, *, history: str = "both", **changes: object) -> StudyConfig:
    """A study of home sequences with all pages."""
    sequences = {"sha256": "0" * 64, "history": history}
    return paged_study(task=(task,), sequences=sequences, **FILLED, **changes)


@pytest.mark.parametrize("rule", SUCCESS_RULES)
@pytest.mark.parametrize("task", get_args(TaskKind))
def test_texts_of_home_sequences_tell_the_scored_limits_and_found_in_place_of_stop(
    task: TaskKind, rule: SuccessRule, tmp_path: Path
) -> None:
    config = told_sequences(task, success=rule)
    limits = set(limits_m(config, task))
    told = texts_that_tell_the_rule(config, task, config.conditions(task))
    for name, text in told.items():
        said = lengths_m(text)
        assert min(limits) in said, (name, text)
        assert said <= limits, (name, text)
    frozen(tmp_path, config)
    told |= {f"{path}": path.read_text("utf-8") for path in (tmp_path / "told").iterdir()}
    pages = "\n".join(text for name, text in told.items() if not name.endswith(("protocol.md", "preregistration.md")))
    assert "STOP" not in pages
    assert ("FOUND" in pages) == (task == "pan")
    assert disagreements(pages, config, plan=plan(config), task=task) == []


@pytest.mark.parametrize("task", get_args(TaskKind))
def test_people_are_told_whether_they_can_read_messages_again(task: TaskKind) -> None:
    answers = {"visible": "Yes, all messages", "hidden": "No, it is there", "both": "In some homes"}
    for history, right in answers.items():
        config = told_sequences(task, history=history)
        pages = "\n".join(instruction_texts(config, task, config.conditions(task)))
        questions = {each.name: each for each in questions_for(config, task, config.conditions(task))}
        assert questions.keys() >= {"next", "changed", "again", "all"}
        assert "whose" not in questions
        assert all(len(set(each.answers)) == 3 for each in questions.values())
        assert questions["again"].answers[0].startswith(right)
        assert ("cannot read it again" in pages) == (history != "visible")
        assert ("the newest first" in pages) == (history != "hidden")


def test_after_practice_in_a_home_people_are_told_how_many_answers_were_right() -> None:
    config = told_sequences("pog")
    marks = [((x, 0.0, 0.0),) for x in (-2.0, 2.0)]
    scored = [score_answer(episode(), points, storeys=[(0.0, 0.0)]) for points in marks]
    ends = [SearchEnd.model_construct(answer=answer, measures=None, all=None) for answer in scored]
    for searches, told in ((ends, "1 of 2 answers was right, but"), (ends[:1], "1 of 1 answers was right.")):
        run = SequenceRun.model_construct(end=SequenceEnd.model_construct(searches=tuple(searches)))
        assert practice_text(config, "pog", run).startswith(told)


@pytest.mark.parametrize("rule", SUCCESS_RULES)
def test_no_wrong_answer_of_the_quiz_is_right_and_the_right_one_is_first(rule: SuccessRule) -> None:
    for task in get_args(TaskKind):
        config = paged_study(task=(task,), success=rule)
        for question in questions_for(config, task, config.conditions(task)):
            assert len(question.answers) == len(set(question.answers)) == 3
            assert all(not lengths_m(wrong) for wrong in question.answers[1:])
            assert question.because


@pytest.mark.parametrize("rule", SUCCESS_RULES)
def test_practice_is_judged_by_the_rule_of_the_study(rule: SuccessRule) -> None:
    config = paged_study(success=rule)
    for task in get_args(TaskKind):
        right, wrong = (
            practice_text(config, task, ended(task, config=config, is_right=is_right)) for is_right in (True, False)
        )
        assert right.startswith("That was right. An answer is right when")
        assert wrong.startswith("That was not right, but it was only practice. An answer is right when")
        assert practice_text(config, task, None) == "It was only practice."


def test_only_the_rule_that_scores_a_run_without_stop_says_that_stop_is_not_needed() -> None:
    poses = [Pose((0.0, 0.0, 0.0), 0.0), Pose((-1.25, 0.0, 0.0), 0.0)]
    measures = score_run(
        episode(), poses, stopped=False, navigation=SquareRoom(), collisions=0, scene_digest=SCENE_DIGEST
    )
    for rule in SUCCESS_RULES:
        config = paged_study(task=("pan",), success=rule)
        figures = measures.rules[rule]
        pages = " ".join("".join(instruction_texts(config, "pan", ("none",))).split())
        quiz = " ".join(question.because for question in questions_for(config, "pan", ("none",)))
        assert ("Only STOP gives an answer" in pages) == (not figures.success)
        assert ("counts as not found" in pages) == (not figures.success)
        assert ("have given no answer" in quiz) == (not figures.success)
        assert ("however the search ends" in pages) == figures.success


def test_a_large_object_is_clicked_in_its_middle() -> None:
    config = paged_study(task=("pog",))
    end_of_a_bed = (episode().targets[0].position[0] + 1.1, 0.4, 0.0)
    assert not score_answer(episode(), [end_of_a_bed], storeys=[(0.0, 0.0)]).success
    pages = " ".join("".join(instruction_texts(config, "pog", ("map_open",))).split())
    assert "**Click the middle of that object**" in pages
    assert "such as a bed, a mark at one end can be too far from the middle" in pages
    middle = next(question for question in questions_for(config, "pog", ("map_open",)) if question.name == "middle")
    assert "Anywhere on the object" in middle.answers[1:]


@pytest.mark.parametrize("keys", ["paper4", "paper6"])
def test_keys_and_limits_of_a_trial_are_those_of_the_study_file(keys: str) -> None:
    config = paged_study(
        actions=keys,
        steps=120,
        pan_max_s=240.0,
        resume_within_s=300.0,
        memory={"arms": ("topdown", "glb"), "min_s": 10.0, "max_s": 90.0},
        pog={"conditions": ("map_first",), "look_min_s": 0.0, "look_max_s": 45.0, "answer_max_s": 75.0},
    )
    pan = " ".join("".join(instruction_texts(config, "pan", ("topdown", "glb"))).split())
    pog = " ".join("".join(instruction_texts(config, "pog", ("map_first",))).split())
    assert ("| `R` |" in pan and "| `F` |" in pan) == (Action.LOOK_UP in config.action_set)
    assert "**120 steps** or after 4 minutes" in pan
    assert config.task_for(episode(), "pan").max_steps == 120
    assert "within 5 minutes the same search goes on" in pan
    assert pan.count("at least 10 seconds and at most 90 seconds") == 2
    assert "at most 45 seconds" in pog
    assert "75 seconds after the text appears" in pog
    look, task_max_s = terms_of(config, "topdown").look, terms_of(config, "map_first").task_max_s
    assert (look.min_s, look.max_s, task_max_s) == (10.0, 90.0, 75.0)


def test_each_participant_is_told_about_one_task_only(tmp_path: Path) -> None:
    config = paged_study(task=("pan", "pog"), success="habitat", **FILLED)
    names = freeze_texts(tmp_path, config, plan(config))
    texts = {name: (tmp_path / name).read_text(encoding="utf-8") for name in names if name.endswith(".md")}
    walking, pointing = (
        told_text(texts, "consent.md", task) + told_text(texts, "instructions.md", task)
        + "".join(instruction_texts(config, task, config.conditions(task)))
        for task in ("pan", "pog")
    )  # fmt: skip
    assert "You steer a small robot" in walking
    assert "mark" not in walking
    assert "steer" not in pointing
    assert "viewing place" not in pointing


def test_a_text_that_an_earlier_version_froze_is_shown_as_it_is() -> None:
    old = {"consent.md": "# Ours\n\n{ % as it was\n", "instructions.md": "Both tasks."}
    assert told_text(old, "consent.md", "pan") == old["consent.md"]
    assert told_text(old, "instructions.md", "pog") == "Both tasks."
    assert told_text({}, "consent.md", "pan") == ""


def frozen(folder: Path, config: StudyConfig, *, is_pilot: bool = False) -> tuple[dict[str, str], StudyPlan]:
    """The texts of a study, frozen, and its plan."""
    drawn = plan(config).model_copy(update={"is_pilot": is_pilot})
    return freeze_texts(folder, config, drawn), drawn


def test_a_study_whose_file_is_not_filled_in_cannot_be_planned(tmp_path: Path) -> None:
    with pytest.raises(StudyError) as caught:
        frozen(tmp_path, paged_study())
    line = str(caught.value)
    assert "\n" not in line
    fields = (
        "ethics.institution, ethics.insurance, ethics.pay, ethics.pay_if_leaving, privacy.retention, ethics.contact"
    )
    law = "ethics.irb, ethics.legal_basis, ethics.data_protection_officer, ethics.complaint_body"
    assert f"consent.md: {fields}, {law} to be filled in" in line
    assert not (tmp_path / "told").exists()
    frozen(tmp_path, paged_study(**FILLED))
    frozen(tmp_path, paged_study(flow=("instructions",)))  # nobody is shown the consent form


def test_people_of_a_pilot_read_plain_words_where_the_file_is_empty(tmp_path: Path) -> None:
    names, _ = frozen(tmp_path, paged_study(), is_pilot=True)
    assert set(names) >= {"consent.md", told_name("consent.md", "pan"), told_name("instructions.md", "pog")}
    for name in set(names) - {"languages/en"}:
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert open_places(text) == ()
        assert "told" not in name or not set("{}<>") & set(text)
    consent = " ".join((tmp_path / told_name("consent.md", "pan")).read_text(encoding="utf-8").split())
    assert "The team of this pilot study invites you" in consent
    assert "No pay is stated for this pilot study." in consent
    (tmp_path / "consent.md").write_text("Bring [to be filled in: lunch].")
    with pytest.raises(StudyError, match="lunch to be filled in"):
        frozen(tmp_path, paged_study(), is_pilot=True)


def test_a_text_changed_by_hand_must_say_what_the_study_file_says(tmp_path: Path) -> None:
    config = paged_study(steps=300, **FILLED)
    write_texts(tmp_path, "en")
    (tmp_path / "consent.md").write_text("It takes about 20 minutes. You get 15 EUR. It takes {{ minutes }} minutes.")
    (tmp_path / "instructions.md").write_text("# Ours\n\nYou have 500 steps. Stop within two metres of it.")
    with pytest.raises(StudyError) as caught:
        frozen(tmp_path, config)
    line = str(caught.value)
    assert "\n" not in line
    for part in (
        "consent.md: says 'takes about 20 minutes'",
        "ethics.duration_min) is 2700",
        "says '15 EUR', but ethics.pay is 4 or 12",
        "instructions.md: says 'have 500 steps', but steps is 300",
        "says 'within two metres'",
        "Correct study.yaml or the text, then plan again.",
    ):
        assert part in line, part


@pytest.mark.parametrize(
    ("text", "is_said_otherwise"),
    [
        ("You have five hundred steps.", False),
        ("You have three hundred steps.", True),
        ("Follow these three steps. Walk 2 steps back.", False),
        ("It lasts an hour.", True),
        ("Taking part takes 45 min.", False),
        ("We answer within 24 hours.", False),
        ("Stop within 1 m of its middle.", False),
        ("Stop within 150 centimetres of its middle.", False),
        ("Stop less than 2 metres away.", True),
        ("Stop where the object is in plain view.", True),
        ("You receive €12.", False),
        ("You receive $ 20 in cash.", True),
        ("Rest after every 10 searches.", False),
        ("Rest after every 12 searches.", True),
        ("You do 3 searches.", False),
        ("You do forty searches.", True),
        ("Records are deleted on 31 December 2027.", False),
        ("Records are deleted on 2030-01-01.", True),
        ("W walks 25 cm, D turns 30°.", False),
        ("W walks 50 cm.", True),
        ("D turns 45 degrees.", True),
        ("Press Enter twice within 2 seconds.", False),
        ("Come back within 10 minutes to the same search.", False),
        ("Come back within 30 minutes to the same search.", True),
    ],
)
def test_numbers_are_compared_where_words_name_them(text: str, is_said_otherwise: bool) -> None:
    config = paged_study(task=("pan",), **FILLED)
    assert bool(disagreements(text, config, plan=plan(config), task="pan")) == is_said_otherwise, text


def test_a_consent_form_must_say_what_goes_to_a_language_model(tmp_path: Path) -> None:
    told = "We send your comments to the language model of Somebody Ltd, in Anywhere, to sort them."
    config = paged_study(**(FILLED | {"ethics": FILLED["ethics"] | {"language_model": told}}))
    frozen(tmp_path / "own", config)
    consent = (tmp_path / "own" / told_name("consent.md", "pan")).read_text(encoding="utf-8")
    assert f"{told} Nothing else of yours is sent to a language model." in " ".join(consent.split())
    for text, problem in (
        ("Take part.", "does not name the language model, but ethics.language_model is set"),
        ("We never send a word to a language model.", "says 'never send a word to a language model', but ethics.lan"),
    ):
        (tmp_path / "own" / "consent.md").write_text(text)
        with pytest.raises(StudyError, match=f"consent.md: {problem}"):
            frozen(tmp_path / "own", config)
    frozen(tmp_path / "none", paged_study(**FILLED))
    consent = (tmp_path / "none" / told_name("consent.md", "pan")).read_text(encoding="utf-8")
    assert "The program of this study sends nothing that you do or write to a language model" in " ".join(
        consent.split()
    )


def test_a_consent_form_must_say_that_comments_are_stored(tmp_path: Path) -> None:
    config = paged_study(**FILLED, comments=True)
    frozen(tmp_path, config)
    told = " ".join((tmp_path / told_name("consent.md", "pan")).read_text(encoding="utf-8").split())
    assert "If you write a comment at the end, its text." in told
    assert "deleted with it if you withdraw" in told
    (tmp_path / "consent.md").write_text("Take part.")
    with pytest.raises(StudyError, match=r"consent.md: does not name the comment, but comments is set"):
        frozen(tmp_path, config)
    with pytest.raises(StudyError, match=r"comments only with consent in flow, found flow \['instructions'\]"):
        frozen(tmp_path / "unasked", paged_study(**FILLED, comments=True, flow=("instructions",)))
    frozen(tmp_path / "none", paged_study(**FILLED))
    assert "comment" not in (tmp_path / "none" / told_name("consent.md", "pan")).read_text(encoding="utf-8")


def test_the_text_at_the_end_is_frozen_like_the_others(tmp_path: Path) -> None:
    names, _ = frozen(tmp_path, paged_study(**FILLED))
    assert not [name for name in names if "debriefing" in name]
    (tmp_path / "debriefing.md").write_text("# Why\n\n{{ institution }} asked you.", encoding="utf-8")
    names, _ = frozen(tmp_path, paged_study(**FILLED))
    assert set(names) >= {"debriefing.md", "told/debriefing-pan.md", "told/debriefing-pog.md"}
    told = (tmp_path / "told" / "debriefing-pan.md").read_text(encoding="utf-8")
    assert told == f"# Why\n\n{FILLED['ethics']['institution']} asked you.\n"
    (tmp_path / "debriefing.md").write_text("You used at most 400 steps. [to be filled in: thanks]", encoding="utf-8")
    with pytest.raises(StudyError, match=r"debriefing\.md: thanks to be filled in.*says 'most 400 steps'"):
        frozen(tmp_path, paged_study(**FILLED))


def test_a_consent_form_must_say_what_the_survey_asks(tmp_path: Path) -> None:
    survey = {"eligibility": ("I have not seen these homes.",), "questions": ("age", "ai_tools")}
    config = paged_study(**FILLED, survey=survey)
    frozen(tmp_path / "ours", config)
    consent = " ".join((tmp_path / "ours" / told_name("consent.md", "pan")).read_text(encoding="utf-8").split())
    assert "It asks for: age (in steps of ten years), help by an AI program." in consent
    assert "and are deleted when you withdraw" in consent
    assert "- I have not seen these homes." in consent
    (tmp_path / "ours" / "consent.md").write_text("There is no survey.")
    with pytest.raises(StudyError, match=r"says 'no survey', but survey\.questions is set"):
        frozen(tmp_path / "ours", config)
    (tmp_path / "ours" / "consent.md").write_text("After a survey. We never ask questions about yourself.")
    with pytest.raises(StudyError, match=r"says 'never ask questions about you', but survey\.questions is set"):
        frozen(tmp_path / "ours", config)
    (tmp_path / "ours" / "consent.md").write_text("Take part.")
    with pytest.raises(StudyError, match="does not name the survey"):
        frozen(tmp_path / "ours", config)


def test_each_question_of_the_survey_can_be_refused() -> None:
    assert set(SURVEY) == set(get_args(SurveyTopic))
    for topic, answers in SURVEY.items():
        config = study(flow=("consent",), survey={"questions": (topic,)})
        (question,) = questions_of(config).values()
        assert list(question.answers.values())[-1] == "I prefer not to say"
        assert tuple(question.answers) == answers
        assert len(answers) >= 3


def test_a_field_that_no_study_has_is_refused_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "consent.md").write_text("Hello {{ salary }}.")
    with pytest.raises(StudyError, match=r"consent\.md: cannot be filled in \('salary' is undefined\)"):
        frozen(tmp_path, paged_study(**FILLED))
    (tmp_path / "consent.md").write_text("Hello {{ insitution }}.")
    with pytest.raises(StudyError, match=r"double braces\. Did you mean 'institution'\? Use: "):
        frozen(tmp_path, paged_study(**FILLED))
    (tmp_path / "consent.md").write_text("Hello\n{{ pay")
    with pytest.raises(StudyError, match=r"consent\.md, line 2: cannot be filled in"):
        frozen(tmp_path, paged_study(**FILLED))


@pytest.mark.parametrize("rule", SUCCESS_RULES)
def test_our_own_texts_agree_with_every_study_file(rule: SuccessRule, tmp_path: Path) -> None:
    for task in (("pan",), ("pog",), ("pan", "pog")):
        config = paged_study(
            task=task, success=rule, memory={"arms": ("none", "glb")}, breaks={"every": None}, confidence=True, **FILLED
        )
        frozen(tmp_path / rule / "-".join(task), config)
        for each in task:
            pages = "\n".join(instruction_texts(config, each, config.conditions(each)))
            assert disagreements(pages, config, plan=plan(config), task=each) == []


def test_people_whose_mark_goes_to_objects_are_told_to_click_the_object_and_not_its_middle() -> None:
    snaps = paged_study(task=("pog",), pog={"conditions": ["map_open"], "pointing": "snap"})
    free = paged_study(task=("pog",), pog={"conditions": ["map_open"]})
    for config, is_told in ((snaps, True), (free, False)):
        pages = "\n".join(instruction_texts(config, "pog", ("map_open",)))
        assert ("your mark goes to it" in pages) == is_told
        assert ("Click the middle of that object" in pages) == (not is_told)
        assert ("the middle of that object" in welcome_text(config, "pog")) == (not is_told)
        question = next(each for each in questions_for(config, "pog", ("map_open",)) if each.name == "middle")
        assert (question.answers[0] == "Anywhere on the object") == is_told

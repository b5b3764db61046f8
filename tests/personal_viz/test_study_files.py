"""`study init` and `study plan`: texts are frozen with the plan, and nothing that was asked changes in silence."""

import datetime
import hashlib
import io
import json
import shutil
import sys
from pathlib import Path

import pytest

from human_study.design.plan import PLAN_FILE, PlannedParticipant, StudyPlan, StudyScene, load_plan
from human_study.design.study import STUDY_FILE, StudyConfig, StudyDataset, load_study
from human_study.texts.words import empty_fields
from personal_viz.cli.study.init import StudyInit
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.cli.study.wizard import ALWAYS, TRIALS, asked
from personal_viz.study_app.study_files import require_texts
from sim.errors import StudyError

from .invented import invented_dataset
from .program import Done, assert_one_line, personal_viz

UNTOLD = StudyConfig(study="x", dataset=StudyDataset(sha256="x"), task=("pan",))
ETHICS = {
    "irb": "2026-17",
    "institution": "The University of Anywhere",
    "contact": "study@anywhere.example",
    "pay": "12 EUR",
    "pay_if_leaving": "You get it whenever you stop.",
    "insurance": "There is none.",
    "data_protection_officer": "dpo@anywhere.example",
    "legal_basis": "your consent",
    "complaint_body": "the Data Protection Authority of Anywhere",
}


def test_a_study_is_planned_when_its_texts_are_whole_and_says_what_it_could_not_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, dataset = tmp_path / "study", tmp_path / "dataset"
    invented_dataset(dataset, name="FlowHome", seed=5)
    StudyInit(study=study, dataset=dataset, per_split=1).run()
    law = "ethics.insurance, ethics.data_protection_officer, ethics.legal_basis, ethics.complaint_body"
    fields = f"ethics.institution, ethics.contact, ethics.pay, ethics.pay_if_leaving, {law}, ethics.irb"
    assert f"{fields}, privacy.retention\n" in capsys.readouterr().out
    file = (study / STUDY_FILE).read_text(encoding="utf-8")
    for before, instead in (
        ("trials_per_person: null", "trials_per_person: 4"),
        ("  pan: 2\n", "  pan: 0\n"),
        ("  pog: 2\n", "  pog: 0\n"),
        ("  every: 15\n", "  every: null\n"),
    ):
        assert before in file
        file = file.replace(before, instead)
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    with pytest.raises(StudyError, match=r"consent\.md: ethics\.institution, .*Correct study\.yaml or the text"):
        StudyPlanVerb(study=study, dataset=dataset).run()
    assert not (study / PLAN_FILE).exists()
    for field, value in {**ETHICS, "retention": "2027-12-31"}.items():
        file = file.replace(f"  {field}: ''", f"  {field}: {value}").replace(f"  {field}: null", f"  {field}: {value}")
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    capsys.readouterr()
    assert StudyPlanVerb(study=study, dataset=dataset).run() == 0
    printed = capsys.readouterr().out
    made = load_plan(study, load_study(study))
    assert made.changes[0].startswith("design.trials_per_person: 4 asked, 1 planned, because")
    assert f"  Other than asked: {made.changes[0]}.\n" in printed
    assert "  trials of each split that a person has: easy 0 to 1, medium 0 to 1, hard 0 to 1\n" in printed
    assert StudyPlanVerb(study=study, dataset=dataset, json=True).run() == 0
    told = json.loads(capsys.readouterr().out)
    assert told["per_person"] == {"easy": [0, 1], "medium": [0, 1], "hard": [0, 1]}
    assert (told["people"], told["trials"], told["changes"]) == (15, 15, list(made.changes))
    files = {"consent.md", "instructions.md", "told/consent-pan.md", "told/instructions-pan.md"}
    assert set(made.texts) == {*files, "languages/en"}
    told = study / "told" / "consent-pan.md"
    assert "The University of Anywhere invites you" in told.read_text(encoding="utf-8")
    for path in (told, study / "instructions.md"):
        require_texts(study, load_study(study), made)
        before = path.read_text(encoding="utf-8")
        path.write_text(before + "More.\n", encoding="utf-8")
        with pytest.raises(StudyError, match="the text that was planned"):
            require_texts(study, load_study(study), made)
        path.write_text(before, encoding="utf-8")
    assert capsys.readouterr().err == ""
    of_earlier = made.model_copy(update={"texts": {name: made.texts[name] for name in files}})
    other = made.model_copy(update={"texts": {**made.texts, "languages/en": "0" * 64}})
    require_texts(study, load_study(study), of_earlier)
    assert capsys.readouterr().err == ""
    require_texts(study, load_study(study), other)
    assert "texts for participants (en) differ from those of" in capsys.readouterr().err
    (study / "debriefing.md").write_text("Thanks.", encoding="utf-8")
    with pytest.raises(StudyError, match=r"debriefing\.md: was written after the plan; expected"):
        require_texts(study, load_study(study), made)


def test_marks_go_to_objects_only_where_the_files_of_a_scan_tell_of_objects(tmp_path: Path, demo_root: Path) -> None:
    study, scans = tmp_path / "study", tmp_path / "scans"
    StudyInit(study=study, dataset=demo_root, per_split=1, task=("pog",)).run()
    file = (study / STUDY_FILE).read_text(encoding="utf-8")
    assert "pointing: free" in file
    assert load_study(study).storey_names == "texts"  # buttons and descriptions use the same words
    (study / STUDY_FILE).write_text(file.replace("pointing: free", "pointing: snap"), encoding="utf-8")
    scans.mkdir()
    shutil.copy(demo_root / "scenes" / "Demo.glb", scans)
    with pytest.raises(StudyError, match=r"pog\.pointing is 'snap', but no file tells .* expected Demo\.semantic\.glb"):
        StudyPlanVerb(study=study, dataset=demo_root, scenes_dir=scans, pilot=True).run()
    (study / STUDY_FILE).write_text(file.replace("object_names: auto", "object_names: demand"), encoding="utf-8")
    with pytest.raises(StudyError, match=r"pog\.object_names is 'demand', but no file tells .* Take .*: off"):
        StudyPlanVerb(study=study, dataset=demo_root, scenes_dir=scans, pilot=True).run()
    for end in (".semantic.glb", ".semantic.txt"):
        shutil.copy(demo_root / "scenes" / f"Demo{end}", scans)
    (study / STUDY_FILE).write_text(file.replace("pointing: free", "pointing: snap"), encoding="utf-8")
    text = scans / "Demo.semantic.txt"
    head, *lines = text.read_text(encoding="utf-8").splitlines(keepends=True)
    missing = list[str]()
    for _ in range(2):  # the file names the first missing target, then another one
        kept = [line for line in lines if _label(line) in missing]
        text.write_text("".join([head, *kept]), encoding="utf-8")
        with pytest.raises(
            StudyError, match=r"Demo\.semantic\.txt does not list '.*', a target of .*/Demo/"
        ) as refused:
            StudyPlanVerb(study=study, dataset=demo_root, scenes_dir=scans, pilot=True).run()
        missing.append(str(refused.value).split("'")[3])
    assert len({_label(line) for line in lines} & set(missing)) == 2
    assert not (study / PLAN_FILE).exists()
    file = file.replace("pointing: free", "pointing: snap").replace("room_names: 'off'", "room_names: 'on'")
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    assert load_study(study).pog.room_names == "on"
    assert StudyPlanVerb(study=study, dataset=demo_root, pilot=True).run() == 0  # the plan tells of objects and rooms


def _label(line: str) -> str:
    """The name of an object in a line of a semantic text."""
    number, _, category, _ = line.split(",")
    return category.strip('"') + f"_{number}"


def test_rooms_of_a_scan_have_no_names(tmp_path: Path, demo_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study, scans = tmp_path / "study", tmp_path / "scans"
    StudyInit(study=study, dataset=demo_root, per_split=1, task=("pog",)).run()
    file = (study / STUDY_FILE).read_text(encoding="utf-8").replace("room_names: 'off'", "room_names: demand")
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    scans.mkdir()
    shutil.copy(demo_root / "scenes" / "Demo.glb", scans)
    monkeypatch.setattr("personal_viz.study_app.study_files.scene_kind", lambda *_: "scan")
    with pytest.raises(StudyError, match=r"pog\.room_names is 'demand', but Demo is a scan, .* expected off"):
        StudyPlanVerb(study=study, dataset=demo_root, scenes_dir=scans, pilot=True).run()


def test_marks_that_an_earlier_version_planned_are_not_shown_to_anybody_new(tmp_path: Path) -> None:
    text = "Ask [to be filled in: ethics.contact]."
    (tmp_path / "consent.md").write_text(text, encoding="utf-8")
    config = StudyConfig(study="old", dataset=StudyDataset(sha256="0" * 64), task=("pan",))
    made = StudyPlan(
        study_version=config.study_version,
        scenes=(StudyScene(name="Home", kind="invented"),),
        texts={"consent.md": hashlib.sha256(text.encode()).hexdigest()},
        participants=(PlannedParticipant(code="p01", task="pan", trials=()),),
    )
    with pytest.raises(StudyError, match=r"consent\.md: ethics\.contact to be filled in"):
        require_texts(tmp_path, config, made)
    (tmp_path / "study.db").touch()  # it has begun, and keeps what people have read
    require_texts(tmp_path, config, made)


def init_with(monkeypatch: pytest.MonkeyPatch, dataset: Path, answers: str) -> Done:
    """`study init --wizard` in the current folder with these lines on standard input."""
    monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
    return personal_viz("study", "init", "study", "--dataset", dataset, "--wizard")


def test_the_wizard_asks_for_what_only_a_person_knows_and_checks_each_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = tmp_path / "dataset"
    invented_dataset(dataset, name="FlowHome", seed=5)
    monkeypatch.chdir(tmp_path)
    answers = {
        "study": "our study\nour-study",
        "task": "pan, pog",
        "design.kind": "hous-once\ncrossed",
        "primary": "more success\nhuman_minus_agent_SR, memory_effect_SPL",
        "survey.eligibility": "none\nI am 18 or older, and read English.",
        "ethics.language_model": 'NONE\n""',
        "ethics.pay": "12 EUR: an hour # paid at the end",
        "ethics.insurance": "[A, yes",
        "ethics.legal_basis": "2026-11-22",
        "ethics.irb": "IRB #2026-14",
        "ethics.contact": "Dr. X, room #12, x@y.example",
        "privacy.retention": "2027-02-31\n2027-12-31",
    }
    places = [place for place in (*ALWAYS, *empty_fields(UNTOLD)) if place != TRIALS]  # crossed: everybody does all
    done = init_with(monkeypatch, dataset, "".join(answers.get(place, "") + "\n" for place in places))
    assert (done.returncode, done.stderr) == (0, "")
    config = load_study(tmp_path / "study")
    assert (config.study, config.task, config.design.kind) == ("our-study", ("pan", "pog"), "crossed")
    assert (config.design.trials_per_person, config.design.raters_per_episode) == (None, 5)
    assert f"\n5/{len(places)} primary: " in done.stdout
    assert config.primary == ("human_minus_agent_SR", "memory_effect_SPL")
    assert config.survey.eligibility == ("I am 18 or older, and read English.",)
    assert config.ethics.language_model == ""
    for said in (
        "primary.0 is 'more success'; ",
        "survey.eligibility.0 is 'none'; ",
        "ethics.language_model is 'NONE'; ",
    ):
        assert f"answer: {said}expected: Value error, a " in done.stdout
    assert done.stdout.count("leave it empty if there is none. Answer again.") == 2
    texts = ("pay", "irb", "contact", "insurance", "legal_basis")
    assert config.ethics.model_dump(include=set(texts)) == {name: answers[f"ethics.{name}"] for name in texts}
    assert config.privacy.retention == datetime.date(2027, 12, 31)
    assert "answer: study is 'our study'; expected: String should match pattern" in done.stdout
    assert "answer: design.kind is 'hous-once'; expected: Input should be 'house-once' or 'crossed'. Did you mean" in (
        done.stdout
    )
    assert "answer: privacy.retention is '2027-02-31'" in done.stdout
    left = [line for line in done.stdout.splitlines() if line.startswith("Before people take part")]
    assert "ethics.institution" in left[0]
    assert "ethics.pay," not in left[0]


@pytest.mark.parametrize(
    ("place", "answer", "said", "taken"),
    [
        (TRIALS, "many\n0\n12", ("is 'many'; ", "is 0; expected: Input should be greater"), 12),
        (TRIALS, "&a [*a]\n12", ("is '&a [*a]'; ",), 12),
        (TRIALS, f"{'[' * 1200}\n12", ("is '[[[[",), 12),
        (TRIALS, "2027-12-31: the end\n12", ("is '2027-12-31: the end'; ",), 12),
        ("survey.eligibility", '"I see well.", "I can hear, too."', (), ("I see well.", "I can hear, too.")),
        ("survey.eligibility", '["I see well.", "I can hear."]', (), ("I see well.", "I can hear.")),
        ("survey.eligibility", "keine\n", ("eligibility.0 is 'keine'; expected",), ()),
        ("ethics.language_model", "no\n-\n", ("is 'no'; expected", "is '-'; expected"), ""),
    ],
)
def test_the_wizard_asks_again_in_one_line_until_an_answer_fits(
    place: str,
    answer: str,
    said: tuple[str, ...],
    taken: object,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = [answer if each == place else "" for each in (*ALWAYS, *empty_fields(UNTOLD))]
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(lines) + "\n"))
    section, field = place.split(".")
    assert getattr(getattr(asked(UNTOLD), section), field) == taken
    problems = [line for line in capsys.readouterr().out.splitlines() if "answer: " in line]
    assert len(problems) == len(said)
    for problem, part in zip(problems, said, strict=True):
        assert part in problem
        assert problem.endswith("Answer again.")


def test_a_wizard_that_ends_early_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = tmp_path / "dataset"
    invented_dataset(dataset, name="FlowHome", seed=5)
    monkeypatch.chdir(tmp_path)
    assert_one_line(init_with(monkeypatch, dataset, "ours\npog\n"), "--wizard: found no answer for design.kind")
    assert not (tmp_path / "study").exists()

    def interrupted(_: str) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", interrupted)
    done = init_with(monkeypatch, dataset, "")
    assert (done.returncode, done.stderr) == (130, "personal-viz: stopped\n")
    assert not (tmp_path / "study").exists()

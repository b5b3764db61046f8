"""The planner gives the figures of HUMAN_STUDY.md, sections 3 and 8, within the error of a few simulations."""

import json
from pathlib import Path

import numpy as np
import pytest

from human_study.design.plan import PlannedParticipant, PlannedTrial, StudyPlan, StudyScene, save_plan
from human_study.design.study import StudyAggregate, StudyDataset, StudyDesign, StudyMemory, save_study
from human_study.report.power import PowerAssumptions, PowerDesign, PowerRow, alternatives, design_of, power_row
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.cli.verbs import parse
from sim.errors import StudyError
from sim.types import SPLITS

from .report_examples import study_config
from .sequence_trials import sequence_study


def first_row(design: PowerDesign, *, sd: float, simulations: int = 120, **more: float) -> PowerRow:
    assumptions = PowerAssumptions.model_validate({"num_simulations": simulations} | more)
    return power_row(design, person_sd=sd, assumptions=assumptions)


@pytest.mark.release
@pytest.mark.parametrize(
    ("people", "episodes", "raters", "alike", "different"),
    [(5, 50, 5, 19, 35), (25, 50, 5, 18, 18), (5, 250, 1, 16, 35)],
    ids=["5 people, same 50", "25 people x 10", "5 people, own 50"],
)
def test_widths_are_those_of_the_design_document(
    people: int, episodes: int, raters: int, alike: float, different: float
) -> None:
    """250 trials per split. Own episodes come out 3 to 4 points wider than stated: our t keeps the people's df."""
    design = PowerDesign("one", people, episodes, raters)
    margin = 4.5 if raters == 1 else 2.5
    assert first_row(design, sd=0.3).width_split == pytest.approx(alike, abs=margin)
    assert first_row(design, sd=0.9).width_split == pytest.approx(different, abs=margin)


@pytest.mark.release
@pytest.mark.parametrize(
    ("people", "episodes", "expected"), [(5, 50, 0.37), (20, 50, 0.47), (5, 100, 0.62), (5, 200, 0.88), (10, 200, 0.95)]
)
def test_power_to_tell_splits_apart(people: int, episodes: int, expected: float) -> None:
    row = first_row(PowerDesign("one", people, episodes, people), sd=0.3, simulations=200)
    assert row.power_splits == pytest.approx(expected, abs=0.13)


@pytest.mark.release
def test_power_of_the_paired_comparison_with_an_agent() -> None:
    design = PowerDesign("one", 5, 50, 5)
    assert 0.35 <= first_row(design, sd=0.3, simulations=200).power_agent <= 0.6
    assert first_row(design, sd=0.3, agent_gap=0.36).power_agent >= 0.97


@pytest.mark.release
def test_false_alarms_are_about_as_rare_as_promised() -> None:
    """With almost no gap, findings are false alarms: at most 5 of 100, within the error of 200 draws."""
    design = PowerDesign("one", 10, 50, 5, num_conditions=2)
    row = first_row(design, sd=0.9, simulations=200, agent_gap=1e-6, split_gap=1e-6, memory_gap=1e-6)
    assert max(row.power_splits, row.power_agent, row.power_memory) <= 0.1


def test_more_people_narrow_the_interval_where_people_differ() -> None:
    few, many = (first_row(PowerDesign("one", n, 20, 4), sd=1.2, simulations=40) for n in (4, 20))
    assert many.width_total < 0.6 * few.width_total


def test_everybody_has_about_as_many_trials_and_nobody_an_episode_twice() -> None:
    design = PowerDesign("one", 20, 50, 5, num_conditions=2)
    met = [list(zip(*(side.tolist() for side in design.split_trials(c)), strict=True)) for c in (0, 1)]
    assert len(set(met[0] + met[1])) == 2 * 250
    people, counts = np.unique([who for who, _ in met[0] + met[1]], return_counts=True)
    assert len(people) == 20
    assert set(counts.tolist()) <= {24, 25, 26}
    for condition in met:
        per_episode = np.unique([where for _, where in condition], return_counts=True)[1]
        assert set(per_episode.tolist()) == {5}


def test_a_study_file_gives_its_design() -> None:
    crossed = study_config(design=StudyDesign(kind="crossed", raters_per_episode=5))
    found = design_of(crossed)
    assert (found.num_people, found.episodes_per_split, found.num_conditions) == (10, 4, 2)
    once = study_config(
        dataset=StudyDataset(sha256="d", splits=dict.fromkeys(SPLITS, 50)),
        design=StudyDesign(raters_per_episode=5, trials_per_person=30),
        memory=StudyMemory(arms=("none", "topdown")),
    )
    assert design_of(once).num_people == 50  # HUMAN_STUDY.md, section 3: 1500 trials, 50 people x 30
    assert design_of(once).trials_per_person == 30


def test_a_study_of_sequences_is_refused() -> None:
    with pytest.raises(StudyError, match="found sequences, a study of home sequences; expected one of episodes"):
        design_of(sequence_study())


def test_a_study_with_random_homes_is_simulated_with_them() -> None:
    config = study_config(aggregate=StudyAggregate(intervals="homes"))
    assert design_of(config).num_homes == 31
    assert design_of(study_config()).num_homes is None
    alike, apart = (
        first_row(PowerDesign("one", 20, 20, 5, num_homes=homes), sd=0.5, simulations=60, home_share=0.4)
        for homes in (None, 5)
    )
    assert apart.width_split > 1.2 * alike.width_split
    assert apart.width_total > 1.2 * alike.width_total


def test_alternatives_are_different_designs_and_say_what_they_spend() -> None:
    design = PowerDesign("mine", 25, 50, 5)
    found = alternatives(design)
    spent = {one.label: one.trials_per_split * one.num_splits for one in found}
    assert spent["as many trials, twice the people"] == 750
    assert spent["twice the trials: twice both"] == 1500
    assert len({(one.num_people, one.episodes_per_split, one.raters) for one in [design, *found]}) == len(found) + 1


def test_the_command_prints_the_same_twice_and_reads_the_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = study_config()
    save_study(tmp_path, config)
    trials = [
        PlannedTrial(order_no=n, task="pan", condition="none", split=split, scene="Home0", episode_id=str(n), rep=1)
        for n, split in enumerate(SPLITS, start=1)
    ]
    people = [PlannedParticipant(code=f"p0{n}", task="pan", arm=n % 2, trials=tuple(trials)) for n in (1, 2, 3, 4)]
    people.append(PlannedParticipant(code="p05", task="pan", arm=0, trials=()))
    plan = StudyPlan(
        study_version=config.study_version, scenes=(StudyScene(name="Home0", kind="scan"),), participants=tuple(people)
    )
    assert (design_of(config, plan).num_people, design_of(config, plan).episodes_per_split) == (4, 1)
    save_plan(tmp_path, plan)
    assert StudyPlanVerb(study=tmp_path, power=True, simulations=20, json=True, person_sd=(0.5,)).run() == 0
    printed = capsys.readouterr().out
    assert StudyPlanVerb(study=tmp_path, power=True, simulations=20, json=True, person_sd=(0.5,)).run() == 0
    assert capsys.readouterr().out == printed
    assert json.loads(printed)["rows"][0]["num_people"] == 4
    assert StudyPlanVerb(power=True, people=6, episodes=10, raters=3, simulations=20, person_sd=(0.5,)).run() == 0
    assert "| 6 people | 6 | 10 | 3 |" in capsys.readouterr().out


def test_impossible_options_are_refused() -> None:
    with pytest.raises(StudyError, match="expected all within 0 and 1"):
        StudyPlanVerb(power=True, base_rate=0.9, memory_gap=0.2).run()
    with pytest.raises(StudyError, match="raters times conditions people"):
        StudyPlanVerb(power=True, people=3, raters=5).run()
    with pytest.raises(StudyError, match="0 or at least 2 homes"):
        StudyPlanVerb(power=True, homes=1).run()
    with pytest.raises(StudyError, match="raters times conditions people"):
        StudyPlanVerb(power=True, people=5, raters=5, conditions=2).run()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("--base-rate 1.5", "--base-rate: base_rate is 1.5; expected: Input should be less than 1"),
        ("--gap 0", "--gap: agent_gap is 0.0; expected: Input should be greater than 0"),
        ("--split-gap -0.2", "--split-gap: split_gap is -0.2; expected: Input should be greater than 0"),
        ("--memory-gap 2", "--memory-gap: memory_gap is 2.0; expected: Input should be less than 1"),
        (
            "--person-sd 0.3 -1",
            "--person-sd: person_sds.1 is -1.0; expected: Input should be greater",
        ),
        ("--person-sd", "--person-sd: person_sds is (); expected: Tuple should have at least 1 item"),
        ("--episode-sd nan", "--episode-sd: episode_sd is nan; expected: Input should be"),
        (
            "--simulations 3",
            "--simulations: num_simulations is 3; expected: Input should be greater than or equal to 20",
        ),
        ("--seed -1", "--seed: seed is -1; expected: Input should be greater than or equal to 0"),
    ],
)
def test_an_option_out_of_its_range_is_one_line(options: str, line: str) -> None:
    with pytest.raises(StudyError) as caught:
        parse(["study", "plan", "--power", *options.split()]).run()
    assert str(caught.value).startswith(f"study plan --power, {line}")


def test_every_option_of_the_command_reaches_the_simulation(capsys: pytest.CaptureFixture[str]) -> None:
    options = "--people 8 --episodes 10 --raters 2 --conditions 2 --base-rate 0.6 --gap 0.2 --split-gap 0.12"
    options += " --homes 4 --memory-gap 0.3 --person-sd 0.4 0.8 --episode-sd 1.1 --simulations 25 --seed 7 --json"
    assert parse(["study", "plan", "--power", *options.split()]).run() == 0
    found = json.loads(capsys.readouterr().out)
    assert found["assumptions"] == {
        "base_rate": 0.6,
        "split_gap": 0.12,
        "agent_gap": 0.2,
        "memory_gap": 0.3,
        "person_sds": [0.4, 0.8],
        "episode_sd": 1.1,
        "agent_alike": 0.5,
        "home_share": 0.15,
        "num_simulations": 25,
        "seed": 7,
    }
    assert (found["rows"][0]["design"], found["rows"][0]["trials"]) == ("8 people", 3 * 10 * 2 * 2)
    assert found["rows"][0]["power_memory"] is not None
    assert found["num_homes"] == 4


@pytest.mark.slow
def test_the_options_defaults_are_those_of_the_assumptions(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--people", "4", "--episodes", "4", "--raters", "2", "--json"]
    assert parse(["study", "plan", "--power", *options]).run() == 0
    found = PowerAssumptions.model_validate(json.loads(capsys.readouterr().out)["assumptions"])
    assert found == PowerAssumptions()

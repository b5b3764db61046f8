"""Verb `study plan`: draws episodes, assigns them to people, freezes the study; or says how precise it will be."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import ValidationError
from tyro.conf import Positional, arg

from human_study.design.plan import PLAN_FILE, StudyPlan, load_plan, per_person
from human_study.design.study import StudyConfig, load_study
from human_study.store.records import DATABASE_FILE
from sim.errors import StudyError, line_from_validation_error
from sim.words.english import how_many

from ...study_app.study_files import plan_study
from ..options import Evidence, ScenesDir, Sequences, dataset_options
from ..output import print_json

_OPTIONS = {"agent_gap": "gap", "person_sds": "person_sd", "num_simulations": "simulations"}
"""Names of options whose name differs from their field in the assumptions."""


@dataclass
class StudyPlanVerb:
    """Draw the episodes, assign them to people, freeze the study; --power says beforehand how precise it will be."""

    study: Positional[Path | None] = None
    dataset: Annotated[Path | None, arg(help="Folder of the PersONAL episodes; not needed for --power.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    sequences: Sequences = None
    pilot: Annotated[bool, arg(help="May be served without an ethics id; all records say that it is a pilot.")] = False
    power: Annotated[bool, arg(help="Only simulate: width of intervals, power, and better designs.")] = False
    people: Annotated[int, arg(help="--power without a study: total number of people.")] = 25
    episodes: Annotated[int, arg(help="--power without a study: episodes of each split.")] = 50
    raters: Annotated[int, arg(help="--power without a study: people per episode and condition.")] = 5
    conditions: Annotated[
        int, arg(help="--power without a study: number of conditions, such as 2 (without and with memory).")
    ] = 1
    homes: Annotated[
        int, arg(help="--power without a study: homes, random in intervals; 0 = only episodes are random.")
    ] = 31
    base_rate: Annotated[float, arg(help="--power: success rate of people.")] = 0.65
    gap: Annotated[float, arg(help="--power: how much worse an agent is than people.")] = 0.15
    split_gap: Annotated[float, arg(help="--power: difference between two splits.")] = 0.10
    memory_gap: Annotated[float, arg(help="--power: how much better people are with memory.")] = 0.10
    person_sd: Annotated[tuple[float, ...], arg(help="--power: SDs between people (logit), a table each.")] = (0.3, 0.9)
    episode_sd: Annotated[float, arg(help="--power: standard deviation (SD) between episodes (logit).")] = 1.3
    simulations: Annotated[int, arg(help="--power: number of simulated studies per figure.")] = 150
    seed: Annotated[int, arg(help="--power: seed of the draws.")] = 0
    json: bool = False

    def run(self) -> int:
        if self.power:
            return self._simulate()
        if self.study is None or self.dataset is None:
            raise StudyError(
                f"study plan: found no {'study' if self.study is None else '--dataset'}; expected a study folder and "
                "its dataset. Give both, or --power to simulate only."
            )
        if (self.study / DATABASE_FILE).exists():
            raise StudyError(
                f"{self.study / DATABASE_FILE}: found records, so the study has begun; expected none. A plan never "
                "changes after that: give a new study another folder."
            )
        places = {"evidence": self.evidence, "sequences": self.sequences}
        made = plan_study(self.study, self.dataset, self.scenes_dir, **places, pilot=self.pilot)
        facts = _facts(made, load_study(self.study))
        if self.json:
            print_json({"written": str(self.study / PLAN_FILE), **facts})
            return 0
        _print_plan(made, facts)
        next_verb = f"personal-viz study serve {self.study} {dataset_options(self.dataset, self.evidence)}"
        print(f"Written to {self.study / PLAN_FILE}. Next: {next_verb}")
        return 0

    def _simulate(self) -> int:
        """Prints the precision of a design and of similar ones; the same options print the same.

        Raises:
            StudyError: The folder holds no study, or an option is out of range.
        """
        from human_study.report.power import PowerAssumptions, PowerDesign, design_of, power_report
        from human_study.report.render import power_markdown

        if self.study is not None:
            config = load_study(self.study)
            design = design_of(config, load_plan(self.study, config) if (self.study / PLAN_FILE).is_file() else None)
        else:
            people, episodes, raters, conditions = self.people, self.episodes, self.raters, self.conditions
            if (
                min(people, episodes, raters, conditions) < 1
                or raters * conditions > people
                or self.homes < 0
                or self.homes == 1
            ):
                raise StudyError(
                    f"study plan --power: found {people} people, {episodes} episodes, {raters} raters, {conditions} "
                    f"conditions and {self.homes} homes; expected each at least 1, at least raters times conditions "
                    "people, and 0 or at least 2 homes. Change one of them."
                )
            design = PowerDesign(
                f"{people} people", people, episodes, raters, num_conditions=conditions, num_homes=self.homes or None
            )
        fields = {
            "base_rate": self.base_rate,
            "agent_gap": self.gap,
            "split_gap": self.split_gap,
            "memory_gap": self.memory_gap,
            "person_sds": tuple(dict.fromkeys(self.person_sd)),
            "episode_sd": self.episode_sd,
            "num_simulations": self.simulations,
            "seed": self.seed,
        }
        try:
            assumptions = PowerAssumptions.model_validate(fields)
        except ValidationError as error:
            field = str(error.errors()[0]["loc"][0])
            where = f"study plan --power, --{_OPTIONS.get(field, field).replace('_', '-')}"
            raise StudyError(line_from_validation_error(where, error, advice="Change this option.")) from None
        found = power_report(design, assumptions=assumptions)
        print(found.model_dump_json(indent=2) if self.json else power_markdown(found), end="\n" if self.json else "")
        return 0


def _facts(made: StudyPlan, config: StudyConfig) -> dict[str, Any]:
    """What `study plan` says of a plan: its sizes, the trials of each person, and what differs from the study file."""
    counted = [(person.code, trial) for person in made.participants for trial in person.trials if trial.phase == "main"]
    trials = Counter(code for code, _ in counted)
    visits = Counter((code, trial.scene) for code, trial in counted)
    return {
        "study": config.study,
        "design": config.design.kind,
        "episodes" if config.sequences is None else "sequences": len({trial.key for _, trial in counted}),
        "homes": dict(sorted(Counter(scene.kind for scene in made.scenes).items())),
        "people": len(trials),
        "spare_people": len(made.participants) - len(trials),
        "trials": len(counted),
        "people_by_trials": {str(number): people for number, people in sorted(Counter(trials.values()).items())},
        "per_person": per_person(made.participants),
        "most_in_one_home": max(visits.values(), default=0),
        "changes": made.changes,
    }


def _print_plan(made: StudyPlan, facts: Mapping[str, Any]) -> None:
    what = "sequences" if "sequences" in facts else "episodes"
    number, homes = how_many(facts[what], what.removesuffix("s")), how_many(len(made.scenes), "home")
    print(f"{facts['study']}: {number} in {homes}, design {facts['design']}")
    sizes = ", ".join(f"{people} people x {number} trials" for number, people in facts["people_by_trials"].items())
    spare = facts["spare_people"]
    print(f"  {facts['trials']} counted trials: {sizes}" + (f"; {spare} spare people" if spare else ""))
    ranges = (f"{split} " + " to ".join(map(str, sorted(set(of)))) for split, of in facts["per_person"].items())
    print(f"  trials of each split that a person has: {', '.join(ranges)}")
    for change in made.changes:
        print(f"  Other than asked: {change}.")
    print(f"  most trials of one person in one home: {facts['most_in_one_home']}")
    print("  homes: " + ", ".join(f"{count} {kind}" for kind, count in facts["homes"].items()))
    if set(facts["homes"]) != {"scan"}:
        print("  Not a human baseline for PersONAL: that is claimed on scans only.")

"""Verb `study init`: writes a study file, consent and instructions for the researcher to read and change."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from human_study.design.study import (
    MAX_STUDY_NAME,
    SCHEMA_FILE,
    STUDY_FILE,
    Language,
    StudyAggregate,
    StudyBreaks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudySequences,
    save_study,
)
from human_study.private_files import write_private
from human_study.texts.participants import TEXT_FILES, write_texts
from human_study.texts.words import empty_fields
from personal_viz.study_app.recruit_codes import CODES_FILE
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.errors import StudyError
from sim.types import SPLITS, Split

from ..options import Dataset, Evidence, Sequences, dataset_options
from .wizard import asked

CODES_TEMPLATE = """# Codes that the recruiting platform gave for this study; uncomment with
# recruit.kind: prolific. Never share this file.
# [prolific]
# completion = ""
# screen_out = ""
# no_consent = ""
"""
HOMES_PER_PERSON = 6
"""About an hour and a half of 7 searches in a home, 2 minutes each."""


@dataclass
class StudyInit:
    """Write a study file, consent and instructions for you to read and change."""

    study: Positional[Path]
    dataset: Dataset
    evidence: Evidence = ()
    sequences: Sequences = None
    name: Annotated[str | None, arg(help="Public name of the study; that of the folder by default.")] = None
    task: Annotated[tuple[Literal["pan", "pog"], ...], arg(help="Both: each participant does one of them.")] = ("pan",)
    design: Literal["house-once", "crossed"] = "house-once"
    language: Annotated[Language, arg(help="Language of the texts for participants.")] = "en"
    per_split: Annotated[int, arg(help="Episodes of each split.")] = 50
    seed: int = 0
    wizard: Annotated[bool, arg(help="Ask here for what only a person knows, such as pay and approval.")] = False

    def run(self) -> int:
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        found = {episode.key.split for episode in episodes.episodes()}
        splits: dict[Split, int | Literal["all"]] = {split: self.per_split for split in SPLITS if split in found}
        if (self.study / STUDY_FILE).exists():
            raise StudyError(
                f"{self.study / STUDY_FILE}: exists already; expected a new folder. Give another, or edit it."
            )
        config = StudyConfig(
            study=self.name or _study_name(self.study),
            dataset=StudyDataset(sha256=episodes.digest(), splits=splits, seed=self.seed),
            task=self.task,
            language=self.language,
            design=StudyDesign(kind=self.design),
            storey_names="texts",
            aggregate=StudyAggregate(intervals="homes"),
        )
        if self.sequences is not None:
            config = _of_sequences(config, SequenceSet(self.sequences))
        if self.wizard:
            config = asked(config)
        save_study(self.study, config)
        write_texts(self.study, self.language)
        write_private(self.study / CODES_FILE, CODES_TEMPLATE)
        print(f"Written to {self.study}: {STUDY_FILE}, {SCHEMA_FILE}, {', '.join(TEXT_FILES)}, {CODES_FILE}")
        left = [field for field in empty_fields(config) if field != "ethics.duration_min"]  # the plan estimates it
        if left:
            print(f"Before people take part, fill these in {STUDY_FILE}: {', '.join(left)}")
        told = "" if self.sequences is None else f" --sequences {self.sequences}"
        print(f"Next: personal-viz study plan {self.study} {dataset_options(self.dataset, self.evidence)}{told}")
        return 0


def _of_sequences(config: StudyConfig, told: SequenceSet) -> StudyConfig:
    """The study with a set of home sequences: as many homes for a person as fit one sitting, with breaks between."""
    most = None if config.design.kind == "crossed" else HOMES_PER_PERSON
    fields = {
        "sequences": StudySequences(sha256=told.digest()),
        "dataset": config.dataset.model_copy(update={"max_per_scene": None}),
        "design": config.design.model_copy(update={"trials_per_person": most}),
        "breaks": StudyBreaks(every=2, sitting_max=HOMES_PER_PERSON),
    }
    return config.model_copy(update=fields)


def _study_name(folder: Path) -> str:
    """The folder's name, changed where needed into a valid name of a study."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-")[:MAX_STUDY_NAME] or "study"

"""Verb `study purge-ids`: deletes the platform ids that were kept for paying people."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from human_study.design.study import load_study
from personal_viz.study_app.gateway.admission import PAY_FILE, PayFile


@dataclass
class StudyPurgeIds:
    """Delete the ids of a recruiting platform that were kept for paying people."""

    study: Positional[Path]

    def run(self) -> int:
        config = load_study(self.study)
        num_ids = PayFile(self.study).purge()
        print(
            f"{config.study}: {num_ids} platform ids deleted from {self.study / PAY_FILE}; "
            "delete copies elsewhere yourself"
        )
        return 0

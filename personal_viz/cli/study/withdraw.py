"""Verb `study withdraw`: withdraws a participant on request; if a process serves the study, that process does it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from human_study.design.study import load_study
from human_study.store.requests import Withdrawal, change_study


@dataclass
class StudyWithdraw:
    """Withdraw a participant who asked you to; what was done is deleted if the study file says so."""

    study: Positional[Path]
    participant: Annotated[
        Positional[str], arg(metavar="p02", help="The code that study status shows; exports number people anew.")
    ]

    def run(self) -> int:
        config = load_study(self.study)
        change_study(self.study, [Withdrawal(participant=self.participant)])
        done = "everything done is deleted" if config.privacy.on_withdraw == "delete" else "what was done is kept"
        print(f"{self.study}: {self.participant} has withdrawn; {done}")
        return 0

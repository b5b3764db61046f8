"""Verb `study check-db`: checks whether a study's database is whole; brings an older one up to date."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from human_study.store.database import bring_up_to_date, close_to_others, require_keys, require_same_files
from human_study.store.records import read_study


@dataclass
class StudyCheckDb:
    """Check the study's database: integrity and hash chains; an older one is brought up to date first."""

    study: Positional[Path]

    def run(self) -> int:
        for version in bring_up_to_date(self.study):
            print(f"{self.study}: brought to schema version {version}; a copy of the earlier file is in backups")
        with read_study(self.study) as reader:
            num_events = reader.check()
            require_keys(reader)
            require_same_files(reader)
        close_to_others(self.study)
        print(f"{self.study}: {num_events} events, database and hash chains are whole, and the keys open them")
        return 0

"""The verbs of studies with people."""

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import subcommand

from .bots import StudyBots
from .check_db import StudyCheckDb
from .doctor import StudyDoctor
from .ethics import StudyEthics
from .exclude import StudyExclude
from .export import StudyExport
from .import_check import StudyImportCheck
from .init import StudyInit
from .plan import StudyPlanVerb
from .purge_ids import StudyPurgeIds
from .report import StudyReportVerb
from .serve import StudyServe
from .status import StudyStatus
from .verify import StudyVerify
from .withdraw import StudyWithdraw


@dataclass
class Study:
    """Studies with people."""

    verb: (
        Annotated[StudyInit, subcommand("init")]
        | Annotated[StudyPlanVerb, subcommand("plan")]
        | Annotated[StudyEthics, subcommand("ethics")]
        | Annotated[StudyServe, subcommand("serve")]
        | Annotated[StudyStatus, subcommand("status")]
        | Annotated[StudyDoctor, subcommand("doctor")]
        | Annotated[StudyBots, subcommand("bots")]
        | Annotated[StudyWithdraw, subcommand("withdraw")]
        | Annotated[StudyPurgeIds, subcommand("purge-ids")]
        | Annotated[StudyExclude, subcommand("exclude")]
        | Annotated[StudyCheckDb, subcommand("check-db")]
        | Annotated[StudyVerify, subcommand("verify")]
        | Annotated[StudyExport, subcommand("export")]
        | Annotated[StudyImportCheck, subcommand("import-check")]
        | Annotated[StudyReportVerb, subcommand("report")]
    )

    def run(self) -> int:
        return self.verb.run()

"""`study serve` with choices that have no flag, started by tests: FOLDER DATASET PORT and, as JSON, those choices.

They are `page_version`, as if this program were another version, and `patience_s` and `every_s` of the heartbeat.
"""

import json
import sys
from pathlib import Path

from personal_viz.cli.study.serve import StudyServe
from personal_viz.study_app.gateway.heartbeat import Heartbeat
from personal_viz.study_app.gateway.options import ServeOptions


def main() -> None:
    """Serves until Ctrl-C or SIGTERM."""
    folder, dataset, port, given = sys.argv[1:]
    choices = {"page_version": None, "patience_s": 90.0, "every_s": 5.0, "workers": 1, **json.loads(given)}
    options = ServeOptions(
        port=int(port),
        pilot=True,
        workers=choices["workers"],
        page_version=choices["page_version"],
        heartbeat=Heartbeat(every_s=choices["every_s"], patience_s=choices["patience_s"]),
    )
    StudyServe(Path(dataset), Path(folder), serving=options).run()


if __name__ == "__main__":
    main()

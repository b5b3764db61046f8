"""Writes the literals of this folder: `python -m tests.release.record [NAME...]`, at the commit to be frozen.

They were made on 2026-11-23 from commit 0d21b8b itself, in a clone of it with this folder copied to tests/release:

    git checkout 0d21b8b
    python -m tests.release.record          # data/*.json: what the program says about the runs, the homes and the maps

The inputs data/runs, data/study and data/study-agents were written at that commit too, by stored.py, which
`git log -- tests/release/stored.py` still shows. The scene digest in the steps of data/runs was replaced on 2026-11-23:
HOMES_VERSION 2 draws some wood grain differently, and `replay` refuses runs of another digest. No literal changed.

Each file names the commit of its literal. To change one, write it again at the commit that changes the behaviour and
give the reason in the file's `reason`. The files hold ids and numbers only, no text of an episode.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.conftest import SHARED

from . import answers
from .doors import open_home

DATASET = SHARED / "personal-dataset" / "split"
GOLDEN = SHARED / "habitat-golden"


def home(dataset: Path, name: str, plan: Path) -> dict[str, Any]:
    """All frozen values of one home."""
    opened = open_home(dataset, name)
    paths, views = answers.chosen_paths(opened), answers.chosen_views(opened)
    return {
        "objects": answers.home_poses(opened, plan),
        "areas": answers.home_areas(opened),
        "paths": {"ends": paths, "lengths": answers.path_lengths(opened, paths)},
        "depth": {"views": views, "mm": answers.depth_mm(opened, views)},
    }


def invented_homes(out: Path) -> dict[str, Any]:
    """The two invented homes, by name."""
    dataset = answers.invented(out)
    return {name: home(dataset, name, dataset / "scenes" / f"{name}.plan.json") for name in answers.INVENTED}


def recovered_home(out: Path) -> dict[str, Any]:
    """One home made from its episodes alone."""
    answers.homes_totals(DATASET, answers.RECOVERED, plans=out)
    return {answers.RECOVERED: home(DATASET, answers.RECOVERED, out / f"{answers.RECOVERED}.plan.json")}


LITERALS: dict[str, Callable[[Path], Any]] = {
    "invented-homes": invented_homes,
    "recovered-home": recovered_home,
    "homes": lambda out: answers.homes_totals(DATASET),
    "homes-sample": lambda out: answers.homes_totals(DATASET, *answers.SAMPLE),
    "ground": lambda out: {method: answers.ground_answers(DATASET, out, method) for method in answers.METHODS},
    "check-habitat": lambda out: answers.habitat_agreement(GOLDEN),
    "metrics": lambda out: answers.metrics_of_runs(),
    "report": lambda out: answers.report_numbers(out),
    "replay": lambda out: answers.replayed_rows(DATASET, out / "runs.rrd"),
}


def main(names: list[str]) -> None:
    """Writes the named literals, or all."""
    commit = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()
    for name in names or LITERALS:
        with tempfile.TemporaryDirectory() as out:
            document = {"commit": commit, "reason": "first literals", "values": LITERALS[name](Path(out))}
        (answers.DATA / f"{name}.json").write_text(_readable(document) + "\n", encoding="utf-8")
        print(f"{name}.json written at {commit[:7]}")


def _readable(value: Any, indent: str = "") -> str:
    """JSON with one line per value that is short enough."""
    line = json.dumps(value)
    if len(indent) + len(line) <= 300 or not isinstance(value, dict | list):
        return line
    deeper = indent + " "
    if isinstance(value, dict):
        body = [f"{deeper}{json.dumps(key)}: {_readable(one, deeper)}" for key, one in value.items()]
        return "{\n" + ",\n".join(body) + f"\n{indent}}}"
    if all(isinstance(one, int | float | None) for one in value):
        return line
    return "[\n" + ",\n".join(deeper + _readable(one, deeper) for one in value) + f"\n{indent}]"


if __name__ == "__main__":
    main(sys.argv[1:])

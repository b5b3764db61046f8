"""Tables of stored runs, tables of a stored study and a recording hold the same values as at commit 0d21b8b."""

from pathlib import Path

from .answers import literal, metrics_of_runs, replayed_rows, report_numbers
from .differences import differences

REL = 1e-6
"""Allows for sums that are computed in another order."""


def test_metrics_of_stored_runs_are_the_same() -> None:
    assert differences(literal("metrics"), metrics_of_runs(), rel=REL) == []


def test_the_report_on_a_stored_study_has_the_same_numbers(tmp_path: Path) -> None:
    frozen, found = literal("report"), report_numbers(tmp_path)
    assert differences(frozen, found, rel=REL, absolute=1e-9) == []
    # no person or trial may be added; measures may be (here sr_strict and far_from_view)
    for table in ("outcomes", "left_out"):
        assert frozen[table].keys() == found[table].keys()
    groups = [{name.rpartition(" | ")[0] for name in numbers["rows"]} for numbers in (frozen, found)]
    assert groups[0] == groups[1]


def test_a_recording_has_the_same_entities_and_rows(dataset_root: Path, tmp_path: Path) -> None:
    assert differences(literal("replay"), replayed_rows(dataset_root, tmp_path / "runs.rrd")) == []

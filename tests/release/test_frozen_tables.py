"""Tables of stored runs and of a stored study say what commit 0d21b8b said; a recording holds what it held."""

from pathlib import Path

from .answers import literal, metrics_of_runs, replayed_rows, report_numbers
from .differences import differences

REL = 1e-6
"""Sums may be taken in another order."""


def test_metrics_of_stored_runs() -> None:
    assert differences(literal("metrics"), metrics_of_runs(), rel=REL) == []


def test_numbers_of_the_report_on_a_stored_study(tmp_path: Path) -> None:
    frozen, found = literal("report"), report_numbers(tmp_path)
    assert differences(frozen, found, rel=REL, absolute=1e-9) == []
    # people and trials that were not there may not count; measures may join (here sr_strict and far_from_view)
    for table in ("outcomes", "left_out"):
        assert frozen[table].keys() == found[table].keys()
    groups = [{name.rpartition(" | ")[0] for name in numbers["rows"]} for numbers in (frozen, found)]
    assert groups[0] == groups[1]


def test_entities_and_rows_of_a_recording(dataset_root: Path, tmp_path: Path) -> None:
    assert differences(literal("replay"), replayed_rows(dataset_root, tmp_path / "runs.rrd")) == []

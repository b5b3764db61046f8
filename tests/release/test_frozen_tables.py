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
    for table in ("rows", "outcomes", "left_out"):  # people and trials that were not there may not count
        assert frozen[table].keys() == found[table].keys()


def test_entities_and_rows_of_a_recording(dataset_root: Path, tmp_path: Path) -> None:
    assert differences(literal("replay"), replayed_rows(dataset_root, tmp_path / "runs.rrd")) == []

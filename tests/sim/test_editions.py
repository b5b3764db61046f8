"""Editions of the authors' episodes are known by their content, named in run files and never compared."""

from pathlib import Path

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.episodes.editions import edition_of
from sim.errors import RunFileError
from sim.tasks.metrics import require_comparable
from sim.tasks.run_files import RunInfo

from .worlds import run_info

FIRST, SECOND = "a21ece7a650d" + "0" * 52, "804b31a5da9b" + "0" * 52


def test_an_edition_is_known_by_its_digest_and_anything_else_is_own() -> None:
    names = ["2025-09 (data/split)", "2025-12 (data/new)", "own", ""]
    assert [edition_of(digest) for digest in (FIRST, SECOND, "b" * 64, "")] == names


def test_a_run_file_names_the_edition_of_its_digest_whatever_the_file_says() -> None:
    info = run_info("r", dataset_digest=FIRST)
    assert info.edition == "2025-09 (data/split)"
    raw = info.model_dump(mode="json")
    assert RunInfo.model_validate(raw | {"dataset_digest": SECOND}).edition == "2025-12 (data/new)"
    assert RunInfo.model_validate({key: value for key, value in raw.items() if key != "edition"}) == info


def test_runs_on_two_editions_are_refused_by_their_names() -> None:
    with pytest.raises(RunFileError, match=r"804b31a5da9b \(b, edition 2025-12 \(data/new\)\), a21ece7a650d \(a, edi"):
        require_comparable([run_info("a", dataset_digest=FIRST), run_info("b", dataset_digest=SECOND)])


def test_the_shared_release_is_the_first_edition(dataset_root: Path) -> None:
    assert edition_of(PersonalDataset(dataset_root).digest()) == "2025-09 (data/split)"

"""`ground` on oracle maps of all released episodes gives the answers of commit 0d21b8b; scores to 2e-6."""

from pathlib import Path

import pytest

from .answers import METHODS, ground_answers, literal
from .differences import differences


@pytest.mark.parametrize("method", METHODS)
def test_ground_gives_the_same_answers(method: str, dataset_root: Path, tmp_path: Path) -> None:
    frozen, found = literal("ground")[method], ground_answers(dataset_root, tmp_path, method)
    assert frozen["digests"].keys() == found["digests"].keys()
    assert differences(frozen, found, absolute=2e-6) == []

"""`check-habitat` finds the agreement that commit 0d21b8b found, to the last digit."""

from pathlib import Path

from .answers import habitat_agreement, literal
from .differences import differences


def test_agreement_with_habitat_is_the_same(golden_root: Path) -> None:
    assert differences(literal("check-habitat"), habitat_agreement(golden_root)) == []

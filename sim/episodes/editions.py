"""Names of the editions of PersONAL's episodes, which share homes and objects but no episode (DESIGN.md)."""

_EDITIONS = {"a21ece7a650d": "2025-09 (data/split)", "804b31a5da9b": "2025-12 (data/new)"}
"""Name of each of the authors' editions by the first 12 hex digits of `PersonalDataset.digest`."""
OWN = "own"
"""Name of all other episodes; also of the authors' with evidence, which changes the digest because it changes homes."""


def edition_of(digest: str) -> str:
    """Name of the edition with this `PersonalDataset.digest`; empty for no episodes."""
    return _EDITIONS.get(digest[:12], OWN) if digest else ""

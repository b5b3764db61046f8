"""Verb `study purge-ids`: forgets the platform ids that were kept for paying people."""

from pathlib import Path

from human_study.design.study import load_study
from personal_viz.study_app.gateway.admission import PAY_FILE, PayFile


def purge_ids(*, study: Path) -> int:
    """Deletes the ids of a study; its records hold only keyed hashes of them.

    Args:
        study: Folder of the study, which may be served meanwhile.
    """
    config = load_study(study)
    num_ids = PayFile(study).purge()
    print(f"{config.study}: {num_ids} platform ids deleted from {study / PAY_FILE}; delete copies elsewhere yourself")
    return 0

"""Checks that a study's files still fit its database: the original study and plan, and keys that open it."""

from sim.errors import StudyError

from ..design.plan import PLAN_FILE, load_plan
from ..design.study import STUDY_FILE, load_study
from .records import StudyReader
from .vault import KEYS_FILE, Vault


def require_same_files(reader: StudyReader) -> None:
    """Refuses a folder whose `study.yaml` or `plan.json` was changed after the start; a missing file is ignored.

    Raises:
        StudyError: A file is damaged, has another format version, or is not the original one.
    """
    if not (reader.folder / STUDY_FILE).is_file():
        return
    config = load_study(reader.folder)
    _require_same(reader, STUDY_FILE, "study_version", config.study_version, reader.study_version)
    if (reader.folder / PLAN_FILE).is_file():
        found = load_plan(reader.folder, config).plan_version
        _require_same(reader, PLAN_FILE, "plan_version", found, reader.plan.plan_version)


def require_keys(reader: StudyReader) -> None:
    """Refuses a folder whose `keys.json` does not open each participant's records, unless they were deleted.

    Studies of the first version need no keys, because their records are plain text.

    Raises:
        StudyError: The file is missing or damaged, or a participant's key is missing or wrong.
    """
    vault, codes = Vault(reader.folder), reader.codes()
    of_trial = "JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
    sealed = reader.rows(
        f"SELECT code, trial_id || '/' || seq, payload FROM event {of_trial} WHERE seq = 1 UNION ALL"
        f" SELECT code, trial_id || '/outcome', payload FROM outcome {of_trial}"
    )
    if any(payload.startswith("{") for *_, payload in sealed):
        codes = tuple(code for code, _, payload in sealed if not payload.startswith("{"))
    withdrew = {code for (code,) in reader.rows("SELECT code FROM stage WHERE stage = 'withdrawn'")}
    deleted = withdrew if reader.config.privacy.on_withdraw == "delete" else set()
    lost = sorted({code for code in codes if not (vault.has_key(code) or vault.is_shredded(code) or code in deleted)})
    if lost:
        path = reader.folder / KEYS_FILE
        found = f"has no key of {', '.join(lost[:3])}" if path.exists() else "found no such file"
        more = f" and {len(lost) - 3} more" if path.exists() and len(lost) > 3 else ""
        raise StudyError(
            f"{path}: {found}{more}; expected a key of each participant who has not withdrawn. Restore the file: "
            "without it nothing that they did can be read."
        )
    for code, where, payload in sealed:
        if vault.has_key(code):
            vault.open(code, payload, where=where)


def _require_same(reader: StudyReader, name: str, what: str, found: str, expected: str) -> None:
    if found != expected:
        raise StudyError(
            f"{reader.folder / name}: {what} is {found[:12]}; expected {expected[:12]}, which the database holds. "
            "It was changed after the start: restore it. The records are whole, and say themselves how they were made."
        )

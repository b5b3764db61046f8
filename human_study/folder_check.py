"""Whether a study's files still say what its database holds: what people did was done under that, and nothing else."""

from sim.errors import StudyError

from .plan import PLAN_FILE, load_plan
from .records import StudyReader
from .study import STUDY_FILE, load_study


def require_same_files(reader: StudyReader) -> None:
    """Refuses a folder whose `study.yaml` or `plan.json` was changed after the start; one that has none has no say.

    Raises:
        StudyError: A file is damaged, of another version of the format, or not the one that the study began with.
    """
    if not (reader.folder / STUDY_FILE).is_file():
        return
    config = load_study(reader.folder)
    _require_same(reader, STUDY_FILE, "study_version", config.study_version, reader.study_version)
    if (reader.folder / PLAN_FILE).is_file():
        found = load_plan(reader.folder, config).plan_version
        _require_same(reader, PLAN_FILE, "plan_version", found, reader.plan.plan_version)


def _require_same(reader: StudyReader, name: str, what: str, found: str, expected: str) -> None:
    if found != expected:
        raise StudyError(
            f"{reader.folder / name}: {what} is {found[:12]}; expected {expected[:12]}, which the database holds. "
            "It was changed after the start: restore it. The records are whole, and say themselves how they were made."
        )

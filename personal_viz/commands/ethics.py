"""Verb `study ethics`: the documents for an ethics board and a registry, and texts for participants filled in."""

from collections import Counter
from pathlib import Path

from human_study.ethics.documents import ethics_documents
from human_study.ethics.sheets import open_places, with_filled_places
from human_study.plan import PLAN_FILE, StudyPlan, load_plan
from human_study.records import DATABASE_FILE
from human_study.study import StudyConfig, load_study, write_whole
from sim.errors import StudyError

CONSENT_FILE = "consent.md"
TEXT_FILES = (CONSENT_FILE, "instructions.md")
"""What participants read."""


def ethics(*, study: Path, out: Path, fill: bool = False) -> int:
    """Writes protocol, information sheet, consent, data flow, retention, time and pay, and preregistration.

    Args:
        study: Folder with study.yaml, with or without a plan.
        out: Folder for the documents; files of these names are replaced.
        fill: First put what study.yaml says by now in place of the marks in the study's own consent.md and
            instructions.md; the plan must be made again after that.

    Raises:
        StudyError: The study file cannot be read, the study has begun (`fill`), or `out` cannot be written.
    """
    config = load_study(study)
    plan = load_plan(study, config) if (study / PLAN_FILE).is_file() else None
    if fill:
        _fill(study, config, plan)
    consent = study / CONSENT_FILE
    text = consent.read_text(encoding="utf-8") if consent.is_file() else None
    documents = ethics_documents(config, plan, consent=text)
    for name, document in documents.items():
        write_whole(out / name, document)
    print(f"Written to {out}: {', '.join(documents)}")
    marks = Counter(field for document in documents.values() for field in open_places(document))
    if plan is None:
        print(f"The numbers of people and trials come with the plan: personal-viz study plan {study}")
    if marks:
        fields = ", ".join(f"{field} (in {count})" for field, count in sorted(marks.items()))
        print(f"{sum(marks.values())} places are to be filled in: {fields}")
    else:
        print("Nothing is left to be filled in. Read every document before you hand it on.")
    return 0


def _fill(study: Path, config: StudyConfig, plan: StudyPlan | None) -> None:
    """Replaces the marks in the study's own texts.

    Raises:
        StudyError: People have read them already.
    """
    if (study / DATABASE_FILE).exists():
        raise StudyError(
            f"{study / DATABASE_FILE}: the study has begun; expected one that nobody has read the texts of. Leave "
            "--fill out."
        )
    for name in TEXT_FILES:
        path = study / name
        if not path.is_file():
            continue
        before = path.read_text(encoding="utf-8")
        after = with_filled_places(before, config, plan=plan)
        if after != before:
            write_whole(path, after)
            again = " Make the plan again: it holds the text's hash." if plan is not None else ""
            print(f"Filled in {path}.{again}")

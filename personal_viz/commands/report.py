"""Verb `study report`: a study's figures as tables and pictures."""

from collections.abc import Sequence
from pathlib import Path

from sim.errors import StudyError
from sim.files import write_whole
from sim.tasks.metrics import read_runs
from sim.types import SuccessRule, TaskKind


def report(*, runs: Sequence[Path], out: Path, rule: SuccessRule, json: bool) -> int:
    """Writes the report of the runs into a folder; the same runs give the same bytes.

    Raises:
        StudyError: No run is of people, an agent did other episodes, or `out` cannot be written.
        RunFileError: A folder holds no run, a run is damaged, or the runs must not stand side by side.
    """
    from human_study.report import study_report
    from human_study.report_figures import outcome_matrix_svg, person_dots_svg
    from human_study.report_tables import csv_text, latex, markdown

    found = study_report(read_runs(list(runs)), rule=rule)
    text = markdown(found)
    document = found.model_dump_json(indent=2) + "\n"
    files = {"report.md": text, "report.csv": csv_text(found), "report.tex": latex(found), "report.json": document}
    tasks: list[TaskKind] = [row.task for row in found.rows if row.kind == "human"]
    for task in dict.fromkeys(tasks):
        files[f"{task}-people.svg"] = person_dots_svg(found, task)
        files[f"{task}-episodes.svg"] = outcome_matrix_svg(found, task)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            write_whole(out / name, content)
    except OSError as error:
        raise StudyError(
            f"--out: {str(out)!r} cannot be written ({error.strerror}); expected a folder, or a place for one. "
            "Choose another."
        ) from None
    print(document if json else f"{text}\nWritten to {out}: {', '.join(files)}", end="" if json else "\n")
    return 0

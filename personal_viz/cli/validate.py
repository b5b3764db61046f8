"""Verb `validate`: reports everything that is wrong in a folder of episodes, or in a set of home sequences."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from rich.text import Text

from sim.authoring.sequences.checks import SequenceReport, validate_sequences
from sim.episodes.sequence_files import holds_sequences
from sim.episodes.validate import CheckResult, Measure, ValidationReport, validate_dataset
from sim.types import SPLITS, Split

from .options import Dataset, Json
from .output import print_json, print_table

_COLOURS = {"error": "red", "defect": "yellow", "note": "dim", "ok": "green"}
_NUM_EXAMPLES = 4


@dataclass
class Validate:
    """Check every file of episodes, or of a set of home sequences; exit code 1 only when something is unusable."""

    dataset: Dataset
    json: Json = False

    def run(self) -> int:
        if holds_sequences(self.dataset):
            found = validate_sequences(self.dataset)
            (print_json if self.json else _print_sequences)(_json_of_sequences(found))
            return 1 if found.problems else 0
        report = validate_dataset(self.dataset)
        if self.json:
            print_json(_json_of_report(report))
        else:
            _print_report(report)
        return 1 if report.num_errors else 0


def _json_of_sequences(report: SequenceReport) -> dict[str, Any]:
    return {
        "root": str(report.root),
        "sequences": report.num_sequences,
        "subtasks": report.num_subtasks,
        "by_kind": report.subtasks,
        "messages": report.messages,
        "errors": len(report.problems),
        "problems": report.problems,
        "broken": report.broken,
    }


def _print_sequences(document: dict[str, Any]) -> None:
    for name in ("by_kind", "messages"):
        document[name] = ", ".join(f"{kind} {count}" for kind, count in document[name].items()) or "none"
    print("{root}: {sequences} sequences with {subtasks} searches ({by_kind}); messages: {messages}".format(**document))
    for line in (*document["problems"], *document["broken"]):
        print(line)
    print(f"{document['errors']} files that cannot be used, {len(document['broken'])} broken guarantees.")


def _json_of_report(report: ValidationReport) -> dict[str, Any]:
    checks = [
        {
            "row": check.row,
            "slug": check.measure.slug,
            "level": check.level,
            "count": check.measure.count,
            "per_split": check.measure.per_split,
            "episodes": check.measure.names,
            "unit": check.measure.unit,
            "population": check.measure.population,
            "title": check.title,
            "also": [{k: v for k, v in asdict(measure).items() if k != "names"} for measure in check.also],
        }
        for check in report.checks
    ]
    return {
        "episodes": sum(report.num_episodes.values()),
        "per_split": report.num_episodes,
        "errors": report.num_errors,
        "checks": checks,
        "problems": report.problems,
    }


def _print_report(report: ValidationReport) -> None:
    counts = ", ".join(f"{split} {report.num_episodes[split]}" for split in SPLITS)
    print(f"{report.root}: {sum(report.num_episodes.values())} episodes ({counts})")
    rows = [row for check in report.checks for row in _rows(check)]
    heads = ("row", "level", "found", *SPLITS, "check")
    print_table("Checks of DATA_FORMAT.md, section 8", heads, rows, texts=("level", "check"), folds=True)
    for check in report.checks:
        if check.level != "note" and check.measure.names:
            print(f"row {check.row}, {check.level}, {check.measure.slug}: {_examples(check.measure)}")
    for line in report.problems:
        print(line)
    found = {level: sum(c.level == level and c.measure.count > 0 for c in report.checks) for level in _COLOURS}
    print(
        f"{report.num_errors} errors (a file or episode cannot be used), {found['defect']} kinds of defects "
        f"(wrong, can be worked round), {found['note']} kinds of notes (normal for the format). "
        "Every episode concerned: --json."
    )


def _rows(check: CheckResult) -> Iterator[tuple[str | Text, ...]]:
    """The check's row, and one for each further measure."""
    level = check.level if check.measure.count else "ok"
    text = Text.assemble(check.measure.slug, (f" ({check.measure.unit}: {check.title})", "dim"))
    yield str(check.row), Text(level, _COLOURS[level]), *_cells(check.measure), text
    for measure in check.also:
        cells = ("", "", *_cells(measure), f"  {measure.slug} ({measure.unit})")
        yield tuple(Text(cell, "dim") for cell in cells)


def _cells(measure: Measure) -> tuple[str, ...]:
    return (f"{measure.count:,}", *(_share(measure, split) for split in SPLITS))


def _share(measure: Measure, split: Split) -> str:
    """The split's count, with a percentage for units of which a split holds thousands."""
    count = f"{measure.per_split[split]:,}"
    if measure.population is None or "points" not in measure.unit or not measure.population[split]:
        return count
    return f"{count} ({measure.per_split[split] / measure.population[split]:.1%})"


def _examples(measure: Measure) -> str:
    more = f" and {len(measure.names) - _NUM_EXAMPLES:,} more" if len(measure.names) > _NUM_EXAMPLES else ""
    return ", ".join(measure.names[:_NUM_EXAMPLES]) + more

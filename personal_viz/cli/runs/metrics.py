"""Verb `metrics`: the paper's tables from stored runs."""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from grounding.report.sources import pog_notes
from sim.homes.kind import scene_label
from sim.sequences.rows import holds_sequence_runs, sequence_rows
from sim.tasks.metrics import (
    MetricRow,
    metric_rows,
    paper_table,
    reading_notes,
    require_comparable,
    rule_warnings,
)
from sim.tasks.run_folders import read_runs, run_folders, with_controls
from sim.types import RULE_NOTES, SuccessRule

from ..options import Json
from ..output import print_json, print_table, say
from .sequence_table import print_sequences


@dataclass
class Metrics:
    """SR, SPL and DTG (PAN) or SR and top-3 (POG) per split, in the paper's layout; and the measures of sequences."""

    runs: Positional[tuple[Path, ...]]
    rule: Annotated[SuccessRule, arg(help=f"What counts as success in PAN: {'; '.join(RULE_NOTES.values())}.")] = (
        "paper"
    )
    json: Json = False

    def run(self) -> int:
        folders = run_folders(self.runs)
        sequences = sequence_rows([folder for folder in folders if holds_sequence_runs(folder)], rule=self.rule)
        episodes = [folder for folder in folders if not holds_sequence_runs(folder)]
        found = read_runs(with_controls(episodes), with_reported=True) if episodes else []
        require_comparable(run.info for run in found if run.episodes or run.reported)
        require_comparable(run.info for run in found if run.answers)
        rows = metric_rows(found, rule=self.rule)
        warnings = rule_warnings(rows)
        if self.json:
            print_json([*map(_labelled, rows), *(row.model_dump() for row in sequences)])
            for line in warnings:
                say(line)
            return 0
        for task, title in (
            ("pan", f"PAN, rule {self.rule}"),
            ("pog", "POG, planar distance <= 1 m on the target's storey"),
        ):
            for kind in dict.fromkeys(row.scene_kind for row in rows if row.task == task):
                shown = [row for row in rows if row.task == task and row.scene_kind == kind]
                table = paper_table(shown)
                heads = [
                    f"{split.capitalize() if head == 'SR' else ''}\n{head}"
                    for split in table.splits
                    for head in table.heads
                ]
                lines = [(line.name, *chain(*line.cells)) for line in table.lines]
                if all(row.rule == "reported" for row in shown):
                    title = "PAN, as reported"
                print_table(f"{title}; edition {shown[0].edition}; scenes: {kind}", ("Method", *heads), lines)
                label = scene_label(kind)
                answered = [run.info for run in found if run.answers and run.info.scene_kind == kind]
                maps = pog_notes(answered) if task == "pog" else ()
                for line in [*([f"{label}."] if label else []), *reading_notes(shown), *maps]:
                    print(line)
        print_sequences(sequences)
        for line in warnings:
            print(line)
        for row in rows:
            if row.unreachable or row.undefined:
                print(
                    f"{row.who}, {row.split}: {row.unreachable} trials without a path to the goal (left out of DTG), "
                    f"{row.undefined} without a usable point under the rule, or measured before the rule "
                    "(left out of all)"
                )
        return 0


def _labelled(row: MetricRow) -> dict[str, Any]:
    return row.model_dump() | {"scene_label": scene_label(row.scene_kind)}

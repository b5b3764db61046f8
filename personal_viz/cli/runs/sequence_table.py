"""The table of `metrics` about runs of home sequences."""

import re
from collections import defaultdict
from collections.abc import Collection, Sequence

from sim.sequences.figures import SequenceFigures
from sim.sequences.rows import SequenceRow
from sim.sequences.runs import VIEW_DISTANCE

from ..output import print_table

_HEADS = ("Method", "n", "SR", "fresh", "revisit", "changed", "stale", "partial", "progress", "all", "CSR", "CGT")
_HEADS += ("SPL", "PPL", "old", "lag")
_SETTINGS = re.compile(r"(\S+) \([a-z_]+=[^()]*\)")
"""In a row's condition: what it sees with, and all its settings."""


def print_sequences(rows: Sequence[SequenceRow]) -> None:
    """Prints one table per kind of homes: two lines per row, by the rule and by GOAT-Bench's; shares in percent."""
    for kind in dict.fromkeys(row.scene_kind for row in rows):
        shown = [row for row in rows if row.scene_kind == kind]
        once, lines = _same_settings(shown), []
        for row in shown:
            name = _name(row.who, row.condition, once)
            lines.append(_cells(f"{name}, POG" if row.task == "pog" else name, row.sequence_measures))
            if row.goat_measures is not None:
                lines.append(_cells(f"  FOUND < {VIEW_DISTANCE:g} m", row.goat_measures))
        print_table(f"Home sequences, rule {rows[0].rule}; edition {shown[0].edition}; scenes: {kind}", _HEADS, lines)
        if shown[0].scene_label:
            print(f"{shown[0].scene_label}.")
        print(
            "Shares in percent; all = sequences in which all searches succeed, old = FOUND at the object that was "
            "right before, lag = failed searches about a message (docs/home-sequences.md)."
        )
        for line in (*(f"{text}." for text in once), *(note for row in shown for note in _notes(row, once))):
            print(line)


def _same_settings(rows: Sequence[SequenceRow]) -> tuple[str, ...]:
    """Settings such as "oracle:mild (miss=0.2)" that all rows with that perception share, to be told once."""
    found: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        for match in _SETTINGS.finditer(row.condition):
            found[match[1]].add(match[0])
    return tuple(text for texts in found.values() if len(texts) == 1 for text in texts)


def _cells(name: str, found: SequenceFigures) -> tuple[str, ...]:
    shares = (
        *(found.sr, found.sr_fresh, found.sr_revisit, found.sr_changed, found.sr_stale, found.partial),
        *(found.progress, found.composite, found.csr, found.cgt, found.spl, found.ppl, found.stale),
    )
    lag = "-" if found.lag is None else f"{found.lag:.2f}"
    return name, str(found.n), *("-" if share is None else f"{100 * share:.1f}" for share in shares), lag


def _notes(row: SequenceRow, once: Collection[str]) -> list[str]:
    """What the table has no column for."""
    name, found, notes = _name(row.who, row.condition, once), row.sequence_measures, []
    if found.intervals:
        low, high = (100 * min(1, max(0, end)) for end in found.intervals["partial"])
        notes.append(f"{name}: partial {low:.1f} to {high:.1f} (95 %, homes random, sequences inside homes).")
    if found.recall is not None and found.precision is not None:
        notes.append(
            f"{name}: of all right objects, recall {100 * found.recall:.1f}, precision {100 * found.precision:.1f}."
        )
    if found.interference is not None:
        notes.append(f"{name}: interference {100 * found.interference:+.1f} points.")
    beside = row.beside_first
    if beside is not None:
        value, between = 100 * beside.sr.value, _between(beside.sr.interval)
        first = _name(beside.who, beside.condition, once)
        notes.append(f"{name}: SR {value:+.1f} points beside {first} on the same sequences{between}.")
    gain = row.memory_gain
    if gain is not None and gain.sr is not None and gain.spl is not None and gain.sr_all is not None:
        steps = "" if gain.steps is None else f", steps {gain.steps:+.1f}"
        notes.append(
            f"{name}: memory gain in {gain.n} revisits SR {100 * gain.sr:+.1f}, SPL {100 * gain.spl:+.1f}{steps}; in "
            f"all searches SR {100 * gain.sr_all:+.1f} points{_between(gain.interval_all)}."
        )
    return notes


def _between(interval: tuple[float, float] | None) -> str:
    """An interval of a difference of shares, in points."""
    if interval is None:
        return ""
    low, high = (100 * min(1, max(-1, end)) for end in interval)
    return f" ({low:+.1f} to {high:+.1f}, 95 %, homes random)"


def _name(who: str, condition: str, once: Collection[str]) -> str:
    for text in once:
        condition = condition.replace(text, text.partition(" (")[0])
    return who if condition == "none" else f"{who} ({condition})"

"""What the page and the Markdown say alike: heads, figures and names as texts, not yet escaped."""

from dataclasses import dataclass

from recordings.texts import NOTICE
from sim.words.english import how_many

from .gathered import Trial
from .rows import Row, Section

GROUPS = (("people", "people"), ("agents", "agents"), ("difference", "people \u2212 agents"))
"""Names of the groups of columns, and what heads call them."""
REASONS = {"steps": "out of steps", "giveup": "gave up", "timeout": "out of time", "technical": "technical failure"}
"""How runs ended, in words."""


@dataclass(frozen=True, slots=True)
class Page:
    """All that the page says."""

    sections: tuple[Section, ...]
    has_scan_pixels: bool
    """Whether maps and pictures of scans lie in the folder."""
    has_left_out_pixels: bool
    """Whether they were left out."""

    @property
    def notes(self) -> list[str]:
        """What holds for the whole folder."""
        left_out = "Maps, geometry and pictures of the scans are left out; --with-pixels writes them."
        notice = NOTICE.replace("This recording holds", "This folder holds")
        return [*([notice] if self.has_scan_pixels else []), *([left_out] if self.has_left_out_pixels else [])]

    @property
    def counts(self) -> str:
        """How much there is."""
        trials = [trial for section in self.sections for row in section.rows for trial in row.trials]
        num_people = len({(trial.who, trial.participant) for trial in trials if trial.who_kind == "human"})
        num_agents = len({(trial.who, trial.condition) for trial in trials if trial.who_kind == "agent"})
        keys = {row.key for section in self.sections for row in section.rows}
        return (
            f"{how_many(len(keys), 'episode')} in {how_many(len({key.scene for key in keys}), 'home')}, "
            f"{how_many(len(trials), 'run')} of {how_many(num_people, 'person', 'people')} and "
            f"{how_many(num_agents, 'agent')}."
        )


def written(value: float | None, digits: int, *, is_signed: bool = False) -> str:
    """A figure as tables show it: `-` for none, a true minus sign, `+` before differences."""
    if value is None:
        return "-"
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0 else ("\u2212" if value < 0 else "+" if is_signed else "") + text


def facts(trial: Trial) -> str:
    """A trial's figures beside who did it."""
    words = [] if trial.spl is None else [f"SPL {100 * trial.spl:.0f}"]
    words += [] if trial.steps is None else [f"{trial.steps} step{'' if trial.steps == 1 else 's'}"]
    if trial.task == "pog" and trial.distance_m is not None:
        words.append(f"{trial.distance_m:.2f} m")
    words += [] if trial.time_s is None else [f"{trial.time_s:.1f} s"]
    return ", ".join(words + ([] if trial.reason in ("stop", "click") else [REASONS.get(trial.reason, trial.reason)]))


def groups_of(section: Section) -> list[tuple[str, str]]:
    """The groups of columns that have figures: people, agents, and their difference where both are there."""
    kinds = {trial.who_kind for row in section.rows for trial in row.trials}
    has = {"people": "human" in kinds, "agents": "agent" in kinds, "difference": len(kinds) == 2}
    return [(name, head) for name, head in GROUPS if has[name]]


def who_kinds(section: Section) -> dict[tuple[str, str], str]:
    """`people` or `agent`, by name and condition."""
    return {
        (trial.who, trial.condition): "people" if trial.who_kind == "human" else "agent"
        for row in section.rows
        for trial in row.trials
    }


def success_counts(row: Row) -> str:
    """How many people and agents succeeded."""
    words = []
    for kind, noun in (("human", "people"), ("agent", "agents")):
        found = [trial.success for trial in row.trials if trial.who_kind == kind and trial.success is not None]
        words += [f"{noun} {sum(found)} of {len(found)}"] if found else []
    return ", ".join(words) or "none scored"


def trial_name(trial: Trial) -> str:
    """Which person, or which agent under which condition."""
    return trial.name if trial.who_kind == "human" else agent_name(trial)


def agent_name(trial: Trial) -> str:
    """An agent and its condition: what the paper's tables call a row."""
    return trial.who if trial.condition == "none" else f"{trial.who} ({trial.condition})"

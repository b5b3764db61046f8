"""Questions that reviewers ask about human baselines, answered from the study file where it holds the answer.

`templates/checklist.md.j2` holds the questions, their sources and the answers.
"""

from collections.abc import Sequence

from ..design.study import StudyConfig
from ..texts.catalogue import ENGLISH, catalogue_of
from ..texts.words import words_of
from .counts import ExclusionCount, FlowCount
from .measures import WITHIN
from .page import filled
from .rows import TOTAL, ReportRow
from .trials import ReportValue

NOT_IN_FILE = "not in the study file"


class ChecklistItem(ReportValue):
    """A question and its answer."""

    source: str
    part: str
    question: str
    answer: str
    """The answer; `not in the study file` where only the researcher knows it."""


def checklist(
    config: StudyConfig,
    *,
    rows: Sequence[ReportRow],
    flow: Sequence[FlowCount],
    exclusions: Sequence[ExclusionCount],
    is_pilot: bool,
    plan_changes: Sequence[str] = (),
) -> list[ChecklistItem]:
    """All questions of both lists."""
    measures = {row.measure for row in rows if row.measure not in WITHIN and row.split == TOTAL}
    text = filled(
        "checklist.md.j2",
        study=config,
        words=words_of(config, catalogue=catalogue_of(ENGLISH)),
        not_in_file=NOT_IN_FILE,
        agents=sorted({row.who for row in rows if row.kind == "agent"}),
        measures=sorted(measures),
        limits=_limits(config),
        conditions=[name for task in config.task for name in config.conditions(task)],
        has_several_conditions=any(len(config.conditions(task)) > 1 for task in config.task),
        flow={count.point: count.n for count in flow},
        exclusions=exclusions,
        is_pilot=is_pilot,
        plan_changes=plan_changes,
    )
    return [item for part in f"\n{text}".split("\n# ")[1:] for item in _items(part)]


def _items(part: str) -> list[ChecklistItem]:
    """The questions of one part of the filled template."""
    title, *questions = part.split("\n## ")
    source, _, name = title.strip().partition(": ")
    pairs = [question.partition("\n") for question in questions]
    return [
        ChecklistItem(source=source, part=name, question=question, answer=" ".join(answer.split()))
        for question, _, answer in pairs
    ]


def _limits(config: StudyConfig) -> list[str]:
    found = []
    if "pan" in config.task:
        found += [f"{config.steps} steps"] + ([f"{config.pan_max_s:g} s of walking"] if config.pan_max_s else [])
    if "pog" in config.task and config.pog.answer_max_s:
        found.append(f"{config.pog.answer_max_s:g} s of pointing")
    return found

"""Questions that reviewers ask about human baselines, answered from the study file, the records and the survey.

`templates/checklist.md.j2` holds the questions, their sources and the answers.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from sim.tasks.run_files import Run
from sim.words.english import how_many

from ..design.study import StudyConfig, SurveyTopic
from ..export.survey import LEAST_IN_A_CELL, SurveyRow, survey_counts
from ..export.trial_table import TrialRow
from ..texts.words import words_of
from .counts import ExclusionCount, FlowCount
from .measures import WITHIN
from .page import filled
from .rows import TOTAL, ReportRow
from .source import StudyRecords
from .trials import ReportValue

NOT_ANSWERED = "not answered"


class ChecklistItem(ReportValue):
    """A question and its answer."""

    source: str
    """The checklist that asks it."""
    part: str
    question: str
    """Begins with the question's number in the checklist, where it has one."""
    answer: str
    """The answer; `not answered` where neither the study file nor the records have one."""
    answered_from: str
    """Fields of the study file, `records`, `survey`, `runs` or `program` (true of every study that it serves)."""


def checklist(
    records: StudyRecords,
    *,
    rows: Sequence[ReportRow],
    flow: Sequence[FlowCount],
    exclusions: Sequence[ExclusionCount],
    is_pilot: bool,
    runs: Sequence[Run] = (),
) -> list[ChecklistItem]:
    """All questions of both lists; none without a study file.

    `runs` holds those of the report, from which it is known which agents ran on the study.
    """
    if records.config is None:
        return []
    config = _on_one_line(records.config)
    measures = {row.measure for row in rows if row.measure not in WITHIN and row.split == TOTAL}
    reached = {count.point: count.n for count in flow}
    text = filled(
        "checklist.md.j2",
        study=config,
        words=words_of(config),
        agents=_agents(rows),
        others=_not_on_study(runs, records.config.study_version),
        measures=sorted(measures),
        limits=_limits(config),
        conditions=[name for task in config.task for name in config.conditions(task)],
        has_several_conditions=any(len(config.conditions(task)) > 1 for task in config.task),
        flow=reached,
        exclusions=exclusions,
        is_pilot=is_pilot,
        plan_changes=records.plan_changes,
        dates=records.dates,
        counts=_counts(records.rows),
        survey=survey_words(records.survey),
        response=_response(config, reached),
    )
    return [item for part in f"\n{text}".split("\n# ")[1:] for item in _items(part)]


def survey_words(rows: Sequence[SurveyRow]) -> dict[SurveyTopic, str]:
    """The number of people who gave each answer, by topic; small numbers are hidden (k-anonymity)."""
    return {
        topic: ", ".join(f"{answer} {num}" for answer, num in sorted(_hidden(counts).items()))
        for topic, counts in survey_counts(rows).items()
    }


def _hidden(counts: Mapping[str, int]) -> dict[str, int | str]:
    """The counts in words, without small ones and without those from which a small one could be computed.

    Who knows the number of people also knows the sum of all hidden answers: while a small one could be told from it,
    the next smallest is hidden too.
    """
    ordered = sorted(counts.items(), key=lambda item: (item[1], item[0]))
    at = sum(num < LEAST_IN_A_CELL for _, num in ordered)
    while 0 < at < len(ordered) and (at == 1 or sum(num for _, num in ordered[:at]) < LEAST_IN_A_CELL):
        at += 1
    words = {answer: f"{'under' if num < LEAST_IN_A_CELL else 'at least'} {LEAST_IN_A_CELL}" for answer, num in ordered}
    return {answer: words[answer] if place < at else num for place, (answer, num) in enumerate(ordered)}


def _on_one_line(value: Any) -> Any:
    """A text, or the texts of a model, without line breaks or marks that would begin a question of the template."""
    if isinstance(value, str):
        return re.sub(r"^#+ ", "", " ".join(value.split()))
    if isinstance(value, tuple):
        return tuple(map(_on_one_line, value))
    if isinstance(value, BaseModel):
        return value.model_copy(update={name: _on_one_line(each) for name, each in value})
    return value


def _not_on_study(runs: Sequence[Run], version: str) -> list[str]:
    """Names of agents with a run that was not made on the study, of whose simulator and texts nothing is known."""
    agents = [run.info for run in runs if run.info.who_kind != "human"]
    return sorted({info.who for info in agents if info.config.get("study_version") != version})


def _items(part: str) -> list[ChecklistItem]:
    """The questions of one part of the filled template."""
    title, *questions = part.split("\n## ")
    source, _, name = title.strip().partition(": ")
    found = []
    for question in questions:
        head, _, answer = question.partition("\n")
        asked, _, origin = head.partition(" | ")
        found.append(
            ChecklistItem(
                source=source,
                part=name,
                question=asked,
                answer=" ".join(answer.split()) or NOT_ANSWERED,
                answered_from=origin,
            )
        )
    return found


def _agents(rows: Sequence[ReportRow]) -> list[str]:
    """Each agent with the number of its episodes."""
    sizes: dict[str, int] = {}
    for row in rows:
        if row.kind == "agent" and row.split == TOTAL:
            sizes[row.who] = max(sizes.get(row.who, 0), row.num_episodes)
    return [f"{who} {how_many(size, 'episode')}, several runs averaged" for who, size in sorted(sizes.items())]


def _counts(rows: Sequence[TrialRow]) -> dict[str, Any]:
    """Numbers of people, episodes and counted trials with a result."""
    results = [row for row in rows if row.is_result]
    episodes = Counter((row.task, row.split, row.scene, row.episode_id) for row in results)
    people = Counter(row.participant for row in results)
    return {
        "trials": len(results),
        "people": len(people),
        "episodes": len(episodes),
        "per_episode": _range(episodes.values()),
        "per_person": _range(people.values()),
    }


def _range(values: Collection[int]) -> str:
    least, most = min(values, default=0), max(values, default=0)
    return f"{most}" if least == most else f"{least} to {most}"


def _response(config: StudyConfig, reached: Mapping[str, int]) -> dict[str, str]:
    """The number of people who were invited, or of links, and the share of the invited who finished."""
    invited, links = config.reporting.invited, reached.get("places in the plan", 0)
    if invited is None:  # a personal link for each place, spare ones too; nobody says how many were sent
        return {"invited": f"{how_many(links, 'link')}, " if config.recruit.kind == "local" else "", "rate": ""}
    rate = f"{100 * reached.get('finished', 0) / invited:.0f} % of the invited finished"
    return {"invited": f"{invited} invited, ", "rate": rate}


def _limits(config: StudyConfig) -> list[str]:
    found = []
    if "pan" in config.task:
        found += [f"{config.steps} steps"] + ([f"{config.pan_max_s:g} s of walking"] if config.pan_max_s else [])
    if "pog" in config.task and config.pog.answer_max_s:
        found.append(f"{config.pog.answer_max_s:g} s of pointing")
    return found

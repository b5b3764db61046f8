"""Answers to a study's survey: the exported table, counts of each answer, and answers that could name a person."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

from pydantic import BaseModel, ConfigDict

from ..design.study import SurveyTopic
from ..store.records import StudyReader
from ..texts.survey import ABOUT_THE_PERSON, SURVEY, answers_from_json

LEAST_IN_A_CELL = 5
"""Answers that fewer people gave are not shown (k-anonymity)."""


class SurveyRow(BaseModel):
    """One answer of one person."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person, as in the other tables."""
    topic: SurveyTopic
    """The question; its words are in human_study/texts/survey.py of the version that asked it."""
    answer: str
    """The chosen answer; `prefer_not_to_say` is one too. Questions that were left out have no row."""


def survey_rows(reader: StudyReader, codes: Mapping[str, str]) -> list[SurveyRow]:
    """The answers of the people in `codes` (exported code by code in the study), in the order of the questions."""
    answers = {codes[code]: answers_from_json(text) for code, text in reader.answers("survey").items() if code in codes}
    return [
        SurveyRow(participant=code, topic=topic, answer=given[topic])
        for code, given in sorted(answers.items())
        for topic in SURVEY
        if topic in given
    ]


def survey_counts(rows: Sequence[SurveyRow]) -> dict[SurveyTopic, Counter[str]]:
    """Number of people by topic and answer, in the order of the questions."""
    counts: dict[SurveyTopic, Counter[str]] = defaultdict(Counter)
    for row in rows:
        counts[row.topic][row.answer] += 1
    return {topic: counts[topic] for topic in SURVEY if topic in counts}


def small_cells(rows: Sequence[SurveyRow]) -> list[str]:
    """Answers, and combinations of answers about the person, that fewer than LEAST_IN_A_CELL people gave, in words."""
    found = [
        f"{topic} {answer} ({num})"
        for topic, counts in survey_counts(rows).items()
        for answer, num in sorted(counts.items())
        if num < LEAST_IN_A_CELL
    ]
    people: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        if row.topic in ABOUT_THE_PERSON:
            people[row.participant].append(row.answer)
    alone = [num for num in Counter(map(tuple, people.values())).values() if num < LEAST_IN_A_CELL]
    if alone:
        found.append(f"{len(alone)} combinations of answers about the person ({sum(alone)} people)")
    return found

"""The questions that a study may ask people about themselves after the last search, and their fixed answers.

No answer is typed, so that none can name a person. Every question can be left out. The words are in `words.toml`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from ..design.study import StudyConfig, SurveyTopic
from .catalogue import Catalogue, catalogue_of

PREFER_NOT = "prefer_not_to_say"
"""The answer that every question has, its last."""
SURVEY: dict[SurveyTopic, tuple[str, ...]] = {
    "age": ("18_24", "25_34", "35_44", "45_54", "55_64", "65_or_older", PREFER_NOT),
    "gender": ("woman", "man", "another", PREFER_NOT),
    "education": ("school", "vocational", "bachelor", "master_or_higher", PREFER_NOT),
    "language": ("first_language", "very_well", "well_enough", "with_difficulty", PREFER_NOT),
    "games": ("never", "yearly", "monthly", "weekly", PREFER_NOT),
    "expertise": ("no", "study", "work", PREFER_NOT),
    "ai_tools": ("no", "some", "most", PREFER_NOT),
    "other_help": ("no", "some", "most", PREFER_NOT),
    "homes": ("no", "not_sure", "yes", PREFER_NOT),
}
"""Stored values of the answers by topic, in the order in which they are asked."""
ABOUT_THE_PERSON: tuple[SurveyTopic, ...] = ("age", "gender", "education", "language", "games", "expertise")
"""Topics that describe a person, so that answers to several of them together may name one."""


@dataclass(frozen=True, slots=True)
class SurveyQuestion:
    """One question as people read it."""

    text: str
    about: str
    """The topic in texts on the study, such as "education"."""
    answers: Mapping[str, str]
    """Words of each answer by its stored value."""


def questions_of(config: StudyConfig, catalogue: Catalogue | None = None) -> dict[SurveyTopic, SurveyQuestion]:
    """The questions that the study asks, in its language or that of the catalogue."""
    words = catalogue if catalogue is not None else catalogue_of(config.language)
    return {
        topic: SurveyQuestion(
            words(f"survey.{topic}.question"),
            words(f"survey.{topic}.about"),
            {
                answer: words(f"survey.{answer}" if answer == PREFER_NOT else f"survey.{topic}.{answer}")
                for answer in answers
            },
        )
        for topic, answers in SURVEY.items()
        if topic in config.survey.questions
    }


def given_answers(config: StudyConfig, form: Mapping[str, str]) -> dict[SurveyTopic, str]:
    """The known answers of a form to the study's questions; anything else in it is left out."""
    return {topic: form[topic] for topic in config.survey.questions if form.get(topic) in SURVEY[topic]}


def answers_to_json(answers: Mapping[SurveyTopic, str]) -> str:
    """The text that is stored, encrypted."""
    return json.dumps(answers, sort_keys=True)


def answers_from_json(text: str) -> dict[SurveyTopic, str]:
    """The answers of a stored text."""
    return json.loads(text)

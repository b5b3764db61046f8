"""The questions that a study may ask people about themselves after the last search, and their fixed answers.

No answer is typed, so that none can name a person. Every question can be left out.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from ..design.study import StudyConfig, SurveyTopic

PREFER_NOT = "prefer_not_to_say"
"""Stored value of the answer that every question has."""
ABOUT_THE_PERSON: tuple[SurveyTopic, ...] = ("age", "gender", "education", "language", "games", "expertise")
"""Topics that describe a person, so that answers to several of them together may name one."""


@dataclass(frozen=True, slots=True)
class SurveyQuestion:
    """One question with its answers."""

    text: str
    about: str
    """The topic in texts on the study, such as "education"."""
    choices: Mapping[str, str]
    """Words of each answer by its stored value."""

    @property
    def answers(self) -> dict[str, str]:
        """The choices and, last, the refusal to answer."""
        return {**self.choices, PREFER_NOT: "I prefer not to say"}


SURVEY: dict[SurveyTopic, SurveyQuestion] = {
    "age": SurveyQuestion(
        "How old are you?",
        "age (in steps of ten years)",
        {
            **{"18_24": "18 to 24", "25_34": "25 to 34", "35_44": "35 to 44", "45_54": "45 to 54"},
            **{"55_64": "55 to 64", "65_or_older": "65 or older"},
        },
    ),
    "gender": SurveyQuestion(
        "What is your gender?", "gender", {"woman": "Woman", "man": "Man", "another": "Another gender"}
    ),
    "education": SurveyQuestion(
        "What is the highest education that you have finished?",
        "education",
        {
            "school": "School",
            "vocational": "Vocational training",
            "bachelor": "Bachelor's degree or similar",
            "master_or_higher": "Master's degree or higher",
        },
    ),
    "language": SurveyQuestion(
        "How well do you read the language of this study?",
        "how well the texts' language is read",
        {
            "first_language": "It is my first language",
            "very_well": "Very well",
            "well_enough": "Well enough to understand the texts",
            "with_difficulty": "With difficulty",
        },
    ),
    "games": SurveyQuestion(
        "How often do you play games in which you move through 3-D rooms?",
        "how often games in 3-D rooms are played",
        {"never": "Never", "yearly": "A few times a year", "monthly": "Every month", "weekly": "Every week"},
    ),
    "expertise": SurveyQuestion(
        "Do you work on, or study, robots or computer vision?",
        "work or studies on robots or computer vision",
        {"no": "No", "study": "I study it", "work": "I work on it"},
    ),
    "ai_tools": SurveyQuestion(
        "Did an AI program, such as a chatbot, help you to answer?",
        "help by an AI program",
        {"no": "No", "some": "In some searches", "most": "In most searches"},
    ),
    "other_help": SurveyQuestion(
        "Did anything else help you, such as notes, pictures of the screen, or another person?",
        "any other help",
        {"no": "No", "some": "In some searches", "most": "In most searches"},
    ),
    "homes": SurveyQuestion(
        "Had you seen any of these homes before this study?",
        "whether the homes were known before",
        {"no": "No", "not_sure": "I am not sure", "yes": "Yes"},
    ),
}
"""The questions by topic, in the order in which they are asked."""


def questions_of(config: StudyConfig) -> dict[SurveyTopic, SurveyQuestion]:
    """The questions that the study asks."""
    return {topic: question for topic, question in SURVEY.items() if topic in config.survey.questions}


def given_answers(config: StudyConfig, form: Mapping[str, str]) -> dict[SurveyTopic, str]:
    """The known answers of a form to the study's questions; anything else in it is left out."""
    return {
        topic: form[topic] for topic, question in questions_of(config).items() if form.get(topic) in question.answers
    }


def answers_to_json(answers: Mapping[SurveyTopic, str]) -> str:
    """The text that is stored, encrypted."""
    return json.dumps(answers, sort_keys=True)


def answers_from_json(text: str) -> dict[SurveyTopic, str]:
    """The answers of a stored text."""
    return json.loads(text)

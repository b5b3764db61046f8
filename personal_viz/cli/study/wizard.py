"""The questions of `study init --wizard`: what only a person knows, each answer checked before the next question."""

import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import yaml
from pydantic import ValidationError

from human_study.design.study import StudyConfig
from human_study.design.study_yaml import field_told, schema_of
from human_study.texts.words import empty_fields
from sim.errors import StudyError, line_from_validation_error

TRIALS = "design.trials_per_person"
ALWAYS = (
    *("study", "task", "design.kind", "design.raters_per_episode", TRIALS),
    *("primary", "smallest_effect", "sample_size_reason", "recruit.kind", "survey.eligibility"),
    "ethics.language_model",
)
"""Fields that are asked for besides those that the texts need; a crossed design needs no number of trials."""


def asked(config: StudyConfig) -> StudyConfig:
    """The study with a person's answers, read from standard input; an empty answer keeps the value in brackets.

    Raises:
        StudyError: The input ended before the last question.
    """
    print("An empty answer keeps the value in brackets. Nothing is written before the last answer; Ctrl-C ends.")
    schema = schema_of(StudyConfig)
    left = [*ALWAYS, *(place for place in empty_fields(config) if place not in ALWAYS)]
    number = 0
    while left:
        place = left.pop(0)
        number += 1
        meaning, allowed = field_told(schema, place)
        print(f"\n{number}/{number + len(left)} {place}: {meaning}\n  {allowed}")
        config = _answered(config, place)
        if config.design.kind == "crossed" and TRIALS in left:
            left.remove(TRIALS)
            design = config.design.model_copy(update={"trials_per_person": None})
            config = config.model_copy(update={"design": design})
    print("\nFacts for the report (reporting: in the study file) can be written there at any time.")
    return config


def _answered(config: StudyConfig, place: str) -> StudyConfig:
    """The study with one field as a person answers; asks again until the answer fits."""
    values = config.model_dump(mode="json")
    *parents, name = place.split(".")
    inner = values
    for parent in parents:
        inner = inner[parent]
    kept = inner[name]
    shown = kept if isinstance(kept, str) else json.dumps(kept, ensure_ascii=False)
    while True:
        try:
            answer = input(f"  [{shown}] ").strip()
        except (EOFError, UnicodeDecodeError):
            raise StudyError(
                f"--wizard: found no answer for {place}; expected one line per question. Nothing was written: give "
                "all answers, or an empty line to keep a value."
            ) from None
        if not answer:
            return config
        problem = ""
        for value in _readings(answer):
            inner[name] = value
            try:
                return StudyConfig.model_validate_json(json.dumps(values, default=str), strict=True)
            except ValidationError as error:
                fits = not isinstance(value, (str, list)) if kept is None else isinstance(value, type(kept))
                if fits or not problem:
                    problem = line_from_validation_error("answer", error, advice="Answer again.")
            except (TypeError, ValueError, RecursionError):  # JSON holds no list in itself and no day as a key
                continue  # the plain text comes first and is always JSON, so there is a problem to tell
        print(f"  {problem}")


def _readings(answer: str) -> Iterator[Any]:
    """The ways in which an answer can be read: as plain text, as a value, as one item, and as a list without brackets.

    The whole text comes first, because YAML would cut `IRB #12` at the number sign. It is one item before it is
    several, because a sentence may have commas, unless it begins with a quote or a bracket.
    """
    yield answer
    for text in (answer, f"[{answer}]"):
        with suppress(yaml.YAMLError, ValueError, RecursionError):  # ValueError: the 32nd of May
            yield yaml.safe_load(text)
        if text is answer and answer[0] not in "[\"'":
            yield [answer]

"""Questions on the rules. After a wrong answer people read why and try again; after two such rounds they reread."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.types import TaskKind

from ..design.study import Condition, StudyConfig
from .words import filled, words_of


@dataclass(frozen=True, slots=True)
class Question:
    """One question; the first answer is the right one, and each participant sees the answers in a drawn order."""

    name: str
    text: str
    answers: tuple[str, ...]
    because: str
    """Explanation after a wrong answer; Markdown."""

    def shuffled(self, seed: Sequence[int]) -> tuple[str, ...]:
        """The answers in an order that is the same for the same seed."""
        order = np.random.default_rng(list(seed)).permutation(len(self.answers))
        return tuple(self.answers[index] for index in order)


@dataclass(slots=True)
class QuizRound:
    """One round through the questions, of one participant."""

    questions: tuple[Question, ...]
    answered: int = 0
    """Number of questions that were answered correctly in the end."""
    wrong: list[str] = field(default_factory=list)
    """Names of the questions with at least one wrong answer."""

    @property
    def present(self) -> Question | None:
        """The question to answer now; None at the end of the round."""
        return self.questions[self.answered] if self.answered < len(self.questions) else None

    def answer(self, text: str) -> bool:
        """Takes an answer and returns whether it is right. After a wrong answer the same question stays."""
        question = self.present
        assert question is not None
        if text == question.answers[0]:
            self.answered += 1
            return True
        if question.name not in self.wrong:
            self.wrong.append(question.name)
        return False


def questions_for(config: StudyConfig, task: TaskKind, conditions: Sequence[Condition]) -> tuple[Question, ...]:
    """The questions for somebody who does this task under these conditions."""
    text = filled("quiz.md", words_of(config, task=task, conditions=conditions))
    return tuple(_question(part) for part in f"\n{text}".split("\n## ")[1:])


def _question(part: str) -> Question:
    """One question of a language's `quiz.md`."""
    name, text, answers, because = part.strip().split("\n\n", 3)
    return Question(
        name,
        text=" ".join(text.split()),
        answers=tuple(line.removeprefix("- ") for line in answers.splitlines()),
        because=" ".join(because.replace("\n>", "\n").removeprefix(">").split()),
    )

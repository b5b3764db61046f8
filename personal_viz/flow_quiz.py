"""Questions on the rules: who answers wrongly is told why and asked again; wrong twice means reading once more."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from human_study.study import Condition, StudyConfig
from sim.types import TaskKind


@dataclass(frozen=True, slots=True)
class Question:
    """One question; the first answer is the right one and is shown at a place drawn for each participant."""

    name: str
    text: str
    answers: tuple[str, ...]
    because: str
    """Shown after a wrong answer."""

    def shuffled(self, seed: Sequence[int]) -> tuple[str, ...]:
        """The answers in an order that is the same for the same seed."""
        order = np.random.default_rng(list(seed)).permutation(len(self.answers))
        return tuple(self.answers[index] for index in order)


@dataclass(slots=True)
class QuizRound:
    """One round through the questions, of one participant."""

    questions: tuple[Question, ...]
    answered: int = 0
    """How many questions were answered correctly in the end."""
    wrong: list[str] = field(default_factory=list)
    """Names of the questions with at least one wrong answer."""

    @property
    def present(self) -> Question | None:
        """The question to answer now; None at the end of the round."""
        return self.questions[self.answered] if self.answered < len(self.questions) else None

    def answer(self, text: str) -> bool:
        """Takes an answer; whether it is right. A wrong one leaves the question where it is."""
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
    questions = [*(_pan_questions(config) if task == "pan" else _POG), _WHOSE]
    questions += [_QUESTIONS_OF_CONDITIONS[name] for name in conditions if name in _QUESTIONS_OF_CONDITIONS]
    return (*dict.fromkeys(questions), _FEEDBACK)


def _pan_questions(config: StudyConfig) -> tuple[Question, ...]:
    return (
        Question(
            "distance",
            "You have found the object. How close must the robot stand when you press STOP?",
            ("Within one metre", "Anywhere in the same room", "So close that it touches the object"),
            "The robot must stand within one metre of the object. Seeing it from the door is not enough.",
        ),
        Question(
            "stop",
            "How do you give your answer?",
            ("Press STOP (or Enter) twice", "Click the object in the picture", "Walk until the steps are used up"),
            "Press STOP, or the Enter key, twice. The second press makes it count, so nobody stops by accident."
            f" Who does not stop within {config.steps} steps has given no answer.",
        ),
    )


_POG = (
    Question(
        "mark",
        "You clicked, but the mark is on the wrong object. What can you do?",
        ("Click again: the mark moves", "Nothing: the first click counts", "Reload the page"),
        "The mark moves with each click. Only the mark that you confirm counts.",
    ),
    Question(
        "confirm",
        "When is your answer given?",
        ("When I press Confirm the mark", "When I click for the first time", "When I stop moving the mouse"),
        "A mark counts when you press Confirm the mark, not before.",
    ),
)
_WHOSE = Question(
    "whose",
    "The line above says: Find Mira's chair. There are four chairs. Which one counts?",
    ("The one that the text says is Mira's", "Any chair", "The nearest chair"),
    "Only the object that belongs to that person counts. The text says which one it is.",
)
_FEEDBACK = Question(
    "feedback",
    "Will you be told after a search whether you were right?",
    ("No", "Yes, at once", "Yes, after the break"),
    "Nobody is told during the study. Please give your best answer each time.",
)
_GONE = Question(
    "gone",
    "You see the home before the search. Can you look at it again while you walk?",
    ("No, it is gone when the robot starts", "Yes, at any time", "Yes, once"),
    "The view from outside is gone when the robot starts. Remember what you can.",
)
_QUESTIONS_OF_CONDITIONS: dict[Condition, Question] = {
    "topdown": _GONE,
    "glb": _GONE,
    "map_first": Question(
        "order",
        "What do you see first?",
        ("The home alone; what to find comes after that", "Only the text", "The answer of somebody else"),
        "First you look at the home. What to find is said after that.",
    ),
}

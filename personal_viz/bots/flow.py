"""What a bot answers to the cards between trials: it finds buttons by their labels, as a person does."""

from human_study.design.study import StudyConfig
from human_study.texts.quiz import questions_for
from sim.types import TaskKind

from .wire import BotConnection

_ON = (r"^begin", r"^next", r"^continue$", r"^go on", r"^try again")
"""Labels that lead on, the likeliest first."""


def right_answers(config: StudyConfig, task: TaskKind = "pan") -> frozenset[str]:
    """The labels of all right answers in the quiz of a task's participants."""
    return frozenset(question.answers[0] for question in questions_for(config, task, config.conditions(task)))


async def answer_card(connection: BotConnection, *, sure: int = 1) -> bool:
    """Presses what leads on; False when the page offers nothing, or nothing yet.

    Args:
        connection: With the page.
        sure: What is said when the page asks how sure an answer is, 1 to 5.
    """
    for pattern in (*_ON, rf"^{sure}:"):
        button = connection.page.button(pattern)
        if button is not None:
            await connection.set_value(button.uuid, True)
            return True
    return False

"""What a bot answers to each page around the trials: it finds buttons by their labels, as a person does."""

import time

from human_study.design.study import StudyConfig
from human_study.texts.quiz import questions_for
from sim.types import TaskKind

from .page import BotPage
from .wire import BotConnection

DEVICE = {"webgl2": True, "width": 1280, "height": 800}
"""What a bot's browser says of itself."""
_ON = (
    r"^start",
    r"^begin",
    r"^next",
    r"^continue$",
    r"^go on",
    r"^i agree",
    r"^i have read",
    r"^try again",
)
"""Labels that lead on, the likeliest first."""
_END = ("thank you", "you can close this page", "completion code", "you will be paid")


def right_answers(config: StudyConfig, task: TaskKind = "pan") -> frozenset[str]:
    """The labels of all right answers in the quiz of a task's participants."""
    return frozenset(question.answers[0] for question in questions_for(config, task, config.conditions(task)))


def is_the_end(page: BotPage) -> bool:
    """Whether nothing is left to do."""
    text = page.text.lower()
    return any(words in text for words in _END) and not page.of_kind("GuiButtonMessage")


def is_the_pause(page: BotPage) -> bool:
    """Whether the study asks for a rest that is longer than a bot waits."""
    return page.button(r"^look whether") is not None


async def answer_page(connection: BotConnection, answers: frozenset[str], *, sure: int = 1) -> bool:
    """Does what leads on; False when the page offers nothing, or nothing yet.

    Args:
        connection: With the page.
        answers: The right answers to the quiz.
        sure: What is said when the page asks how sure an answer is, 1 to 5.
    """
    page = connection.page
    if "Looking at your browser" in page.text:
        now_ms = time.perf_counter() * 1e3
        return await connection.tell({"kind": "device", "n": int(now_ms), "t_cli_ms": now_ms, **DEVICE})
    key = page.command("W")
    if key is not None and page.button(r"without a keyboard") is not None:
        await connection.trigger(key.uuid)
        return True
    for button in page.of_kind("GuiButtonMessage"):
        if button.label in answers:
            await connection.set_value(button.uuid, True)
            return True
    for pattern in (*_ON, rf"^{sure}:"):
        button = page.button(pattern)
        if button is not None:
            await connection.set_value(button.uuid, True)
            return True
    return False

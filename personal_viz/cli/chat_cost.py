"""Limits and cost of a run's chat model, for the verbs that ask one."""

from typing import Protocol

from grounding.chat.budget import ChatUsage
from sim.errors import AgentError
from sim.words.english import how_many


class ChatLimits(Protocol):
    """The options of a verb that limit a chat model and price it."""

    max_calls: int | None
    max_tokens: int | None
    price: tuple[float, float] | None


def require_chat_for_limits(verb: ChatLimits, *, has_chat: bool) -> None:
    """Refuses limits that would be ignored, and prices below zero.

    Raises:
        AgentError: The message names the option.
    """
    for option, value in (
        ("--max-calls", verb.max_calls),
        ("--max-tokens", verb.max_tokens),
        ("--price", verb.price),
    ):
        if value is not None and not has_chat:
            raise AgentError(
                f"{option} is {value!r} without a chat model; expected it with --llm-url and --llm-model only. Leave "
                "it out."
            )
    if verb.price is not None and not all(0 <= money < float("inf") for money in verb.price):
        raise AgentError(f"--price is {verb.price!r}; expected two amounts of at least 0. Give others.")


def chat_line(used: ChatUsage, price: tuple[float, float] | None) -> str:
    """The usage in one line.

    Args:
        used: Of the run, over all calls that continued it.
        price: Money for a million tokens of prompts, and of answers; None = the cost is not known.
    """
    cost = "" if price is None else f", {used.cost(price):.2f} at {price[0]:g} and {price[1]:g} for a million"
    return (
        f"Chat model in this run: {how_many(used.calls, 'call')} ({used.cached} more answered from the cache, "
        f"{used.no_answer} without an answer, {used.retries} retries), {used.prompt_tokens} + {used.completion_tokens} "
        f"tokens{cost}."
    )


def chat_document(used: ChatUsage, price: tuple[float, float] | None) -> dict[str, object]:
    """The usage for `--json`."""
    return {**used.model_dump(), "cost": None if price is None else round(used.cost(price), 4)}

"""The one door to language models: an OpenAI-compatible chat endpoint (OpenAI, vLLM, Ollama, llama.cpp).

Words and pictures -> one request at temperature 0 -> the model's words. Answers are kept in the cache folder; the key
covers everything that they depend on. Phrases, descriptions, grounders and agents all ask here.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, HttpUrl, ValidationError, field_validator

from sim.cache import cached_bytes
from sim.errors import AgentError
from sim.extras import require
from sim.tasks.chat_turns import picture_name

from .budget import Budget, ChatUsage
from .pictures import data_url, png_of
from .protocol import NoAnswer, NoWords, Part

GIVE_UP_AFTER = 5
"""Questions without an answer in a row that end the run: a dead server would give all that is left to a fallback."""
_VERSION = 1
"""Part of the cache's key."""
_MOST_SAID = 300
"""Characters of a server's words that errors repeat."""
_REFUSALS = {401: "the key", 403: "the key", 404: "--llm-url and --llm-model"}
"""HTTP statuses that a second question will not change, and the setting to correct."""


class LlmOptions(BaseModel):
    """Address of the model, with the name of the key's environment variable but never the key."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    base_url: HttpUrl
    """E.g. http://127.0.0.1:11434/v1."""
    model: str = Field(min_length=1)
    api_key_env: str | None = Field(default=None, pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    """Environment variable that holds the key; None = the server needs no key."""
    timeout_s: float = Field(default=60.0, gt=0, allow_inf_nan=False)
    """Longest time for one request, seconds."""
    max_retries: int = Field(default=3, ge=0)
    """Further requests after time-outs and HTTP 429 or 5xx, later each time, or when the server's Retry-After says."""

    @field_validator("base_url")
    @classmethod
    def _without_secrets(cls, url: HttpUrl) -> HttpUrl:
        if url.username or url.password:
            raise ValueError("an address without name and password; options are kept in run files")
        return url


def llm_options(url: str, model: str, key_env: str) -> LlmOptions:
    """The options of `--llm-url`, `--llm-model` and `--llm-key-env`; an empty `key_env` = no key.

    Raises:
        AgentError: One of them is not valid.
    """
    try:
        return LlmOptions.model_validate({"base_url": url, "model": model, "api_key_env": key_env or None})
    except ValidationError as error:
        first = error.errors()[0]
        raise AgentError(
            f"--llm-url, --llm-model or --llm-key-env: {first['loc'][0]} is {first['input']!r} ({first['msg']}); "
            "expected an address such as http://127.0.0.1:11434/v1. Correct the option."
        ) from None


@dataclass(frozen=True, slots=True)
class Reply:
    """The outcome of one question."""

    answer: str
    """The model's words; "" = none came."""
    problem: NoAnswer | None
    """Why none came; None where one came."""
    used: ChatUsage
    sent: tuple[str | bytes, ...]
    """The parts as they were sent: texts, and PNG files of pictures."""


class Endpoint:
    """A `Chat` (protocol.py) behind an address. Not for several threads."""

    def __init__(self, options: LlmOptions, *, budget: Budget | None = None) -> None:
        """Sends no request yet.

        Args:
            options: Address and model.
            budget: The run's limits, and the file that counts; None = neither.

        Raises:
            AgentError: The key's environment variable is not set.
            MissingDependencyError: The package `openai` is missing.
        """
        self.options = options
        self._budget = budget
        self._openai = require("openai", extra="llm")
        self._requests = 0
        self._failures_in_a_row = 0
        self._client = self._openai.OpenAI(
            base_url=str(options.base_url),
            api_key=_key(options),
            timeout=options.timeout_s,
            max_retries=options.max_retries,
            http_client=self._openai.DefaultHttpxClient(event_hooks={"request": [self._count_request]}),
        )

    @property
    def name(self) -> str:
        """The model's name."""
        return self.options.model

    def ask(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> str:
        """As the protocol says.

        Raises:
            NoAnswer: None came.
            AgentError: The server refuses the key or the model or gave no answer several times, or the budget is spent.
        """
        reply = self.reply(system, parts, is_json=is_json)
        if reply.problem is not None:
            raise reply.problem
        return reply.answer

    def reply(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> Reply:
        """The answer with what it cost, or the reason why none came.

        Raises:
            AgentError: As in `ask`.
        """
        sent = tuple(part if isinstance(part, str) else png_of(part) for part in parts)
        named = [part if isinstance(part, str) else [picture_name(part)] for part in sent]
        key = json.dumps([_VERSION, str(self.options.base_url), self.options.model, system, named, is_json])
        fresh: list[ChatUsage] = []

        def asked() -> bytes:
            answer, used = self._asked(system, sent, is_json=is_json)
            fresh.append(used)
            return answer.encode()

        try:
            answer = cached_bytes("chat", key, asked).decode()
        except _Failed as error:
            return Reply("", error.problem, error.used, sent)
        if not fresh:
            self._count(ChatUsage(cached=1))
        return Reply(answer, None, fresh[0] if fresh else ChatUsage(cached=1), sent)

    def _asked(self, system: str, sent: Sequence[str | bytes], *, is_json: bool) -> tuple[str, ChatUsage]:
        """The answer of the server; `_Failed` where none came."""
        if self._budget is not None:
            self._budget.take_call()
        more = {"response_format": {"type": "json_object"}} if is_json else {}
        messages = [{"role": "system", "content": system}, {"role": "user", "content": _content(sent)}]
        self._requests, answer, problem, tokens = 0, "", None, (0, 0)
        try:
            made = self._client.chat.completions.create(
                model=self.options.model, temperature=0, messages=messages, **more
            )
            answer, problem, tokens = *_answer_of(made), _tokens_of(made)
        except self._openai.OpenAIError as error:
            problem = NoAnswer(self._reason(error))
        except ValueError as error:  # the body is not JSON
            problem = NoAnswer(f"the server's answer is not JSON: {error}")
        is_dead = problem is not None and not isinstance(problem, NoWords)
        self._failures_in_a_row = self._failures_in_a_row + 1 if is_dead else 0
        if self._failures_in_a_row >= GIVE_UP_AFTER:
            raise AgentError(
                f"{self.options.base_url}: gave no answer {GIVE_UP_AFTER} times in a row ({problem}); expected one. "
                "What is done is kept: correct --llm-model or the server, and run the same command again."
            )
        used = ChatUsage(
            no_answer=problem is not None,
            retries=max(0, self._requests - 1),
            prompt_tokens=tokens[0],
            completion_tokens=tokens[1],
        )
        self._count(used)
        used += ChatUsage(calls=1)
        if problem is not None:
            raise _Failed(problem, used)
        return answer, used

    def _count(self, used: ChatUsage) -> None:
        if self._budget is not None:
            self._budget.add(used)

    def _count_request(self, _: object) -> None:
        self._requests += 1

    def _reason(self, error: Exception) -> str:
        """The reason for an error of the client in a few words; raises AgentError if it will not change."""
        status = getattr(error, "status_code", None)
        if status in _REFUSALS:
            raise AgentError(
                f"{self.options.base_url}: refused the request for model {self.options.model!r} (HTTP {status}); "
                f"expected an answer. Correct {_REFUSALS[status]}."
            ) from None
        said = " ".join(str(error).split()).removeprefix(f"Error code: {status}").lstrip(" -")[:_MOST_SAID]
        return ": ".join(filter(None, (f"HTTP {status}" if status else "", said))) or type(error).__name__


class _Failed(Exception):
    """No answer came; it is not kept in the cache."""

    def __init__(self, problem: NoAnswer, used: ChatUsage) -> None:
        super().__init__(str(problem))
        self.problem, self.used = problem, used


def _key(options: LlmOptions) -> str:
    if options.api_key_env is None:
        return "none"  # the client requires some key
    key = os.environ.get(options.api_key_env)
    if not key:
        raise AgentError(
            f"--llm-key-env: environment variable {options.api_key_env} is not set; expected the key of "
            f"{options.base_url}. Set it, or leave --llm-key-env out for a server without keys."
        )
    return key


def _content(sent: Sequence[str | bytes]) -> str | list[dict[str, Any]]:
    """The parts in OpenAI's form; words alone as one text, which servers without pictures take too."""
    if all(isinstance(part, str) for part in sent):
        return "\n\n".join(part for part in sent if isinstance(part, str))
    return [
        {"type": "text", "text": part}
        if isinstance(part, str)
        else {"type": "image_url", "image_url": {"url": data_url(part)}}
        for part in sent
    ]


def _answer_of(made: object) -> tuple[str, NoAnswer | None]:
    """The text of a chat completion, or the reason why there is none."""
    choices = getattr(made, "choices", None) or ()
    message = getattr(choices[0], "message", None) if choices else None
    content = getattr(message, "content", None)
    if getattr(choices[0] if choices else None, "finish_reason", None) == "length":
        return "", NoWords("the answer is cut off at the server's limit of tokens")
    if isinstance(content, str) and content.strip():
        return content.encode("utf-8", "replace").decode(), None  # half a surrogate pair cannot be written
    refusal = getattr(message, "refusal", None)
    return "", NoWords(f"the model refuses: {refusal}" if refusal else "the answer holds no text")


def _tokens_of(made: object) -> tuple[int, int]:
    """Tokens of prompt and answer; 0 where the server does not tell them."""
    usage = getattr(made, "usage", None)
    counts = [getattr(usage, name, None) for name in ("prompt_tokens", "completion_tokens")]
    prompt, completion = (count if isinstance(count, int) and count >= 0 else 0 for count in counts)
    return prompt, completion

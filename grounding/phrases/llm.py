"""A language model behind an OpenAI-compatible chat endpoint (OpenAI, vLLM, Ollama, llama.cpp), and phrases from it.

For phrases, the model gets the description of a task and nothing else. Answers are kept in the cache folder; the key
covers everything that they depend on. If an answer is missing or unreadable, the rules answer instead, with a count
and a warning.
"""

import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, HttpUrl, ValidationError, field_validator

from sim.cache import cached_bytes
from sim.errors import AgentError
from sim.extras import require
from sim.types import Task

from .rules import RulePhrases

PROMPT = """You read a paragraph about a home and list who owns what.
Answer with one JSON object and nothing else:
{"ownership": [{"owner": "<first name>", "object": "<object with its article and looks>", "room": "<room or empty>"}]}
One entry per owner and object: an object shared by three people gives three entries. Write names as the paragraph has
them. Describe each object as fully as the paragraph does (colour, material, what it is near), in its words. Replace
"it", "both" and "the same room" by what they stand for. Leave out objects without an owner."""
_PROMPT_VERSION = 1
"""Part of the cache's key, as is the prompt itself."""
_GIVE_UP_AFTER = 5
"""Failures in a row after which no more requests are sent: a dead server would cost one time-out per description."""
_REFUSALS = {401: "the key", 403: "the key", 404: "--llm-url and --llm-model"}
"""HTTP statuses that a second request will not change, and the setting to correct."""


Message = dict[str, str]
"""`role` and `content`, as in OpenAI's interface."""


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


class Chat:
    """The endpoint: asks the model, and says in words why it gave no answer."""

    def __init__(self, options: LlmOptions) -> None:
        """Sends no request yet.

        Raises:
            AgentError: The key's environment variable is not set.
            MissingDependencyError: The package `openai` is missing.
        """
        self.options = options
        openai = require("openai", extra="llm")
        self.Error: type[Exception] = openai.OpenAIError
        """Raised by `ask` where no answer came."""
        self._client = openai.OpenAI(
            base_url=str(options.base_url), api_key=_key(options), timeout=options.timeout_s, max_retries=1
        )

    def ask(self, messages: Sequence[Message], *, is_json: bool = False) -> str:
        """The text of the model's answer at temperature 0; empty where the answer holds no text.

        Raises:
            Chat.Error: No answer came; `reason` says why.
        """
        more = {"response_format": {"type": "json_object"}} if is_json else {}
        reply = self._client.chat.completions.create(
            model=self.options.model, temperature=0, messages=list(messages), **more
        )
        return _content_of(reply)

    def reason(self, error: Exception) -> str:
        """The reason for an `Error` in a few words.

        Raises:
            AgentError: The server refuses the key or the model, and would refuse every other request too.
        """
        status = getattr(error, "status_code", None)
        if status in _REFUSALS:
            raise AgentError(
                f"phrases: {self.options.base_url} refused the request for model {self.options.model!r} "
                f"(HTTP {status}); expected an answer. Correct {_REFUSALS[status]}."
            ) from None
        return f"HTTP {status}" if status else str(error) or type(error).__name__


class _Owned(BaseModel):
    """One entry of an answer."""

    owner: str = Field(min_length=1)
    object: str = Field(min_length=1)
    room: str | None = None


class _Reply(BaseModel):
    """The answer that the prompt asks for; more fields are ignored."""

    ownership: tuple[_Owned, ...]


class ChatPhrases:
    """A `PhraseSource` that asks a model once per description."""

    def __init__(self, options: LlmOptions, *, warn: Callable[[str], None] | None = None) -> None:
        """Sends no request yet; `warn` gets each problem in one line, by default it goes to stderr.

        Raises:
            AgentError: The key's environment variable is not set.
            MissingDependencyError: The package `openai` is missing.
        """
        self.name = f"llm:{options.model}"
        self.num_fallbacks = 0
        """Calls in this process that the rules answered instead; a run counts its own from its answers."""
        self.num_dropped = 0
        """Entries left out because their owner is not named in the text."""
        self._chat = Chat(options)
        self._rules = RulePhrases()
        self._warn = warn or (lambda line: print(line, file=sys.stderr, flush=True))
        self._failures_in_a_row = 0

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The model's phrases "X owns Y in the Z"; the phrases of the rules if the model gives none.

        Raises:
            AgentError: The server refuses the key or the model, and would refuse every other request too.
        """
        try:
            content = self._content(task.description)
            entries = _Reply.model_validate_json(_json_in(content)).ownership
        except ValueError as error:  # the body is not JSON, or the model's words inside it are not
            first = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            return self._fall_back(task, f"the answer is not the JSON asked for: {first}")
        except self._chat.Error as error:
            self._failures_in_a_row += 1
            return self._fall_back(task, self._chat.reason(error))
        known = [entry for entry in entries if _stands_in(entry.owner, task.description)]
        if len(known) < len(entries):
            self.num_dropped += len(entries) - len(known)
            strangers = sorted({entry.owner for entry in entries} - {entry.owner for entry in known})
            self._warn(f"phrases: {self.name} named owners that the text does not: {', '.join(strangers)}; left out")
        if not known:
            return self._fall_back(task, "the answer names no owner of the text")
        return tuple(dict.fromkeys(map(_sentence, known)))

    def _content(self, description: str) -> str:
        if self._failures_in_a_row >= _GIVE_UP_AFTER:
            raise self._chat.Error(f"no longer asked after {_GIVE_UP_AFTER} failures in a row")
        options = self._chat.options
        key = json.dumps([_PROMPT_VERSION, PROMPT, str(options.base_url), options.model, description])
        return cached_bytes("phrases", key, lambda: self._asked(description).encode()).decode()

    def _asked(self, description: str) -> str:
        """The model's answer; its form is checked here, so that no bad answer is kept."""
        content = self._chat.ask(
            [{"role": "system", "content": PROMPT}, {"role": "user", "content": description}], is_json=True
        )
        self._failures_in_a_row = 0
        _Reply.model_validate_json(_json_in(content))
        return content

    def _fall_back(self, task: Task, reason: str) -> tuple[str, ...]:
        self.num_fallbacks += 1
        self._warn(f"phrases: {self.name} gave no answer ({reason}); read by rules instead")
        return self._rules.phrases(task)


def _key(options: LlmOptions) -> str:
    if options.api_key_env is None:
        return "none"  # the client requires some key
    key = os.environ.get(options.api_key_env)
    if not key:
        raise AgentError(
            f"phrases: environment variable {options.api_key_env} is not set; expected the key of {options.base_url}. "
            "Set it, or leave --llm-key-env out for a server without keys."
        )
    return key


def _content_of(reply: Any) -> str:
    """The text of a chat completion; empty (so not JSON) if the server's answer has another shape."""
    choices = getattr(reply, "choices", None) or ()
    message = getattr(choices[0], "message", None) if choices else None
    content = getattr(message, "content", None)
    return content if isinstance(content, str) else ""


def said_in(content: str) -> str:
    """An answer without the model's reasoning before it."""
    return re.sub(r"<think>.*?</think>", "", content, flags=re.DOTALL).strip()


def _json_in(content: str) -> str:
    """The outermost {...}; models put it into code fences and after their reasoning."""
    found = re.search(r"\{.*\}", said_in(content), re.DOTALL)
    return found[0] if found else content


def _stands_in(owner: str, text: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(owner)}(?!\w)", text) is not None


def _sentence(entry: _Owned) -> str:
    room = re.sub(r"^(?:in\s+)?(?:the\s+)?", "", (entry.room or "").strip(), flags=re.IGNORECASE).rstrip(".")
    return f"{entry.owner} owns {entry.object.strip().rstrip('.')}" + (f" in the {room}" if room else "")

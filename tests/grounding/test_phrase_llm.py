"""Phrases from a chat endpoint: the request, the cache, and rules as the fallback for wrong or missing answers."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from grounding.chat.endpoint import Endpoint, LlmOptions
from grounding.phrases.llm import ChatPhrases
from grounding.phrases.rules import RulePhrases
from grounding.phrases.sources import make_phrases
from sim.errors import AgentError
from sim.types import Task

from .chat_stub import ChatStub, chat_stub

pytest.importorskip("openai", reason="extra llm is not installed")

TEXT = "In the hall, Ada owns a red lamp near the door. The blue sofa in the den belongs to Bo."
TASK = Task("pog", TEXT, ("Find Ada's lamp",))
ENTRIES = [
    {"owner": "Ada", "object": "a red lamp near the door", "room": "the hall"},
    {"owner": "Bo", "object": "the blue sofa", "room": "den"},
]
PHRASES = ("Ada owns a red lamp near the door in the hall", "Bo owns the blue sofa in the den")


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def stub() -> Iterator[ChatStub]:
    with chat_stub() as server:
        server.content = json.dumps({"ownership": ENTRIES})
        yield server


class Source:
    """A phrase source that asks the stub, and the warnings that it gave."""

    def __init__(self, stub: ChatStub, **options: object) -> None:
        self.warnings: list[str] = []
        settings = LlmOptions.model_validate({"base_url": stub.url, "model": "small", "max_retries": 0, **options})
        self.source = ChatPhrases(Endpoint(settings), warn=self.warnings.append)

    def ask(self, task: Task = TASK) -> tuple[str, ...]:
        return self.source.phrases(task)


def test_the_model_is_asked_once_and_gets_only_the_description(stub: ChatStub) -> None:
    first = Source(stub)
    assert first.ask() == first.ask() == PHRASES
    assert Source(stub).ask() == PHRASES
    (request,) = stub.requests
    assert request["temperature"] == 0
    assert request["model"] == "small"
    assert request["response_format"] == {"type": "json_object"}
    assert [message["role"] for message in request["messages"]] == ["system", "user"]
    assert request["messages"][1]["content"] == TEXT
    assert first.warnings == []


def test_another_model_or_another_text_is_asked_again(stub: ChatStub) -> None:
    Source(stub).ask()
    Source(stub, model="large").ask()
    Source(stub).ask(Task("pog", TEXT + " That is all.", ("Find Ada's lamp",)))
    assert len(stub.requests) == 3


def test_the_key_comes_from_the_environment_and_is_sent(stub: ChatStub, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_KEY", "secret-1")
    source = Source(stub, api_key_env="MY_KEY")
    source.ask()
    assert stub.keys == ["Bearer secret-1"]
    assert "secret-1" not in LlmOptions.model_validate({"base_url": stub.url, "model": "m"}).model_dump_json()
    monkeypatch.delenv("MY_KEY")
    with pytest.raises(AgentError, match="MY_KEY is not set"):
        Source(stub, api_key_env="MY_KEY")


def test_an_address_with_a_password_is_refused() -> None:
    with pytest.raises(ValidationError, match="without name and password"):
        LlmOptions.model_validate({"base_url": "http://me:pw@127.0.0.1/v1", "model": "m"})


def test_code_fences_and_thoughts_around_the_json_are_ignored(stub: ChatStub) -> None:
    stub.content = f"<think>Who is {{Bo}}?</think>Here:\n```json\n{stub.content}\n```"
    assert Source(stub).ask() == PHRASES


def test_rules_read_the_text_if_the_server_does_not_answer_in_time(stub: ChatStub) -> None:
    stub.is_stuck = True
    source = Source(stub, timeout_s=0.1)
    assert source.ask() == RulePhrases().phrases(TASK)
    assert "timed out" in source.warnings[0]


@pytest.mark.parametrize(
    "content",
    ["I cannot say.", "", "<think>Ada?</think>", '{"ownership": "Ada"}', '{"owners": []}', '{"ownership": [', None],
)
def test_rules_read_the_text_if_the_answer_is_not_the_requested_json(stub: ChatStub, content: str | None) -> None:
    stub.content = content
    broken = Source(stub)
    assert broken.ask() == RulePhrases().phrases(TASK)
    assert broken.source.num_fallbacks == 1
    assert broken.warnings[0].endswith("read by rules instead")


@pytest.mark.parametrize("body", [b"<html>busy</html>", b"{}", b'{"choices": []}', b"null"])
def test_rules_read_the_text_if_the_body_is_no_chat_answer(stub: ChatStub, body: bytes) -> None:
    stub.body = body
    broken = Source(stub)
    assert broken.ask() == RulePhrases().phrases(TASK)
    assert broken.source.num_fallbacks == 1


def test_owners_that_the_text_does_not_name_are_left_out(stub: ChatStub) -> None:
    strangers = [{"owner": "Zoe", "object": "the sofa"}, {"owner": "Ad", "object": "the sofa"}]
    stub.content = json.dumps({"ownership": [*strangers, *ENTRIES]})
    source = Source(stub)
    assert source.ask() == PHRASES
    assert source.source.num_dropped == 2
    assert "Ad, Zoe" in source.warnings[0]
    stub.content = json.dumps({"ownership": strangers})
    other = Task("pog", TEXT + " Good night.", ("Find Ada's lamp",))
    assert source.ask(other) == RulePhrases().phrases(other)
    assert source.source.num_fallbacks == 1


def test_rules_replace_a_failing_server_until_five_failures_in_a_row_end_the_run(stub: ChatStub) -> None:
    stub.status = 500
    source = Source(stub)
    tasks = [Task("pog", f"{TEXT} There are {number} rooms.", TASK.queries) for number in range(5)]
    assert [source.ask(task) for task in tasks[:4]] == [RulePhrases().phrases(task) for task in tasks[:4]]
    assert source.source.num_fallbacks == 4
    assert "HTTP 500" in source.warnings[0]
    with pytest.raises(AgentError, match=r"gave no answer 5 times in a row \(HTTP 500.*run the same command again\.$"):
        source.ask(tasks[4])


def test_sources_are_made_by_name(stub: ChatStub) -> None:
    options = LlmOptions.model_validate({"base_url": stub.url, "model": "small"})
    assert make_phrases("llm", chat=Endpoint(options)).name == "llm:small"
    assert make_phrases("rules").name == "rules"
    assert make_phrases("dataset").name == "dataset"
    with pytest.raises(AgentError, match="--llm-url"):
        make_phrases("llm")

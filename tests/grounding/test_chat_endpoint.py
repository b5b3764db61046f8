"""The endpoint of chat models against a stub server that also misbehaves: cache, retries, budget, transcript."""

import json
import multiprocessing
from base64 import b64decode
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.chat.budget import Budget, ChatUsage
from grounding.chat.endpoint import Endpoint, LlmOptions
from grounding.chat.protocol import NoAnswer, NoWords
from grounding.chat.transcript import RecordedChat
from sim.errors import AgentError, RunFileError
from sim.tasks.chat_turns import read_turns
from sim.types import EpisodeKey

from .chat_stub import ChatStub, chat_stub

pytest.importorskip("openai", reason="extra llm is not installed")

KEY = EpisodeKey("easy", "HomeOne", "0")
AT_ONCE = {"Retry-After": "0.001"}
PICTURE = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ChatStub]:
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    with chat_stub() as server:
        server.content, server.tokens = "seven", (100, 20)
        yield server


def endpoint(stub: ChatStub, *, budget: Budget | None = None, **options: object) -> Endpoint:
    return Endpoint(LlmOptions.model_validate({"base_url": stub.url, "model": "small", **options}), budget=budget)


def test_words_and_pictures_are_sent_once_at_temperature_0(stub: ChatStub) -> None:
    large = np.zeros((30, 2048, 3), np.uint8)
    for _ in range(2):
        assert endpoint(stub).ask("Count.", ["How many?", PICTURE, large]) == "seven"
    (request,) = stub.requests
    assert request["temperature"] == 0
    text, small, scaled = request["messages"][1]["content"]
    assert text == {"type": "text", "text": "How many?"}
    assert np.array_equal(_picture(small), PICTURE)
    assert _picture(scaled).shape == (15, 1024, 3)


@pytest.mark.parametrize(
    ("options", "system", "parts"),
    [({}, "Count.", ["a", 255 - PICTURE]), ({}, "Look.", ["a", PICTURE]), ({"model": "b"}, "Count.", ["a", PICTURE])],
    ids=["another picture", "another task", "another model"],
)
def test_every_part_of_a_question_counts_for_the_cache(stub: ChatStub, options: dict, system: str, parts: list) -> None:
    endpoint(stub).ask("Count.", ["a", PICTURE])
    endpoint(stub, **options).ask(system, parts)
    assert len(stub.requests) == 2


@pytest.mark.parametrize("status", [429, 500, 503])
def test_a_busy_server_is_asked_again_when_it_says(stub: ChatStub, tmp_path: Path, status: int) -> None:
    stub.failures = [(status, AT_ONCE), (status, AT_ONCE)]
    budget = Budget(tmp_path / "run")
    assert endpoint(stub, budget=budget).ask("Count.", ["a"]) == "seven"
    assert budget.used() == ChatUsage(calls=1, retries=2, prompt_tokens=100, completion_tokens=20)


def test_no_answer_after_the_last_retry_says_the_status_and_is_not_kept(stub: ChatStub, tmp_path: Path) -> None:
    stub.failures = [(500, AT_ONCE)] * 3
    budget = Budget(tmp_path / "run")
    chat = endpoint(stub, budget=budget, max_retries=2)
    with pytest.raises(NoAnswer, match="HTTP 500"):
        chat.ask("Count.", ["a"])
    assert budget.used() == ChatUsage(calls=1, no_answer=1, retries=2)
    assert chat.ask("Count.", ["a"]) == "seven"


def test_a_slow_server_gives_no_answer(stub: ChatStub) -> None:
    stub.is_stuck = True
    with pytest.raises(NoAnswer, match="timed out"):
        endpoint(stub, timeout_s=0.05, max_retries=0).ask("Count.", ["a"])


def test_a_refusal_is_told_and_the_server_is_asked_on(stub: ChatStub) -> None:
    chat = endpoint(stub)
    stub.content, stub.refusal = None, "I cannot help"
    for _ in range(7):
        with pytest.raises(NoWords, match="the model refuses: I cannot help"):
            chat.ask("Count.", ["a"])
    assert len(stub.requests) == 7


def test_an_answer_that_is_cut_off_is_none_and_is_not_kept(stub: ChatStub) -> None:
    stub.content, stub.finish = '{"number": 1', "length"
    chat = endpoint(stub)
    with pytest.raises(NoWords, match="cut off"):
        chat.ask("Count.", ["a"])
    stub.content, stub.finish = "\ud83d seven", "stop"
    assert chat.ask("Count.", ["a"]) == "? seven", "half a surrogate pair cannot be written to a file"


def test_a_server_that_takes_no_pictures_ends_the_run_with_its_own_words(stub: ChatStub) -> None:
    stub.status, stub.body = 400, b'{"error": {"message": "this model reads no images"}}'
    chat = endpoint(stub)
    for text in "abcd":
        with pytest.raises(NoAnswer, match=r"HTTP 400: .*this model reads no images"):
            chat.ask("Count.", [text])
    with pytest.raises(AgentError, match=r"5 times in a row .*this model reads no images.*run the same command again"):
        chat.ask("Count.", ["e"])


def test_calls_of_two_processes_are_all_counted(tmp_path: Path) -> None:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        list(pool.map(_count_fifty, [tmp_path, tmp_path]))
    assert Budget(tmp_path).used() == ChatUsage(calls=100)


def _count_fifty(folder: Path) -> None:
    for _ in range(50):
        Budget(folder, max_calls=100).take_call()


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_refused_key_or_model_ends_the_run(stub: ChatStub, status: int) -> None:
    stub.status = status
    with pytest.raises(AgentError, match=f"HTTP {status}"):
        endpoint(stub).ask("Count.", ["a"])


def test_a_spent_budget_of_calls_ends_the_run_and_a_larger_one_continues(stub: ChatStub, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    first = endpoint(stub, budget=Budget(folder, max_calls=2))
    first.ask("Count.", ["a"])
    endpoint(stub, budget=Budget(folder, max_calls=2)).ask("Count.", ["b"])  # another worker process
    assert first.ask("Count.", ["a"]) == "seven"  # a kept answer costs nothing
    with pytest.raises(AgentError) as error:
        first.ask("Count.", ["c"])
    assert str(error.value) == (
        f"--max-calls: the run has used 2 of 2; expected some left for the next question. What is done is kept in "
        f"{folder}: run the same command with a larger --max-calls to go on."
    )
    assert endpoint(stub, budget=Budget(folder, max_calls=3)).ask("Count.", ["c"]) == "seven"
    assert Budget(folder).used() == ChatUsage(calls=3, cached=1, prompt_tokens=300, completion_tokens=60)
    assert Budget(folder).used().cost((2.0, 10.0)) == pytest.approx(0.0012)


def test_a_spent_budget_of_tokens_ends_the_run(stub: ChatStub, tmp_path: Path) -> None:
    chat = endpoint(stub, budget=Budget(tmp_path, max_tokens=120))
    chat.ask("Count.", ["a"])
    with pytest.raises(AgentError, match="--max-tokens: the run has used 120 of 120"):
        chat.ask("Count.", ["b"])
    assert len(stub.requests) == 1


def test_a_damaged_usage_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "chat_usage.json").write_text("{")
    with pytest.raises(RunFileError, match="Delete the file to count from zero"):
        Budget(tmp_path).take_call()


def test_a_transcript_holds_each_question_and_each_picture_once(stub: ChatStub) -> None:
    chat = RecordedChat(endpoint(stub))
    chat.ask("Look.", ["one", PICTURE])
    stub.content = None
    with pytest.raises(NoAnswer):
        chat.ask("Look.", ["two", PICTURE])
    first = chat.take(KEY)
    assert [(turn.call, turn.answer, turn.problem) for turn in first.turns] == [
        (1, "seven", ""),
        (2, "", "the answer holds no text"),
    ]
    (name,) = first.pictures
    assert np.array_equal(np.asarray(Image.open(BytesIO(first.pictures[name]))), PICTURE)
    assert [part.model_dump() for part in first.turns[0].parts] == [{"text": "one"}, {"picture": name}]
    chat.ask("Look.", ["one", PICTURE])
    later = chat.take(KEY)
    assert (later.turns[0].cached, later.turns[0].prompt_tokens, later.pictures) == (True, 0, {})
    assert chat.take(KEY).turns == ()


def test_turns_of_a_damaged_file_name_the_line(tmp_path: Path) -> None:
    (tmp_path / "chat.jsonl").write_text(json.dumps({"kind": "chat"}) + "\n")
    with pytest.raises(RunFileError, match=r"chat\.jsonl:1: .*split"):
        list(read_turns(tmp_path))


def _picture(part: dict) -> np.ndarray:
    head, data = part["image_url"]["url"].split(",")
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(BytesIO(b64decode(data))))

"""Descriptions of generated episodes: only paragraphs from which the rules read every owner and object are accepted."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from grounding.chat.endpoint import Endpoint, LlmOptions
from grounding.phrases.described import ANSWERS, Describer, misread
from sim.authoring.descriptions import OwnedItem
from sim.errors import AgentError

from .chat_stub import ChatStub, chat_stub

ITEMS = [
    OwnedItem("red lamp near the door", "hall", ("Ada",)),
    OwnedItem("blue sofa", "living room", ("Ada", "Bo")),
]
RIGHT = (
    "On the ground floor, the red lamp near the door in the hall belongs to Ada. The blue sofa in the living room "
    "is shared by Ada and Bo."
)
SWAPPED = RIGHT.replace("belongs to Ada", "belongs to Bo")


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ChatStub]:
    pytest.importorskip("openai", reason="extra llm is not installed")
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    with chat_stub() as server:
        yield server


def describer(stub: ChatStub) -> Describer:
    options = {"base_url": stub.url, "model": "small", "max_retries": 0}
    return Describer(Endpoint(LlmOptions.model_validate(options)))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (RIGHT, ""),
        (SWAPPED, "it does not say that Ada owns the red lamp near the door"),
        (RIGHT.replace("Ada and Bo", "Bo"), "it does not say that Ada owns the blue sofa"),
        (RIGHT.replace("belongs to Ada", "belongs to Ada and Bo"), "it says that Bo owns the red lamp near the door"),
        (RIGHT.replace("Ada and Bo", "Ada, Bo and Cy"), "it says that Cy owns the blue sofa"),
        (RIGHT + " Ada owns a bicycle in the garage.", "'Ada owns a bicycle in the garage' is about none"),
        ("", "it does not say that Ada owns the red lamp near the door"),
    ],
    ids=["right", "another owner", "an owner left out", "one more owner", "a stranger", "another object", "nothing"],
)
def test_a_paragraph_is_read_back_or_the_first_difference_is_named(text: str, problem: str) -> None:
    assert misread(text, ITEMS).startswith(problem)
    assert bool(misread(text, ITEMS)) == bool(problem)


def test_objects_with_equal_words_are_told_apart_by_their_rooms_or_not_at_all() -> None:
    twins = [OwnedItem("red lamp", "hall", ("Ada",)), OwnedItem("red lamp", "attic", ("Bo",))]
    assert not misread("Ada owns a red lamp in the hall. Bo owns a red lamp in the attic.", twins)
    assert "about several" in misread("Ada owns a red lamp. Bo owns a red lamp in the attic.", twins)


def test_templates_are_tried_until_one_is_read_back() -> None:
    describe = Describer()
    text = describe(ITEMS, floor="ground floor", rng=rng())
    assert text is not None
    assert not misread(text, ITEMS)
    assert "ground floor" in text
    assert describe.counts == {"templates": 1}
    unreadable = [OwnedItem("thing that belongs to Zed", "hall", ("Ada",)), *ITEMS]
    assert describe(unreadable, floor="ground floor", rng=rng()) is None


def test_a_right_answer_of_the_model_is_taken_and_asked_for_once(stub: ChatStub) -> None:
    stub.content = f"<think>Ada, Bo</think>\n{RIGHT}\n"
    for _ in range(2):
        describe = describer(stub)
        assert describe(ITEMS, floor="ground floor", rng=rng()) == RIGHT
        assert describe.counts == {"llm": 1}
    (request,) = stub.requests
    assert request["temperature"] == 0
    assert request["messages"][1]["content"] == (
        "Floor: ground floor\nOwners and objects:\n- Ada: a red lamp near the door, in the hall\n"
        "- Ada and Bo: a blue sofa, in the living room"
    )


@pytest.mark.parametrize("wrong", [SWAPPED, "", "No.", " ".join(["word"] * 700)])
def test_after_wrong_answers_templates_describe_and_both_are_counted(stub: ChatStub, wrong: str) -> None:
    stub.content = wrong
    describe = describer(stub)
    text = describe(ITEMS, floor="ground floor", rng=rng())
    assert text == Describer()(ITEMS, floor="ground floor", rng=rng())
    assert describe.counts == {"llm refused": ANSWERS, "templates": 1}
    last = stub.requests[-1]["messages"][1]["content"]
    assert last.count("You wrote: ") == last.count("That was refused: it ") == ANSWERS - 1


@pytest.mark.parametrize(
    ("content", "body"),
    [("", None), (" \n", None), (None, None), (None, b"{}"), (None, b'{"choices": []}')],
    ids=["empty", "blank", "no text", "no answer", "no choices"],
)
def test_an_empty_answer_is_counted_as_refused_and_asked_for_again_later(
    stub: ChatStub, content: str | None, body: bytes | None
) -> None:
    stub.content, stub.body = content, body
    describe = describer(stub)
    assert describe(ITEMS, floor="ground floor", rng=rng()) == Describer()(ITEMS, floor="ground floor", rng=rng())
    assert describe.counts == {"llm refused": ANSWERS, "templates": 1}
    stub.content, stub.body = RIGHT, None
    later = describer(stub)
    assert later(ITEMS, floor="ground floor", rng=rng()) == RIGHT
    assert later.counts == {"llm": 1}


@pytest.mark.parametrize(("status", "part"), [(500, "gave no answer (HTTP 500)"), (404, "refused the request")])
def test_an_endpoint_without_answers_ends_the_work(stub: ChatStub, status: int, part: str) -> None:
    stub.status = status
    with pytest.raises(AgentError) as error:
        describer(stub)(ITEMS, floor="ground floor", rng=rng())
    assert part in str(error.value)

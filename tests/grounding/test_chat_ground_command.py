"""`ground` with chat methods in a home that was walked for a few steps, against a stub server."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from grounding.agents.exploration import save_exploration
from grounding.agents.explore import explore, start_on_storey
from grounding.agents.explored_storeys import exploration_name
from grounding.chat.budget import Budget
from personal_viz.cli.grounding.ground import Ground
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError
from sim.homes.open_home import open_scene
from sim.tasks.chat_turns import ChatTurn, PicturePart, TextPart, read_turns
from sim.tasks.run_files import read_run
from sim.types import Camera
from tests.sim.home_story import leaks, marked_story, told_in

from .chat_stub import ChatStub, chat_stub

pytest.importorskip("openai", reason="extra llm is not installed")


@pytest.fixture(scope="module")
def explored(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An output folder that already holds a short walk through the home Small, instead of a whole exploration."""
    out = tmp_path_factory.mktemp("runs")
    scene = open_scene(PersonalDataset(small_home_root), "Small")
    start = start_on_storey(scene, scene.navigation.storey_heights[0], 0)
    name = exploration_name(scene, storey=0, seed=0, camera=Camera())
    save_exploration(out / "explorations" / name, explore(scene, start, max_steps=24))
    return out


@pytest.fixture
def stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ChatStub]:
    with chat_stub() as server:
        server.content, server.tokens = '{"ids": [1]}', (100, 5)
        monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
        yield server


def ground(explored: Path, root: Path, stub: ChatStub, method: str, **options: object) -> None:
    settings = {"layout": "objects", "paraphrase": 3} if method != "frames-vlm" else {}
    verb = Ground(
        dataset=root, method=method, map="explore", out=explored, llm_url=stub.url, llm_model="small", json=True,
        **{**settings, **options},
    )  # type: ignore[arg-type]  # fmt: skip
    assert verb.run() == 0


def the_caption_that_fits(request: dict) -> str:
    """The first thing of the list whose category is in the query."""
    question, things = request["messages"][1]["content"].split("\n\n[")
    query = question.rpartition("Query: ")[2].lower()
    fitting = [thing["id"] for thing in json.loads("[" + things) if thing["caption"] in query]
    return json.dumps({"ids": fitting[:3] or [1]})


def test_a_model_that_reads_the_list_finds_what_is_mapped_and_the_run_says_what_it_cost(
    explored: Path, small_home_root: Path, stub: ChatStub, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.think = the_caption_that_fits
    ground(explored, small_home_root, stub, "object-list-llm", price=(2.0, 10.0))
    found = json.loads(capsys.readouterr().out)
    run = read_run(Path(found["run"]))
    calls = len(stub.requests)
    assert (found["n"], found["fell_back"], found["phrases"]) == (24, 0, "none")
    assert found["top3"]["total"] > 25
    assert "chat model small" in run.info.condition
    assert found["chat"] == {
        "calls": calls, "cached": 24 - calls, "no_answer": 0, "retries": 0, "prompt_tokens": 100 * calls,
        "completion_tokens": 5 * calls, "cost": round(calls * 0.00025, 4),
    }  # fmt: skip
    turns = list(read_turns(Path(found["run"])))
    assert [turn.key for turn in turns] == [answer.key for answer in run.answers]


@pytest.mark.parametrize("method", ["object-list-llm", "map-image-vlm", "frames-vlm"])
def test_a_prompt_holds_the_task_and_what_perception_gave_and_nothing_else(
    explored: Path, small_home_root: Path, stub: ChatStub, method: str
) -> None:
    """All that differs between the prompts of a storey's episodes are description and query. The rest comes from the
    map or the walk, and with captions paraphrased to categories it holds no caption, owner, phrase or id of the
    dataset."""
    stub.content = '{"places": [{"frame": 1, "x": 5, "y": 400}]}' if method == "frames-vlm" else '{"ids": [1]}'
    ground(explored, small_home_root, stub, method, run_id=f"walked-{method}")
    folder = explored / f"walked-{method}"
    dataset = PersonalDataset(small_home_root)
    turns = list(read_turns(folder))
    assert len({turn.key for turn in turns}) == 24
    rests = {_without_the_task(turn, dataset) for turn in turns}
    assert len(rests) == 1
    (rest,) = rests
    for episode in dataset.episodes():
        record = episode.record
        captions = [caption for captions in record.captions_per_object for caption in captions]
        secrets = [*record.extracted_summary, *captions, record.owner, *record.object_names, record.episode_id]
        assert not [secret for secret in secrets if re.search(rf"\b{re.escape(secret)}\b", rest, re.IGNORECASE)]
    pictures = {part.picture for turn in turns for part in turn.parts if isinstance(part, PicturePart)}
    assert {path.name for path in (folder / "chat").glob("*.png")} == {Path(name).name for name in pictures}
    assert 0 < len(pictures) <= 16 or method == "object-list-llm"


def test_prompts_of_a_home_sequence_hold_nothing_before_its_time(
    explored: Path, small_home_root: Path, stub: ChatStub, tmp_path: Path
) -> None:
    messages, subtasks = marked_story()
    told_in(small_home_root, tmp_path, messages=messages, subtasks=subtasks)
    ground(explored, small_home_root, stub, "object-list-llm", sequences=tmp_path, run_id="told")
    turns = list(read_turns(explored / "told"))
    assert len(turns) == len(subtasks)
    for search, turn in enumerate(turns):
        words = "\n".join(part.text for part in turn.parts if isinstance(part, TextPart))
        assert leaks(words, search) == []
        assert f"Query: {subtasks[search]['query'][0]}" in words
        assert ("MESSAGE-2" in words) == (search >= 3)


def _without_the_task(turn: ChatTurn, dataset: PersonalDataset) -> str:
    task = dataset.episode(turn.key).task("pog")
    words = "\n".join(part.text if isinstance(part, TextPart) else part.picture for part in turn.parts)
    assert words.count(task.description) == 1
    return turn.system + words.replace(task.description, "").replace(task.queries[0], "")


def test_a_spent_budget_keeps_the_answers_and_a_larger_one_gives_the_rest(
    explored: Path, small_home_root: Path, stub: ChatStub
) -> None:
    options = {"run_id": "limited", "limit": 2, "paraphrase": 2}
    with pytest.raises(AgentError, match="--max-calls: the run has used 3 of 3"):
        ground(explored, small_home_root, stub, "object-list-llm", max_calls=3, **options)
    before = (explored / "limited" / "chat.jsonl").read_text()
    assert before.count("\n") >= 3
    ground(explored, small_home_root, stub, "object-list-llm", max_calls=24, **options)
    assert (explored / "limited" / "chat.jsonl").read_text().startswith(before)
    assert len(read_run(explored / "limited").answers) == 6
    used = Budget(explored / "limited").used()
    assert used.calls == len(stub.requests)
    assert used.calls + used.cached >= 6


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"llm_url": ""}, "expected both for phrases llm and for object-list-llm, map-image-vlm, frames-vlm"),
        ({"layout": "grid"}, "--method object-list-llm with --layout grid"),
        ({"method": "frames-vlm", "map": "oracle", "layout": None}, "expected --map explore, whose walks give"),
        (
            {"method": "joint", "layout": None, "llm_url": "", "llm_model": "", "max_calls": 3},
            "--max-calls is 3 without",
        ),
        ({"encoder": "clip:some/model"}, "with --encoder clip:some/model, which gives things no words"),
        ({"price": (-1.0, 2.0)}, "--price is (-1.0, 2.0); expected two amounts of at least 0"),
        ({"max_calls": 0}, "--max-calls is 0; expected a whole number from 1"),
    ],
)
def test_options_that_do_not_fit_are_refused_in_one_line(
    small_home_root: Path, tmp_path: Path, options: dict, words: str
) -> None:
    base = {"method": "object-list-llm", "map": "explore", "layout": "objects", "llm_url": "http://127.0.0.1:1/v1"}
    verb = Ground(**{"dataset": small_home_root, "out": tmp_path, "llm_model": "m", **base, **options})
    with pytest.raises(Exception, match=re.escape(words)):
        verb.run()

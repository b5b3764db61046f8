"""Shards: whole homes, each in one shard, the same ones everywhere; joined, they are the run without `--shard`."""

import shutil
from pathlib import Path

import pytest

from grounding.chat.budget import Budget, ChatUsage
from personal_viz.cli.grounding.ground import Ground
from personal_viz.cli.runs.merge import Merge
from personal_viz.cli.runs.run import Run
from sim.errors import PersonalVizError, RunFileError
from sim.tasks.chat_turns import ChatTurn, read_turns
from sim.tasks.shards import SHARDS, Shard, joined_run, shard_from_text

EPISODES = {"A": 9, "B": 1, "C": 4, "D": 4, "E": 2}
FILES = ("steps.jsonl", "answers.jsonl")


def test_shards_hold_each_home_once_and_as_even_numbers_of_episodes_as_whole_homes_allow() -> None:
    assert [Shard(number, 2).homes(EPISODES) for number in (1, 2)] == [{"A", "B"}, {"C", "D", "E"}]
    assert [Shard(number, 3).homes(EPISODES) for number in (1, 2, 3)] == [{"A"}, {"C", "E"}, {"B", "D"}]
    assert Shard().homes(EPISODES) == set(EPISODES)
    backwards = dict(reversed(EPISODES.items()))
    assert Shard(2, 3).homes(backwards) == {"C", "E"}


def test_more_shards_than_homes_are_refused() -> None:
    assert [Shard(number, 5).homes(EPISODES) for number in (1, 5)] == [{"A"}, {"B"}]
    with pytest.raises(PersonalVizError, match=r"--shard 6/6: found 5 homes; expected at most as many shards.* i/5"):
        Shard(6, 6).homes(EPISODES)


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/0", "a/b", "-1/2", ""])
def test_a_shard_that_is_not_one_of_n_is_refused(text: str) -> None:
    with pytest.raises(PersonalVizError, match=r"--shard is .* expected i/N with i from 1 to N"):
        shard_from_text(text)


@pytest.fixture(scope="module")
def answered(small_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of `ground`: `whole` at once, `parts` in two shards."""
    out = tmp_path_factory.mktemp("answered")
    assert _ground(small_root, out / "whole") == 0
    for number in (2, 1):
        assert _ground(small_root, out / "parts", shard=f"{number}/2") == 0
    return out


def _ground(dataset: Path, out: Path, **options: object) -> int:
    return Ground(dataset, "random", out=out, **options).run()  # type: ignore[arg-type]


def _shards(folder: Path) -> list[Path]:
    return sorted((folder / SHARDS).iterdir())


def test_merged_answers_are_those_of_the_run_without_shards(answered: Path, tmp_path: Path) -> None:
    assert Merge(tmp_path, (answered / "parts" / SHARDS,)).run() == 0
    (merged,), (whole,) = tmp_path.iterdir(), (answered / "whole").iterdir()
    assert merged.name == whole.name
    assert _same_run(merged, whole)
    before = (merged / "answers.jsonl").stat().st_mtime_ns
    assert Merge(tmp_path, tuple(_shards(answered / "parts"))).run() == 0  # a second call finds them
    assert (merged / "answers.jsonl").stat().st_mtime_ns == before
    (merged / "answers.jsonl").write_text("")
    with pytest.raises(RunFileError, match=r"exists and is not what these shards give; expected no such folder"):
        Merge(tmp_path, tuple(_shards(answered / "parts"))).run()


def test_prompts_and_pictures_of_a_chat_model_come_along(answered: Path, tmp_path: Path) -> None:
    shards = [shutil.copytree(shard, tmp_path / shard.name) for shard in _shards(answered / "parts")]
    for shard, scene in zip(shards, ("HomeTwo", "HomeOne"), strict=True):
        turn = ChatTurn(split="easy", scene=scene, episode_id="0", call=1, model="m", system="s", parts=())
        (shard / "chat.jsonl").write_text(turn.model_dump_json() + "\n")
        Budget(shard).add(ChatUsage(calls=1, prompt_tokens=100))
        (shard / "chat").mkdir()
        (shard / "chat" / f"{scene}.png").write_bytes(scene.encode())
    for _ in ("written", "found"):
        assert Merge(tmp_path / "out", tuple(shards)).run() == 0
    (merged,) = (tmp_path / "out").iterdir()
    assert [turn.scene for turn in read_turns(merged)] == ["HomeOne", "HomeTwo"]
    assert Budget(merged).used() == ChatUsage(calls=2, prompt_tokens=200)
    assert {path.name: path.read_bytes() for path in (merged / "chat").iterdir()} == {
        "HomeOne.png": b"HomeOne",
        "HomeTwo.png": b"HomeTwo",
    }


def _same_run(merged: Path, whole: Path) -> bool:
    """Whether all files have the same bytes, but for the time in run.json."""
    assert sorted(path.name for path in merged.iterdir()) == sorted(path.name for path in whole.iterdir())
    lines = [(folder / "run.json").read_text().splitlines() for folder in (merged, whole)]
    timeless = [[line for line in found if "created_utc" not in line] for found in lines]
    same = [(merged / name).read_bytes() == (whole / name).read_bytes() for name in FILES if (whole / name).exists()]
    return timeless[0] == timeless[1] and bool(same) and all(same)


@pytest.mark.slow
def test_merged_walks_are_those_of_the_run_without_shards(invented_root: Path, tmp_path: Path) -> None:
    for out, shards in (("whole", [None]), ("parts", ["1/2", "2/2"])):
        for shard in shards:
            options = {"out": tmp_path / out, "limit": 4, "shard": shard}
            assert Run(invented_root, "random", **options).run() == 0  # type: ignore[arg-type]
    assert Merge(tmp_path / "parts", (tmp_path / "parts" / SHARDS,)).run() == 0
    name = "random-invented-seed0"
    assert _same_run(tmp_path / "parts" / name, tmp_path / "whole" / name)


def test_shards_that_do_not_make_one_run_are_refused_by_name(answered: Path, small_root: Path, tmp_path: Path) -> None:
    one, two = _shards(answered / "parts")
    copy = shutil.copytree(one, tmp_path / "copy")
    with pytest.raises(RunFileError, match=r"found 1 of 2 shards; expected 2/2 too\. Run what is missing"):
        joined_run([one])
    with pytest.raises(RunFileError, match=r"copy: holds shard 1/2, as .*shard-1-of-2 does; expected each shard once"):
        joined_run([one, two, copy])
    lines = (copy / "answers.jsonl").read_text().splitlines(keepends=True)
    (copy / "answers.jsonl").write_text("".join(lines[:-1]))
    with pytest.raises(RunFileError, match=rf"copy: holds {len(lines) - 1} of {len(lines)} episodes of shard 1/2"):
        joined_run([copy, two])
    (whole,) = (answered / "whole").iterdir()
    with pytest.raises(RunFileError, match=r"holds a whole run; expected one made with --shard"):
        Merge(tmp_path / "out", (one, two, whole)).run()
    assert _ground(small_root, tmp_path / "fewer", shard="2/2", limit=3) == 0
    with pytest.raises(RunFileError, match=r"chosen episodes differ; expected shards of one command"):
        joined_run([one, *_shards(tmp_path / "fewer")])
    text = (two / "run.json").read_text()
    other = shutil.copytree(two, tmp_path / "other")
    (other / "run.json").write_text(text.replace('"encoder": "hashed"', '"encoder": "minilm"'))
    with pytest.raises(
        RunFileError, match=r"other: config.encoder is 'minilm', in .* 'hashed'; expected shards of one"
    ):
        joined_run([one, other])
    assert not (tmp_path / "out").exists()

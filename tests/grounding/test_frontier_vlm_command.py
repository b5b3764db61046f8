"""`run --agent frontier-vlm` in an invented home against a stub server: two runs, one table, and the questions."""

import re
import shutil
from pathlib import Path

import pytest

from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.run import Run
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import PersonalVizError, RunFileError
from sim.tasks.chat_turns import ChatTurn, TextPart, read_turns
from sim.tasks.run_files import read_run
from sim.tasks.run_folders import read_runs, with_controls

from .chat_stub import chat_stub

pytest.importorskip("openai", reason="extra llm is not installed")


@pytest.mark.slow
def test_the_control_stands_beside_the_model_and_unusable_answers_are_counted(
    small_home_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    with chat_stub() as stub:
        stub.content = "I would go left."
        verb = Run(
            dataset=small_home_root, agent="frontier-vlm", perception="oracle", goal_text="caption", split=("easy",),
            limit=1, out=tmp_path, run_id="asked", llm_url=stub.url, llm_model="small", jobs=2,
        )  # fmt: skip
        verb.run()
        said = capsys.readouterr().out
        assert "frontier-vlm (goal text caption (ground truth)" in said
        assert "frontier-geometry (goal text caption (ground truth)" in said
        turns = list(read_turns(tmp_path / "asked"))
        asked = len(stub.requests)
        assert len(turns) == asked > 0
        verb.run()  # everything is done: nothing is asked again
        assert len(stub.requests) == asked
        assert f"asked: {asked} of {asked} question" in capsys.readouterr().out
    assert all(turn.answer == "I would go left." and "not the JSON asked for" in turn.problem for turn in turns)
    assert f"asked: {len(turns)} of {len(turns)} question" in said
    for turn in turns:
        _require_only_the_task(turn, PersonalDataset(small_home_root).episode(turn.key))
    (model,), (control,) = (read_run(tmp_path / name).episodes for name in ("asked", "asked-frontier-geometry"))
    assert (model.key, model.end.reason) == (control.key, control.end.reason)
    Metrics((tmp_path / "asked",)).run()
    assert "frontier-geometry" in capsys.readouterr().out, "a table of the model alone does not exist"
    in_report = [run.info.run_id for run in read_runs(with_controls([tmp_path / "asked"]))]
    assert in_report == ["asked", "asked-frontier-geometry"]
    (tmp_path / "alone").mkdir()
    moved = shutil.move(tmp_path / "asked", tmp_path / "alone" / "asked")
    with pytest.raises(RunFileError, match="found no run asked-frontier-geometry beside it"):
        Metrics((moved,)).run()
    Metrics((moved, tmp_path / "asked-frontier-geometry")).run()


def _require_only_the_task(turn: ChatTurn, episode: Episode) -> None:
    """Besides description and query, the words hold no caption, owner, phrase or id of the dataset: not even where
    the detector was given the caption."""
    words = "\n".join(part.text if isinstance(part, TextPart) else part.picture for part in turn.parts)
    task = episode.task("pan")
    assert words.count(task.description) == words.count(f"Query: {task.queries[0]}") == 1
    rest = turn.system + words.replace(task.description, "").replace(task.queries[0], "")
    record = episode.record
    captions = [caption for captions in record.captions_per_object for caption in captions]
    secrets = [*record.extracted_summary, *captions, record.owner, *record.object_names, record.episode_id]
    assert len(secrets) > 4
    assert not [secret for secret in secrets if re.search(rf"\b{re.escape(secret)}\b", rest, re.IGNORECASE)]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"max_calls": 0}, "--max-calls is 0; expected a whole number from 1"),
        ({"price": (-1.0, 1.0)}, "--price is"),
        ({"llm_key_env": "NO_SUCH_KEY"}, "environment variable NO_SUCH_KEY is not set"),
    ],
)
def test_wrong_options_of_the_model_are_refused_before_the_control_runs(
    tmp_path: Path, options: dict, expected: str
) -> None:
    run = Run(
        dataset=tmp_path,
        agent="frontier-vlm",
        perception="oracle",
        llm_url="http://127.0.0.1:9/v1",
        llm_model="m",
        out=tmp_path,
        **options,
    )
    with pytest.raises(PersonalVizError, match=expected):
        run.run()

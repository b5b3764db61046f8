"""The verb `ground` on the small dataset, and the reference figures on released episodes."""

import json
from pathlib import Path

import numpy as np
import pytest

from grounding.evaluation.evaluate import GroundSettings, SceneGrounder
from personal_viz.cli.grounding.ground import Ground
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, DatasetError, PersonalVizError, RunFileError
from sim.tasks.metrics import metric_rows
from sim.tasks.rules import scene_storeys, score_answer
from sim.tasks.run_files import read_run

from .chat_stub import chat_stub

DEFAULTS = {"json": True}


def ground(**options) -> int:
    """Runs the verb with these options and returns its exit code."""
    return Ground(**options).run()


def document(capsys: pytest.CaptureFixture[str], **options) -> dict:
    """The one JSON document that the verb prints."""
    assert ground(**{**DEFAULTS, **options}) == 0
    return json.loads(capsys.readouterr().out)


def test_query_scoring_prints_one_document(small_root: Path, tmp_path: Path, capsys) -> None:
    found = document(capsys, dataset=small_root, method="qs", out=tmp_path, scene=("HomeTwo",))
    assert found["method"] == "qs"
    assert found["encoder"] == "hashed"
    assert found["phrases"] == "none"
    assert found["map"] == "oracle"
    assert found["storey_given"] is True
    assert found["n"] == 6
    assert found["n_per_split"] == {"easy": 3, "medium": 0, "hard": 3}
    # two of three right in each split (test_evaluate_grounding.py), none in medium
    assert found["sr"] == {"easy": 66.67, "medium": None, "hard": 66.67, "total": 66.67}
    assert found["top3"] == {"easy": 100.0, "medium": None, "hard": 100.0, "total": 100.0}
    assert found["pooled"] == {"sr": 66.67, "top3": 100.0}


def test_rpg_says_that_its_phrases_come_from_the_dataset(small_root: Path, tmp_path: Path, capsys) -> None:
    found = document(capsys, dataset=small_root, method="rpg", out=tmp_path, all_storeys=True)
    assert found["phrases"] == "dataset"
    assert found["storey_given"] is False
    assert found["total_is"] == "plain mean of the splits"
    info = read_run(Path(found["run"])).info
    assert info.scene_kind == "oracle-map"
    assert info.condition == "oracle map, hashed encoder, phrases dataset, all storeys"
    assert info.who == "rpg"


def test_results_with_phrases_of_the_dataset_are_always_shown_beside_those_with_rules(
    small_root: Path, tmp_path: Path, capsys
) -> None:
    found = document(capsys, dataset=small_root, method="rpg", out=tmp_path, run_id="mine")
    beside = found["with_rule_phrases"]
    assert (found["phrases"], beside["phrases"], beside["n"]) == ("dataset", "rules", 11)
    assert {path.name for path in tmp_path.iterdir()} == {"mine", "mine-rules"}
    assert "dataset = the episode files' own (ground truth)" in found["notes"][0]
    assert "rpg 25.3 / 23.6 / 15.2 / 16.8. Not comparable with the paper" in found["notes"][-1]
    alone = document(capsys, dataset=small_root, method="rpg", out=tmp_path, phrases="rules")
    assert (alone["phrases"], alone["with_rule_phrases"]) == ("rules", None)
    assert alone["condition"] == "oracle map, hashed encoder, phrases rules, storey given"
    assert ground(**{**DEFAULTS, "dataset": small_root, "method": "rpg", "out": tmp_path, "json": False}) == 0
    printed = capsys.readouterr().out
    assert "rpg (phrases dataset)" in printed
    assert "rpg (phrases rules)" in printed


def test_the_total_is_the_plain_mean_of_splits_and_pooled_counts_every_episode_once(
    small_root: Path, tmp_path: Path, capsys
) -> None:
    found = document(capsys, dataset=small_root, method="qs", out=tmp_path)
    assert found["n_per_split"] == {"easy": 8, "medium": 0, "hard": 3}
    # 6 of 8 and 2 of 3: (75 + 66.67) / 2 = 70.83, but 8 of 11 = 72.73
    assert found["sr"] == {"easy": 75.0, "medium": None, "hard": 66.67, "total": 70.83}
    assert found["pooled"]["sr"] == 72.73
    rows = {row.split: row for row in metric_rows([read_run(Path(found["run"]))])}
    for split in ("easy", "hard", "total"):
        assert rows[split].sr == pytest.approx(found["sr"][split], abs=0.01), "the same as in `metrics`"
        assert rows[split].top3 == pytest.approx(found["top3"][split], abs=0.01)


def test_figures_count_only_the_chosen_episodes_if_the_folder_holds_more(
    small_root: Path, tmp_path: Path, capsys
) -> None:
    document(capsys, dataset=small_root, method="qs", out=tmp_path)
    found = document(capsys, dataset=small_root, method="qs", out=tmp_path, limit=1)
    assert found["n"] == 2
    assert len(read_run(Path(found["run"])).answers) == 11


def test_the_table_shows_counts_and_the_folder_of_the_run(small_root: Path, tmp_path: Path, capsys) -> None:
    options = {**DEFAULTS, "dataset": small_root, "method": "qs", "out": tmp_path, "scene": ("HomeTwo",), "json": False}
    assert ground(**{**options, "run_id": "my-run"}) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for text in (
        *("Easy", "Hard", "Total", "66.7", "2/3", "4/6", "100.0", "plain mean of the splits", "my-run"),
        "Map words: captions of the same episode files (circular). Target's storey: given.",
        "paper's HM3D maps SR 15.4 8.6 11.9",
        "Not comparable with the paper",
    ):
        assert text in printed


def test_another_seed_in_the_same_folder_is_refused(small_root: Path, tmp_path: Path, capsys) -> None:
    document(capsys, dataset=small_root, method="random", out=tmp_path, run_id="mine")
    with pytest.raises(RunFileError, match=r"seed is 0, this run has 1; expected the same to resume"):
        document(capsys, dataset=small_root, method="random", out=tmp_path, run_id="mine", seed=1)


def test_bad_options_are_refused_before_anything_is_written(small_root: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "runs"
    base = {**DEFAULTS, "dataset": small_root, "method": "qs", "out": out}
    with pytest.raises(PersonalVizError, match=r"--limit is 0; expected a whole number from 1"):
        ground(**{**base, "limit": 0})
    with pytest.raises(PersonalVizError, match=r"--jobs is 0; expected a whole number from 1"):
        ground(**{**base, "jobs": 0})
    with pytest.raises(DatasetError, match=r"found no scene 'Nowhere'"):
        ground(**{**base, "scene": ("Nowhere",)})
    with pytest.raises(PersonalVizError, match=r"hold no episode; expected one"):
        ground(**{**base, "split": ("medium",)})
    with pytest.raises(PersonalVizError, match=r"--seed is -1; expected a whole number from 0"):
        ground(**{**base, "seed": -1})
    for name in ("a/b", ".hidden", "a b", ""):
        with pytest.raises(PersonalVizError, match=rf"--run-id is '{name}'; expected 1 to 80 letters"):
            ground(**{**base, "run_id": name})
    assert not out.exists()


def test_a_sweep_makes_one_run_per_value(small_root: Path, tmp_path: Path, capsys) -> None:
    options = {"dataset": small_root, "method": "qs", "out": tmp_path, "encoder": "hashed"}
    found = document(capsys, **options, sweep="object-noise=0,0.5")
    assert [item["config"]["object_noise"] for item in found] == [0.0, 0.5]
    assert found[0]["sr"] == document(capsys, **options)["sr"]
    assert found[1]["run"].endswith("ground-qs-oracle-hashed-objectnoise0.5-storey-given-seed0")
    assert found[1]["condition"] == "oracle map, hashed encoder, object noise 0.5, phrases none, storey given"
    named = document(capsys, **options, sweep="object-noise=0.5", run_id="mine")
    assert named[0]["run"].endswith("mine-object-noise0.5")
    assert named[0]["sr"] == found[1]["sr"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sweep": "seed=1,2"}, r"--sweep is 'seed=1,2'; expected NAME=V1,V2"),
        ({"sweep": "encoder=hashed"}, r"--sweep is 'encoder=hashed'; expected NAME=V1,V2"),
        ({"sweep": "blur=a"}, r"--sweep is 'blur=a'; expected numbers behind blur="),
        ({"object_noise": -0.1}, r"--object-noise is -0.1; expected a number of at least 0"),
        ({"object_noise": float("nan")}, r"--object-noise is nan"),
        ({"view_noise": 0.1}, r"--view-noise is 0.1 with --map oracle; expected it with --map explore only"),
        ({"map": "explore", "blur": 0.1}, r"--blur is 0.1 with --map explore; expected it with --map oracle"),
        ({"map": "explore", "confusion": 1.5}, r"--confusion is 1.5; expected a share of 0 to 1"),
        ({"layout": "fine"}, r"--layout is 'fine' on oracle maps; expected grid"),
        ({"map": "explore", "layout": "objects"}, r"--method qs with --layout objects; expected object-phrase"),
        ({"encoder": "word2vec"}, r"encoder 'word2vec': is not known; expected hashed, minilm"),
    ],
)
def test_options_that_do_not_fit_are_refused(small_root: Path, tmp_path: Path, options: dict, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        ground(dataset=small_root, method="qs", out=tmp_path / "runs", **options)
    assert not (tmp_path / "runs").exists()


def test_a_run_with_a_language_model_stores_its_name_and_no_key(
    small_root: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openai", reason="extra llm is not installed")
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("OUR_KEY", "very-secret")
    with chat_stub() as stub:
        stub.content = json.dumps({"ownership": []})
        options = {"phrases": "llm", "llm_url": stub.url, "llm_model": "small", "llm_key_env": "OUR_KEY"}
        found = document(capsys, dataset=small_root, method="phrase", out=tmp_path, **options)
    assert stub.requests
    assert set(stub.keys) == {"Bearer very-secret"}
    assert found["phrases"] == "llm"
    run = Path(found["run"])
    assert run.name == "ground-phrase-oracle-hashed-storey-given-llmsmall-seed0"
    info = read_run(run).info
    assert (info.config["llm_url"], info.config["llm_model"]) == (stub.url, "small")
    assert all(b"very-secret" not in path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())


@pytest.mark.slow
def test_answers_with_phrases_by_rules_are_counted_over_processes(
    small_root: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openai", reason="extra llm is not installed")
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    base = {"dataset": small_root, "out": tmp_path, "jobs": 2, "phrases": "llm", "llm_model": "small"}
    with chat_stub() as stub:
        stub.content = "I cannot say."
        found = document(capsys, **base, method="phrase", llm_url=stub.url)
    assert (found["n"], found["fell_back"]) == (11, 11)


def test_answers_with_phrases_by_rules_are_counted_over_calls(
    small_root: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openai", reason="extra llm is not installed")
    monkeypatch.setenv("PERSONAL_VIZ_CACHE", str(tmp_path / "cache"))
    base = {"dataset": small_root, "out": tmp_path, "phrases": "llm", "llm_model": "small"}
    with chat_stub() as stub:
        stub.content = "I cannot say."
        options = {**base, "llm_url": stub.url, "method": "phrase"}
        assert document(capsys, **options, limit=2)["fell_back"] == 4
        found = document(capsys, **options)
        assert (found["n"], found["fell_back"]) == (11, 11)
        assert ground(**options) == 0
        assert "gave nothing to use for 11 of 11 answers" in capsys.readouterr().out
        asked = len(stub.requests)
        unused = document(capsys, **{**options, "method": "qs"})
    assert (unused["phrases"], unused["fell_back"]) == ("none", None)
    assert len(stub.requests) == asked, "a method without phrases does not ask the model"
    run = read_run(Path(found["run"]))
    assert all(answer.fell_back for answer in run.answers)
    rules = document(capsys, dataset=small_root, out=tmp_path, method="phrase", phrases="rules")
    assert rules["sr"] == found["sr"]
    assert not any(answer.fell_back for answer in read_run(Path(rules["run"])).answers)


@pytest.mark.release
@pytest.mark.parametrize(("method", "reference", "tolerance"), [("random", 0.13, 0.25), ("center", 2.2, 0.1)])
def test_blind_baselines_give_the_reference_figures(
    method: str, reference: float, tolerance: float, dataset_root: Path, tmp_path: Path, capsys
) -> None:
    # GROUNDING.md section 1: `random` draws from all 2,500 cells, `center` is the middle of the bounding box. Three
    # standard deviations of 2,000 draws at 0.13 % are 0.24 %.
    found = document(capsys, dataset=dataset_root, method=method, out=tmp_path)
    assert found["pooled"]["sr"] == pytest.approx(reference, abs=tolerance)


@pytest.mark.release
def test_the_targets_own_cell_succeeds_in_every_released_episode(dataset_root: Path) -> None:
    # GROUNDING.md section 1: the centre of a cell is at most 0.707 m away, so a perfect map gives 100 %
    dataset = PersonalDataset(dataset_root)
    failures = []
    for scene in dataset.scenes:
        grounder = SceneGrounder(dataset, scene, GroundSettings("center"))
        storeys = scene_storeys(dataset.goals(scene).values())
        for episode in dataset.episodes(scenes=(scene,)):
            memory = grounder.memory(episode)
            x, _, z = episode.targets[0].position
            (point,) = memory.points_from_rc(memory.grid.rc_from_xz(np.array([[x, z]]))).tolist()
            if not score_answer(episode, [tuple(point)], storeys=storeys).success:
                failures.append(str(episode.key))
    assert failures == []

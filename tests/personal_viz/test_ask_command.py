"""Verb `ask`: free text about a map file or a home; pictures, recordings, scores, and one line for each refusal."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.maps.files import MapSource, save_memory
from grounding.maps.header import RecordingSource, matrix_of
from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_glb_zup
from tests.grounding.test_free_text import DESCRIPTION, two_storeys
from tests.recordings.reading import tables

from .program import Done, assert_one_line, personal_viz

VASE = [0.5, 4.45, 2.5]
IN_RECORDING = [0.5, -2.5, 4.45]
"""VASE in the recording's frame, which is z-up."""


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    recording = RecordingSource(path=str(tmp_path / "gone"), T_map_recording=matrix_of(T_world_glb_zup))
    source = MapSource(scene="flat", kind="robot", encoder="hashed", recording=recording)
    save_memory(tmp_path / "flat.npz", two_storeys(), source)
    return tmp_path / "flat.npz"


def ask(map_file: Path, *more: object) -> Done:
    return personal_viz("ask", map_file, "--out", map_file.parent / "answer", *more)


def test_answers_are_printed_in_both_frames_and_drawn(map_file: Path) -> None:
    text = map_file.with_name("who.txt")
    text.write_text(DESCRIPTION + "\n")
    done = ask(map_file, "--description", text, "--query", "the blue glass vase", "--query", "Tom's sofa")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "the blue glass vase: no phrase of the description means it"
    assert lines[1].startswith(
        "  1. (0.50, 4.45, 2.50), in the recording (0.50, -2.50, 4.45), storey 1, 1.20 m above the floor, score "
    )
    assert lines[4].startswith("Tom's sofa: ")
    assert "sofa" in lines[4].partition(": ")[2]
    picture = Image.open(map_file.with_name("answer.png"))
    assert min(picture.size) > 200
    found = tables(map_file.with_name("answer.rrd"))
    assert ("/memory/flat/home/storey_1/asked_1/places", True) in found


def test_json_is_one_object_for_one_question_and_a_list_for_several(map_file: Path) -> None:
    one = json.loads(ask(map_file, "--query", "the blue glass vase", "--json").stdout)
    assert set(one) == {"query", "points", "phrase", "method"}
    assert (one["query"], one["phrase"], one["method"]) == ("the blue glass vase", "", "object-dual")
    assert len(one["points"]) == 3
    best = one["points"][0]
    assert (best["map"], best["recording"], best["storey"], best["height"]) == (VASE, IN_RECORDING, 1, 1.2)
    two = json.loads(ask(map_file, "--query", "a", "--query", "b", "--json").stdout)
    assert [item["query"] for item in two] == ["a", "b"]


def test_true_points_score_the_answers(map_file: Path) -> None:
    truth, hard = map_file.with_name("truth.jsonl"), {"frame": "map", "split": "hard"}
    lines = [
        {"query": "the blue glass vase", "points": [IN_RECORDING]},
        {"query": "Tom's sofa", "points": [[3.5, 0.3, 0.5]], **hard, "description": DESCRIPTION},
        {"query": "the white sofa", "points": [[9.0, 0.3, 0.5]], **hard},
    ]
    truth.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = json.loads(ask(map_file, "--truth", truth, "--json").stdout)
    assert found["table"]["sr"] == {"easy": 100.0, "medium": None, "hard": 50.0, "total": 75.0}
    assert [score["success"] for score in found["scores"]] == [True, True, False]
    printed = ask(map_file, "--truth", truth).stdout
    assert "object-dual: SR (%)" in printed
    assert "75.0" in printed


def test_a_picture_holds_twenty_questions_and_says_how_many_there_are(map_file: Path) -> None:
    asked = [part for number in range(21) for part in ("--query", f"sofa {number}")]
    done, png = ask(map_file, *asked[:-2]), map_file.with_name("answer.png")
    drawn = png.read_bytes()
    assert "questions are drawn" not in done.stdout
    done = ask(map_file, *asked)
    assert f"Written to {png} (20 of 21 questions are drawn) and " in done.stdout
    assert "sofa 20: " in done.stdout
    assert png.read_bytes() == drawn
    found = tables(map_file.with_name("answer.rrd"))
    assert any(entity.endswith("/asked_20/places") for entity, _ in found)


def test_questions_may_be_typed(map_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("the blue glass vase\n\nthe sofa\n"))
    done = ask(map_file, "--interactive")
    assert done.returncode == 0, done.stderr
    assert [line.partition(":")[0] for line in done.stdout.splitlines() if not line.startswith("  ")][:2] == [
        "the blue glass vase",
        "the sofa",
    ]


def test_licensed_scans_are_answered_and_not_drawn(map_file: Path) -> None:
    save_memory(map_file, two_storeys(), MapSource(scene="scan", kind="scan", encoder="hashed"))
    done = ask(map_file, "--query", "the sofa")
    assert "1. (" in done.stdout
    assert "Not written" in done.stdout
    assert not map_file.with_name("answer.png").exists()
    assert not map_file.with_name("answer.rrd").exists()
    assert ask(map_file, "--query", "the sofa", "--with-pixels").returncode == 0
    assert map_file.with_name("answer.png").exists()


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        ((), ("found no question", "--query, --truth or --interactive")),
        (("--query", "a", "--phrases", "dataset"), ("--phrases is 'dataset'", "expected rules, llm")),
        (("--query", "a", "--phrases", "llm"), ("--phrases is 'llm'", "--llm-url")),
        (("--query", "a", "--description", "who.txt"), ("--description who.txt: cannot be read",)),
        (("--query", "a", "--encoder", "minilm"), ("holds 768-d vectors", "expected one encoder")),
        (("--query", "a", "--method", "joint"), ("got a map of", "expected a grid map")),
        (("--query", "a", "--method", "best"), ("--method is 'best'",)),
        (("--query", "a", "--dataset", "data"), ("--dataset is given", "the name of a home only")),
        (("--query", "a", "--llm-url", "http://x"), ("--llm-url is given", "--phrases llm only")),
        (("--query", "a", "--autocast", "bfloat16"), ("--autocast is 'bfloat16' with --encoder hashed",)),
    ],
)
def test_refusals_are_one_line_and_write_nothing(map_file: Path, more: tuple[str, ...], parts: tuple[str, ...]) -> None:
    assert_one_line(ask(map_file, *more), *parts)
    assert not map_file.with_name("answer.png").exists()


def test_a_long_paragraph_is_no_file_name_in_any_alphabet(map_file: Path) -> None:
    done = ask(map_file, "--description", "Lily’s mug is blue. " * 12, "--query", "the sofa", "--json")
    assert done.returncode == 0, done.stderr


def test_no_question_writes_nothing_and_an_end_keeps_the_answers(
    map_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    done = ask(map_file, "--interactive")
    assert (done.returncode, done.stdout) == (0, "Nothing was asked, and nothing is written.\n")

    class Interrupted(io.StringIO):
        def __next__(self) -> str:
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "stdin", Interrupted())
    assert ask(map_file, "--interactive", "--query", "the sofa").returncode == 0
    assert map_file.with_name("answer.png").exists()


def test_answers_outlive_their_recording_and_json_says_what_is_not_written(map_file: Path) -> None:
    map_file.with_name("gone").mkdir()  # emptied since
    done = ask(map_file, "--query", "the sofa", "--json")
    assert json.loads(done.stdout)["points"]
    assert "Answers are shown on the map alone: " in done.stderr
    save_memory(map_file, two_storeys(), MapSource(scene="scan", kind="scan", encoder="hashed"))
    done = ask(map_file, "--query", "the sofa", "--json")
    assert json.loads(done.stdout)["points"]
    assert "Not written" in done.stderr


def test_a_home_needs_its_dataset(tmp_path: Path) -> None:
    done = personal_viz("ask", "Small", "--query", "a", "--out", tmp_path / "a")
    assert_one_line(done, "found 'Small' without --dataset", "personal-viz map")


@pytest.mark.slow
def test_a_home_is_explored_once_and_shows_its_answer(small_home_root: Path, tmp_path: Path) -> None:
    episode = next(PersonalDataset(small_home_root).episodes(scenes=("Small",), splits=("easy",)))
    options = ("--dataset", small_home_root, "--maps", tmp_path / "kept", "--out", tmp_path / "answer", "--json")
    asked = ("--description", episode.record.summary, "--query", episode.record.query[0])
    done = personal_viz("ask", "Small", *options, *asked)
    assert done.returncode == 0, done.stderr
    point = json.loads(done.stdout)["points"][0]
    x, _, z = episode.targets[0].position
    assert np.hypot(point["map"][0] - x, point["map"][2] - z) < 1
    assert point["recording"] is None
    assert Image.open(tmp_path / "answer.png").size[0] > 1000  # three pictures beside the map
    again = personal_viz("ask", "Small", *options, *asked)
    assert again.stdout == done.stdout
    assert "exploring" not in again.stderr

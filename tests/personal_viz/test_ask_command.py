"""Verb `ask`: free text about a map file or a home; pictures, recordings, scores, and one line for each refusal."""

import io
import json
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from grounding.evaluation.known_home import home_of_scan, ids_of_boxes
from grounding.maps.files import MapSource, save_memory
from grounding.maps.header import RecordingSource, matrix_of
from sim.authoring.annotations import AnnotatedObject, Box, Edit, annotation_path, append_edit
from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_glb_zup
from sim.mesh import SceneObject
from sim.types import Camera, Frame
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
        (("--query", "a", "--dataset", "data"), ("--dataset is given", "the name of a home or a scan's file only")),
        (("--query", "a", "--llm-url", "http://x"), ("--llm-url is given", "--phrases llm or a method that asks")),
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
def test_a_home_is_explored_once_and_shows_its_answer(small_root: Path, tmp_path: Path) -> None:
    episode = next(PersonalDataset(small_root).episodes(scenes=("HomeTwo",), splits=("easy",)))
    options = ("--dataset", small_root, "--maps", tmp_path / "kept", "--out", tmp_path / "answer", "--json")
    asked = ("--description", episode.record.summary, "--query", episode.record.query[0])
    done = personal_viz("ask", "HomeTwo", *options, *asked)
    assert done.returncode == 0, done.stderr
    point = json.loads(done.stdout)["points"][0]
    x, _, z = episode.targets[0].position
    assert np.hypot(point["map"][0] - x, point["map"][2] - z) < 1
    assert point["recording"] is None
    assert Image.open(tmp_path / "answer.png").size[0] > 1000  # three pictures beside the map
    again = personal_viz("ask", "HomeTwo", *options, *asked)
    assert again.stdout == done.stdout
    assert "exploring" not in again.stderr


def room_file(path: Path) -> Path:
    """A grey room of 4 x 3 m with a red cube at (1.5, 0.3, 1.0) and a grey one at (-1.5, 0.3, -1.0)."""
    sides = [((4, 0.1, 3), (0, -0.05, 0)), ((4, 0.1, 3), (0, 2.55, 0))]
    sides += [((0.1, 2.6, 3), (x, 1.25, 0)) for x in (-2.05, 2.05)]
    sides += [((4.2, 2.6, 0.1), (0, 1.25, z)) for z in (-1.55, 1.55)]
    sides += [((0.6, 0.6, 0.6), place) for place in ((1.5, 0.3, 1.0), (-1.5, 0.3, -1.0))]
    parts = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in sides]
    for part in parts:
        part.visual.face_colors = (200, 30, 30) if part is parts[-2] else (150, 150, 150)  # type: ignore[union-attr]
    trimesh.util.concatenate(parts).export(path)
    return path


@pytest.mark.slow
def test_a_scans_file_is_asked_by_annotated_boxes(tmp_path: Path) -> None:
    scan, data = room_file(tmp_path / "Room.glb"), tmp_path / "data"
    for number, category, caption, centre in (
        (1, "stool", "red stool near the window", (1.5, 0.35, 1.0)),
        (2, "chest", "oak chest near the door", (-1.5, 0.35, -1.0)),
    ):
        box = Box(centre=centre, size=(0.7, 0.6, 0.7))
        item = AnnotatedObject(id=number, category=category, captions=(caption,), box=box)
        new = Edit(who="ada", utc=datetime.now(UTC), id=number, before=None, after=item)
        append_edit(annotation_path(data, "Room"), new)
    asked = ("--query", "the oak chest", "--query", "Ada's stool", "--description", "Ada owns the red stool.")
    options = ("--maps", tmp_path / "kept", "--out", tmp_path / "answer", "--json", "--up", "y")
    done = personal_viz("ask", scan, "--dataset", data, *options, *asked)
    assert done.returncode == 0, done.stderr
    for reply, place in zip(json.loads(done.stdout), ((-1.5, -1.0), (1.5, 1.0)), strict=True):
        x, y, z = reply["points"][0]["map"]
        assert np.hypot(x - place[0], z - place[1]) < 0.35
        assert 0.1 < y < 0.7
    done = personal_viz("ask", scan, *options, *asked)
    assert_one_line(done, "Room: found no semantics and no annotations", "--encoder clip:MODEL")
    bare = scan.rename(tmp_path / "Bare.glb")
    done = personal_viz("ask", bare, "--dataset", data, *options, *asked)
    assert_one_line(done, "found no annotations of 'Bare' (of: Room)", "Annotate Bare.glb")


@pytest.mark.slow
def test_a_mesh_without_names_is_asked_through_a_model_that_sees(tmp_path: Path) -> None:
    scan = room_file(tmp_path / "Room.glb")
    options = ("--encoder", "tests.grounding.mapped_views:colours", "--maps", tmp_path / "kept", "--up", "y", "--json")
    done = personal_viz("ask", scan, *options, "--out", tmp_path / "answer", "--query", "200 30 30")
    assert done.returncode == 0, done.stderr
    x, _, z = json.loads(done.stdout)["points"][0]["map"]
    assert np.hypot(x - 1.5, z - 1.0) < 0.4


def test_semantics_name_the_objects_of_a_scans_file(small_home_root: Path) -> None:
    home = home_of_scan(small_home_root / "scenes" / "Small.glb")
    assert {"toilet", "sink"} <= set(home.texts.values())
    assert (home.boxes, home.storeys) == ((), (0,))


def test_of_nested_boxes_the_smaller_one_takes_the_pixels_inside() -> None:
    camera = Camera.of_lens(4, 2, fx=2, fy=2, cx=2, cy=1)
    depth = np.array([[2, 2, 2, 0], [2, 2, 5, 2]], np.float32)
    frame = Frame(np.zeros((2, 4, 3), np.uint8), depth, np.eye(4), camera, np.full((2, 4), 9, np.int32))
    table = SceneObject(1, "table_1", "table", (0.0, 0.0, 2.0), (9.0, 9.0, 0.5))
    cup = SceneObject(2, "cup_2", "cup", (-1.5, -0.5, 2.0), (0.2, 0.2, 0.2))
    expected = [[2, 1, 1, 9], [1, 1, 9, 1]]
    assert ids_of_boxes(frame, [cup, table]).tolist() == expected
    assert ids_of_boxes(frame, [table, cup]).tolist() == expected
    assert frame.instance_ids.min() == 9

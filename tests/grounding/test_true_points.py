"""Free-text answers are scored against true points of a file, in the frame and on the storey that it says."""

from pathlib import Path

import numpy as np
import pytest

from grounding.evaluation.true_points import AskedScore, TrueQuery, read_true_points, score_reply, scored_table
from grounding.methods.free_text import FoundPlace, Reply
from grounding.types import Grounding
from sim.errors import DatasetError
from sim.frames import T_world_glb_zup

from .test_free_text import two_storeys

HOME = two_storeys()


def reply(*positions: tuple[float, float, float], storey: int = 0) -> Reply:
    places = tuple(FoundPlace(position, storey, 0.0, 1.0) for position in positions)
    return Reply("the lamp", "", places, Grounding(()))


def truth(*points: tuple[float, float, float], **more: object) -> TrueQuery:
    return TrueQuery.model_validate({"query": "the lamp", "points": points, **more})


def test_distances_are_planar_to_the_nearest_point_of_the_storey() -> None:
    score = score_reply(reply((1, 0.25, 1)), truth((1, 2.0, 1.5), (5, 0.3, 5)), HOME, T_map_recording=None)
    assert (score.distance, score.success, score.top3) == (pytest.approx(0.5), True, True)
    above = score_reply(reply((1, 0.25, 1)), truth((1, 3.5, 1)), HOME, T_map_recording=None)
    assert (above.distance, above.success, above.top3) == (None, False, False)
    third = score_reply(
        reply((9, 0, 9), (8, 0, 9), (1, 0, 1.3)), truth((1, 0.4, 1), radius=0.4), HOME, T_map_recording=None
    )
    assert (third.success, third.top3) == (False, True)
    nothing = score_reply(reply(), truth((1, 0.4, 1)), HOME, T_map_recording=None)
    assert (nothing.distance, nothing.success) == (None, False)


def test_points_of_the_recording_are_turned_into_the_map() -> None:
    found = reply((1.0, 0.25, -2.0))
    z_up = (1.0, 2.0, 0.4)
    assert score_reply(found, truth(z_up), HOME, T_map_recording=T_world_glb_zup).distance == pytest.approx(0)
    as_map = score_reply(found, truth(z_up, frame="map"), HOME, T_map_recording=T_world_glb_zup)
    assert as_map.distance == pytest.approx(np.hypot(0, 2.4))


def test_the_total_is_the_mean_of_the_splits() -> None:
    def one(split: str, success: bool) -> AskedScore:
        return AskedScore.model_validate(
            {"query": "q", "split": split, "distance": 1.0, "success": success, "top3": True}
        )

    table = scored_table([one("easy", True), one("easy", False), one("hard", False)])
    assert table["n"] == {"easy": 2, "medium": 0, "hard": 1, "total": 3}
    assert table["sr"] == {"easy": 50.0, "medium": None, "hard": 0.0, "total": 25.0}
    assert table["top3"]["total"] == 100.0


def test_a_file_is_read_and_wrong_lines_are_named(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    second = '{"query": "b", "points": [[0, 0, 0]], "split": "hard"}'
    path.write_text('{"query": "a", "points": [[1, 2, 3]]}\n\n' + second + "\n")
    assert [(item.query, item.split, item.radius) for item in read_true_points(path)] == [
        ("a", "easy", 1),
        ("b", "hard", 1),
    ]
    for content, said in (
        ('{"query": "a", "points": [[1, 2, 3]]}\n{"query": "b"}\n', r"truth\.jsonl:2: points .*Write one JSON object"),
        ('{"query": "a", "points": [[1, 2]]}', r"truth\.jsonl:1: points"),
        ("\n", r"truth\.jsonl: holds no line"),
    ):
        path.write_text(content)
        with pytest.raises(DatasetError, match=said):
            read_true_points(path)
    with pytest.raises(DatasetError, match=r"no\.jsonl: cannot be read"):
        read_true_points(tmp_path / "no.jsonl")

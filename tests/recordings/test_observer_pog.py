"""A POG trial shown live: marks when they are made, then the answer, then the goal; the answer is read back equal."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from recordings.observer import AnswerObserver
from recordings.sinks import LiveSink
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.rules import score_answer
from sim.tasks.run_files import Answer, ClickRay

from .conftest import KEY, info

RUN = "/runs/study-p01-pog-p01"
TABLE = (3.0, 0.7, -1.8)
BED = (-2.9, 0.4, -1.9)


def ray_to(x: float, y: float, z: float) -> ClickRay:
    """A click ray from 4 m above this point."""
    return ClickRay(
        origin=(x, y + 4, z),
        direction=(0.0, -1.0, 0.0),
        camera_position=(x, y + 4, z),
        camera_wxyz=(1.0, 0.0, 0.0, 0.0),
        storey_y=0.0,
    )


def answered(home: Scene, episode: Episode, out: Path, *, with_pixels: bool = False) -> Answer:
    """Records a person who marks the bed, clicks beside the home, marks the table and confirms; returns the answer."""
    observer = AnswerObserver(
        home,
        LiveSink("file", str(out)),
        info("study-p01-pog", who="human", who_kind="human", scene_kind=home.kind),
        with_pixels=with_pixels,
        participant="p01",
    )
    observer.on_reset(episode)
    observer.on_storey(0.0, 1.0)
    observer.on_click(ray_to(*BED), BED, 2.5)
    observer.on_click(ray_to(9.0, 0.0, 0.0), None, 3.0)
    observer.on_click(ray_to(*TABLE), TABLE, 4.5)
    answer = Answer(
        **KEY._asdict(),
        candidates=(TABLE,),
        participant="p01",
        ray=ray_to(*TABLE),
        t_s=6.0,
        measures=score_answer(episode, (TABLE,), storeys=[(0.0, 0.0)]),
    )
    observer.on_end(answer)
    return answer


def rows(path: Path, entity: str, component: str) -> list[tuple[float | None, Any]]:
    """(time_s, value) of each row; the time is None for a static value."""
    found = []
    for chunk in RrdReader(str(path)).stream():
        if chunk.entity_path != entity:
            continue
        batch = chunk.to_record_batch()
        columns = [name for name in batch.schema.names if name.endswith(component)]
        if not columns:
            continue
        times = [None] * batch.num_rows
        if not chunk.is_static:
            times = [nanoseconds / 1e9 for nanoseconds in batch.column("time_s").cast(pa.int64()).to_pylist()]
        found += list(zip(times, batch.column(columns[0]).to_pylist(), strict=True))
    return sorted(found, key=lambda row: row[0] or 0.0)


def entities(path: Path) -> set[str]:
    """Entity paths of the recording that hold data."""
    return {chunk.entity_path for chunk in RrdReader(str(path)).stream()}


def test_marks_appear_when_they_are_made(tmp_path: Path, home: Scene, episode: Episode) -> None:
    answered(home, episode, tmp_path / "p01.rrd")
    marks = rows(tmp_path / "p01.rrd", f"{RUN}/marks", "Points3D:positions")
    assert [time for time, _ in marks] == [2.5, 4.5]
    assert [[round(x, 4) for x in points[0]] for _, points in marks] == [list(BED), list(TABLE)]
    texts = rows(tmp_path / "p01.rrd", f"{RUN}/actions", "TextLog:text")
    assert [(time, text[0]) for time, text in texts] == [
        (1.0, "human-p01: looks at storey 1"),
        (2.5, "human-p01: marks (-2.90, 0.40, -1.90)"),
        (3.0, "human-p01: clicks beside the home"),
        (4.5, "human-p01: marks (3.00, 0.70, -1.80)"),
        (6.0, "human-p01: click: 1 points"),
    ]
    assert len(rows(tmp_path / "p01.rrd", f"{RUN}/map/storey_0/marks", "Points2D:positions")) == 2


def test_the_goal_appears_only_with_the_answer(tmp_path: Path, home: Scene, episode: Episode) -> None:
    answered(home, episode, tmp_path / "p01.rrd")
    goals = [name for name in entities(tmp_path / "p01.rrd") if name.startswith("/goal")]
    assert "/goal/centre" in goals
    for name in goals:
        chunks = [chunk for chunk in RrdReader(str(tmp_path / "p01.rrd")).stream() if chunk.entity_path == name]
        for chunk in chunks:
            assert not chunk.is_static
            batch = chunk.to_record_batch()
            assert batch.column("time_s").cast(pa.int64()).to_pylist() == [6_000_000_000]
            assert batch.column("step").cast(pa.int64()).to_pylist() == [2]


def test_the_answer_is_equal_when_read_back(tmp_path: Path, home: Scene, episode: Episode) -> None:
    answer = answered(home, episode, tmp_path / "p01.rrd")
    lines = rows(tmp_path / "p01.rrd", f"{RUN}/record", "line")
    assert len(lines) == 1
    assert Answer.model_validate_json(lines[0][1][0]) == answer
    infos = rows(tmp_path / "p01.rrd", f"{RUN}/record", "info")
    assert json.loads(infos[0][1][0])["run_id"] == "study-p01-pog"


def test_a_scan_is_shown_only_with_pixels(tmp_path: Path, home: Scene, episode: Episode) -> None:
    scan = replace(home, kind="scan")
    answered(scan, episode, tmp_path / "without.rrd")
    answered(scan, episode, tmp_path / "with.rrd", with_pixels=True)
    pictures = {"/scene/mesh/storey_0", "/scene/topdown/storey_0"}
    assert not pictures & entities(tmp_path / "without.rrd")
    assert pictures <= entities(tmp_path / "with.rrd")
    documents = [rows(tmp_path / name, "/task", "TextDocument:text") for name in ("without.rrd", "with.rrd")]
    assert ["terms of use" in str(found[-1][1]) for found in documents] == [False, True]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_an_interrupted_trial_leaves_a_readable_file(tmp_path: Path, home: Scene, episode: Episode) -> None:
    observer = AnswerObserver(
        home, LiveSink("file", str(tmp_path / "a.rrd")), info("study-p01-pog", who="human"), participant="p01"
    )
    observer.on_reset(episode)
    observer.on_click(ray_to(*BED), BED, 2.5)
    whole = rows(tmp_path / "a.rrd", f"{RUN}/marks", "Points3D:positions")
    assert [time for time, _ in whole] == [2.5], "flushed rows can be read while the trial runs"
    del observer
    assert [time for time, _ in rows(tmp_path / "a.rrd", f"{RUN}/marks", "Points3D:positions")] == [2.5]

"""The live observer: the recording of a running episode, read back with Rerun's own reader."""

import io
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun_cli
from PIL import Image
from rerun.chunk import RrdReader

from recordings import live_episode
from recordings.maps import HEAT_PALETTE, SEEN_PALETTE
from recordings.observer import ObserveRuns, RerunObserver
from recordings.sinks import LiveSink
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.mesh import Scene
from sim.plan_view.storey import storey_map
from sim.render.raycast import Raycaster
from sim.tasks.observers import FREE, OCCUPIED, Detection, Insight
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import EpisodeRun, RunInfo
from sim.types import Action, GridSpec

from .conftest import info, to_the_table, walk
from .reading import SMALL, Tables, column, tables, view_names

RUN = "/runs/straight.agent"
MAP = f"{RUN}/map/storey_0"
GRID = GridSpec((-2.0, -3.0), 0.5, (8, 6))
"""A grid in the start frame: x from -2 to 1 m, z from -3 to 1 m."""


def observe(
    out: Path,
    home: Scene,
    episode: Episode,
    renderer: Raycaster | None,
    actions: Sequence[Action],
    *,
    insights: Sequence[Insight | None] = (),
    run: EpisodeRun | None = None,
    who: RunInfo | None = None,
    **options: Any,
) -> EpisodeRun:
    """Plays the actions through an observer that writes to `out`; step i has insight i."""
    run = run or walk(home, episode, actions)
    sink = LiveSink("file", str(out))
    observer = RerunObserver(home, sink, who or info("straight.agent"), camera=SMALL, **options)
    env = PanEnv(episode.start, home.navigation, renderer=renderer, camera=SMALL)
    observer.on_reset(episode, env.reset())
    for number, step in enumerate(run.steps):
        observation = env.step(step.action)
        observer.on_step(step, observation, insights[number] if number < len(insights) else None)
    observer.on_end(run)
    return run


@pytest.fixture(scope="module")
def rrd(
    tmp_path_factory: pytest.TempPathFactory, home: Scene, episode: Episode, renderer: Raycaster
) -> tuple[Path, EpisodeRun]:
    """The recording and the run of an agent that reaches the table in 40 steps."""
    out = tmp_path_factory.mktemp("live") / "box.rrd"
    return out, observe(out, home, episode, renderer, to_the_table())


@pytest.fixture(scope="module")
def found(rrd: tuple[Path, EpisodeRun]) -> Tables:
    return tables(rrd[0])


def test_every_step_has_a_row_in_every_entity(found: Tables) -> None:
    rows = {entity: len(columns["step"]) for (entity, static), columns in found.items() if not static}
    assert 3 <= rows.pop(f"{MAP}/seen") <= 9
    moments = ("camera", "depth", "centre_distance", "goal_distance", "map/storey_0/robot")
    steps = ("trail", "actions", "record/line", "map/storey_0/trail")
    goal = ("centre", "region", "places", "path", "map/storey_0")
    goal += tuple(f"map/storey_0/{name}" for name in ("region", "places", "path"))
    assert rows == (
        {f"{RUN}/{name}": 41 for name in moments}
        | {f"{RUN}/{name}": 40 for name in steps}
        | {f"/goal/{name}": 1 for name in goal}
    )


def test_the_finished_file_is_complete_and_valid(rrd: tuple[Path, EpisodeRun]) -> None:
    program = Path(rerun_cli.__file__).with_name("rerun")
    done = subprocess.run([program, "rrd", "verify", rrd[0]], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in rrd[0].parent.iterdir()] == ["box.rrd"]


def test_rows_have_their_steps_pictures_come_from_the_camera_and_goal_and_measures_appear_at_the_end(
    found: Tables,
) -> None:
    assert sorted(found[(f"{RUN}/camera", False)]["step"]) == list(range(41))
    metres = np.array(column(found, f"{RUN}/camera", "path_m")) / 1e9
    assert metres[[0, 3, 4, 27, 30, 40]] == pytest.approx([0, 0, 0.25, 6, 6, 8.25])
    assert "time_s" not in found[(f"{RUN}/camera", False)]
    last = np.asarray(Image.open(io.BytesIO(bytes(column(found, f"{RUN}/camera", "EncodedImage:blob")[40][0]))))
    assert last.shape == (48, 64, 3)
    assert (np.abs(last - np.array([150, 60, 40])).max(axis=-1) < 30).mean() > 0.2  # pixels of the red table
    assert found[("/goal/centre", False)]["step"] == [40]
    assert found[("/goal/region", False)]["step"] == [40]
    texts = [text[0] for text in found[("/task", True)]["TextDocument:text"]]
    assert all("Edition of the episodes: own." in text for text in texts)
    assert ["| straight.agent | yes |" in text for text in texts] == [False, True]
    assert all("**Query:** Find Nell's table." in text for text in texts)
    assert "Nell keeps the red table" in texts[0]


def test_depth_has_a_quarter_of_the_width_and_height_and_is_in_millimetres(
    found: Tables, episode: Episode, home: Scene, renderer: Raycaster
) -> None:
    depth = np.frombuffer(bytes(column(found, f"{RUN}/depth", "DepthImage:buffer")[0][0]), np.uint16).reshape(12, 16)
    truth = PanEnv(episode.start, home.navigation, renderer=renderer, camera=SMALL).reset().depth_m
    assert truth is not None
    assert depth[6, 8] == pytest.approx(truth[26, 34] * 1000, abs=1)
    resolution = column(found, f"{RUN}/depth", "Pinhole:resolution", static=True)
    assert [row for row in resolution if row] == [[[16.0, 12.0]]]


def test_distances_fall_and_the_walking_distance_ends_at_zero(found: Tables, rrd: tuple[Path, EpisodeRun]) -> None:
    centre = np.array(column(found, f"{RUN}/centre_distance", "Scalars:scalars")).ravel()
    walk_m = np.array(column(found, f"{RUN}/goal_distance", "Scalars:scalars")).ravel()
    assert centre[0] == pytest.approx(np.hypot(6.1, 3.0))
    assert centre[40] == pytest.approx(np.hypot(0.1, 0.75), abs=0.01)
    paper = rrd[1].end.measures.rules["paper"] if rrd[1].end.measures else None
    assert paper is not None
    assert walk_m[0] == pytest.approx(paper.start_distance)
    assert walk_m[40] == 0


def test_the_map_of_seen_floor_grows_to_both_rooms(found: Tables, home: Scene) -> None:
    blobs = column(found, f"{MAP}/seen", "EncodedImage:blob")
    pictures = [np.asarray(Image.open(io.BytesIO(bytes(blob[0]))).convert("RGB")) for blob in blobs]
    free = storey_map(home.navigation, 0).free
    shares = [(picture[free] == SEEN_PALETTE[3]).all(axis=-1).mean() for picture in pictures]
    assert (np.diff(shares) >= 0).all()
    assert 0.05 < shares[0] < 0.5
    assert shares[-1] > 0.7
    assert np.unique(pictures[0][free], axis=0).tolist() == sorted(SEEN_PALETTE[[1, 3]].tolist())


def test_the_record_holds_the_lines_of_the_run_file(found: Tables, rrd: tuple[Path, EpisodeRun]) -> None:
    run = rrd[1]
    lines = [row[0] for row in column(found, f"{RUN}/record/line", "line")]
    assert lines == [step.model_dump_json() for step in run.steps]
    assert found[(f"{RUN}/record", True)]["start"] == [[run.start.model_dump_json()]]
    assert found[(f"{RUN}/record/end", True)]["end"] == [[run.end.model_dump_json()]]
    assert RunInfo.model_validate_json(found[(f"{RUN}/record", True)]["info"][0][0]).run_id == "straight.agent"


def test_the_blueprint_shows_camera_home_map_plot_actions_and_task(rrd: tuple[Path, EpisodeRun]) -> None:
    assert view_names(rrd[0]) == {
        *("Actions", "Depth", "Home", "Metres to the goal", "Seen so far", "Task and results", "straight.agent sees")
    }


def test_collisions_are_marked_where_a_wall_stopped_the_robot(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster
) -> None:
    actions = [Action.LEFT, Action.LEFT, Action.LEFT, *[Action.FORWARD] * 6, Action.STOP]
    run = observe(tmp_path / "a.rrd", home, episode, renderer, actions)
    blocked = [number for number, step in enumerate(run.steps, start=1) if step.collided]
    found = tables(tmp_path / "a.rrd")
    assert blocked
    assert column(found, f"{RUN}/collisions", "step") == blocked
    assert column(found, f"{MAP}/collisions", "step") == blocked
    marks = column(found, f"{RUN}/collisions", "Points3D:positions")
    assert marks[0][0][::2] == pytest.approx(run.steps[blocked[0] - 1].position[::2])
    assert column(found, f"{RUN}/actions", "TextLog:text")[blocked[0] - 1] == ["straight.agent: forward (blocked)"]


INSIGHT = Insight(
    grid=GRID,
    occupancy=np.full(GRID.shape, FREE, np.uint8),
    similarity=np.where(np.arange(48).reshape(8, 6) < 24, np.nan, np.arange(48).reshape(8, 6)).astype(np.float32),
    frontiers=np.array([[0.0, -2.0], [1.0, -1.0]]),
    detections=(Detection("table", (10, 5, 30, 25), 0.75, (0.0, 0.4, -2.0)), Detection("bed", (1, 2, 3, 4), 0.5)),
    candidates=np.array([[0.0, 0.4, -2.0], [1.0, 0.2, -1.0]]),
    candidate_scores=(0.9, 0.25),
    goal=(0.0, 0.0, -1.0),
    note="it looks like a table",
)


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory, home: Scene, episode: Episode, renderer: Raycaster) -> Tables:
    """The recording of a run with insights: a full one, one with fewer fields, and an empty one."""
    out = tmp_path_factory.mktemp("live") / "explained.rrd"
    actions = [Action.RIGHT, Action.RIGHT, Action.STOP]
    insights = [INSIGHT, replace(INSIGHT, detections=(), candidates=None, candidate_scores=()), Insight()]
    observe(out, home, turned(episode), renderer, actions, insights=insights)
    return tables(out)


def turned(episode: Episode) -> Episode:
    """The same episode with a start that faces left (-x)."""
    turn = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
    return replace(episode, record=episode.record.model_copy(update={"start_rotation": turn}))


def test_an_insight_is_logged_at_its_step_with_its_points_in_the_world_frame(explained: Tables) -> None:
    assert column(explained, f"{RUN}/note", "step") == [0, 1]
    assert column(explained, f"{RUN}/note", "TextLog:text")[0] == ["because: it looks like a table"]
    assert column(explained, f"{RUN}/frontiers", "step") == [0, 1, 2]
    # the robot starts at (-3, 0, 1.1) and faces -x: 2 m ahead is x = -5, 1 m to its right is z = 0.1
    frontiers = np.array(column(explained, f"{RUN}/frontiers", "Points3D:positions")[0])
    assert frontiers[:, [0, 2]] == pytest.approx(np.array([[-5.0, 1.1], [-4.0, 0.1]]), abs=1e-5)
    (chosen,) = column(explained, f"{RUN}/chosen", "Points3D:positions")[0]
    assert chosen[::2] == pytest.approx([-4.0, 1.1], abs=1e-5)


def test_candidates_and_detections_show_their_scores_and_disappear_when_they_are_gone(explained: Tables) -> None:
    assert column(explained, f"{RUN}/candidates", "Points3D:labels")[0] == ["1 0.90", "2 0.25"]
    assert column(explained, f"{RUN}/found", "Points3D:labels")[0] == ["table 0.75"]
    boxes = f"{RUN}/camera/detections"
    assert column(explained, boxes, "Boxes2D:labels")[0] == ["table 0.75", "bed 0.50"]
    assert column(explained, boxes, "Boxes2D:centers")[0] == [[20.0, 15.0], [2.0, 3.0]]
    assert column(explained, boxes, "Boxes2D:half_sizes")[0] == [[10.0, 10.0], [1.0, 1.0]]
    assert column(explained, f"{RUN}/candidates", "step") == [0, 1]
    assert column(explained, f"{RUN}/candidates", "Points3D:positions")[1] == []
    assert column(explained, f"{RUN}/camera/detections", "Boxes2D:centers")[1] == []
    assert column(explained, f"{MAP}/frontiers", "Points2D:positions")[2] == []


def test_grids_of_an_agent_are_turned_onto_the_map_of_the_storey(explained: Tables, home: Scene) -> None:
    shown = storey_map(home.navigation, 0)
    (blob,) = column(explained, f"{MAP}/similarity", "EncodedImage:blob")
    similarity = np.asarray(Image.open(io.BytesIO(bytes(blob[0]))).convert("RGBA"))
    assert similarity.shape == (*shown.grid.shape, 4)

    def colour(x: float, z: float) -> list[int]:
        row, col = shown.grid.rc_from_xz(np.array([x, z]))
        return similarity[row, col].tolist()

    # the last cell of the grid (row 7, col 5) lies 0.75 m behind and to the right of the start: x = -2.25, z = 0.35
    assert colour(-2.25, 0.35) == HEAT_PALETTE[-1].tolist()
    assert colour(-4.75, 0.35)[3] == 0  # ahead of the robot: not seen
    assert colour(2.0, 0.35)[3] == 0  # outside the grid
    (blob,) = column(explained, f"{MAP}/occupancy", "EncodedImage:blob")
    assert np.asarray(Image.open(io.BytesIO(bytes(blob[0]))).convert("RGBA")).shape == similarity.shape


@pytest.mark.parametrize(
    ("insight", "message"),
    [
        (Insight(occupancy=np.full((2, 2), OCCUPIED, np.uint8)), "found occupancy without grid"),
        (Insight(grid=GRID, similarity=np.zeros((2, 2), np.float32)), r"similarity has shape \(2, 2\); expected"),
        (Insight(frontiers=np.zeros((3, 3))), r"frontiers has shape \(3, 3\); expected \(N, 2\)"),
        (Insight(candidates=np.zeros((2, 3)), candidate_scores=(0.5,)), "found 1 candidate_scores for 2 candidates"),
    ],
)
def test_an_inconsistent_insight_is_refused_with_its_fault(
    tmp_path: Path, home: Scene, episode: Episode, insight: Insight, message: str
) -> None:
    with pytest.raises(AgentError, match=message):
        observe(tmp_path / "a.rrd", home, episode, None, [Action.LEFT, Action.STOP], insights=[insight])


def test_a_scan_shows_only_poses_and_figures(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster
) -> None:
    scan = replace(home, kind="scan")
    observe(tmp_path / "a.rrd", scan, episode, renderer, to_the_table(), insights=[INSIGHT])
    found = tables(tmp_path / "a.rrd")
    shown = {name for columns in found.values() for name in columns}
    assert not {name for name in shown if name.startswith(("EncodedImage", "DepthImage", "Asset3D"))}
    assert not {entity for entity, _ in found if entity.startswith("/scene")}
    assert len(found[(f"{RUN}/camera", False)]["step"]) == 41
    assert (tmp_path / "a.rrd").stat().st_size < 500_000


def test_a_scan_with_permission_shows_everything_and_a_notice(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster
) -> None:
    scan = replace(home, kind="scan")
    observe(tmp_path / "a.rrd", scan, episode, renderer, to_the_table()[:4], with_pixels=True)
    found = tables(tmp_path / "a.rrd")
    assert "EncodedImage:blob" in found[(f"{RUN}/camera", False)]
    assert ("/scene/mesh/storey_0", True) in found
    assert all("HM3D's terms of use" in text[0] for text in found[("/task", True)]["TextDocument:text"])


def test_without_a_renderer_the_map_grows_from_the_floor_plan(tmp_path: Path, home: Scene, episode: Episode) -> None:
    observe(tmp_path / "a.rrd", home, episode, None, to_the_table())
    found = tables(tmp_path / "a.rrd")
    assert "EncodedImage:blob" not in found[(f"{RUN}/camera", False)]
    assert (f"{RUN}/depth", False) not in found
    assert len(found[(f"{MAP}/seen", False)]["step"]) >= 3


def test_a_person_is_shown_with_a_code_and_times(tmp_path: Path, home: Scene, episode: Episode) -> None:
    run = walk(home, episode, [Action.FORWARD, Action.LEFT, Action.STOP], participant="P07")
    who = info("study", who="human", who_kind="human")
    observe(tmp_path / "a.rrd", home, episode, None, [], run=run, who=who, participant="P07")
    found = tables(tmp_path / "a.rrd")
    seconds = np.array(column(found, "/runs/study-P07/camera", "time_s")) / 1e9
    assert seconds == pytest.approx([0, 0.5, 1.0, 1.5])
    assert column(found, "/runs/study-P07/actions", "TextLog:text")[0] == ["human-P07: forward"]


def started(out: Path, home: Scene, episode: Episode, renderer: Raycaster) -> tuple[RerunObserver, PanEnv]:
    """An observer that writes to `out` and has got the start, and the environment."""
    observer = RerunObserver(home, LiveSink("file", str(out)), info("straight.agent"), camera=SMALL)
    env = PanEnv(episode.start, home.navigation, renderer=renderer, camera=SMALL)
    observer.on_reset(episode, env.reset())
    return observer, env


def test_an_interrupted_episode_is_recorded_up_to_its_last_step(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster
) -> None:
    observer, env = started(tmp_path / "a.rrd", home, episode, renderer)
    for step in walk(home, episode, to_the_table()).steps[:6]:
        observer.on_step(step, env.step(step.action), None)
    observer.close()
    found = tables(tmp_path / "a.rrd")
    assert sorted(found[(f"{RUN}/camera", False)]["step"]) == list(range(7))
    assert not {entity for entity, _ in found if entity.startswith("/goal")}


def test_steps_of_a_slow_agent_are_written_to_the_file_immediately(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_episode, "SEND_S", 0.0)
    observer, env = started(tmp_path / "a.rrd", home, episode, renderer)
    for number, step in enumerate(walk(home, episode, to_the_table()).steps[:3], start=1):
        observer.on_step(step, env.step(step.action), None)
        chunks = RrdReader(str(tmp_path / "a.rrd")).stream()
        rows = sum(chunk.num_rows for chunk in chunks if chunk.entity_path == f"{RUN}/camera" and not chunk.is_static)
        assert rows == number + 1
    observer.close()


def test_makers_of_observers_are_equal_if_their_fields_are(home: Scene) -> None:
    makers = [ObserveRuns(LiveSink("folder", "live"), info("a").model_dump_json()) for _ in range(2)]
    assert len(set(makers)) == 1
    assert isinstance(makers[0](home), RerunObserver)

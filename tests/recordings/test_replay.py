"""One recording of many runs, read back with Rerun's own reader."""

import io
import json
import struct
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun_cli
from PIL import Image
from rerun.chunk import RrdReader

from recordings.paths import escape_part
from recordings.replay import log_comparison
from sim.episodes.dataset import key_from_text
from sim.episodes.schema import Episode
from sim.errors import PersonalVizError, RecordingError
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.tasks.run_files import Run

from ..sim.grids import level_floors
from .conftest import KEY, info
from .reading import SMALL, Tables, record, tables, view_names

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


@pytest.fixture(scope="module")
def rrd(
    tmp_path_factory: pytest.TempPathFactory,
    home: Scene,
    episode: Episode,
    renderer: Raycaster,
    agent_run: Run,
    human_run: Run,
    answer_run: Run,
) -> Path:
    """An agent with 40 steps, a person with 14 and a grounder in one file."""
    out = tmp_path_factory.mktemp("rrd") / "deep" / "box.rrd"
    runs = [agent_run, human_run, answer_run]
    return log_comparison(
        runs, episode=episode, scene=home, out=out, renderer=renderer, with_pixels=False, camera=SMALL
    )


@pytest.fixture(scope="module")
def found(rrd: Path) -> Tables:
    return tables(rrd)


def test_the_file_is_valid_alone_in_its_folder_and_has_the_id_of_the_episode(rrd: Path) -> None:
    assert [path.name for path in rrd.parent.iterdir()] == ["box.rrd"]
    program = Path(rerun_cli.__file__).with_name("rerun")
    done = subprocess.run([program, "rrd", "verify", rrd], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (store,) = RrdReader(str(rrd)).recordings()
    assert (store.application_id, store.recording_id) == ("personal-viz", "personal/easy/BoxHouse/7")
    assert tables(rrd)[("/__properties/episode", True)]["scene_kind"] == [["invented"]]


def test_layout_home_and_first_pictures_come_first_in_the_file(rrd: Path) -> None:
    """A viewer shows them while it reads the rest."""
    program = Path(rerun_cli.__file__).with_name("rerun")
    lines = subprocess.run([program, "rrd", "print", rrd], capture_output=True, text=True, check=True).stdout
    chunks = [(line.split(" - ")[1], line) for line in lines.splitlines() if line.startswith("Chunk(")]
    layout = [at for at, (entity, _) in enumerate(chunks) if entity.startswith(("/view", "/container"))]
    home = [at for at, (entity, _) in enumerate(chunks) if entity.startswith("/scene/mesh")]
    runs = [at for at, (entity, _) in enumerate(chunks) if entity.startswith("/runs/")]
    pictures = [at for at in runs if "EncodedImage" in chunks[at][1]]
    first, pictures = pictures[:2], pictures[2:]
    rows = [at for at in runs if at not in first + pictures]
    assert len(first) == len(pictures) == 2
    assert all(" 1 rows " in chunks[at][1] for at in first)
    assert max(layout) < min(home) <= max(home) < min(first) <= max(first) < min(rows)
    assert max(rows) < min(pictures)


def test_every_run_has_its_entities_and_every_step_has_a_row(found: Tables) -> None:
    rows = {
        entity: len(columns["step"]) for (entity, static), columns in found.items() if not static and "step" in columns
    }
    on_map, once = "map/storey_0", ("departure", "parting")
    expected = {f"/runs/grounder/{name}": 1 for name in ("candidates", "actions", f"{on_map}/candidates")}
    for run, steps in (("straight.agent", 40), ("study-P07", 14)):
        moments = ("camera", "centre_distance", "path_deviation", f"{on_map}/robot")
        expected |= {f"/runs/{run}/{name}": steps + 1 for name in moments}
        expected |= {f"/runs/{run}/{name}": steps for name in ("trail", "actions", "record/line", f"{on_map}/trail")}
        expected |= {
            f"/runs/{run}/{name}": 1 for name in ("camera/ended", *once, *(f"{on_map}/{mark}" for mark in once))
        }
    for name in ("region", "places", "path"):
        expected |= {f"/goal/{name}": 1, f"/goal/{on_map}/{name}": 1}
    assert rows == expected | {"/goal/centre": 1, f"/goal/{on_map}": 1}


def test_timelines_count_steps_metres_and_seconds_and_distances_fall_towards_the_goal(found: Tables) -> None:
    agent, person = (found[(f"/runs/{run}/camera", False)] for run in ("straight.agent", "study-P07"))
    assert agent["step"] == list(range(41))
    assert np.array(agent["path_m"])[[0, 3, 4, 27, 30, 40]] / 1e9 == pytest.approx([0, 0, 0.25, 6, 6, 8.25])
    assert "time_s" not in agent
    assert np.array(person["time_s"]) / 1e9 == pytest.approx(np.arange(15) / 2)
    values = found[("/runs/straight.agent/centre_distance", False)]["Scalars:scalars"]
    apart = [row[0] for row in values]
    assert apart[0] == pytest.approx(np.hypot(6.1, 3.0))
    assert apart[-1] == pytest.approx(np.hypot(0.1, 0.75))


def test_the_goal_appears_only_with_the_last_step(found: Tables) -> None:
    goals = {entity: static for entity, static in found if entity.startswith("/goal")}
    assert set(goals.values()) == {False}
    for entity in goals:
        goal = found[(entity, False)]
        assert goal["step"] == [40]
        assert [goal["path_m"][0] / 1e9, goal["time_s"][0] / 1e9] == pytest.approx([8.25, 7.0])
    goal = found[("/goal/centre", False)]
    assert goal["Points3D:positions"][0][0] == pytest.approx([3.1, 0.4, -1.9])
    assert goal["Points3D:labels"] == [["table_3"]]


def test_pictures_show_the_view_of_the_camera_at_each_step(found: Tables) -> None:
    blobs = found[("/runs/straight.agent/camera", False)]["EncodedImage:blob"]
    images = [np.asarray(Image.open(io.BytesIO(bytes(blob[0])))) for blob in blobs]
    assert {image.shape for image in images} == {(48, 64, 3)}
    red, blue = np.array([150, 60, 40]), np.array([60, 90, 160])
    shares = [[(np.abs(image - rgb).max(axis=-1) < 30).mean() for rgb in (red, blue)] for image in images]
    assert shares[0][0] == 0
    assert shares[0][1] > 0.03
    assert shares[40][0] > 0.2
    assert shares[40][1] == 0


def test_the_camera_stands_88_cm_above_the_feet_and_the_text_holds_task_and_results(found: Tables) -> None:
    camera = found[("/runs/study-P07/camera", False)]
    assert camera["Transform3D:translation"][0][0] == pytest.approx([-3.0, 0.88, 1.1])
    columns = np.array(camera["Transform3D:mat3x3"][0][0]).reshape(3, 3)
    assert columns[2] == pytest.approx([0, 0, -1])
    tilted = np.array(camera["Transform3D:mat3x3"][1][0]).reshape(3, 3)
    assert tilted[2] == pytest.approx([0, -0.5, -np.sqrt(0.75)], abs=1e-6)
    text = found[("/task", True)]["TextDocument:text"][0][0]
    assert "Find Nell's table." in text
    assert "red table \\| Ivo" in text
    assert "| straight.agent | yes | 0.75 | 0.75 | 0.00 m | stop | 40 | 8.2 m | 0 |" in text
    assert "| human-P07 | no | 0.00 |" in text
    assert "| grounder | no | yes | 6.00 m | - |" in text
    assert "BoxHouse (invented home)" in text


def test_the_paths_on_map_and_floor_are_the_positions_of_the_runs(found: Tables, agent_run: Run) -> None:
    feet = np.array([pose.position for pose in agent_run.episodes[0].poses])
    whole = np.array(found[("/runs/straight.agent/path", True)]["LineStrips3D:strips"][0][0])
    assert whole == pytest.approx(feet + np.array([0, 0.11, 0]), abs=1e-6)
    robot = np.array([row[0] for row in found[("/runs/straight.agent/map/storey_0/robot", False)]["Arrows2D:origins"]])
    assert np.diff(robot, axis=0) * 0.05 == pytest.approx(np.diff(feet[:, [0, 2]], axis=0), abs=1e-4)
    picture = found[("/scene/topdown/storey_0", True)]["EncodedImage:blob"][0][0]
    pixels = np.asarray(Image.open(io.BytesIO(bytes(picture))))
    cols, rows = np.floor(robot).astype(int).T
    assert (pixels[rows, cols] == 236).any(axis=-1).all()


def test_the_blueprint_shows_both_best_cameras_home_map_plots_text_and_actions(rrd: Path) -> None:
    views = [columns for (_, _), columns in tables(rrd, kind="blueprints").items()]
    classes = Counter(c["ViewBlueprint:class_identifier"][0][0] for c in views if "ViewBlueprint:class_identifier" in c)
    assert classes == {"2D": 3, "3D": 1, "TimeSeries": 2, "TextDocument": 1, "TextLog": 1}
    assert {"straight.agent sees", "human-P07 sees", "Home", "Map"} <= view_names(rrd)


def test_the_same_runs_give_the_same_content(
    rrd: Path, home: Scene, episode: Episode, renderer: Raycaster, agent_run: Run, human_run: Run, answer_run: Run
) -> None:
    again = rrd.with_name("again.rrd")
    runs = [agent_run, human_run, answer_run]
    assert record(again, runs, episode, home, renderer=renderer) == tables(rrd)
    again.unlink()


def test_no_texture_names_a_filter_because_rerun_would_warn(found: Tables, tmp_path: Path) -> None:
    ((content,),) = found[("/scene/mesh/storey_0", True)]["Asset3D:blob"]
    (glb := tmp_path / "home.glb").write_bytes(bytes(content))
    (length,) = struct.unpack_from("<I", glb.read_bytes(), 12)
    samplers = json.loads(glb.read_bytes()[20 : 20 + length])["samplers"]
    assert samplers
    assert not [sampler for sampler in samplers if "Filter" in str(sampler)]
    assert len(load_glb(glb, up="y").faces) > 0


def test_a_scan_without_permission_shows_only_poses(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster, agent_run: Run
) -> None:
    scan = replace(home, kind="scan")
    run = agent_run.model_copy(update={"info": info("straight.agent", scene_kind="scan")})
    found = record(tmp_path / "a.rrd", [run], episode, scan, renderer=renderer)
    assert not [entity for entity, _ in found if entity.startswith("/scene")]
    assert not [name for columns in found.values() for name in columns if name.startswith("EncodedImage")]
    assert len(found[("/runs/straight.agent/camera", False)]["step"]) == 41
    allowed = record(tmp_path / "b.rrd", [run], episode, scan, renderer=renderer, with_pixels=True)
    assert ("/scene/mesh/storey_0", True) in allowed
    assert "EncodedImage:blob" in allowed[("/runs/straight.agent/camera", False)]
    text = allowed[("/task", True)]["TextDocument:text"][0][0]
    assert "terms of use" in text
    assert "terms of use" not in found[("/task", True)]["TextDocument:text"][0][0]


def test_answers_alone_precede_the_goal(tmp_path: Path, home: Scene, episode: Episode, answer_run: Run) -> None:
    found = record(tmp_path / "a.rrd", [answer_run], episode, home)
    assert found[("/runs/grounder/candidates", False)]["step"] == [1]
    assert found[("/goal/centre", False)]["step"] == [2]
    assert "path_m" not in found[("/goal/centre", False)]


def test_each_storey_has_its_own_map_and_mesh(tmp_path: Path, home: Scene, episode: Episode, human_run: Run) -> None:
    two_storeys = level_floors((60, 140), 0.0, 3.0, corner=(-3.5, -1.5))
    walk = human_run.episodes[0]
    up = [3.0 * (number in (4, 5, 6)) for number in range(14)]
    steps = [
        step.model_copy(update={"position": (-3.0 + number / 4, y, 0.5)})
        for number, (step, y) in enumerate(zip(walk.steps, up, strict=True))
    ]
    climbed = human_run.model_copy(update={"episodes": (walk.model_copy(update={"steps": tuple(steps)}),)})
    found = record(tmp_path / "a.rrd", [climbed], episode, replace(home, navigation=two_storeys))
    for storey, wanted in (("storey_0", [y == 0 for y in up]), ("storey_1", [y > 0 for y in up])):
        origins = found[(f"/runs/study-P07/map/{storey}/robot", False)]["Arrows2D:origins"]
        assert [bool(row) for row in origins[1:]] == wanted
    pieces = found[("/runs/study-P07/map/storey_1/trail", False)]["LineStrips2D:strips"]
    assert [number for number, row in enumerate(pieces) if row] == [5, 6]
    assert found[("/goal/map/storey_1", False)]["Points2D:positions"] == [[]]
    names = view_names(tmp_path / "a.rrd")
    assert {"Home, storey 1", "Home, storey 2", "Map, storey 1", "Map, storey 2"} <= names


@pytest.mark.parametrize("name", ["plain-1_a.b", "two words", "a/b", "über[x]:*", "tab\there"])
def test_names_are_escaped_as_in_rerun(name: str) -> None:
    assert escape_part(name) == rr.escape_entity_path_part(name.replace("\t", "_"))


def test_a_run_without_steps_can_be_shown(tmp_path: Path, home: Scene, episode: Episode, agent_run: Run) -> None:
    run = agent_run.episodes[0]
    left = run.model_copy(
        update={"steps": (), "end": run.end.model_copy(update={"reason": "giveup", "measures": None})}
    )
    found = record(tmp_path / "a.rrd", [agent_run.model_copy(update={"episodes": (left,)})], episode, home)
    assert found[("/goal/centre", False)]["step"] == [0]
    assert (
        "| straight.agent | - | - | - | - | giveup | 0 | - | - |" in found[("/task", True)]["TextDocument:text"][0][0]
    )


def test_runs_of_another_episode_kind_or_place_are_refused_and_leave_no_file(
    tmp_path: Path, home: Scene, episode: Episode, agent_run: Run
) -> None:
    out = tmp_path / "a.rrd"
    schematic = agent_run.model_copy(update={"info": info("pilot", scene_kind="schematic")})
    with pytest.raises(RecordingError, match="pilot: was made on a home of kind 'schematic', BoxHouse is opened as"):
        record(out, [agent_run, schematic], episode, home)
    with pytest.raises(RecordingError, match="found no run of episode easy/BoxHouse/8"):
        record(out, [agent_run], replace(episode, key=KEY._replace(episode_id="8")), home)
    blocked = tmp_path / "file"
    blocked.touch()
    folder = tmp_path / "folder.rrd"
    folder.mkdir()
    for place in (blocked / "a.rrd", folder):
        with pytest.raises(RecordingError, match="cannot be written"):
            record(place, [agent_run], episode, home)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.rrd"]


def test_an_output_file_that_is_no_rrd_is_refused_and_keeps_its_content(
    tmp_path: Path, home: Scene, episode: Episode, agent_run: Run
) -> None:
    out = tmp_path / "steps.jsonl"
    out.write_text("precious")
    with pytest.raises(RecordingError, match=r"steps\.jsonl'; expected a file that ends in \.rrd"):
        record(out, [agent_run], episode, home)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("steps.jsonl", "precious")]


def test_runs_made_on_another_version_of_the_home_are_refused(
    tmp_path: Path, home: Scene, episode: Episode, agent_run: Run, answer_run: Run
) -> None:
    rebuilt = replace(home, digest="0123456789abcdef" * 4)
    wanted = (
        f"^straight.agent: was made on BoxHouse with scene_digest '{home.digest[:12]}', the home opened now has "
        "'0123456789ab'; expected"
    )
    with pytest.raises(RecordingError, match=wanted):
        record(tmp_path / "a.rrd", [answer_run, agent_run], episode, rebuilt)
    assert list(tmp_path.iterdir()) == []
    assert record(tmp_path / "a.rrd", [answer_run], episode, rebuilt)


FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
import rerun as rr
from recordings.sinks import open_recording
from sim.errors import PersonalVizError, RecordingError
from sim.types import EpisodeKey

resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
try:
    with open_recording(Path(sys.argv[1]), EpisodeKey("easy", "BoxHouse", "7")) as stream:
        for number in range(int(sys.argv[2])):
            stream.log("/picture", rr.Image(np.random.default_rng(number).integers(0, 255, (200, 200, 3), np.uint8)))
except RecordingError as error:
    print(error)
"""


@pytest.mark.slow
@pytest.mark.parametrize("num_pictures", [1, 30])
def test_a_full_disk_gives_one_line_and_leaves_no_partial_file(tmp_path: Path, num_pictures: int) -> None:
    out = tmp_path / "a.rrd"
    command = [sys.executable, "-c", FULL_DISK, str(out), str(num_pictures)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=Path(__file__).parents[2])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{out}: cannot be written ([Errno 27] File too large")
    assert done.stdout.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_failure_halfway_keeps_the_old_file(tmp_path: Path, home: Scene, episode: Episode, agent_run: Run) -> None:
    class Broken:
        def render_batch(self, *_: object) -> None:
            raise ZeroDivisionError

    out = tmp_path / "a.rrd"
    out.write_text("old")
    with pytest.raises(ZeroDivisionError):
        record(out, [agent_run], episode, home, renderer=Broken())
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.rrd", "old")]


@pytest.mark.parametrize("text", ["easy/BoxHouse", "test/BoxHouse/7", "easy//7", "easy/a/b/c"])
def test_an_episode_option_in_a_wrong_form_is_refused(text: str) -> None:
    assert key_from_text("easy/BoxHouse/7") == KEY
    with pytest.raises(PersonalVizError, match="expected SPLIT/SCENE/ID"):
        key_from_text(text)

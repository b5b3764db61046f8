"""`personal-viz export`, and `import` of its files, as a person types them."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from personal_viz.cli.runs.export import Export
from personal_viz.cli.runs.import_runs import Import
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.tasks.metrics import metric_rows
from sim.tasks.run_files import Run, read_run

from .invented import invented_dataset
from .program import assert_one_line, personal_viz

pytestmark = pytest.mark.slow
RUN = "shortest-path-invented-seed0"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a dataset of one invented home in `data` and a run of three episodes in `runs`."""
    root = tmp_path_factory.mktemp("export")
    invented_dataset(root / "data", name="Demo", seed=1)
    done = personal_viz(
        *("run", "--dataset", str(root / "data"), "--agent", "shortest-path"),
        *("--limit", "1", "--out", str(root / "runs")),
    )
    assert done.returncode == 0, done.stderr
    return root


def imported(home: Path, *files: Path, run_id: str, out: Path, **options: object) -> Run:
    Import(
        files=files,
        dataset=home / "data",
        out=out,
        who="again",
        run_id=run_id,
        **options,
    ).run()
    return read_run(out / run_id)


def test_every_format_is_written_and_says_where(home: Path, tmp_path: Path) -> None:
    for format in ("jsonl", "tum", "minari"):
        out = tmp_path / format
        done = personal_viz("export", str(home / "runs"), "--format", format, "--out", str(out))
        assert done.returncode == 0, done.stderr
        assert f"{out}/" in done.stdout
        assert "3 episodes" in done.stdout
    assert read_run(tmp_path / "jsonl" / RUN) == read_run(home / "runs" / RUN)
    assert "minari.load_dataset('personal/shortest-path-invented-seed0-v0')" in done.stdout
    again = personal_viz("export", str(home / "runs"), "--format", "minari", "--out", str(tmp_path / "minari"))
    assert_one_line(again, "exists already", "--out")


def test_tum_files_are_imported_to_the_same_poses_and_measures(home: Path, tmp_path: Path) -> None:
    Export(runs=(home / "runs" / RUN,), out=tmp_path, format="tum").run()
    files = sorted((tmp_path / RUN).glob("*.tum"))
    done = personal_viz(
        *("import", *map(str, files), "--dataset", str(home / "data"), "--who", "again"),
        *("--frame", "world", "--quaternion", "xyzw", "--out", str(tmp_path), "--run-id", "back"),
    )
    assert done.returncode == 0, done.stderr
    wanted = {run.key: run for run in read_run(home / "runs" / RUN).episodes}
    found = read_run(tmp_path / "back")
    assert found.info.config["frame"] == "world"
    assert len(found.episodes) == len(wanted) == 3
    for run in found.episodes:
        other = wanted[run.key]
        assert [pose.position for pose in run.poses] == [pose.position for pose in other.poses]
        assert [step.action for step in run.steps] == [step.action for step in other.steps]
        assert run.end == other.end


def written_as_vlfm(run: Run, folder: Path) -> None:
    """Writes a run as VLFM does: positions without the last step, and one list of the actions of all episodes."""
    (folder / "trajectory").mkdir(parents=True)
    numbers = {"stop": 0, "forward": 1, "left": 2, "right": 3}
    actions = [numbers[step.action] for episode in run.episodes for step in episode.steps]
    (folder / "actions.txt").write_text("".join(f"{action}\n" for action in actions))
    for episode in run.episodes:
        rows = [(number, *step.position) for number, step in enumerate(episode.steps[:-1], start=1)]
        text = "".join(", ".join(map(str, row)) + "\n" for row in rows)
        (folder / "trajectory" / f"{episode.key.episode_id}_{episode.key.scene}.txt").write_text(text)
        measures = episode.end.measures
        assert measures is not None
        figures = {"success": True, "spl": 0.5, "distance_to_goal": 0.0, "num_steps": measures.num_steps}
        (folder / f"{episode.key.episode_id}_{episode.key.scene}.json").write_text(json.dumps(figures))


def test_vlfms_files_are_imported_step_by_step_and_as_reported(home: Path, tmp_path: Path) -> None:
    run = read_run(home / "runs" / RUN)
    easy = run.model_copy(update={"episodes": tuple(item for item in run.episodes if item.start.split == "easy")})
    written_as_vlfm(easy, tmp_path / "vlfm")
    options = ("--dataset", str(home / "data"), "--split", "easy", "--out", str(tmp_path / "runs"))
    done = personal_viz(
        *("import", str(tmp_path / "vlfm"), "--who", "VLFM", "--run-id", "steps"),
        *("--actions", str(tmp_path / "vlfm" / "actions.txt"), *options),
    )
    assert done.returncode == 0, done.stderr
    found = read_run(tmp_path / "runs" / "steps")
    assert [item.key for item in found.episodes] == [item.key for item in easy.episodes]
    assert [item.end for item in found.episodes] == [item.end for item in easy.episodes]

    done = personal_viz("import", str(tmp_path / "vlfm"), "--who", "VLFM", "--run-id", "told", "--reported", *options)
    assert done.returncode == 0, done.stderr
    assert "1 episodes of 'VLFM', reported, not recomputed" in done.stdout
    done = personal_viz("metrics", str(tmp_path / "runs"))
    assert done.returncode == 0, done.stderr
    assert "VLFM (reported, not recomputed)" in " ".join(done.stdout.split())
    alone = personal_viz("metrics", str(tmp_path / "runs" / "told"))
    assert "PAN, as reported" in alone.stdout
    assert "rule paper" not in alone.stdout
    data, out = str(home / "data"), str(tmp_path / "page")
    shown = personal_viz("replay", "--runs", str(tmp_path / "runs" / "told"), "--dataset", data, "--out", out + ".rrd")
    assert_one_line(shown, "reported, not recomputed")
    browsed = personal_viz("browse", "--dataset", data, "--runs", str(tmp_path / "runs" / "told"), "--port", "0")
    assert_one_line(browsed, "reported, not recomputed")
    refused = personal_viz("compare", str(tmp_path / "runs"), "--dataset", data, "--out", out)
    assert_one_line(refused, "reported, not recomputed", "personal-viz metrics shows such figures")


def test_onemaps_files_are_imported_by_their_number(home: Path, tmp_path: Path) -> None:
    run = read_run(home / "runs" / RUN)
    episode = next(item for item in run.episodes if item.start.split == "easy")
    data = PersonalDataset(home / "data")
    (scene,) = (scene for split, scene in data.files if split == "easy")
    single = [item.episode_id for item in data.content("easy", scene).episodes if isinstance(item.object_id, str)]
    path = tmp_path / "onemap" / "trajectories" / f"poses_{single.index(episode.key.episode_id)}.csv"
    path.parent.mkdir(parents=True)
    np.savetxt(
        path, [[-z, -x, y, pose.yaw] for pose in episode.poses[:-1] for x, y, z in [pose.position]], delimiter=","
    )
    (tmp_path / "onemap" / "state").mkdir()
    (tmp_path / "onemap" / "state" / path.name.replace("poses", "state").replace("csv", "txt")).write_text("1")
    done = personal_viz(
        *("import", str(tmp_path / "onemap"), "--who", "OneMap", "--numbered-by", "onemap", "--split", "easy"),
        *("--motion", "free", "--max-move", "0.25", "--max-turn-deg", "30"),
        *("--dataset", str(home / "data"), "--out", str(tmp_path / "runs"), "--run-id", "onemap"),
    )
    assert done.returncode == 0, done.stderr
    (found,) = read_run(tmp_path / "runs" / "onemap").episodes
    assert found.key == episode.key
    assert found.end.reason == "stop"
    assert found.end.measures is not None
    assert episode.end.measures is not None
    assert found.end.measures.rules == episode.end.measures.rules


def test_options_that_contradict_each_other_are_refused(home: Path, tmp_path: Path) -> None:
    options = {"dataset": home / "data", "who": "VLFM", "out": tmp_path}
    for contradiction, found in (
        ({"reported": True, "frame": "world"}, "--frame: stands beside --reported"),
        ({"reported": True, "numbered_by": "onemap"}, "--numbered-by onemap: stands beside --reported"),
        ({"reported": True, "scenes_dir": tmp_path}, "--scenes-dir: stands beside --reported"),
        ({"reported": True, "allow_sliding": True}, "--allow-sliding: stands beside --reported"),
        ({"numbered_by": "place"}, "--frame is missing beside other options"),
        ({"split": "easy"}, "--frame is missing beside other options"),
        ({"actions": tmp_path, "numbered_by": "onemap"}, "--actions stands beside --numbered-by onemap"),
        ({"actions": tmp_path, "motion": "free", "max_move": 1.0, "max_turn_deg": 9.0}, "--actions stands beside"),
    ):
        with pytest.raises(PersonalVizError, match=found):
            Import(files=(tmp_path,), **options, **contradiction).run()


def test_a_recording_is_exported_as_the_run_that_it_shows(home: Path, tmp_path: Path) -> None:
    key = read_run(home / "runs" / RUN).episodes[0].key
    done = personal_viz(
        *("replay", "--dataset", str(home / "data"), "--runs", str(home / "runs" / RUN)),
        *("--episode", str(key), "--out", str(tmp_path / "one.rrd")),
    )
    assert done.returncode == 0, done.stderr
    Export(runs=(tmp_path / "one.rrd",), out=tmp_path / "out").run()
    original = read_run(home / "runs" / RUN)
    assert read_run(tmp_path / "out" / RUN) == original.model_copy(update={"episodes": original.episodes[:1]})


def test_free_motion_is_scored_in_a_row_of_its_own(home: Path, tmp_path: Path) -> None:
    """The same path in steps a quarter as long: 0.0625 m and 7.5 degrees."""
    run = read_run(home / "runs" / RUN).episodes[0]
    rows = []
    for before, after in pairwise(run.poses):
        turned = math.remainder(after.yaw - before.yaw, 2 * math.pi)
        for part in (0.0, 0.25, 0.5, 0.75):
            place = np.add(before.position, part * np.subtract(after.position, before.position))
            rows.append([*place.tolist(), before.yaw + part * turned])
    rows.append([*run.poses[-1].position, run.poses[-1].yaw])
    path = tmp_path / f"{'-'.join(run.key)}.csv"
    path.write_text("x,y,z,yaw\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    options = {"frame": "world", "stopped": "yes", "run_id": "free", "out": tmp_path}
    with pytest.raises(PersonalVizError, match=r"csv:\d+: .*--motion free"):
        imported(home, path, **options)
    assert not (tmp_path / "free").exists()
    found = imported(home, path, **options, motion="free", max_move=0.07, max_turn_deg=8.0)
    measures, wanted = found.episodes[0].end.measures, run.end.measures
    assert measures.path_m == pytest.approx(wanted.path_m)
    rule, wanted_rule = measures.rules["paper"], wanted.rules["paper"]
    assert (rule.success, rule.dtg) == (True, 0.0)
    assert rule.spl == pytest.approx(wanted_rule.spl)
    assert measures.collisions == 0
    on_paper = found.model_copy(update={"info": found.info.model_copy(update={"condition": "none", "run_id": "p"})})
    cells = metric_rows([found, on_paper])
    assert {row.condition for row in cells} == {"free motion", "none"}


def test_free_motion_through_the_outer_wall_is_refused(home: Path, tmp_path: Path) -> None:
    start = read_run(home / "runs" / RUN).episodes[0].start
    x, y, z = start.position
    path = tmp_path / f"{start.split}-{start.scene}-{start.episode_id}.csv"
    path.write_text("x,y,z,yaw\n" + "".join(f"{x + 0.1 * n},{y},{z},{start.yaw}\n" for n in range(400)))
    free = {"motion": "free", "max_move": 0.2, "max_turn_deg": 9.0}
    with pytest.raises(PersonalVizError, match=r"csv:\d+: position .* aside and .* the nearest floor"):
        imported(home, path, run_id="wall", out=tmp_path, frame="world", stopped="no", **free)
    assert not (tmp_path / "wall").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stopped": "yes"}, "--frame is missing beside other options"),
        ({"frame": "world", "motion": "free"}, "expected metres up to 2 and degrees"),
        ({"frame": "world", "max_move": 0.1}, "expected --motion free"),
        ({"frame": "world", "rounding": 0.5}, "--rounding is 0.5"),
        ({"frame": "world", "episode": "Demo/1"}, "expected SPLIT/SCENE/ID"),
        ({"frame": "world"}, "is a steps file, which says itself how to read it"),
        (
            {"frame": "world", "motion": "free", "max_move": 0.1, "max_turn_deg": 9.0, "max_steps": 0},
            "--max-steps is 0",
        ),
    ],
)
def test_declarations_that_do_not_fit_are_refused(
    home: Path, tmp_path: Path, options: dict[str, object], message: str
) -> None:
    with pytest.raises(PersonalVizError, match=message):
        imported(home, home / "runs" / RUN / "steps.jsonl", run_id="x", out=tmp_path, **options)
    assert list(tmp_path.iterdir()) == []


def test_exporting_no_run_is_refused_in_one_line(tmp_path: Path) -> None:
    assert_one_line(personal_viz("export", "--out", str(tmp_path / "a")), "found no run; expected run folders")
    (tmp_path / "bad.rrd").write_bytes(b"nothing")
    assert_one_line(personal_viz("export", str(tmp_path / "bad.rrd"), "--out", str(tmp_path / "a")), "bad.rrd")
    assert_one_line(personal_viz("export", str(tmp_path / "no"), "--out", str(tmp_path / "a")), "no run.json")

"""Verb `homes` as a person meets it, and results of different kinds of homes, which no command puts side by side."""

import json
import os
from pathlib import Path

import pytest

from personal_viz.cli.contact_sheet import ContactSheet
from personal_viz.cli.homes import Homes
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.replay import Replay
from personal_viz.cli.runs.run import Run
from personal_viz.cli.verbs import parse
from sim.authoring.generation import dataset_files, write_files
from sim.cache import VARIABLE
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, PersonalVizError, RecordingError, RunFileError, SceneError
from sim.homes.open_home import open_scene
from sim.homes.plan import load_plan, save_plan
from sim.homes.recovered.plans import recover_plan
from tests.sim.synthetic import SCENE, example_content, write_dataset

from .editions import first_edition, second_edition
from .program import assert_one_line, personal_viz


@pytest.fixture
def schematic(tmp_path: Path) -> Path:
    """A table seen from a lattice of places, and one episode that asks for it."""
    return first_edition(tmp_path / "data")


def report(dataset: Path, capsys: pytest.CaptureFixture[str], **options) -> dict:
    assert Homes(dataset=dataset, json=True, **options).run() == 0
    return json.loads(capsys.readouterr().out)


def test_the_json_has_each_scene_and_the_total(schematic: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = report(schematic, capsys)
    assert list(found) == ["total", "scenes"]
    assert list(found["scenes"]) == [SCENE]
    assert (found["total"]["episodes"], found["total"]["playable"]) == (1, 1.0)
    # from (2, 3) to the first view point (1, 0): 3.162 m, recorded as 3.25 m
    assert found["total"]["ratio_median"] == pytest.approx(3.162 / 3.25, abs=0.02)
    assert (found["total"]["heldout_n"], found["total"]["heldout_split_within_10"]) == (0, None)
    assert found["scenes"][SCENE]["triangles"] > 50
    assert found["scenes"][SCENE]["build_s"] > 0


def test_build_times_are_those_of_a_first_visit(
    schematic: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import personal_viz.cli.homes as module

    used = []
    built = module.build_home

    def build_home(dataset: PersonalDataset, name: str, *, scenes_dir: Path | None):
        folder = Path(os.environ[VARIABLE])
        used.append((folder, list(folder.iterdir())))
        return built(dataset, name, scenes_dir=scenes_dir)

    before = os.environ[VARIABLE]
    monkeypatch.setattr(module, "build_home", build_home)
    report(schematic, capsys, folds=False)
    ((folder, content),) = used
    assert content == []
    assert not folder.exists()
    assert os.environ[VARIABLE] == before


def test_plans_are_written_where_they_can_be_corrected_and_put_back(
    schematic: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Homes(dataset=schematic, out=tmp_path / "plans", scene=(SCENE,), folds=False).run() == 0
    out = capsys.readouterr().out
    assert f"{schematic}/scenes/<scene>.plan.json" in out
    path = tmp_path / "plans" / f"{SCENE}.plan.json"
    plan = load_plan(path)
    assert plan == recover_plan(PersonalDataset(schematic), SCENE)
    recovered = open_scene(PersonalDataset(schematic), SCENE)
    lower = plan.furniture[0].model_copy(update={"size": (0.5, 0.3, 0.5)})
    save_plan(plan.model_copy(update={"furniture": (lower, *plan.furniture[1:])}), schematic / "scenes" / path.name)
    corrected = open_scene(PersonalDataset(schematic), SCENE)
    assert corrected.objects[0].size == pytest.approx((0.5, 0.3, 0.5))
    assert corrected.digest != recovered.digest
    assert corrected.label == f"{SCENE} (schematic, not HM3D)"
    again = report(schematic, capsys)
    assert again["total"]["heldout_n"] is None  # a given plan is not recovered from anything
    assert again["total"]["playable"] == 1.0


def test_the_table_names_every_scene_and_how_many_were_held_out(
    schematic: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Homes(dataset=schematic).run()
    out = capsys.readouterr().out
    assert SCENE in out
    assert "of n" in out
    assert "100.0%" in out


@pytest.fixture
def more(tmp_path: Path) -> Path:
    """Another edition: the same table, and a lamp that is seen and asked for farther to the right."""
    return second_edition(tmp_path / "more")


def test_evidence_makes_homes_and_the_edition_of_test_on_does_not(
    schematic: Path, more: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = report(schematic, capsys, folds=False)
    asked = report(schematic, capsys, folds=False, test_on=more)["scenes"][SCENE]
    helped = report(schematic, capsys, folds=False, evidence=(more,))["scenes"][SCENE]
    other = asked.pop("other")
    assert (other["episodes"], other["starts_on_floor"]) == (1, 0.0)
    before = alone["scenes"][SCENE]
    assert before.pop("other") is None
    assert {**asked, "build_s": 0} == {**before, "build_s": 0}  # the test edition gave nothing
    assert helped["area_m2"] > before["area_m2"] + 3
    assert helped["episodes"] == 1
    assert [source["folder"] for source in helped["sources"]] == [str(schematic), str(more)]
    own, added = ({key: source[key] for key in ("starts", "view_points", "objects")} for source in helped["sources"])
    assert own == {"starts": 1, "view_points": 117, "objects": 1}
    assert added == {"starts": 1, "view_points": 104, "objects": 1}  # 13 of its places are the first edition's too


def test_the_tables_say_what_came_from_where_and_how_another_edition_is_served(
    schematic: Path, more: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Homes(dataset=more, evidence=(schematic,), folds=False).run()
    assert f"From {schematic}: 1 start, 103 view points, 0 objects." in capsys.readouterr().out
    Homes(dataset=schematic, test_on=more, folds=False).run()
    out = capsys.readouterr().out
    assert f"These homes are made without {more}" in out
    assert "starts on floor" in out


def test_an_edition_that_makes_the_homes_or_has_other_homes_is_no_test(
    schematic: Path, more: Path, tmp_path: Path
) -> None:
    for evidence in ((), (more,)):
        with pytest.raises(DatasetError, match=r"--test-on .*: is an edition that the homes are made from; expected"):
            Homes(dataset=schematic, evidence=evidence, test_on=(schematic, *evidence)[-1]).run()
    elsewhere = write_dataset(tmp_path / "elsewhere", {("easy", "Other"): example_content(scene="Other")})
    with pytest.raises(DatasetError, match=r"--test-on .*elsewhere: holds none of the scenes; expected"):
        Homes(dataset=schematic, test_on=elsewhere).run()
    done = personal_viz("homes", "--dataset", str(schematic), "--evidence", str(schematic))
    assert_one_line(done, "is the dataset itself; expected another edition")


@pytest.mark.slow
def test_jobs_change_nothing_but_times(small_root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = (report(small_root, capsys, jobs=jobs, folds=False) for jobs in (1, 2))
    for found in (one, two):
        for figures in found["scenes"].values():
            figures.pop("build_s")
    assert one == two
    assert list(one["scenes"]) == ["HomeOne", "HomeTwo"]
    assert one["total"]["episodes"] == 11


@pytest.mark.slow
def test_an_invented_home_is_playable_and_nothing_of_it_is_guessed(
    small_home_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    total = report(small_home_root, capsys, folds=False)["total"]
    assert (total["playable"], total["guessed_area"], total["episodes"]) == (1.0, 0.0, 24)


def test_mistakes_are_one_line(schematic: Path, tmp_path: Path) -> None:
    done = personal_viz("homes", "--dataset", str(schematic), "--scene", "Nowhere")
    assert_one_line(done, "found no scene 'Nowhere'; expected one of:")
    assert_one_line(personal_viz("homes", "--dataset", str(tmp_path / "none")), "found no episode file")
    (tmp_path / "file").touch()
    done = personal_viz("homes", "--dataset", str(schematic), "--no-folds", "--out", str(tmp_path / "file" / "plans"))
    assert_one_line(done, "cannot be written")
    with pytest.raises(PersonalVizError, match="--jobs is 0; expected a whole number from 1"):
        Homes(dataset=schematic, json=True, jobs=0).run()
    with pytest.raises(DatasetError):
        Homes(dataset=schematic, scene=("Nowhere",), json=True).run()


def test_the_verbs_parse() -> None:
    verb = parse(["homes", "--dataset", "d", "--scene", "a", "b", "--no-folds", "--jobs", "2"])
    assert verb == Homes(Path("d"), scene=("a", "b"), folds=False, jobs=2)
    verb = parse(["contact-sheet", "A", "--out", "a.png", "--dataset", "d", "--clutter", "2"])
    assert verb == ContactSheet("A", out=Path("a.png"), dataset=Path("d"), clutter=2)


def made_run(dataset: Path, out: Path, *, scene: str, run_id: str) -> Path:
    """A run of the shortest-path agent on one episode of one scene."""
    Run(dataset=dataset, agent="shortest-path", out=out, scene=(scene,), run_id=run_id, split=("easy",), limit=1).run()
    return out / run_id


@pytest.fixture
def mixed(schematic: Path) -> Path:
    """One dataset with a schematic and an invented home."""
    write_files(schematic, dataset_files("Demo", seed=3, episodes_per_split=1))
    return schematic


@pytest.mark.slow
def test_runs_on_different_kinds_of_homes_share_no_run_table_or_recording(mixed: Path, tmp_path: Path) -> None:
    with pytest.raises(
        SceneError, match=r"found scene kinds invented \(Demo\), schematic \(.*expected one kind per run"
    ):
        Run(agent="random", dataset=mixed, out=tmp_path / "runs", scene=("Demo", SCENE)).run()
    runs = tuple(
        made_run(mixed, tmp_path / "runs", scene=scene, run_id=name)
        for scene, name in (("Demo", "on-invented"), (SCENE, "on-schematic"))
    )
    with pytest.raises(RunFileError, match=r"found scene kinds invented \(on-invented\), schematic \(on-schematic\)"):
        Metrics(runs=runs, json=True).run()
    # a home that was corrected into another kind: the earlier run cannot be replayed in it
    info = (runs[1] / "run.json").read_text()
    (runs[1] / "run.json").write_text(info.replace('"scene_kind": "schematic"', '"scene_kind": "scan"'))
    key = str(next(PersonalDataset(mixed).episodes(scenes=(SCENE,))).key)
    with pytest.raises(RecordingError, match=r"was made on a home of kind 'scan'.*opened as 'schematic'"):
        Replay(runs=runs[1:], out=tmp_path / "a.rrd", dataset=mixed, episode=key).run()
    with pytest.raises(RunFileError, match=r"found scene kinds invented .* scan"):
        Metrics(runs=runs).run()


def test_a_scan_is_measured_like_every_home_and_has_no_plan_to_write(
    small_home_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenes = small_home_root / "scenes"
    found = report(small_home_root, capsys, scenes_dir=scenes)["scenes"]["Small"]
    assert (found["scene_kind"], found["playable"], found["viewpoints_ok"]) == ("invented", 1.0, 1.0)
    assert (found["heldout_n"], found["findable"], found["not_findable"]) == (None, None, [])
    assert found["storeys"] == 1
    with pytest.raises(PersonalVizError, match=r"^--out: .*scans have no plan"):
        Homes(dataset=small_home_root, scenes_dir=scenes, out=tmp_path).run()

"""`--evidence` on its way from the command line into homes, runs and studies; homes with other evidence never mix."""

from pathlib import Path

import pytest

from grounding.agents.exploration_jobs import ExploreJob, run_job
from grounding.evaluation.evaluate import select_jobs
from grounding.evaluation.settings import GroundSettings
from personal_viz.bots.homes import BotHomes
from personal_viz.bots.site import Site, make_pilot
from personal_viz.cli.contact_sheet import ContactSheet
from personal_viz.cli.options import dataset_options
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.replay import Replay
from personal_viz.cli.runs.run import Run
from personal_viz.cli.study.serve import StudyServe
from personal_viz.cli.verbs import parse
from personal_viz.compare.app import write_comparison
from personal_viz.study_app.operator.served import serve_command
from personal_viz.study_app.server import open_study
from personal_viz.study_app.study_files import plan_study
from personal_viz.study_app.worker_door import WorkerTask
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, PersonalVizError, RunFileError, SceneError, StudyError
from sim.homes.open_home import open_scene
from sim.tasks.run_files import read_run
from sim.types import Camera
from tests.sim.synthetic import SCENE

from .editions import first_edition, second_edition


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return first_edition(tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="module")
def more(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return second_edition(tmp_path_factory.mktemp("more"))


@pytest.fixture(scope="module")
def both(own: Path, more: Path) -> str:
    """Digest of the home that both editions make."""
    return open_scene(PersonalDataset(own, evidence=[more]), SCENE).digest


@pytest.fixture(scope="module")
def runs(own: Path, more: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Run folders of one episode, without evidence and with it."""
    out = tmp_path_factory.mktemp("runs")
    for evidence in ((), (more,)):
        assert Run(own, "shortest-path", out=out, evidence=evidence).run() == 0
    return [out / "shortest-path-schematic-seed0", out / "shortest-path-schematic-evidence-seed0"]


def test_a_run_names_its_evidence_and_is_made_in_the_home_of_all_editions(
    own: Path, more: Path, both: str, runs: list[Path]
) -> None:
    plain, helped = (read_run(folder) for folder in runs)
    assert "evidence" not in plain.info.config
    assert helped.info.config["evidence"] == PersonalDataset(more).digest()[:12]
    assert plain.info.dataset_digest == PersonalDataset(own).digest()
    assert helped.info.dataset_digest == PersonalDataset(own, evidence=[more]).digest()
    (measures,) = (episode.end.measures for episode in helped.episodes)
    assert measures is not None
    assert measures.scene_digest == both


def test_homes_with_other_evidence_share_no_run_table_page_or_recording(
    own: Path, more: Path, runs: list[Path], tmp_path: Path
) -> None:
    with pytest.raises(RunFileError, match=r"dataset_digest is .*, this run has .*; expected the same to resume"):
        Run(own, "shortest-path", out=runs[0].parent, run_id=runs[0].name, evidence=(more,)).run()
    with pytest.raises(RunFileError, match="expected runs on the same episode files, with the same evidence"):
        Metrics(runs=tuple(runs)).run()
    with pytest.raises(DatasetError, match=r"expected .*, the runs'\. Give the --dataset that was used then, with the"):
        Replay(runs=(runs[1],), out=tmp_path / "a.rrd", dataset=own).run()
    assert Replay(runs=(runs[1],), out=tmp_path / "b.rrd", dataset=own, evidence=(more,)).run() == 0
    with pytest.raises(RunFileError, match="expected runs on the same episode files"):
        write_comparison([runs[1]], dataset=own, out=tmp_path / "page", picture_width=0)


@pytest.mark.slow
def test_a_page_of_runs_is_made_in_the_home_of_all_editions(
    own: Path, more: Path, runs: list[Path], tmp_path: Path
) -> None:
    made = write_comparison([runs[1]], dataset=own, evidence=(more,), out=tmp_path / "page", picture_width=0)
    assert made.num_made == 1


def test_explorers_grounders_servers_and_bots_open_the_home_of_all_editions(
    own: Path, more: Path, both: str, tmp_path: Path
) -> None:
    job = ExploreJob(SCENE, 0, 2, Camera(32, 24), "start", tmp_path, dataset_root=own, evidence=(more,))
    assert [found.scene_digest for found in run_job(job)] == [both]
    (grounds,) = select_jobs(PersonalDataset(own, evidence=[more]), GroundSettings("random"))
    assert (grounds.dataset_root, grounds.evidence) == (own, (more,))
    study = tmp_path / "study"
    config = make_pilot(study, own, participants=1, evidence=(more,), splits={"easy": "all"})
    assert config.dataset.sha256 == PersonalDataset(own, evidence=[more]).digest()
    served = open_study(WorkerTask(study=str(study), dataset=str(own), evidence=(str(more),)))
    with served.homes.use(SCENE) as home:
        assert home.scene.digest == both
    assert BotHomes(Site(study, own, None, (), None, (more,))).home(SCENE).scene_digest == both
    assert serve_command(study, own, evidence=(more,))[-2:] == ["--evidence", str(more)]
    with pytest.raises(StudyError, match="Give the dataset that the study is about with its evidence"):
        plan_study(study, own, None, pilot=True)
    with pytest.raises(DatasetError, match="Give the --dataset that was used then, with the same --evidence"):
        StudyServe(own, study).run()


def test_scans_and_homes_without_a_dataset_take_no_evidence(own: Path, more: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=f"found evidence {more} for the scan of '{SCENE}'; expected none"):
        Run(own, "random", out=tmp_path, evidence=(more,), scenes_dir=tmp_path).run()
    with pytest.raises(PersonalVizError, match=r"--evidence .*: found no --dataset; expected both"):
        ContactSheet(invent=1, evidence=(more,), out=tmp_path / "a.png").run()


@pytest.mark.parametrize(
    "verb",
    [
        ["run", "--agent", "random"],
        ["replay", "--runs", "r", "--out", "a.rrd"],
        ["compare", "r", "--out", "o"],
        ["browse"],
        ["homes"],
        ["contact-sheet", "A"],
        ["explore"],
        ["ground", "--method", "random"],
        ["show-exploration", "a.json", "--out", "a.rrd"],
        ["show-map", "a.npz", "--out", "a.rrd"],
        ["pog-report", "r", "--out", "o"],
        ["study", "init", "s"],
        ["study", "plan", "s"],
        ["study", "serve", "s"],
        ["study", "verify", "s"],
        ["study", "import-check", "e"],
        ["study", "report", "r"],
        ["study", "bots", "s"],
    ],
    ids=lambda verb: " ".join(verb[:2] if verb[0] == "study" else verb[:1]),
)
def test_every_verb_that_opens_homes_takes_evidence(verb: list[str]) -> None:
    found = parse([*verb, "--dataset", "d", "--evidence", "e", "f"])
    assert getattr(found, "evidence", None) == (Path("e"), Path("f"))


def test_the_next_verb_is_printed_with_the_evidence() -> None:
    assert dataset_options(Path("d"), ()) == "--dataset d"
    assert dataset_options(Path("d"), (Path("e"), Path("f"))) == "--dataset d --evidence e f"

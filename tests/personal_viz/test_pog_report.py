"""`personal-viz pog-report` on runs over a small data set: files, their words, the same bytes, refusals."""

import gzip
import html
import json
import re
import shutil
from pathlib import Path

import pytest

from grounding.evaluation.evaluate import evaluate, select_jobs
from grounding.evaluation.settings import GroundSettings
from grounding.methods.by_name import GrounderName
from personal_viz.cli.grounding.pog_report import PogReport
from personal_viz.cli.verbs import parse
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, PersonalVizError
from sim.tasks.provenance import make_run_info
from sim.tasks.run_writer import RunWriter


@pytest.fixture(scope="module")
def made(small_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A data set, and a folder of runs of four methods on it."""
    runs = tmp_path_factory.mktemp("runs")
    dataset = PersonalDataset(small_root)
    methods: tuple[GrounderName, ...] = ("center", "qs", "rpg", "joint")
    for method in methods:
        work = select_jobs(dataset, settings := GroundSettings(method))
        info = make_run_info(
            f"run-{method}",
            who=method,
            who_kind="agent",
            scene_kind="oracle-map",
            dataset_digest=dataset.digest(),
            seed=0,
            config={**settings.config, "phrases": "dataset" if method in ("rpg", "joint") else "none"},
        )
        evaluate(work, RunWriter(runs / f"run-{method}", info), processes=1)
    return small_root, runs


@pytest.fixture(scope="module")
def written(made: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report")
    assert PogReport(runs=[made[1]], out=out, dataset=[made[0]]).run() == 0
    return out


@pytest.mark.slow
def test_every_file_is_written(written: Path) -> None:
    names = {path.name for path in written.iterdir()}
    assert {"index.md", "index.html", "report.json", "table.tex", "table.csv", "differences.csv"} <= names
    assert {"distance.csv", "options.csv", "failures.csv", "distance-1.svg", "distance-1.png"} <= names
    failures = {name for name in names if name.startswith("failure-")}
    assert any(name.startswith("failure-run-qs-hard-HomeTwo-1") for name in failures)


@pytest.mark.parametrize(
    "name", ["index.md", "index.html", "report.json", "table.tex", "table.csv", "methods-1.svg", "distance-1.svg"]
)
def test_every_form_of_the_table_says_what_its_figures_rest_on(written: Path, name: str) -> None:
    text = " ".join((written / name).read_text().split())
    if name.endswith(".svg"):
        text = " ".join(re.sub("<[^>]*>", " ", text).split())
    for words in (
        "captions of the same episode files (circular)",
        "Target's storey: given.",
        "(ground truth)",
        "No row with phrases read by rules for joint, rpg",
        "rpg 25.3 / 23.6 / 15.2 / 16.8",
        "Not comparable with the paper",
    ):
        assert words in html.unescape(text), words


def test_the_curve_of_three_is_drawn_and_runs_that_lack_it_are_named(
    made: tuple[Path, Path], written: Path, tmp_path: Path
) -> None:
    assert "best of the first three" in (written / "distance-1.svg").read_text()
    page = (written / "index.md").read_text()
    assert "No curve of three" not in page
    header, *lines = (written / "distance.csv").read_text().splitlines()
    assert (
        header
        == "table,edition,scene_kind,scene_label,method,metres,sr,home_low,home_high,top3,top3_home_low,top3_home_high"
    )
    assert len(lines) == 4 * 41
    older = tmp_path / "runs"
    shutil.copytree(made[1], older)
    answers = older / "run-qs" / "answers.jsonl"
    old = [json.loads(line) for line in answers.read_text().splitlines()]
    for line in old:
        del line["measures"]["planar_distances"]
    answers.write_text("".join(json.dumps(line) + "\n" for line in old))
    PogReport(runs=[older], out=tmp_path / "out").run()
    assert "No curve of three: the run files of qs hold" in (tmp_path / "out" / "index.md").read_text()


def test_the_page_needs_no_other_file_and_names_commit_methods_and_the_papers_column(written: Path) -> None:
    page = (written / "index.html").read_text()
    assert page.count("<svg") == len(list(written.glob("*.svg")))
    assert "<img" not in page
    assert "src=" not in page
    assert "<th>paper's HM3D maps</th>" in page
    assert "15.4 / 12.7 / 8.6 / 11.9" in page
    assert "beats" not in page
    info = json.loads((written / "report.json").read_text())
    assert [row["name"] for row in info["tables"][0]["rows"]] == [
        "center",
        "qs",
        "rpg (phrases dataset)",
        "joint (phrases dataset)",
    ]
    assert info["tables"][0]["rows"][0]["commits"][0][:12] in page


def test_failures_say_what_they_are_and_why(written: Path) -> None:
    info = json.loads((written / "report.json").read_text())
    found = {(item["run"], item["split"], item["scene"], item["episode_id"]): item for item in info["failures"]}
    # both chairs are "chair" once; the shorter caption is the closer one, and it is Carl's, not Dee's
    chair = found["run-qs", "hard", "HomeTwo", "1"]
    assert (chair["kind"], chair["object"], chair["distance"]) == ("another instance", "chair_1", 5.0)
    assert chair["why"].startswith("The right place is 2. of 3")
    text = (written / "index.md").read_text()
    assert "Find Dee's chair" in text
    picture = (written / chair["picture"]).read_text()
    assert picture.count('font-weight="bold"') == 3, "three candidates"
    counts = [item for item in info["failure_counts"] if item["method"] == "qs"]
    assert sum(item["n"] for item in counts) == counts[0]["of"]


def test_failures_on_two_editions_are_counted_and_drawn_apart(made: tuple[Path, Path], tmp_path: Path) -> None:
    other, runs = tmp_path / "other", tmp_path / "runs"
    shutil.copytree(made[0], other)
    changed = next(other.glob("*/content/*.json.gz"))
    changed.write_bytes(gzip.compress(gzip.decompress(changed.read_bytes()) + b"\n"))
    shutil.copytree(made[1] / "run-qs", runs / "run-short")
    info = json.loads((runs / "run-short" / "run.json").read_text())
    info |= {"run_id": "run-short", "dataset_digest": PersonalDataset(other).digest()}
    (runs / "run-short" / "run.json").write_text(json.dumps(info))
    answers = runs / "run-short" / "answers.jsonl"
    lines = answers.read_text().splitlines(keepends=True)
    answers.write_text(next(line for line in lines if not json.loads(line)["measures"]["success"]))
    PogReport(runs=[made[1] / "run-qs", runs], dataset=[made[0], other], out=tmp_path / "out").run()
    text = (tmp_path / "out" / "index.md").read_text()
    sections = text.split("## Table ")[1:]
    named = [{name for name in ("run-qs", "run-short") if f"failure-{name}" in section} for section in sections]
    assert sorted(map(sorted, named)) == [["run-qs"], ["run-short"]]


def test_latex_has_the_papers_columns(written: Path) -> None:
    lines = (written / "table.tex").read_text().splitlines()
    assert "Method & Easy & Hard & Total & Top-3 & paper's HM3D maps" in lines[3]
    assert any(line.startswith("rpg (phrases dataset) & $") for line in lines)


def test_the_same_runs_give_the_same_bytes(made: tuple[Path, Path], written: Path, tmp_path: Path) -> None:
    PogReport(runs=[made[1]], out=tmp_path, dataset=[made[0]]).run()
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in (written, tmp_path))
    assert first == second


def test_without_a_dataset_there_are_no_failures_and_old_ones_go(
    made: tuple[Path, Path], written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    shutil.copytree(written, out)
    PogReport(runs=[made[1] / "run-qs"], out=out).run()
    assert not list(out.glob("failure-*"))
    assert "--dataset DIR shows those" in capsys.readouterr().out


def test_json_is_one_document(made: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    PogReport(runs=[made[1]], out=tmp_path, json=True).run()
    assert json.loads(capsys.readouterr().out)["tables"][0]["scene_kind"] == "oracle-map"


def test_another_dataset_and_bad_options_are_refused(made: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(made[0] / "hard", other / "hard")
    with pytest.raises(DatasetError, match=r"expected [0-9a-f]{12}, the runs'"):
        PogReport(runs=[made[1]], out=tmp_path / "out", dataset=[other]).run()
    with pytest.raises(PersonalVizError, match="--failures is -1"):
        PogReport(runs=[made[1]], out=tmp_path / "out", failures=-1).run()
    (tmp_path / "file").write_text("")
    with pytest.raises(PersonalVizError, match="cannot be written"):
        PogReport(runs=[made[1]], out=tmp_path / "file").run()


def test_the_verb_takes_runs_and_datasets() -> None:
    verb = parse(["pog-report", "a", "b", "--out", "c", "--dataset", "d", "e", "--failures", "2"])
    assert (verb.runs, verb.dataset, verb.failures) == ((Path("a"), Path("b")), (Path("d"), Path("e")), 2)


def test_the_report_says_where_the_constants_of_joint_were_frozen(
    made: tuple[Path, Path], written: Path, tmp_path: Path
) -> None:
    assert "frozen on 24 invented homes" in (written / "index.md").read_text()
    assert PogReport(runs=[made[1] / "run-qs"], out=tmp_path / "other", dataset=[made[0]]).run() == 0
    assert "frozen" not in (tmp_path / "other" / "index.md").read_text()

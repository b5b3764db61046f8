"""Every file that a verb writes about homes that are no scans says so, and no file about scans does."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image
from rerun.chunk import RrdReader

from human_study.export.study_export import export_study
from personal_viz.cli.contact_sheet import ContactSheet
from personal_viz.cli.grounding.pog_report import PogReport
from personal_viz.cli.homes import Homes
from personal_viz.cli.runs.compare import Compare
from personal_viz.cli.runs.export import Export
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.replay import Replay
from personal_viz.cli.study.report import StudyReportVerb
from personal_viz.cli.verbs import parse
from sim.exchange.export_runs import ExportFormat
from sim.homes.kind import scene_label

from ..human_study.finished import study_with_trials
from .compared_runs import Compared

INVENTED = "Invented homes, made from a seed: no human baseline for PersONAL"
BASELINE = "no human baseline for PersONAL"
NO_TABLE = {"thumb.jpg", "made.json", "steps.jsonl", "answers.jsonl", "namespace_metadata.json"}
"""Written beside a file with the label: a small picture, digests, and a run's steps, whose run.json says the kind."""
OF_PEOPLE = {"data_dictionary.md", "study.yaml", "participants", "exclusions", "events", "verifications", "stages"}
"""Parts of a study's export that hold no result in a home."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """Runs of people, agents and grounders in an invented home."""
    found = Compared(tmp_path_factory.mktemp("invented"))
    found.write_runs()
    return found


@pytest.fixture(scope="module")
def scans(made: Compared, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same runs, called runs on scans."""
    runs = tmp_path_factory.mktemp("scan") / "runs"
    shutil.copytree(made.runs, runs)
    for path in runs.glob("*/run.json"):
        path.write_text(path.read_text().replace('"scene_kind":"invented"', '"scene_kind":"scan"'))
    return runs


def home_runs(runs: Path) -> tuple[Path, ...]:
    return tuple(runs / name for name in ("study", "idle", "evil"))


def said_in(path: Path) -> str:
    """Words that a reader finds in the file: text, a picture's description, a recording's document, a table's cells."""
    if path.suffix in (".png", ".jpg"):
        with Image.open(path) as picture:
            return str(picture.info.get("Description", ""))
    if path.suffix == ".rrd":
        return " ".join(str(chunk.to_record_batch().to_pydict()) for chunk in RrdReader(str(path)).stream()
                        if chunk.entity_path == "/task")  # fmt: skip
    if path.suffix == ".parquet" or path.suffix == ".arrow":
        import pyarrow.ipc
        import pyarrow.parquet

        if path.suffix == ".parquet":
            return str(pyarrow.parquet.read_table(path).to_pydict())
        with pyarrow.OSFile(str(path)) as file:
            return str(pyarrow.ipc.open_file(file).read_all().to_pydict())
    return path.read_text(encoding="utf-8", errors="replace")


def silent_files(folder: Path, *, besides: set[str] = NO_TABLE) -> list[str]:
    """Files without the label."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    assert files
    return [
        str(path.relative_to(folder))
        for path in files
        if path.name not in besides and path.stem not in besides and INVENTED not in said_in(path)
    ]


def test_each_kind_has_one_label_and_scans_have_none() -> None:
    assert scene_label("invented") == INVENTED
    assert scene_label("schematic") == "Schematic homes, recovered from the episode files: " + BASELINE
    assert [scene_label(kind) for kind in ("scan", "oracle-map")] == ["", ""]


@pytest.mark.slow
def test_metrics_have_the_label_below_the_table_and_in_every_row(
    made: Compared, scans: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Metrics(runs=home_runs(made.runs)).run()
    printed = capsys.readouterr().out
    assert f"{INVENTED}." in printed
    assert "Rule paper = our reading of the PersONAL paper" in printed
    assert "evil" not in printed
    Metrics(runs=home_runs(made.runs), rule="habitat", json=True).run()
    rows = json.loads(capsys.readouterr().out)
    assert {row["scene_label"] for row in rows} == {INVENTED}
    assert {row["paper_strict"]["undefined"] for row in rows if row["task"] == "pan"} == {0}
    Metrics(runs=home_runs(scans)).run()
    assert BASELINE not in capsys.readouterr().out


@pytest.mark.slow
def test_every_file_of_a_study_report_has_the_label(made: Compared, scans: Path, tmp_path: Path) -> None:
    assert StudyReportVerb(runs=home_runs(made.runs), out=tmp_path / "invented", dataset=made.data).run() == 0
    names = {path.name for path in (tmp_path / "invented").iterdir()}
    assert {"report.tex", "report.csv", "report.json", "pan-trials.csv", "pan-glmm.R", "pan-people.svg"} <= names
    assert any(name.startswith("overlay-") for name in names)
    assert silent_files(tmp_path / "invented") == []
    assert ",shortest path," in (tmp_path / "invented" / "pan-ways.csv").read_text()
    assert "nDTW with the shortest path" in (tmp_path / "invented" / "report.md").read_text()
    latex = (tmp_path / "invented" / "report.tex").read_text()
    assert "scenes: invented, rule paper" in latex
    assert all("%" not in line or r"\%" in line for line in latex.splitlines())  # no comment carries it
    assert StudyReportVerb(runs=home_runs(scans), out=tmp_path / "scan").run() == 0
    assert [path.name for path in (tmp_path / "scan").iterdir() if BASELINE in said_in(path)] == []


@pytest.mark.slow
def test_every_file_of_a_pog_report_has_the_label(made: Compared, scans: Path, tmp_path: Path) -> None:
    runs = [made.runs / "study", made.runs / "grounder"]
    assert PogReport(runs=runs, out=tmp_path / "invented").run() == 0
    empty = {"differences.csv", "options.csv"}  # header rows only
    assert silent_files(tmp_path / "invented", besides=NO_TABLE | empty) == []
    assert {"methods-1.png", "distance-1.svg", "table.tex"} <= {path.name for path in (tmp_path / "invented").iterdir()}
    assert PogReport(runs=[scans / "study", scans / "grounder"], out=tmp_path / "scan").run() == 0
    assert [path.name for path in (tmp_path / "scan").iterdir() if BASELINE in said_in(path)] == []


@pytest.mark.parametrize("format", ["jsonl", "tum", "minari"])
def test_every_export_of_runs_has_the_label_and_of_reconstructed_homes_the_terms_that_may_apply(
    made: Compared, scans: Path, tmp_path: Path, format: ExportFormat
) -> None:
    info = json.loads((made.runs / "idle" / "run.json").read_text())
    shutil.copytree(made.runs / "idle", tmp_path / "idle")
    (tmp_path / "idle" / "run.json").write_text(json.dumps(info | {"scene_kind": "schematic"}))
    said = {}
    for kind, run in (("invented", made.runs / "idle"), ("scan", scans / "idle"), ("schematic", tmp_path / "idle")):
        assert Export(runs=(run,), out=tmp_path / kind, format=format).run() == 0
        said[kind] = " ".join(said_in(path) for path in (tmp_path / kind).rglob("*") if path.is_file())
    assert silent_files(tmp_path / "invented") == []
    assert BASELINE not in said["scan"]
    terms = "HM3D's terms may apply to your use: https://matterport.com/"
    assert [terms in said[kind] for kind in ("schematic", "invented")] == [True, False]


def test_every_table_of_a_study_export_has_the_label(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")
    export_study(tmp_path / "study", tmp_path / "out")
    assert silent_files(tmp_path / "out", besides=NO_TABLE | OF_PEOPLE) == []


@pytest.mark.slow
def test_the_comparison_and_a_replay_have_the_label(made: Compared, tmp_path: Path) -> None:
    assert (
        Compare(
            runs=(made.runs / "idle", made.runs / "evil"), dataset=made.data, out=tmp_path / "c", picture_width=32
        ).run()
        == 0
    )
    assert silent_files(tmp_path / "c") == []
    page = (tmp_path / "c" / "index.html").read_text()
    assert "Rule paper = our reading of the PersONAL paper" in page
    assert "by paper-strict SR" in page
    out = tmp_path / "r" / "one.rrd"
    out.parent.mkdir()
    key = str(made.episodes[0].key)
    assert Replay(runs=(made.runs / "idle",), out=out, dataset=made.data, episode=key).run() == 0
    assert silent_files(out.parent) == []


@pytest.mark.slow
def test_homes_and_contact_sheets_have_the_label(
    made: Compared, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for as_json in (False, True):
        assert Homes(dataset=made.data, json=as_json, folds=False).run() == 0
        assert INVENTED in capsys.readouterr().out
    options = {"scene": "Demo", "dataset": made.data, "scenes_dir": None, "invent": None, "clutter": 0}
    assert ContactSheet(**options, out=tmp_path / "sheet.png", crops=tmp_path / "crops").run() == 0
    assert silent_files(tmp_path, besides={path.stem for path in (tmp_path / "crops").glob("*.png")}) == []


@pytest.mark.slow
def test_walks_explorations_and_their_recordings_have_the_label(
    made: Compared, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, small = ["--dataset", str(made.data)], ["--width", "48", "--height", "36", "--max-steps", "20"]
    key = str(made.episodes[0].key)
    walk = ["run", *data, "--agent", "random", "--episode", key]
    assert parse([*walk, "--out", str(tmp_path / "runs"), "--rerun", str(tmp_path / "live")]).run() == 0
    explored = ["explore", *data, *small, "--rerun", str(tmp_path / "seen"), "--out", str(tmp_path / "explored")]
    assert parse([*explored, "--json"]).run() == 0
    assert INVENTED in capsys.readouterr().out
    assert {path.suffix for path in tmp_path.rglob("*") if path.is_file()} >= {".rrd", ".png", ".json", ".jsonl"}
    silent = [Path(name) for name in silent_files(tmp_path)]
    assert {path.parent for path in silent} <= {Path("explored")}  # the walks themselves, beside explore.json
    assert all(path.name.startswith("Demo-") for path in silent)

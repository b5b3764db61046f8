"""Verb `reproduce`: from episodes and homes to the paper's tables, once on a scan and once on an invented home."""

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from personal_viz.cli.runs.merge import Merge
from personal_viz.cli.scans.reproduce import FIGURES, Reproduce
from personal_viz.reproduce.page import document_of, page_of, rows_of
from personal_viz.reproduce.paper import PAPER_PAN, paper_cells
from sim.episodes.dataset import PersonalDataset
from sim.tasks.metrics import MetricRow
from sim.tasks.run_folders import read_runs
from sim.tasks.shards import SHARDS

from ..grounding.short_walks import write_short_walks
from ..grounding.tiny_models import save_blip2
from .program import assert_one_line, personal_viz

pytestmark = pytest.mark.slow
NAME = "Small"
TWICE = ("--agent", "random-frontier", "random-frontier")
"""A name that stands twice is done once."""
FEW = ("--method", "random", "rpg", "--limit", "1", "--split", "easy")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, small_home_root: Path) -> Path:
    """An invented home as a lab's scan, reproduced in `out` from short walks; VLFM's reported figures in `vlfm`."""
    root = tmp_path_factory.mktemp("lab")
    shutil.copytree(small_home_root / "easy", root / "data" / "easy")
    folder = root / "hm3d" / "val" / f"00900-{NAME}"
    folder.mkdir(parents=True)
    for end in (".glb", ".semantic.glb", ".semantic.txt"):
        shutil.copy(small_home_root / "scenes" / f"{NAME}{end}", folder)
    (root / "vlfm.csv").write_text("scene_id,episode_id,success,spl\nSmall,0,1,0.5\n")
    told = ("--reported", "--split", "easy", "--numbered-by", "place")
    done = personal_viz(
        *("import", root / "vlfm.csv", "--dataset", root / "data", "--who", "VLFM", *told, "--out", root / "vlfm")
    )
    assert done.returncode == 0, done.stderr
    (root / "model").mkdir()
    save_blip2(root / "model")
    write_short_walks(PersonalDataset(root / "data"), root / "out", scenes_dir=root / "hm3d")
    done = personal_viz("reproduce", *places(root), *FEW)
    assert done.returncode == 0, done.stderr
    return root


def places(root: Path) -> tuple[object, ...]:
    encoder = ("--encoder", f"blip2-itc256:{root / 'model'}")
    return (*encoder, "--dataset", root / "data", "--scenes-dir", root / "hm3d", "--out", root / "out")


def lines_of(page: str) -> list[list[str]]:
    """The cells of each line of the page's tables, without the spaces that put digit below digit."""
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
    return [[cell.strip() for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL)] for row in rows]


def test_the_papers_figures_stand_below_ours_on_scans(lab: Path) -> None:
    page = (lab / "out" / "index.html").read_text()
    lines = {line[0]: line[2:] for line in lines_of(page)}
    assert lines["paper: Region-Gated (RPG)"][:1] == ["25.3"]
    assert lines["paper: Random (x,y)"][:1] == ["0.5"]
    assert lines["paper: Random"][:4] == ["0.0", "", "0.0", "6.02"]
    assert re.fullmatch(r"[01]/1", lines["random-frontier"][1])
    assert "phrases dataset" in page
    assert "phrases rules" in page
    assert "GPT-4.1" in page
    document = json.loads((lab / "out" / "reproduce.json").read_text())
    assert (document["scene_kinds"], document["scene_labels"], document["paper"]) == (["scan"], [], True)
    assert {row["who"] for row in document["rows"]} == {"random", "rpg", "random-frontier"}


def test_a_second_call_continues_and_takes_further_runs_into_its_tables(lab: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (lab / "out").glob("*/*")}
    done = personal_viz("reproduce", *places(lab), *FEW, "--runs", lab / "vlfm", "--json")
    assert done.returncode == 0, done.stderr
    assert {path: path.stat().st_mtime_ns for path in (lab / "out").glob("*/*")} == before
    assert {row["who"] for row in json.loads(done.stdout)["rows"]} == {"random", "rpg", "random-frontier", "VLFM"}
    lines = {line[0]: line[1:] for line in lines_of((lab / "out" / "index.html").read_text())}
    assert lines["VLFM"][:5] == ["reported, not recomputed", "100.0", "1/1", "50.0", "-"]
    assert lines["paper: VLFM"][1] == "12.5"


def test_no_line_of_the_papers_stands_below_maps_of_captions(lab: Path) -> None:
    runs = read_runs([lab / "out"])
    named = [run.info.condition.replace("blip2-itc256", "hashed+oracle-perception") for run in runs]
    told = [
        run.model_copy(update={"info": run.info.model_copy(update={"condition": condition})})
        for run, condition in zip(runs, named, strict=True)
    ]
    names = [line[0] for line in lines_of(page_of(told, rows_of(told)))]
    assert "paper: Random" in names
    assert "paper: Region-Gated (RPG)" not in names


def test_a_dry_run_measures_one_home_and_writes_nothing(lab: Path, small_root: Path, tmp_path: Path) -> None:
    told, out = ("--jobs", "4", "--dry-run", "--json"), tmp_path / "dry"
    done = personal_viz("reproduce", *places(lab)[:2], "--dataset", small_root, "--out", out, *FEW, *told, *TWICE)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["home"] in ("HomeOne", "HomeTwo")
    assert [step["step"] for step in found["steps"]] == ["Exploring", "POG, random", "POG, rpg", "PAN, random-frontier"]
    assert [step["processes"] for step in found["steps"]] == [1, 1, 1, 4]
    hours = [step["seconds"] * step["times"] / step["processes"] / 3600 for step in found["steps"]]
    assert found["hours"] == pytest.approx(sum(hours))
    assert min(found["gigabytes_on_disk"], found["gigabytes_of_memory_per_process"]) > 0
    assert not out.exists()


def test_a_dry_run_takes_as_many_episodes_of_its_home_as_the_whole_work_does(
    invented_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def no_steps(verb: Reproduce, out: Path, homes: Sequence[str], **how: Any) -> Iterator[Any]:
        asked.append({"homes": list(homes), **how})
        return iter(())

    monkeypatch.setattr(Reproduce, "_steps", no_steps)
    Reproduce(invented_root, tmp_path / "out", encoder="hashed", limit=4, split=("easy",), dry_run=True).run()
    whole, one_home = asked
    assert (len(whole["homes"]), whole["limit"]) == (2, 4)
    assert (len(one_home["homes"]), one_home["limit"]) == (1, 2)


def test_invented_homes_are_labelled_and_have_no_line_of_the_papers(lab: Path) -> None:
    runs = read_runs([lab / "out"])
    invented = [run.model_copy(update={"info": run.info.model_copy(update={"scene_kind": "invented"})}) for run in runs]
    rows = rows_of(invented)
    page = page_of(invented, rows)
    assert "Invented homes, made from a seed: no human baseline for PersONAL" in page
    assert not [line for line in lines_of(page) if line[0].startswith("paper: ")]
    assert document_of(invented, rows)["paper"] is False


def test_shards_of_one_folder_give_the_tables_of_the_whole(
    small_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def reproduce(out: Path, shard: str | None = None) -> None:
        few: dict[str, Any] = {"split": ("easy",), "method": ("rpg",), "agent": ("random",), "limit": 2}
        assert Reproduce(small_root, out, encoder="hashed", shard=shard, **few).run() == 0

    parts, whole = tmp_path / "parts", tmp_path / "whole"
    for out in (parts, whole):
        write_short_walks(PersonalDataset(small_root), out)
    for shard in ("1/2", "2/2"):
        reproduce(parts, shard)
        assert f"Shard {shard} is done" in capsys.readouterr().err
        assert not (parts / FIGURES).exists()
    assert Merge(parts, (parts / SHARDS,)).run() == 0
    for out in (parts, whole):
        reproduce(out)
    shown = [json.loads((out / FIGURES).read_text())["rows"] for out in (parts, whole)]
    assert {(row["who"], row["split"]): row["n"] for row in shown[0]} == {
        (who, split): 2 for who in ("rpg", "random") for split in ("easy", "total")
    }
    assert shown[0] == shown[1]


def test_unknown_encoders_and_scenes_are_refused_before_any_work(lab: Path, tmp_path: Path) -> None:
    base = ("reproduce", "--dataset", lab / "data", "--out", tmp_path / "out")
    assert_one_line(personal_viz(*base, "--scene", "Nowhere"), "found no scene 'Nowhere'")
    assert_one_line(personal_viz(*base, "--encoder", "no-such"), "no-such")
    assert_one_line(personal_viz(*base, "--encoder", "hashed", "--method", "guess"), "guess")
    assert_one_line(personal_viz(*base, "--encoder", "hashed", "--agent", "nobody"), "--agent is 'nobody'")
    assert_one_line(personal_viz(*base, "--scenes-dir", tmp_path), "Small")
    assert_one_line(personal_viz(*base, "--encoder", "hashed", "--device", "cuda"), "--device is 'cuda'")
    assert_one_line(personal_viz(*base, "--encoder", f"blip2-itc256:{tmp_path}"), str(tmp_path))
    assert not list(tmp_path.glob("out/*"))


def test_runs_that_cannot_stand_in_these_tables_are_refused_before_any_work(lab: Path, tmp_path: Path) -> None:
    base = ("reproduce", "--dataset", lab / "data", "--encoder", "hashed")  # without --scenes-dir: a schematic home
    again = personal_viz(*base, "--out", lab / "out")
    assert_one_line(again, "found scene kinds scan", "schematic (reproduce)")
    assert_one_line(personal_viz(*base, "--out", tmp_path / "out", "--runs", lab / "vlfm"), "found scene kinds scan")
    assert_one_line(personal_viz(*base, "--out", tmp_path / "out", "--runs", tmp_path / "none"), "none")
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize(
    ("who", "condition", "name", "cell"),
    [
        ("human", "none", "Human", ("63.5", "", "41.3", "1.48")),
        ("human", "memory_topdown", "Human w. env. memory", ("86.0", "", "52.2", "1.03")),
        ("OneMap", "free motion", "OneMap", ("28.9", "", "22.0", "3.82")),
    ],
)
def test_rows_find_the_papers_line_by_their_name(who: str, condition: str, name: str, cell: tuple[str, ...]) -> None:
    row = MetricRow(
        who=who,
        task="pan",
        condition=condition,
        scene_kind="scan",
        edition="2025-09",
        split="total",
        rule="paper",
        n=1,
        k=0,
        sr=0.0,
    )
    assert paper_cells(row, columns=("total",)) == (name, [cell])
    assert paper_cells(row.model_copy(update={"who": "mine"}), columns=("total",)) is None
    assert all(len(figures) == 4 for line in PAPER_PAN.values() for figures in line)

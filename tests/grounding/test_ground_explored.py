"""`ground --map explore` on small homes after a few steps: real encoders, worker processes, and progress notes."""

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from grounding.agents.progress_notes import read_notes, scene_note
from grounding.encoders import by_name as encoders
from grounding.encoders import clip
from grounding.encoders.protocol import ModelOptions
from grounding.maps.files import load_memory, read_map_header
from grounding.maps.oracle_map import oracle_home
from grounding.types import FeatureMap
from personal_viz.cli.grounding.ground import Ground
from personal_viz.progress import counted
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, PersonalVizError
from sim.render.raycast import Raycaster
from sim.tasks.run_files import read_run
from sim.types import Camera, Frame, GridSpec

from .short_walks import write_short_walks
from .tiny_models import save_clip


@pytest.fixture(scope="module")
def clip_name(tmp_path_factory: pytest.TempPathFactory) -> str:
    return f"clip:{save_clip(tmp_path_factory.mktemp('models') / 'tiny')}"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, small_root: Path) -> Path:
    """A folder of runs with short walks of both homes."""
    out = tmp_path_factory.mktemp("runs")
    write_short_walks(PersonalDataset(small_root), out)
    return out


def maps_of(runs: Path, run_id: str) -> Path:
    return runs / str(read_run(runs / run_id).info.config["maps"])


@pytest.mark.slow
def test_a_real_encoder_is_loaded_once_for_all_homes_with_the_given_options(
    small_root: Path, runs: Path, clip_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = []

    def counted(self: clip.Clip, source: str, *, options: ModelOptions) -> None:
        loaded.append((options.device, options.autocast, options.batch_size))
        load(self, source, options=options)

    load = clip.Clip.__init__
    monkeypatch.setattr(clip.Clip, "__init__", counted)
    encoders._model.cache_clear()
    options = {"autocast": "bfloat16", "batch": 3, "run_id": "real", "json": True}
    assert Ground(small_root, "qs", map="explore", encoder=clip_name, out=runs, **options).run() == 0
    assert loaded == [("cpu", "bfloat16", 3)]
    run = read_run(runs / "real")
    assert (len(run.answers), run.info.config["autocast"]) == (11, "bfloat16")
    assert run.info.condition.startswith(f"explore map, {clip_name} encoder, autocast bfloat16, ")
    for scene in ("HomeOne", "HomeTwo"):
        header = read_map_header(maps_of(runs, "real") / f"{scene}.npz")
        assert header.encoder.startswith("clip-")
        assert header.dim == 24
        assert "oracle" not in header.source.builder


def test_the_device_reaches_the_model(
    small_root: Path, runs: Path, clip_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)  # so that a machine with a GPU refuses too
    with pytest.raises(AgentError, match=r"device 'cuda': torch sees no such device"):
        Ground(small_root, "qs", map="explore", encoder=clip_name, out=runs, device="cuda", run_id="gpu").run()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": "cuda"}, r"--device is 'cuda' with --encoder hashed, which runs no model of ours; expected one of"),
        ({"batch": 4}, r"--batch is 4 with --encoder hashed, which runs no model of ours"),
        ({"batch": 0}, r"--batch is 0; expected a whole number from 1"),
        ({"autocast": "float16"}, r"--autocast is 'float16' with --encoder hashed"),
    ],
)
def test_options_for_models_are_refused_without_a_model(
    options: dict, message: str, small_root: Path, tmp_path: Path
) -> None:
    with pytest.raises(PersonalVizError, match=message):
        Ground(small_root, "qs", map="explore", out=tmp_path / "runs", **options).run()
    assert not (tmp_path / "runs").exists()


def test_the_centre_of_an_explored_home_is_the_middle_of_the_seen_area(small_root: Path, runs: Path) -> None:
    scene = {"scene": ("HomeTwo",), "out": runs, "json": True, "map": "explore"}
    assert Ground(small_root, "center", **scene, run_id="centre").run() == 0
    memory = load_memory(maps_of(runs, "centre") / "HomeTwo.npz").storeys[0].memory
    assert isinstance(memory, FeatureMap)
    x, z = memory.centre_xz
    answers = {answer.candidates for answer in read_run(runs / "centre").answers}
    assert answers == {((x, memory.floor_y, z),)}
    # the views of a few steps have another middle than all goals and view points of the home (test_oracle_map.py)
    home = oracle_home(PersonalDataset(small_root), "HomeTwo")
    assert memory.centre_xz != pytest.approx(home.centre_xz, abs=0.01)
    corner = np.floor(home.centre_xz) - 25  # the cells are those of the oracle map
    assert memory.grid == GridSpec((corner[0], corner[1]), 1.0, (50, 50))


def test_a_sweep_renders_each_view_once_and_makes_the_maps_of_separate_runs(
    small_root: Path, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = []

    def counted(self: Raycaster, T_world_camera: np.ndarray, camera: Camera) -> Frame:
        views.append(T_world_camera)
        return render(self, T_world_camera, camera)

    render = Raycaster.render
    monkeypatch.setattr(Raycaster, "render", counted)
    numbers = {}
    for out, sweep in (("one", "view-noise=0.1"), ("three", "view-noise=0,0.1,0.3"), ("texts", "paraphrase=0,3")):
        shutil.copytree(runs / "explorations", tmp_path / out / "explorations")
        views.clear()
        options = {"scene": ("HomeTwo",), "out": tmp_path / out, "json": True, "map": "explore", "run_id": "run"}
        assert Ground(small_root, "qs", sweep=sweep, **options).run() == 0
        numbers[out] = len(views)
    assert numbers["one"] == numbers["three"] == numbers["texts"] > 0
    alone, among = (maps_of(tmp_path / out, "run-view-noise0.1") / "HomeTwo.npz" for out in ("one", "three"))
    assert alone.read_bytes() == among.read_bytes()
    found = {path.read_bytes() for path in tmp_path.glob("three/map-*/maps/HomeTwo.npz")}
    assert len(found) == 3
    assert len({path.read_bytes() for path in tmp_path.glob("texts/map-*/maps/HomeTwo.npz")}) == 2


def test_notes_show_the_work_in_progress_and_disappear_when_it_ends(tmp_path: Path) -> None:
    with scene_note(tmp_path, "HomeTwo") as two, scene_note(tmp_path, "HomeOne") as one:
        two("exploring storey 1 of 1, 5 steps")
        one("mapping 3 of 9 views")
        assert read_notes(tmp_path) == ["HomeOne: mapping 3 of 9 views", "HomeTwo: exploring storey 1 of 1, 5 steps"]
    assert read_notes(tmp_path) == []
    with scene_note(tmp_path / "gone", "HomeOne") as one, scene_note(None, "HomeOne") as nobody:
        one("a note that cannot be written")
        nobody("a note that nobody reads")
    assert read_notes(tmp_path / "gone") == []


def test_the_bar_shows_notes_on_terminals_and_counts_in_logs() -> None:
    log = io.StringIO()
    with counted("a run", 4, console=Console(file=log), every_s=0.01) as progress:
        assert progress.notes is None
        progress.add()
        while "\n" not in log.getvalue():
            pass
    assert log.getvalue().startswith("a run: 1 of 4, 0 s")
    screen = io.StringIO()
    with counted("a run", 4, console=Console(file=screen, force_terminal=True, width=80)) as progress:
        notes = progress.notes
        assert notes is not None
        with scene_note(notes, "HomeOne") as say:
            say("mapping 3 of 9 views")
            progress.refresh()
    assert "HomeOne: mapping 3 of 9 views" in screen.getvalue()
    assert not notes.exists()


@pytest.mark.slow
def test_worker_processes_make_the_same_maps_and_answers(small_root: Path, tmp_path: Path, runs: Path) -> None:
    two = tmp_path / "two"
    shutil.copytree(runs / "explorations", two / "explorations")
    for out, jobs in ((runs, 1), (two, 2)):
        options = {"view_noise": 0.2, "confusion": 0.2, "jobs": jobs, "run_id": "noisy", "json": True}
        assert Ground(small_root, "dual", map="explore", out=out, **options).run() == 0
    assert read_run(runs / "noisy").answers == read_run(two / "noisy").answers
    for scene in ("HomeOne", "HomeTwo"):
        one, other = (maps_of(out, "noisy") / f"{scene}.npz" for out in (runs, two))
        assert one.read_bytes() == other.read_bytes()

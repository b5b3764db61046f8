"""Explorations in recordings, live and replayed, read back with Rerun's own reader."""

import pickle
from dataclasses import replace
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from grounding.agents import exploration_jobs as jobs
from grounding.agents.exploration_jobs import ExploreJob, run_job
from grounding.agents.explore import Exploration, explore
from personal_viz.cli.grounding.explore import watching
from recordings.explorations import ObserveExplorations, WatchedExploration, exploration_figures, replay_exploration
from recordings.paths import ExplorationKey
from recordings.read import read_rrd
from recordings.sinks import LiveSink, live_sink
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.types import Camera, Pose

from .reading import Tables, column, tables

CAMERA = Camera(width=160, height=120)
START = Pose((-3.0, 0.0, 1.1), 0.0)
SEED = 5
RUN = "/runs/frontier"
pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


def watching_to(home: Scene, out: Path) -> WatchedExploration:
    return WatchedExploration(home, LiveSink("file", str(out)), START, seed=SEED, camera=CAMERA)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, home: Scene) -> tuple[Path, Exploration]:
    """The recording of an exploration of the two-room house, and the exploration."""
    out = tmp_path_factory.mktemp("explore") / "live.rrd"
    watched = watching_to(home, out)
    exploration = explore(home, START, seed=SEED, max_steps=60, camera=CAMERA, on_step=watched)
    watched.end(exploration)
    assert watched.problem is None
    return out, exploration


@pytest.fixture(scope="module")
def found(live: tuple[Path, Exploration]) -> Tables:
    return tables(live[0])


def test_a_recording_has_view_depth_path_frontiers_and_both_maps(live: tuple[Path, Exploration], found: Tables) -> None:
    steps = len(live[1].steps)
    assert steps > 15
    rows = {entity: len(columns["step"]) for (entity, static), columns in found.items() if not static}
    assert rows[f"{RUN}/camera"] == rows[f"{RUN}/depth"] == rows[f"{RUN}/map/storey_0/robot"] == steps + 1
    assert rows[f"{RUN}/trail"] == rows[f"{RUN}/actions"] == steps
    assert rows[f"{RUN}/map/storey_0/occupancy"] == (steps - 1) // 5 + 1
    assert rows[f"{RUN}/map/storey_0/seen"] == rows[f"{RUN}/seen_m2"]
    assert rows[f"{RUN}/frontiers"] == rows[f"{RUN}/map/storey_0/frontiers"] > 3
    assert rows[f"{RUN}/chosen"] > 3


def test_pictures_have_colours_and_the_seen_floor_grows_to_most_of_the_house(found: Tables) -> None:
    sizes = {len(blob[0]) for blob in column(found, f"{RUN}/camera", "EncodedImage:blob")}
    assert len(sizes) > 10, "black pictures would all have one size"
    seen = [value for (value,) in column(found, f"{RUN}/seen_m2", "Scalars:scalars")]
    assert seen == sorted(seen)
    assert seen[0] < 12 < seen[-1] < 40, "two rooms of 20 square metres"


def test_a_recorded_exploration_holds_no_goal_and_no_episode(live: tuple[Path, Exploration], found: Tables) -> None:
    entities = {entity for entity, _ in found}
    assert not [entity for entity in entities if "goal" in entity.lower() or "/record" in entity]
    assert f"{RUN}/centre_distance" not in entities
    text = found[("/task", True)]["TextDocument:text"][-1][0]
    assert "Nothing is looked for" in text
    assert f"| stop reason | {live[1].stop_reason} |" in text
    with pytest.raises(RecordingError, match="found no run"):
        read_rrd(live[0])


def test_the_recording_names_home_and_seed_and_shows_seen_floor_and_the_agents_map(
    live: tuple[Path, Exploration],
) -> None:
    reader, names, name = RrdReader(str(live[0])), set(), "ViewBlueprint:display_name"
    for chunk in (chunk for layout in reader.blueprints() for chunk in reader.stream(store=layout)):
        batch = chunk.to_record_batch()
        names |= {row[0] for row in batch.column(name).to_pylist()} if name in batch.schema.names else set()
    assert {"Free floor seen, square metres", "What it thinks", "Seen so far", "Depth", "frontier sees"} <= names
    (store,) = RrdReader(str(live[0])).recordings()
    assert store.recording_id == f"personal/explore/BoxHouse/storey0/seed{SEED}"


def test_a_replayed_exploration_gives_the_same_recording(
    live: tuple[Path, Exploration], found: Tables, tmp_path: Path, home: Scene
) -> None:
    out, exploration = tmp_path / "again.rrd", live[1]
    same = replay_exploration(exploration, home, LiveSink("file", str(out)))
    assert same == len(exploration.steps)
    again = tables(out)
    assert set(again) == set(found)
    for entity, name in (
        (f"{RUN}/map/storey_0/occupancy", "EncodedImage:blob"),
        (f"{RUN}/frontiers", "Points3D:positions"),
        (f"{RUN}/camera", "EncodedImage:blob"),
    ):
        assert column(again, entity, name) == column(found, entity, name)


def test_if_the_explorer_chooses_another_action_its_insights_are_left_out_from_there(
    live: tuple[Path, Exploration], tmp_path: Path, home: Scene
) -> None:
    out, exploration = tmp_path / "other.rrd", live[1]

    class FourActions:
        """Repeats the first four stored actions and then gives none."""

        def reset(self, task, camera, *, seed, keep_memory=False) -> None:
            self.left = 10

        def act(self, observation):
            self.left -= 1
            return exploration.steps[9 - self.left].action if self.left > 5 else None

    short = exploration.model_copy(update={"steps": exploration.steps[:8], "coverage": exploration.coverage[:9]})
    same = replay_exploration(short, home, LiveSink("file", str(out)), agent=FourActions())
    assert same == 4
    read = tables(out)
    assert len(read[(f"{RUN}/trail", False)]["step"]) == 8
    assert "chooses another action at step 5" in read[("/task", True)]["TextDocument:text"][-1][0]
    assert (f"{RUN}/frontiers", False) not in read


def test_a_scan_without_permission_shows_only_the_path(
    live: tuple[Path, Exploration], tmp_path: Path, home: Scene
) -> None:
    out = tmp_path / "way.rrd"
    scan = replace(home, kind="scan")
    replay_exploration(live[1], scan, LiveSink("file", str(out)))
    entities = {entity for entity, _ in tables(out)}
    assert f"{RUN}/trail" in entities
    assert not [name for name in entities if "occupancy" in name or "/depth" in name or name.startswith("/scene")]


def test_another_home_is_refused(live: tuple[Path, Exploration], tmp_path: Path, home: Scene) -> None:
    other = replace(home, digest="e" * 64)
    with pytest.raises(RecordingError, match="expected the same home"):
        replay_exploration(live[1], other, LiveSink("file", str(tmp_path / "x.rrd")))


def test_a_failing_recording_does_not_stop_the_exploration(tmp_path: Path, home: Scene) -> None:
    (tmp_path / "file").write_text("")
    watched = watching_to(home, tmp_path / "file" / "x.rrd")
    exploration = explore(home, START, seed=SEED, max_steps=5, camera=CAMERA, on_step=watched)
    assert len(exploration.steps) == 5
    with pytest.raises(RecordingError, match="cannot be written"):
        watched.end(exploration)


def test_figures_include_doors_and_rooms_if_the_home_has_a_plan(live: tuple[Path, Exploration]) -> None:
    planned = live[1].model_copy(update={"doors_passed": 1, "num_doors": 2, "rooms_missed": ("attic",)})
    figures = dict(exploration_figures(planned))
    assert figures["doors passed"] == "1 of 2"
    assert figures["rooms neither entered nor seen"] == "attic"
    assert "doors passed" not in dict(exploration_figures(live[1]))


def test_several_explorations_need_a_folder_and_each_gets_its_file(tmp_path: Path) -> None:
    keys = [ExplorationKey("HomeA", 0, 3), ExplorationKey("HomeA", 1, 3)]
    with (
        pytest.raises(RecordingError, match="found 2 explorations for one file"),
        live_sink(str(tmp_path / "a.rrd"), keys),
    ):
        pass
    with live_sink(str(tmp_path / "folder"), keys) as sink:
        names = [str(sink.file_of(key)) for key in keys]
    assert [Path(name).name for name in names] == ["explore-HomeA-storey0-seed3.rrd", "explore-HomeA-storey1-seed3.rrd"]


def test_a_job_is_shown_live_and_its_stored_exploration_is_replayed(
    tmp_path: Path, home: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "_opened", lambda job: (home, None))
    shown = []
    for name in ("live", "again"):
        watch = ObserveExplorations(LiveSink("folder", str(tmp_path / name)))
        job = ExploreJob(
            home.name, seed=2, max_steps=8, camera=CAMERA, storeys="start", out=tmp_path / "out", watch=watch
        )
        assert pickle.loads(pickle.dumps(job)) == job
        (exploration,) = run_job(job)
        shown.append(tables(tmp_path / name / "explore-BoxHouse-storey0-seed2.rrd"))
    assert len(exploration.steps) == 8
    assert set(shown[0]) == set(shown[1])
    first, second = (column(one, f"{RUN}/map/storey_0/occupancy", "EncodedImage:blob") for one in shown)
    assert first == second
    assert len(first) == 2


def test_a_recording_that_cannot_be_written_is_reported_after_the_exploration_is_stored(
    tmp_path: Path, home: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "_opened", lambda job: (home, None))
    (tmp_path / "file").write_text("")
    watch = ObserveExplorations(LiveSink("file", str(tmp_path / "file" / "x.rrd")))
    job = ExploreJob(home.name, seed=2, max_steps=4, camera=CAMERA, storeys="start", out=tmp_path / "out", watch=watch)
    with pytest.raises(RecordingError, match="cannot be written"):
        run_job(job)
    assert len(list((tmp_path / "out").glob("*.json"))) == 1


def test_several_storeys_need_a_folder(tmp_path: Path) -> None:
    job = ExploreJob("Home", seed=0, max_steps=4, camera=CAMERA, storeys="all", out=tmp_path)
    with pytest.raises(RecordingError, match="found 2 explorations for one file"):  # noqa: SIM117 - the error is inside
        with watching(str(tmp_path / "a.rrd"), [job], with_pixels=False):
            pass
    with watching(str(tmp_path / "folder"), [job], with_pixels=True) as (watched,):
        assert watched.watch == ObserveExplorations(LiveSink("folder", str(tmp_path / "folder")), with_pixels=True)
    with watching(None, [job], with_pixels=False) as jobs:
        assert jobs == [job]

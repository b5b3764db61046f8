"""Watching agents never changes a run, and a failing observer loses no finished episode."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from personal_viz.cli.runs.run import Run
from recordings.observer import ObserveRuns
from recordings.sinks import LiveSink
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError, RecordingError
from sim.mesh import Scene
from sim.tasks.agent_makers import AgentMaker, MakesPlugin, MakesRandom, MakesShortestPath
from sim.tasks.observers import Insight
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import EpisodeRun, Step, read_run
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import AgentJob, run_agent
from sim.types import Action, Camera, Observation, Task

pytestmark = pytest.mark.slow


class Wanders:
    """Walks at random for 15 steps and explains itself."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self._rng = np.random.default_rng(seed)
        self._seen = 0.0

    def act(self, observation: Observation) -> Action:
        assert observation.rgb is not None
        self._seen += float(observation.rgb.mean())
        if observation.step == 15:
            return Action.STOP
        return (Action.FORWARD, Action.LEFT, Action.RIGHT)[int(self._rng.integers(3))]

    def insight(self) -> Insight | None:
        return Insight(goal=(0.0, 0.0, -1.0), note=f"I have seen {self._seen:.0f}")


class CannotExplain(Wanders):
    """Raises when it is asked for its reason."""

    def insight(self) -> Insight | None:
        raise ValueError("no reason")


class ExplainsWrongly(Wanders):
    """Returns a text instead of an Insight."""

    def insight(self) -> Any:
        return "because"


class Recorder:
    """Notes every call that it receives."""

    def __init__(self, fails_at: str = "") -> None:
        self.told: list[str] = []
        self._fails_at = fails_at

    def on_reset(self, episode: Episode, observation: Observation) -> None:
        self._note(f"reset {observation.step} {observation.rgb is not None}")

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        self._note(f"step {observation.step} {step.action.value} {insight.note if insight else None}")

    def on_end(self, run: EpisodeRun) -> None:
        self._note(f"end {len(run.steps)}")

    def close(self) -> None:
        self._note("close")

    def _note(self, text: str) -> None:
        self.told.append(text)
        if self._fails_at and text.startswith(self._fails_at):
            raise RecordingError(f"no space at {text}")


@dataclass(frozen=True)
class Gives:
    """Makes an observer by returning an existing one."""

    observer: Recorder

    def __call__(self, scene: Scene) -> Recorder:
        return self.observer


WANDERS = MakesPlugin(f"{__name__}:Wanders")
CANNOT_EXPLAIN = MakesPlugin(f"{__name__}:CannotExplain")
EXPLAINS_WRONGLY = MakesPlugin(f"{__name__}:ExplainsWrongly")


@pytest.fixture(scope="module")
def plain(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[EpisodeRun, ...]:
    """Two unwatched episodes of Wanders."""
    out = tmp_path_factory.mktemp("runs") / "plain"
    run_job(small_home_root, out, agent=WANDERS)
    return read_run(out).episodes


def run_job(
    root: Path, out: Path, *, agent: AgentMaker, number: int = 2, make_observer: Callable[[Scene], Any] | None = None
) -> None:
    """Runs the first `number` episodes of the home and writes them to `out`."""
    keys = tuple(episode.key for episode in PersonalDataset(root).episodes(scenes=("Small",)))[:number]
    job = AgentJob(root, "Small", keys, scenes_dir=None, agent=agent, seed=0, make_observer=make_observer)
    info = make_run_info("a", who="a", who_kind="agent", scene_kind="invented", dataset_digest="d", seed=0)
    run_agent([job], RunWriter(out, info), processes=1)


def command(root: Path, out: Path, **changes: Any) -> int:
    options: dict[str, Any] = {
        "agent": "random", "scenes_dir": None, "scene": (), "split": (), "limit": 1, "seed": 3, "jobs": 1,
        "run_id": "a", "dataset": root, "out": out,
    }  # fmt: skip
    return Run(**(options | changes)).run()


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["random", "shortest-path", f"{__name__}:Wanders"])
def test_a_watched_run_has_the_same_bytes(small_home_root: Path, tmp_path: Path, agent: str) -> None:
    command(small_home_root, tmp_path / "plain", agent=agent)
    command(small_home_root, tmp_path / "watched", agent=agent, rerun=str(tmp_path / "live"))
    plain, watched = tmp_path / "plain" / "a", tmp_path / "watched" / "a"
    assert (plain / "steps.jsonl").read_bytes() == (watched / "steps.jsonl").read_bytes()
    assert sorted(path.name for path in plain.iterdir()) == sorted(path.name for path in watched.iterdir())
    runs = read_run(watched).episodes
    assert len(runs) == 3
    names = {f"{item.key.split}-{item.key.scene}-{item.key.episode_id}.rrd" for item in runs}
    assert {path.name for path in (tmp_path / "live").iterdir()} == names


@pytest.mark.slow
def test_a_run_watched_in_two_processes_has_the_same_bytes(small_home_root: Path, tmp_path: Path) -> None:
    agent = f"{__name__}:Wanders"
    command(small_home_root, tmp_path / "plain", agent=agent)
    command(small_home_root, tmp_path / "watched", agent=agent, jobs=2, rerun=str(tmp_path / "live"))
    plain, watched = tmp_path / "plain" / "a" / "steps.jsonl", tmp_path / "watched" / "a" / "steps.jsonl"
    assert plain.read_bytes() == watched.read_bytes()
    assert len(list((tmp_path / "live").iterdir())) == 3


def test_an_observer_gets_each_step_with_its_picture_and_reason(small_home_root: Path, tmp_path: Path) -> None:
    observer = Recorder()
    run_job(
        small_home_root,
        tmp_path / "a",
        agent=WANDERS,
        number=1,
        make_observer=Gives(observer),
    )
    assert observer.told[0] == "reset 0 True"
    assert [text.split()[:2] for text in observer.told[1:17]] == [["step", str(number)] for number in range(1, 17)]
    assert all("I have seen" in text for text in observer.told[1:17])
    assert observer.told[17:] == ["end 16"]


@pytest.mark.parametrize("agent", [MakesRandom(), MakesShortestPath()])
def test_observers_get_pictures_even_if_the_agent_uses_none(
    small_home_root: Path, tmp_path: Path, agent: AgentMaker
) -> None:
    observer = Recorder()
    run_job(small_home_root, tmp_path / "a", agent=agent, number=1, make_observer=Gives(observer))
    assert observer.told[0] == "reset 0 True"
    assert observer.told[1].endswith("None")


@pytest.mark.parametrize("moment", ["reset", "step 3", "end"])
def test_an_episode_whose_observer_fails_is_still_finished_and_on_disk(
    small_home_root: Path, plain: tuple[EpisodeRun, ...], tmp_path: Path, moment: str
) -> None:
    observer = Recorder(fails_at=moment)
    with pytest.raises(RecordingError, match=f"no space at {moment}"):
        run_job(small_home_root, tmp_path / "a", agent=WANDERS, make_observer=Gives(observer))
    assert read_run(tmp_path / "a").episodes == plain[:1]
    assert observer.told[-1].startswith(moment)  # it is not called again
    run_job(small_home_root, tmp_path / "a", agent=WANDERS)
    assert read_run(tmp_path / "a").episodes == plain


def test_an_agent_that_cannot_explain_itself_is_named(small_home_root: Path, tmp_path: Path) -> None:
    observer = Recorder()
    with pytest.raises(AgentError, match=r"CannotExplain\.insight\(\) raised ValueError: no reason"):
        run_job(
            small_home_root,
            tmp_path / "a",
            agent=CANNOT_EXPLAIN,
            make_observer=Gives(observer),
        )
    assert observer.told[-1] == "close"
    run_job(small_home_root, tmp_path / "b", agent=CANNOT_EXPLAIN)  # unwatched, it is not asked
    assert len(read_run(tmp_path / "b").episodes) == 2
    with pytest.raises(AgentError, match=r"ExplainsWrongly\.insight\(\) returned str; expected an Insight or None"):
        run_job(
            small_home_root,
            tmp_path / "a",
            agent=EXPLAINS_WRONGLY,
            make_observer=Gives(Recorder()),
        )


def test_one_file_for_several_episodes_is_refused_before_any_runs(small_home_root: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="found 3 episodes for one file"):
        command(small_home_root, tmp_path / "out", rerun=str(tmp_path / "a.rrd"))
    assert not (tmp_path / "out" / "a").exists()
    assert not (tmp_path / "a.rrd").exists()


def test_a_finished_episode_keeps_its_recording(
    small_home_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = next(iter(PersonalDataset(small_home_root).episodes(scenes=("Small",)))).key
    options = {"agent": "shortest-path", "episode": str(first), "rerun": str(tmp_path / "a.rrd")}
    command(small_home_root, tmp_path / "out", **options)
    before = (tmp_path / "a.rrd").stat()
    capsys.readouterr()
    command(small_home_root, tmp_path / "out", **options)
    assert "No episode is left to run, so nothing is recorded." in capsys.readouterr().out
    assert (tmp_path / "a.rrd").stat() == before


def test_jobs_with_equal_observers_are_equal_and_hashable(tmp_path: Path) -> None:
    jobs = [
        AgentJob(tmp_path, "Small", (), scenes_dir=None, agent=MakesRandom(), seed=0, make_observer=maker)
        for maker in (ObserveRuns(LiveSink("folder", "a"), "{}"), ObserveRuns(LiveSink("folder", "a"), "{}"), None)
    ]
    assert len(set(jobs)) == 2

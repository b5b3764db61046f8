"""`personal-viz replay` on runs that agents made in a schematic home of the released dataset."""

from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from personal_viz.cli.runs.replay import Replay
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.tasks.agent_makers import MakesRandom, MakesShortestPath
from sim.tasks.provenance import make_run_info
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import AgentJob, run_agent
from sim.types import EpisodeKey

KEY = EpisodeKey("easy", "4ok3usBNeis", "195")


@pytest.mark.slow
def test_two_agents_on_a_released_episode_become_one_recording(
    dataset_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    digest = PersonalDataset(dataset_root).digest()
    folders = []
    for agent, maker in (("shortest-path", MakesShortestPath()), ("random", MakesRandom())):
        info = make_run_info(agent, who=agent, who_kind="agent", scene_kind="schematic", dataset_digest=digest)
        writer = RunWriter(tmp_path / agent, info)
        job = AgentJob(dataset_root, KEY.scene, (KEY,), scenes_dir=None, agent=maker, seed=0)
        run_agent([job], writer, processes=1)
        folders.append(writer.folder)
    out = tmp_path / "both.rrd"
    assert Replay(runs=tuple(folders), out=out, dataset=dataset_root, scenes_dir=None).run() == 0
    printed = capsys.readouterr().out
    assert f"{out}: {KEY} in 4ok3usBNeis (schematic, not HM3D)" in printed
    entities = {chunk.entity_path for chunk in RrdReader(str(out)).stream()}
    assert {"/runs/shortest-path/camera", "/runs/random/camera", "/goal/centre", "/task"} <= entities
    with pytest.raises(RecordingError, match="found no run of episode easy/4ok3usBNeis/196"):
        Replay(runs=(folders[0],), out=out, dataset=dataset_root, scenes_dir=None, episode="easy/4ok3usBNeis/196").run()

"""`run --agent vlfm` and `onemap` by name with faulty oracle perception: what run.json keeps and Rerun shows."""

import json
from pathlib import Path

import pytest

from personal_viz.cli.runs.run import Run
from sim.episodes.dataset import PersonalDataset
from sim.tasks.run_files import read_run

from ..recordings.reading import tables

MILD = (
    "oracle:mild (view_noise=0.05, object_noise=0.05, confusion=0.1, background=clutter, miss=0.2, far=8..3, "
    "small=8..40, hidden=0.1..0.6, false_rate=0.02, box_jitter=0.05, score_noise=0.05) in hashed"
)
TARGET = (
    "green and white striped woven rug next to the blue wooden dresser and next to the bed with a teal and white "
    "floral cover"
)
"""The phrase that the description has for what the query asks for."""
SHOWN = ("frontiers", "candidates", "camera/detections", "found", "chosen", "note", "map/storey_0/similarity")


@pytest.mark.slow
def test_runs_keep_goal_text_and_faults_are_recorded_with_what_was_seen_and_repeat_byte_for_byte(
    small_home_root: Path, tmp_path: Path
) -> None:
    episode = next(PersonalDataset(small_home_root).episodes(splits=("easy",)))
    for agent in ("vlfm", "onemap"):
        rrd = tmp_path / f"{agent}.rrd"
        Run(
            dataset=small_home_root, agent=agent, perception="oracle:mild", episode=str(episode.key), out=tmp_path,
            run_id=agent, rerun=str(rrd),
        ).run()  # fmt: skip
        info = json.loads((tmp_path / agent / "run.json").read_text())
        assert info["condition"] == f"goal text phrase, sees with {MILD}"
        assert (info["config"]["goal_text"], info["config"]["perception"]) == ("phrase", MILD)
        (run,) = read_run(tmp_path / agent).episodes
        assert run.end.reason == "stop"
        found = tables(rrd)
        rows = {name: found.get((f"/runs/{agent}/{name}", False), {"step": []})["step"] for name in SHOWN}
        assert [name for name, steps in rows.items() if not steps] == []
        assert len(rows["note"]) == len(run.steps)
        labels = found[(f"/runs/{agent}/camera/detections", False)]["Boxes2D:labels"]
        assert {text.rsplit(" ", 1)[0] for texts in labels for text in texts} == {TARGET}
    Run(dataset=small_home_root, agent="vlfm", perception="oracle:mild", episode=str(episode.key), out=tmp_path,
        run_id="again").run()  # fmt: skip
    first, again = (tmp_path / name / "steps.jsonl" for name in ("vlfm", "again"))
    assert again.read_bytes() == first.read_bytes()

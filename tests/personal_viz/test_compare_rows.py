"""Trials to comparable rows: means, differences, order, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from personal_viz.compare.gathered import Setting, Trial, gather
from personal_viz.compare.rows import means_of, sections
from sim.errors import RunFileError
from sim.tasks.run_files import Answer, EpisodeRun, Run, RunInfo
from sim.types import EpisodeKey
from tests.human_study.report_examples import pan_episode
from tests.sim.worlds import run_info

from .compared_runs import written

KEY = EpisodeKey("easy", "Hut", "1")
HOME = Setting("schematic")


def trial(who: str, *, success: bool | None, key: EpisodeKey = KEY, **changes: object) -> Trial:
    """A PAN trial of 10 steps and SPL 0.5 if successful; `human` is a person who needs 4 s."""
    is_human = who == "human"
    base = Trial(
        key, "pan", HOME, who, "human" if is_human else "agent", "none", "P01" if is_human else None, who, "stop",
        success, None if success is None else 0.5 * success, 10, 4.0 if is_human else None, 0.0, "d" * 64, "digest",
    )  # fmt: skip
    return replace(base, **changes)


def info(run_id: str, **changes: object) -> RunInfo:
    return run_info(run_id, **({"scene_kind": "schematic"} | changes))


def walk(scene_digest: str) -> EpisodeRun:
    return pan_episode(KEY, success=False, steps=1, code=None, scene_digest=scene_digest)


def test_people_minus_agents_is_the_difference_of_their_means() -> None:
    trials = [
        trial("human", success=True, steps=20),
        trial("human", success=True, steps=30),
        trial("a", success=True, steps=100),
        trial("b", success=False, steps=60),
    ]
    assert means_of(trials, "pan") == {
        "people": {"sr": 100.0, "spl": 50.0, "steps": 25.0, "time_s": 4.0},
        "agents": {"sr": 50.0, "spl": 25.0, "steps": 80.0, "time_s": None},
        "difference": {"sr": 50.0, "spl": 25.0, "steps": -55.0, "time_s": None},
    }


def test_trials_that_were_not_scored_are_in_no_mean() -> None:
    found = means_of([trial("human", success=True), trial("human", success=None, steps=500, reason="technical")], "pan")
    assert found["people"]["steps"] == 10.0
    assert found["agents"]["sr"] is None


def test_rows_are_sorted_by_the_human_lead_and_rows_without_one_come_last(tmp_path: Path) -> None:
    even, ahead, alone = (EpisodeKey("easy", "Hut", name) for name in ("1", "2", "3"))
    runs = [
        Run(info=info("human", who_kind="human"), episodes=(walk("d"),)),
        Run(info=info("a"), episodes=(walk("d"),)),
    ]
    trials = [
        trial("human", success=True, key=even),
        trial("a", success=True, key=even),
        trial("human", success=True, key=ahead),
        trial("a", success=False, key=ahead),
        trial("a", success=True, key=alone),
    ]
    keys = dict.fromkeys((even, ahead, alone), "Find it.")
    found = sections(trials, runs, queries=keys, folders={(HOME, key): "f" for key in keys})
    assert [row.key.episode_id for row in found[0].rows] == ["2", "1", "3"]
    assert [row.means["difference"]["sr"] for row in found[0].rows] == [100.0, 0.0, None]


def test_kinds_tasks_and_oracle_maps_never_share_a_table() -> None:
    kinds = ("invented", "scan", "schematic")
    runs = [Run(info=info(kind, scene_kind=kind), episodes=(walk("d"),)) for kind in kinds]
    answer = Answer(
        split="easy", scene="Hut", episode_id="1", candidates=((0.0, 0.0, 0.0),),
        measures={"success": True, "top3_success": True, "planar_distance": 0.1, "distance_3d": 0.1},
    )  # fmt: skip
    runs.append(Run(info=info("map", scene_kind="oracle-map"), answers=(answer,)))
    trials = [trial(kind, success=True, setting=Setting(kind)) for kind in kinds]
    trials.append(trial("map", success=True, setting=None, task="pog", spl=None, steps=None))
    folders = {(one.setting, KEY): "f" for one in trials}
    found = sections(trials, runs, queries={KEY: "Find it."}, folders=folders)
    assert [section.title.split(", ")[1] for section in found] == [
        "scans",
        "schematic homes",
        "invented homes",
        "oracle maps",
    ]
    assert [len(section.rows[0].trials) for section in found] == [1, 1, 1, 1]
    assert found[0].remark == ""
    assert "no human baseline for PersONAL" in found[1].remark
    assert "no human baseline for PersONAL" in found[2].remark


def gathered(runs: Path, aside: Path) -> object:
    known = {KEY: None}
    return gather([runs], dataset_digest="d", episodes=known, into=aside)


def test_runs_on_two_versions_of_a_home_are_refused(tmp_path: Path) -> None:
    written(Run(info=info("old"), episodes=(walk("1" * 64),)), tmp_path / "runs")
    written(Run(info=info("young"), episodes=(walk("2" * 64),)), tmp_path / "runs")
    with pytest.raises(RunFileError, match="young: was made on Hut with scene_digest '222222222222', old with"):
        gathered(tmp_path / "runs", tmp_path / "aside")


def test_runs_on_other_episode_files_are_refused(tmp_path: Path) -> None:
    written(Run(info=info("other", dataset_digest="e" * 64), episodes=(walk("d"),)), tmp_path / "runs")
    with pytest.raises(RunFileError, match="other: dataset_digest is 'eeeeeeeeeeee'"):
        gathered(tmp_path / "runs", tmp_path / "aside")


def test_an_answer_whose_scene_is_a_path_writes_nothing(tmp_path: Path) -> None:
    answer = Answer(split="easy", scene="../../away", episode_id="1", candidates=())
    written(Run(info=info("evil"), answers=(answer,)), tmp_path / "runs")
    with pytest.raises(RunFileError, match="which --dataset does not hold"):
        gathered(tmp_path / "runs", tmp_path / "aside")
    assert not (tmp_path / "aside").exists()
    assert not (tmp_path / "away").exists()


def test_ways_are_compared_with_those_of_the_people_beside_them(tmp_path: Path) -> None:
    def walked(run_id: str, path: int, **names: object) -> None:
        walk = pan_episode(KEY, success=True, steps=8, code=None, path=path)
        written(Run(info=info(run_id, dataset_digest="d", **names), episodes=(walk,)), tmp_path / "runs")

    human = {"who": "human", "who_kind": "human"}
    walked("a", 4, **human)  # 5 places, 25 cm apart
    walked("b", 8, **human)  # 4 places more, which end 1 m further on: 2.5 m over 9 places
    walked("c", 8, **human, condition="memory_topdown")
    walked("agent", 4)
    walked("beside", 4, config={"study_conditions": "memory_topdown"})
    found = gather([tmp_path / "runs"], dataset_digest="d", episodes={KEY: None}, into=tmp_path / "aside")  # type: ignore
    apart = {trial.run_id: trial.from_people_m for trial in found.trials}
    assert apart.pop("c") is None  # nobody else in this condition
    assert apart == pytest.approx({"a": 2.5 / 9, "b": 2.5 / 9, "agent": 5 / 27, "beside": 2.5 / 9})
    told = {trial.run_id: trial.facts for trial in found.trials}
    assert told["a"].endswith("8.0 s, 0.28 m from other people's ways")
    assert told["agent"].endswith(", 0.19 m from people's ways")


def test_no_folder_at_all_is_an_error_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="found no run folder on the command line"):
        gather([], dataset_digest="d", episodes={}, into=tmp_path)


def test_agents_on_the_peoples_study_stand_in_the_tables_of_their_conditions_on_the_same_episodes() -> None:
    done, left = EpisodeKey("easy", "Hut", "1"), EpisodeKey("easy", "Hut", "2")
    trials = [
        trial("human", success=True, key=done, run_id="p-none"),
        trial("human", success=False, key=done, run_id="p-map", condition="memory_topdown"),
        *(trial("blind", success=True, key=key, beside=("none", "memory_topdown")) for key in (done, left)),
        trial("seer", success=True, key=done, condition="memory_topdown", beside=("memory_topdown",)),
        *(trial("stranger", success=True, key=key) for key in (done, left)),
    ]
    facts = {"p-none": ("human", "none"), "p-map": ("human", "memory_topdown"), "seer": ("agent", "memory_topdown")}
    runs = []
    for name in dict.fromkeys(one.run_id for one in trials):
        kind, condition = facts.get(name, ("agent", "none"))
        walks = tuple(
            pan_episode(one.key, success=bool(one.success), steps=1, code=one.participant)
            for one in trials
            if one.run_id == name
        )
        who = "human" if kind == "human" else name
        runs.append(Run(info=info(name, who=who, who_kind=kind, condition=condition), episodes=walks))
    keys = dict.fromkeys((done, left), "Find it.")
    found = plain, mapped, _ = sections(trials, runs, queries=keys, folders={(HOME, key): "f" for key in keys})
    shown = {
        section.condition: [(row.who, row.n) for row in section.metrics if row.split == "total"] for section in found
    }
    assert shown == {
        "none": [("human", 1), ("blind", 1), ("stranger", 1)],
        "memory_topdown": [("human", 1), ("blind", 1), ("seer", 1), ("stranger", 1)],
        None: [("blind", 1), ("stranger", 1)],
    }
    assert plain.title.endswith("schematic homes: Human")
    assert mapped.title.endswith(": Human with memory (top-down map)")
    assert mapped.notes[0].startswith("Agents without memory_topdown in their name had no exposure")
    assert [row.key for row in mapped.rows] == [done]


def test_agents_that_ran_on_another_study_than_the_people_are_refused(tmp_path: Path) -> None:
    people = info("p", who="human", who_kind="human", config={"study_version": "a" * 64})
    agent = info("walker", config={"study_version": "b" * 64, "study_conditions": "none"})
    for one in (people, agent):
        written(Run(info=one, episodes=(walk("d" * 64),)), tmp_path / "runs")
    with pytest.raises(RunFileError, match="walker: ran on study version bbbbbbbbbbbb; expected aaaaaaaaaaaa"):
        gathered(tmp_path / "runs", tmp_path / "aside")

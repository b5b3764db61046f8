"""Grounders answer episodes: the choice of episodes, the answers, resuming, and worker processes."""

from pathlib import Path

import pytest

from grounding.evaluation.evaluate import GroundSettings, SceneGrounder, evaluate, open_job, select_jobs
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import Answer, read_run
from sim.tasks.run_writer import RunWriter

RPG = GroundSettings("rpg")


def writer_in(folder: Path) -> RunWriter:
    return RunWriter(
        folder, make_run_info("test", who="rpg", who_kind="agent", scene_kind="oracle-map", dataset_digest="d")
    )


def names(jobs) -> list[str]:
    return [str(key) for job in jobs for key in job.keys]


def test_the_limit_counts_per_split_and_takes_one_episode_of_every_scene_first(small_root: Path) -> None:
    dataset = PersonalDataset(small_root)
    for seed in range(5):
        drawn = names(select_jobs(dataset, RPG, limit=2, sample_seed=seed))
        easy = [name for name in drawn if name.startswith("easy/")]
        assert len(easy) == 2
        assert {name.split("/")[1] for name in easy} == {"HomeOne", "HomeTwo"}
    assert len(names(select_jobs(dataset, RPG))) == 11
    assert names(select_jobs(dataset, RPG, splits=("medium",))) == []


def test_query_scoring_gives_the_answers_computed_by_hand(small_root: Path) -> None:
    dataset = PersonalDataset(small_root)
    (job,) = select_jobs(dataset, GroundSettings("qs"), splits=("hard",))
    answers = [open_job(job)(key).answer for key in job.keys]
    assert [answer.episode_id for answer in answers] == ["0", "1", "2"]
    # "Find Carl's mirror": the only text with "mirror" is at x 0.5, z 4.5, the centre of a cell
    assert answers[2].candidates[0] == (0.5, 0.0, 4.5)
    assert answers[2].measures is not None
    assert answers[2].measures.success
    assert answers[2].measures.planar_distance == 0.0
    assert answers[2].storey_given
    # both captions have "chair" once; the shorter one has the higher cosine, and its chair is Carl's
    assert [answer.measures.success for answer in answers if answer.measures] == [True, False, True]
    assert [answer.measures.top3_success for answer in answers if answer.measures] == [True, True, True]


def test_without_the_storey_the_answer_uses_the_merged_map_and_says_so(small_root: Path) -> None:
    dataset = PersonalDataset(small_root)
    given = SceneGrounder(dataset, "HomeOne", RPG)
    merged = SceneGrounder(dataset, "HomeOne", GroundSettings("rpg", all_storeys=True))
    (bed,) = [episode for episode in dataset.episodes(scenes=("HomeOne",)) if episode.record.object_category == "bed"]
    assert len(given.memory(bed).rows) == 2
    assert len(merged.memory(bed).rows) == 4
    assert given.answer(bed).storey_given
    assert not merged.answer(bed).storey_given
    assert given.answer(bed).candidates[0] == (2.5, 3.0, 7.5)


def test_answers_do_not_depend_on_the_other_episodes_of_the_run(small_root: Path, tmp_path: Path) -> None:
    dataset = PersonalDataset(small_root)
    settings = GroundSettings("random", seed=3)
    whole, part = writer_in(tmp_path / "whole"), writer_in(tmp_path / "part")
    evaluate(select_jobs(dataset, settings), whole, processes=1)
    evaluate(select_jobs(dataset, settings, splits=("hard",), limit=2), part, processes=1)
    of_whole = {answer.key: answer for answer in read_run(whole.folder).answers}
    of_part = read_run(part.folder).answers
    assert len(of_part) == 2
    assert all(of_whole[answer.key] == answer for answer in of_part)


def test_answers_before_an_error_are_on_disk_and_each_is_counted(
    small_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = SceneGrounder.answer

    def failing(grounder: SceneGrounder, episode: Episode) -> Answer:
        if str(episode.key) == "hard/HomeTwo/1":
            raise AgentError("no answer")
        return answer(grounder, episode)

    monkeypatch.setattr(SceneGrounder, "answer", failing)
    jobs = select_jobs(PersonalDataset(small_root), RPG)
    writer, counted = writer_in(tmp_path), []
    with pytest.raises(AgentError, match="no answer"):
        evaluate(jobs, writer, processes=1, on_episode=lambda: counted.append(len(writer.done)))
    expected = names(jobs)[: names(jobs).index("hard/HomeTwo/1")]
    assert [str(one.key) for one in read_run(tmp_path).answers] == expected
    assert len(counted) == len(expected)
    assert counted[-1] == len(expected)


def test_a_killed_run_continues_where_it_stopped(small_root: Path, tmp_path: Path) -> None:
    jobs = select_jobs(PersonalDataset(small_root), RPG)
    evaluate(jobs, writer_in(tmp_path / "run"), processes=1)
    path = tmp_path / "run" / "answers.jsonl"
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    calls: list[int] = []
    for _ in range(2):
        evaluate(jobs, writer_in(tmp_path / "run"), processes=1, on_episode=lambda: calls.append(1))
        assert path.read_text() == whole
        assert 0 < len(calls) < 11


@pytest.mark.slow
def test_worker_processes_write_the_same_bytes(small_root: Path, tmp_path: Path) -> None:
    jobs = select_jobs(PersonalDataset(small_root), RPG)
    evaluate(jobs, writer_in(tmp_path / "one"), processes=1)
    evaluate(jobs, writer_in(tmp_path / "two"), processes=2)
    assert (tmp_path / "one" / "answers.jsonl").read_bytes() == (tmp_path / "two" / "answers.jsonl").read_bytes()

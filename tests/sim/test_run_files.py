"""Run files: round trip, resuming after a kill, an old version, damage."""

import json
from pathlib import Path

import pytest

from sim.errors import RunFileError
from sim.tasks.metrics import (
    MetricRow,
    metric_rows,
    paper_table,
    reading_notes,
    require_comparable,
    rule_warnings,
)
from sim.tasks.run_files import (
    Answer,
    AnswerMeasures,
    EpisodeEnd,
    EpisodeRun,
    EpisodeStart,
    RuleMeasures,
    Run,
    RunInfo,
    Step,
    read_run,
)
from sim.tasks.run_writer import RunWriter
from sim.types import Action

from .test_files import files_up_to
from .worlds import measured, run_info


def info(**changes) -> RunInfo:
    """`run.json` of a run."""
    return run_info("r1", **{"who": "random"} | changes)


def finished(episode_id: str = "1", *, success: bool = True, **changes) -> EpisodeRun:
    """A run of two steps; `changes` are changed fields of its measures."""
    rule = RuleMeasures(success=success, spl=0.5 * success, soft_spl=0.5, dtg=0.0 if success else 2.0, start_distance=2)
    steps = (
        Step(action=Action.FORWARD, position=(0.1, 0.0, -0.25), yaw=0.1),
        Step(action=Action.STOP, position=(0.1, 0.0, -0.25), yaw=0.1, t_s=3.5),
    )
    start = EpisodeStart(split="easy", scene="Demo", episode_id=episode_id, position=(0.1, 0.0, 0.0), yaw=0.1)
    return EpisodeRun(start=start, steps=steps, end=EpisodeEnd(reason="stop", measures=measured(rule, **changes)))


def written(tmp_path: Path, *runs: EpisodeRun) -> Path:
    """A run folder with these episodes."""
    writer = RunWriter(tmp_path / "r1", info())
    for run in runs:
        writer.add_episode(run)
    return writer.folder


def test_a_run_is_equal_when_read_back_and_a_run_without_results_leaves_no_file(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "r1", info())
    answer = Answer(split="hard", scene="Demo", episode_id="9", candidates=((1.0, 0.0, 2.0),), scores=(0.5,))
    writer.add_episode(finished())
    writer.add_answers([answer])
    assert read_run(tmp_path / "r1") == Run(info=info(), episodes=(finished(),), answers=(answer,))
    RunWriter(tmp_path / "none", info())
    assert [path.name for path in tmp_path.iterdir()] == ["r1"]


def test_a_killed_run_continues_after_its_last_complete_block(tmp_path: Path) -> None:
    steps = written(tmp_path, finished("1")) / "steps.jsonl"
    whole = steps.read_text()
    block = "".join(line.model_dump_json() + "\n" for line in (finished("2").start, *finished("2").steps))
    steps.write_text(whole + block + '{"kind":"st')
    again = RunWriter(tmp_path / "r1", info(created_utc="2026-01-02T00:00:00+00:00"))
    assert steps.read_text() == whole
    assert {key.episode_id for key in again.done} == {"1"}
    again.add_episode(finished("2"))
    assert [run.key.episode_id for run in read_run(tmp_path / "r1").episodes] == ["1", "2"]


def test_a_folder_of_another_run_or_a_newer_version_is_refused(tmp_path: Path) -> None:
    folder = written(tmp_path, finished())
    with pytest.raises(RunFileError, match=r"run\.json: seed is None, this run has 3; expected the same to resume"):
        RunWriter(folder, info(seed=3))
    path = written(tmp_path, finished()) / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "schema_version": 4}))
    with pytest.raises(RunFileError, match=r"run\.json: schema_version is 4; expected"):
        read_run(path.parent)


def test_episodes_of_another_version_of_the_home_are_refused(tmp_path: Path) -> None:
    folder = written(tmp_path, finished("1", scene_digest="old"))
    before = (folder / "steps.jsonl").read_text()
    again = RunWriter(folder, info())
    message = r"steps\.jsonl: scene_digest of Demo is 'old', easy/Demo/2 has 'new'; expected one version.*another --out"
    with pytest.raises(RunFileError, match=message) as caught:
        again.add_episode(finished("2", scene_digest="new"))
    assert "\n" not in str(caught.value)
    assert (folder / "steps.jsonl").read_text() == before
    again.add_episode(finished("2", scene_digest="old"))
    assert len(read_run(folder).episodes) == 2


def test_a_full_disk_gives_one_line_and_leaves_only_complete_episodes(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "r1", info())
    writer.add_episode(finished("1"))
    steps = tmp_path / "r1" / "steps.jsonl"
    before = steps.read_text()
    message = r"r1: cannot be written \(.*Give another --out, or make room"
    with files_up_to(len(before) + 40), pytest.raises(RunFileError, match=message) as caught:
        writer.add_episode(finished("2"))
    assert "\n" not in str(caught.value)
    assert steps.read_text() == before
    writer.add_episode(finished("2"))
    assert len(read_run(tmp_path / "r1").episodes) == 2


@pytest.mark.parametrize("tail", ["5\n", "[]\n", "null\n", '"end"\n', '{"kind":["end"]}\n'])
def test_a_tail_of_json_that_is_no_run_line_is_removed(tmp_path: Path, tail: str) -> None:
    steps = written(tmp_path, finished()) / "steps.jsonl"
    whole = steps.read_text()
    steps.write_text(whole + tail)
    with pytest.raises(RunFileError, match=r"steps\.jsonl:5: kind is"):
        read_run(tmp_path / "r1")
    assert len(RunWriter(tmp_path / "r1", info()).done) == 1
    assert steps.read_text() == whole


STEP = '{"kind":"step","action":"%s","position":%s"yaw":0}'
EPISODE = '{"kind":"episode","split":"easy","scene":"Demo","episode_id":"1","position":[0,0,0],"yaw":0}\n'


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{broken", r"steps\.jsonl:2: found text that is not JSON"),
        ('{"kind":"jump"}', r"steps\.jsonl:2: kind is 'jump'; expected one of"),
        (STEP % ("fly", "[0,0,0],"), r"steps\.jsonl:2: action is 'fly'; expected"),
        (STEP % ("stop", "[0,NaN,0],"), r"steps\.jsonl:2: position\.1 is nan"),
        ('{"kind":"step","action":"stop","yaw":0}', r"steps\.jsonl:2: position is nothing; expected"),
        (EPISODE.rstrip(), "expected 'step'"),
    ],
)
def test_a_damaged_line_is_refused_with_its_number(tmp_path: Path, line: str, message: str) -> None:
    folder, run = written(tmp_path, finished()), finished()
    (folder / "steps.jsonl").write_text(f"{run.start.model_dump_json()}\n{line}\n{run.end.model_dump_json()}\n")
    with pytest.raises(RunFileError, match=message) as caught:
        read_run(folder)
    assert "\n" not in str(caught.value)


STOPPED = EPISODE + STEP % ("stop", "[0,0,0],") + "\n"
VERSION_1 = {
    "run.json": '{"schema_version":1,"run_id":"old","who":"shortest-path","who_kind":"agent","scene_kind":"scan",'
    '"dataset_digest":"d","created_utc":"2026-11-20T00:00:00+00:00"}',
    "steps.jsonl": STOPPED.replace('"episode",', '"episode","schema_version":1,')
    + '{"kind":"end","reason":"stop","measures":{"rules":{'
    '"paper":{"success":true,"spl":1.0,"soft_spl":1.0,"dtg":0.0,"start_distance":0.0},'
    '"habitat":{"success":false,"spl":0.0,"soft_spl":0.0,"dtg":1.25,"start_distance":1.25},"authors":null},'
    '"centre_distance":0.8,"path_m":0.0,"num_steps":1,"collisions":0,"stored_geodesic":2.0,"scene_digest":"s"}}\n',
}
"""A run as commit 0d21b8b wrote it."""


@pytest.fixture
def old(tmp_path: Path) -> Run:
    for name, text in VERSION_1.items():
        (tmp_path / name).write_text(text)
    return read_run(tmp_path)


def test_a_run_from_before_paper_strict_is_undefined_under_it_and_keeps_its_other_figures(old: Run) -> None:
    assert old.episodes[0].steps[0].action is Action.STOP
    assert old.info.condition == "none"
    assert old.info.made_for == "paper"  # at that time, shortest-path had only this rule
    paper, strict = (metric_rows([old], rule=rule)[0] for rule in ("paper", "paper-strict"))
    assert (paper.n, paper.k, paper.sr, paper.undefined) == (1, 1, 100.0, 0)
    assert (strict.n, strict.undefined, strict.sr, strict.dtg) == (0, 1, None, None)
    assert paper.paper_strict.undefined == 1
    assert (paper.far_from_view.n, paper.far_from_view.k, paper.far_from_view.share) == (1, 1, 100.0)
    assert "by paper-strict not known, 1 trials measured before this rule" in reading_notes(metric_rows([old]))[1]


def test_the_first_runs_without_versions_can_still_be_read_and_written_again(old: Run, tmp_path: Path) -> None:
    (tmp_path / "steps.jsonl").write_text(STOPPED + '{"kind":"end","reason":"stop"}\n')
    assert read_run(tmp_path).episodes[0].steps == old.episodes[0].steps
    RunWriter(tmp_path / "again", old.info).add_episode(old.episodes[0])
    assert read_run(tmp_path / "again") == old


def walked(episode_id: str, *, paper: bool, strict: bool, to_view: float | None) -> EpisodeRun:
    """A run that ends `to_view` metres of walking from the nearest view point; None = it cannot be reached."""
    rules = {
        name: RuleMeasures(success=success, spl=0.5 * success, soft_spl=0.5, dtg=to_view, start_distance=4.0)
        for name, success in (("paper", paper), ("habitat", False), ("authors", False), ("paper-strict", strict))
    }
    return finished(episode_id, rules=rules)


def test_rows_show_the_strict_rule_and_how_many_successes_end_far_from_every_view_point() -> None:
    runs = (
        walked("1", paper=True, strict=True, to_view=0.4),
        walked("2", paper=True, strict=True, to_view=1.0),  # the boundary still counts as near
        walked("3", paper=True, strict=False, to_view=1.01),
        walked("4", paper=True, strict=False, to_view=None),  # behind a wall, without any path
        walked("5", paper=False, strict=False, to_view=3.0),  # no success
        finished("6"),  # a success without any view point that counts
    )
    easy, total = metric_rows([Run(info=info(), episodes=runs)])
    assert (easy.k, easy.n, easy.paper_strict.k, easy.paper_strict.n) == (5, 6, 3, 6)
    assert easy.paper_strict.sr == pytest.approx(50.0)
    for row in (easy, total):
        assert (row.far_from_view.n, row.far_from_view.k, row.far_from_view.share) == (4, 2, 50.0)
    notes = reading_notes([easy, total])
    assert notes[0].startswith("Rule paper = our reading of the PersONAL paper")
    assert notes[1:] == [
        "random: by paper-strict SR 50.0 (3/6); 2 of 4 successes by paper (50.0 %) end more than 1 m of walking from "
        "every view point."
    ]


def test_totals_of_different_splits_do_not_stand_side_by_side() -> None:
    names = {
        "who": "whole",
        "condition": "none",
        "scene_kind": "scan",
        "task": "pan",
        "rule": "paper",
        "edition": "own",
    }
    cells = [MetricRow(**names, split=split, n=1, k=1, sr=100.0) for split in ("easy", "hard", "total")]
    part = [row.model_copy(update={"who": "part"}) for row in cells if row.split != "hard"]
    table = paper_table([*cells, *part])
    whole, lacking = table.lines
    assert whole.cells[-1][:2] == ("100.0", "1/1")
    assert lacking.cells[0][:2] == ("100.0", "1/1")
    assert set(lacking.cells[-1]) == {"-"}
    assert "part: no total, because others did more than easy." in reading_notes([*cells, *part])
    assert paper_table(part).lines[0].cells[-1][:2] == ("100.0", "1/1")
    assert not [note for note in reading_notes(part) if "no total" in note]


def test_a_table_warns_of_runs_made_for_another_rule() -> None:
    run = Run(info=info(who="shortest-path", made_for="paper"), episodes=(finished(),))
    assert rule_warnings(metric_rows([run])) == []
    assert rule_warnings(metric_rows([Run(info=info(), episodes=(finished(),))], rule="habitat")) == []
    (line,) = rule_warnings(metric_rows([run], rule="habitat"))
    assert line == (
        "Warning: shortest-path was made for rule paper, and is counted here by habitat. "
        "personal-viz run --agent shortest-path --rule habitat walks for it."
    )


def test_metrics_count_successes_and_leave_unreachable_goals_out_of_mean_distances() -> None:
    runs = tuple(finished(str(number), success=success) for number, success in enumerate((True, True, False)))
    easy, total = metric_rows([Run(info=info(), episodes=runs)])
    assert (easy.split, easy.n, easy.k) == ("easy", 3, 2)
    assert (easy.sr, easy.spl, easy.dtg) == pytest.approx((200 / 3, 100 / 3, 2 / 3))
    assert (total.split, total.sr) == ("total", easy.sr)
    undefined = metric_rows([Run(info=info(), episodes=runs[:1])], rule="habitat")[0]
    assert (undefined.n, undefined.undefined, undefined.sr) == (0, 1, None), "counted apart"
    lost = RuleMeasures(success=False, spl=0, soft_spl=0, dtg=None, start_distance=None)
    runs = (finished("1", success=False), finished("2", rules=measured(lost).rules))
    row = metric_rows([Run(info=info(), episodes=runs)])[0]
    assert (row.n, row.unreachable, row.dtg) == (2, 1, 2.0)


def broken(episode_id: str) -> EpisodeRun:
    """A run that ended with a technical failure."""
    run = finished(episode_id, success=False)
    return run.model_copy(update={"end": run.end.model_copy(update={"reason": "technical"})})


def test_technical_failures_are_left_out_of_every_row() -> None:
    right = AnswerMeasures(success=True, top3_success=True, planar_distance=0.2, distance_3d=0.5)
    wrong = AnswerMeasures(success=False, top3_success=False, planar_distance=None, distance_3d=None)
    names = {"split": "easy", "scene": "Demo"}
    answers = (
        Answer(**names, episode_id="4", candidates=((1.0, 0.0, 2.0),), scores=(0.5,), measures=right),
        Answer(**names, episode_id="5", candidates=(), reason="technical", measures=wrong),
        Answer(**names, episode_id="6", candidates=(), reason="technical"),
    )
    runs = (finished("1"), finished("2", success=False), broken("3"))
    pan, _, pog, _ = metric_rows([Run(info=info(), episodes=runs, answers=answers)])
    assert (pan.task, pan.n, pan.k, pan.sr, pan.spl, pan.dtg) == ("pan", 2, 1, 50.0, 25.0, 1.0)
    assert (pog.task, pog.n, pog.k, pog.sr, pog.top3) == ("pog", 1, 1, 100.0, 100.0)
    nothing = metric_rows([Run(info=info(), episodes=(broken("3"),))])
    assert [(row.n, row.sr, row.dtg) for row in nothing] == [(0, None, None), (0, None, None)]


def test_two_seeds_of_an_agent_are_pooled_but_runs_on_other_episode_files_are_refused() -> None:
    first = Run(info=info(run_id="a", seed=0), episodes=(finished("1"),))
    second = Run(info=info(run_id="b", seed=1), episodes=(finished("1", success=False),))
    assert [(row.n, row.k) for row in metric_rows([first, second])] == [(2, 1), (2, 1)]
    other = Run(info=info(run_id="c", dataset_digest="e"), episodes=(finished("2"),))
    with pytest.raises(
        RunFileError,
        match=r"found dataset_digest d \(a, edition own\), e \(c, edition own\); expected runs on the same",
    ) as caught:
        metric_rows([first, other])
    assert "\n" not in str(caught.value)
    strangers = [first.info, other.info.model_copy(update={"who": "human"})]
    with pytest.raises(RunFileError, match="expected runs on the same episode files"):
        require_comparable(strangers)


def test_rows_name_the_edition_and_those_of_two_agents_on_two_editions_are_refused() -> None:
    first, second = (
        Run(info=info(run_id=who, who=who, dataset_digest=digest * 10), episodes=(finished(),))
        for who, digest in (("a", "a21ece7a650d"), ("b", "804b31a5da9b"))
    )
    assert {row.edition for row in metric_rows([first])} == {"2025-09 (data/split)"}
    with pytest.raises(RunFileError, match=r"edition 2025-12 .* expected runs on the same episode files"):
        metric_rows([first, second])


def test_runs_with_and_without_labels_never_share_a_table() -> None:
    plain = Run(info=info(run_id="plain"), episodes=(finished("1"),))
    named = Run(info=info(run_id="named", labels=True, who="other"), episodes=(finished("1"),))
    assert [row.who for row in metric_rows([named]) if row.split == "total"] == ["other"]
    message = r"categories of objects written on them \(named\) and without \(plain\).*Give them separately.*--labels"
    with pytest.raises(RunFileError, match=message) as caught:
        metric_rows([plain, named])
    assert "\n" not in str(caught.value)
    wrong = AnswerMeasures(success=False, top3_success=False, planar_distance=None, distance_3d=None)
    answer = Answer(split="easy", scene="Demo", episode_id="4", candidates=(), measures=wrong)
    pointed = Run(info=info(run_id="pointed"), answers=(answer,))
    assert {row.task for row in metric_rows([named, pointed])} == {"pan", "pog"}, "answers come without such pictures"


@pytest.mark.parametrize(
    ("changed", "had_labels"),
    [
        ({}, True),
        ({"condition": "clutter 1"}, True),
        ({"condition": "memory_glb", "who_kind": "human"}, True),
        ({"schema_version": 1}, True),
        ({"scene_kind": "invented"}, False),
        ({"scene_kind": "scan"}, False),
        ({"condition": "map_open", "who_kind": "human"}, False),
        ({"condition": "explored grid, hashed, phrases dataset"}, False),
        ({"config": {"imported": "runs.csv"}}, False),
        ({"schema_version": 3}, False),
    ],
)
def test_older_pan_runs_in_schematic_homes_had_labels(changed: dict, had_labels: bool) -> None:
    written_then = {"schema_version": 2, "scene_kind": "schematic"} | changed
    raw = info().model_dump(mode="json", exclude={"labels"}) | written_then
    assert RunInfo.model_validate_json(json.dumps(raw), strict=True).labels is had_labels


def test_metrics_refuse_runs_without_distances() -> None:
    unmeasured = finished().model_copy(update={"end": EpisodeEnd(reason="stop")})
    with pytest.raises(RunFileError, match=r'holds no measures for easy/Demo/1.*"personal-viz import" first'):
        metric_rows([Run(info=info(), episodes=(unmeasured,))])


def test_metrics_refuse_a_trial_that_would_count_twice_but_pool_seeds() -> None:
    first, again, other = (
        Run(info=info(run_id=name, seed=seed), episodes=(finished(),)) for name, seed in (("a", 0), ("b", 0), ("c", 1))
    )
    assert metric_rows([first, other])[0].n == 2
    with pytest.raises(RunFileError, match=r"b: found easy/Demo/1 a second time \(first in a\)"):
        metric_rows([first, again])
    with pytest.raises(RunFileError, match="a second time"):
        metric_rows([first, first])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"spl":0.5', '"spl":7.0', r"spl is 7\.0; expected"),
        ('"dtg":0.0', '"dtg":-3.0', r"dtg is -3\.0; expected"),
        ('"habitat":null,', "", "rules"),
        ('"num_steps":2', '"num_steps":3', "the block is not whole"),
    ],
)
def test_impossible_measures_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path, finished()) / "steps.jsonl"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RunFileError, match=message):
        read_run(path.parent)

"""A study of home sequences by bots, from its plan to its report: four people do one sequence in the home Small.

p01 walks and p02 points with the history in view, and hear everything; p03 and p04 have no history and hear nothing.
"""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from pydantic import ValidationError

from human_study.design.plan import StudyScene
from human_study.design.planning import make_plan
from human_study.design.sampling import sample_episodes
from human_study.design.study import StudyConfig, load_study, save_study
from human_study.export.import_check import import_check
from human_study.export.manifest import MANIFEST_FILE, Manifest, exported_file, read_manifest
from human_study.export.study_export import export_study
from human_study.export.verify import TrialHome, verify_trial
from human_study.sequence_report.measures import SequenceStudyReport, sequence_report
from human_study.sequence_report.source import read_sequences
from human_study.sequence_report.text import sequence_csv, sequence_html, sequence_markdown
from human_study.store.records import read_study
from human_study.trial.events import SearchBegun
from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError
from sim.sequences.rows import sequence_rows
from sim.sequences.runs import SequenceRun, read_sequence_runs
from sim.sequences.searches import sequence_key
from sim.sequences.writer import SequenceWriter
from sim.tasks.provenance import make_run_info
from sim.types import EpisodeKey, SceneKind
from tests.sim.home_story import MESSAGES, SCENE, SUBTASKS, told_in

from .finished import table_of
from .sequence_trials import clicks, do_sequence, home_of, oracle_run, presses, sequence_study
from .small_world import study
from .stores import do_next, open_planned

CONFIG = sequence_study(sequences={"sha256": "5" * 64, "history": "both"})


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """Folder of the set, and its sequence."""
    out = tmp_path_factory.mktemp("set")
    return out, told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)


@pytest.fixture(scope="module")
def home(small_home_root: Path, told: tuple[Path, HomeSequence]) -> TrialHome:
    return home_of(small_home_root, [told[1]])


@pytest.fixture(scope="module")
def finished(
    small_home_root: Path, told: tuple[Path, HomeSequence], home: TrialHome, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder with the `study` and its export `out`; nobody writes to it."""
    folder, (root, story) = tmp_path_factory.mktemp("finished"), told
    plan = make_plan(CONFIG, [StudyScene(name=SCENE, kind="invented")], [sequence_key(story)], is_pilot=True)
    with open_planned(folder / "study", CONFIG, plan) as store:
        for person in plan.participants:
            (trial,) = person.trials
            is_deaf = trial.condition == "history_hidden"
            commands = list(clicks(story, home, is_deaf=is_deaf))
            if person.task == "pan":
                commands = list(presses(oracle_run(small_home_root, root, story, is_deaf=is_deaf)))
            do_sequence(store, person.code, trial.order_no, story, home, commands)
    export_study(folder / "study", folder / "out")
    return folder


def test_people_and_histories_are_dealt_as_memory_arms_are(finished: Path) -> None:
    with read_study(finished / "study") as reader:
        people = reader.plan.participants
    assert [(one.task, one.arm, one.trials[0].condition) for one in people] == [
        ("pan", 0, "history_visible"),
        ("pog", 0, "history_visible"),
        ("pan", 1, "history_hidden"),
        ("pog", 1, "history_hidden"),
    ]


def test_every_trial_is_done_again_and_agrees(finished: Path, home: TrialHome) -> None:
    with read_study(finished / "study") as reader:
        for code in reader.codes():
            (trial,) = reader.trials(code)
            assert trial.trial_id is not None
            assert trial.outcome is not None
            events = [stored.event for stored in reader.events(trial.trial_id)]
            names = {"home": home, "participant": code}
            done = verify_trial(events, trial.outcome, trial.key, **names)
            assert (done.status, done.detail) == ("verified", "")
            searches = [search.model_copy(update={"is_after_news": True}) for search in trial.outcome.searches]
            other = trial.outcome.model_copy(update={"searches": tuple(searches)})
            assert "searches[0].is_after_news" in verify_trial(events, other, trial.key, **names).detail
            told = [
                event.model_copy(update={"notes": ()}) if isinstance(event, SearchBegun) else event for event in events
            ]
            assert verify_trial(told, trial.outcome, trial.key, **names).status == "failed"


def test_an_export_holds_runs_as_agents_have_and_a_row_for_each_search(finished: Path, home: TrialHome) -> None:
    out = finished / "out"
    folders = sorted(path.parent for path in out.glob("*/run.json"))
    runs = [run for folder in folders for run in read_sequence_runs(folder)]
    trials = [(line["task"], line["participant"]) for line in table_of(out, "trials")]
    assert sorted(task for task, _ in trials) == ["pan", "pan", "pog", "pog"]
    assert sorted(person for _, person in trials) == ["p01", "p02", "p03", "p04"]
    assert sorted((run.start.task, run.start.participant) for run in runs) == sorted(trials)
    rows = {(row.task, row.condition): row.sequence_measures for row in sequence_rows(folders)}
    for (_, condition), figures in rows.items():
        wrong = 0 if condition == "history_hidden" else 1
        assert (figures.sr_fresh, figures.sr_revisit, figures.sr_changed, figures.sr_stale) == (1, 1, wrong, wrong)
        assert figures.stale == 1 - wrong
    assert len(rows) == 4
    lines = table_of(out, "searches")
    assert len(lines) == 4 * 6
    hidden = {line["participant"] for line in table_of(out, "trials") if line["condition"] == "history_hidden"}
    shown = [line for line in lines if line["participant"] in hidden]
    assert {(line["search"], tuple(line["notes"]), line["is_told"]) for line in shown} == {
        (0, ("0",), True), (1, (), False), (2, ("1",), True), (3, ("2",), True), (4, (), False), (5, (), False),
    }  # fmt: skip
    assert "## searches" in (out / "data_dictionary.md").read_text()
    assert import_check(out, lambda _: home).agrees


@pytest.fixture(scope="module")
def reported(
    finished: Path, told: tuple[Path, HomeSequence], small_home_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> SequenceStudyReport:
    """People beside an agent of each task and agents that fit no people, from the study as from its export."""
    agents = tmp_path_factory.mktemp("agents")
    walk = oracle_run(small_home_root, told[0], told[1], is_deaf=False)
    write_agent(agents / "oracle", walk)
    write_agent(agents / "elsewhere", walk, sequences="6" * 64)
    write_agent(agents / "cluttered", walk, clutter=1)
    write_agent(agents / "paraphrased", walk, query_index=1)
    write_agent(agents / "quick", walk, max_steps=100)
    searches = [
        one.model_copy(update={"measures": one.measures and one.measures.model_copy(update={"scene_digest": "9" * 64})})
        for one in walk.end.searches
    ]
    end = walk.end.model_copy(update={"searches": tuple(searches)})
    write_agent(agents / "rebuilt", walk.model_copy(update={"end": end}))
    found = read_sequences([finished / "study"])
    assert found is not None
    (pointed,) = next(runs for info, runs in found.people if info.run_id.endswith("pog-history_visible"))
    start = pointed.start.model_copy(update={"participant": None})
    write_agent(agents / "maps", pointed.model_copy(update={"start": start}), who="pointer", kind="oracle-map")
    reports = []
    for folder in (finished / "study", finished / "out"):
        source = read_sequences([folder, agents])
        assert source is not None
        reports.append(sequence_report(source))
    assert reports[0] == reports[1]
    return reports[0]


def test_the_report_has_the_measures_of_agents_by_history(reported: SequenceStudyReport) -> None:
    rows = {(one.row.task, one.row.who, one.row.condition): one for one in reported.rows}
    assert list(rows) == [
        ("pan", "human", "history_visible"),
        ("pan", "human", "history_hidden"),
        ("pan", "shortest-path", "none"),
        ("pog", "human", "history_visible"),
        ("pog", "human", "history_hidden"),
        ("pog", "pointer", "none"),
    ]
    assert {one.row.scene_kind for one in reported.rows} == {"invented"}
    for (_, who, condition), one in rows.items():
        right = 0 if condition == "history_hidden" else 1
        found = one.row.sequence_measures
        assert (found.sr_fresh, found.sr_changed, found.sr_stale, found.stale) == (1, right, right, 1 - right)
        assert (one.num_people, one.num_sequences, one.num_homes) == (int(who == "human"), 1, 1)
    shown = {(row.condition, row.kind): row for row in reported.exposure if row.task == "pog"}
    changed = shown["history_hidden", "changed"]
    assert (changed.n, changed.num_told, changed.right_told, changed.right_untold) == (2, 1, 0, 0)
    assert shown["history_visible", "all"].num_told == shown["history_visible", "all"].n == 6


def test_people_stand_beside_each_other_and_beside_agents_of_the_same_sequences(reported: SequenceStudyReport) -> None:
    points = {(row.task, row.first, row.second, row.kind): row.value for row in reported.differences}
    visible, hidden = "human (history visible)", "human (history hidden)"
    assert points["pan", visible, hidden, "changed"] == 1
    assert points["pan", visible, "shortest-path", "all"] == 0
    assert points["pan", hidden, "shortest-path", "stale"] == -1
    assert points["pog", visible, "pointer", "all"] == 0
    assert points["pog", hidden, "pointer", "all"] == -0.5
    assert [(left.run, left.reason) for left in reported.left_out_runs] == [
        ("cluttered", "was in homes with other clutter (1) than people (0)"),
        ("elsewhere", "is on other sequences (666666666666) than people (555555555555)"),
        ("paraphrased", "read other paraphrases of the queries (1) than people (0)"),
        ("quick", "had other steps for a search (100) than people (500)"),
        ("rebuilt", "was in another version of home Small (999999999999) than people"),
    ]


def test_the_report_is_written_as_text_page_and_table(reported: SequenceStudyReport) -> None:
    text, label = sequence_markdown(reported), reported.scene_labels[0]
    assert "| Human (history hidden) | 1 | 1 | 1 | 50.0 | 100.0 | 100.0 | 0.0 | 0.0 | 100.0 |" in text
    assert label in text
    assert reported.not_shown in text
    assert "Messages that people could read</h2>" in sequence_html(reported)
    heads, *lines = sequence_csv(reported).splitlines()
    assert heads.endswith("measure,value,low,high,n_sequences,n_searches")
    assert any(line.startswith("pan,invented,") and line.endswith("history_visible,all,sr,1.0,,,1,6") for line in lines)
    assert f'pan,invented,"{label}",human (history visible) - shortest-path,,all,sr,0.0,,,,12' in lines


def write_agent(
    folder: Path, run: SequenceRun, *, who: str = "shortest-path", kind: SceneKind = "invented", **config: str | int
) -> None:
    """A run folder of an agent on the study's set, with these entries in its `config`."""
    info = make_run_info(
        folder.name,
        who=who,
        who_kind="agent",
        scene_kind=kind,
        dataset_digest=CONFIG.dataset.sha256,
        seed=0,
        config={"sequences": "5" * 64, **config},
    )
    SequenceWriter(folder, info).add_sequence(run)


def test_an_excluded_trial_counts_and_is_named(finished: Path, home: TrialHome, tmp_path: Path) -> None:
    folder, out = Path(shutil.copytree(finished / "study", tmp_path / "study")), tmp_path / "out"
    before = read_sequences([folder])
    with read_study(folder) as reader:
        plan = reader.plan
        (trial,) = reader.trials("p01")
    assert trial.trial_id is not None
    with open_planned(folder, CONFIG, plan) as store:
        store.exclude("trial", trial.trial_id, rule_id="disturbed", reason="the telephone rang")
    export_study(folder, out)
    assert import_check(out, lambda _: home).agrees
    assert read_manifest(out).left_out == (), "it is in its run folder"
    assert before is not None
    for one in (folder, out):
        source = read_sequences([one])
        assert source is not None
        report, earlier = sequence_report(source), sequence_report(before)
        assert (report.rows, report.exposure, report.ends) == (earlier.rows, earlier.exposure, earlier.ends)
        assert [(row.rule_id, row.num_trials) for row in report.exclusions] == [("disturbed", 1)]
        assert "excludes 1 trials of 1 people, which count all the same: the telephone rang." in sequence_markdown(
            report
        )


def test_intervals_of_the_report_take_homes_for_random(finished: Path) -> None:
    source = read_sequences([finished / "study"])
    assert source is not None
    (seen, (right,)), (unseen, (half_right,)) = [one for one in source.people if one[1][0].start.task == "pan"]
    if seen.condition == "history_hidden":
        seen, right, unseen, half_right = unseen, half_right, seen, right

    def elsewhere(run: SequenceRun, whose: SequenceRun) -> SequenceRun:
        return run.model_copy(update={"start": whose.start.model_copy(update={"scene": "Elsewhere"})})

    pointing = [one for one in source.people if one[1][0].start.task == "pog"]
    people = ((seen, (right, elsewhere(right, right))), (unseen, (half_right, elsewhere(right, half_right))), *pointing)
    report = sequence_report(dataclasses.replace(source, people=people))
    hidden = next(one for one in report.rows if one.row.condition == "history_hidden")
    half = 12.7062 / 4  # t of 1 degree; homes' shares are 0.5 and 1
    figures = hidden.row.sequence_measures
    assert (hidden.num_homes, figures.sr) == (2, 0.75)
    assert figures.intervals["sr"] == pytest.approx((0, 1), abs=1e-4)
    assert figures.intervals["partial"] == pytest.approx((0, 1), abs=1e-4)
    row = next(one for one in report.differences if one.kind == "all")
    assert (row.value, row.num_first, row.num_second) == (0.25, 12, 12)
    assert (row.low, row.high) == pytest.approx((0.25 - half, 0.25 + half), abs=1e-4)
    text = sequence_markdown(report)
    assert "75.0 [0.0, 100.0]" in text
    assert "+25.0 [-100.0, 100.0]" in text


def test_messages_in_view_are_counted_by_the_rule_of_the_report(finished: Path) -> None:
    source = read_sequences([finished / "out"])
    assert source is not None
    for rule, num_right in (("paper", 6), ("habitat", 1)):
        report = sequence_report(source, rule=rule)
        row = next(one for one in report.rows if (one.row.task, one.row.condition) == ("pan", "history_visible"))
        shown = next(one for one in report.exposure if (one.task, one.condition) == ("pan", "history_visible"))
        assert (shown.kind, shown.num_told, shown.right_told) == ("all", 6, num_right)
        assert row.row.sequence_measures.sr == pytest.approx(num_right / 6)
    people = [(info, tuple(map(without_a_point, runs))) for info, runs in source.people]
    report = sequence_report(dataclasses.replace(source, people=tuple(people)))
    shown = next(one for one in report.exposure if (one.task, one.condition) == ("pan", "history_visible"))
    assert (shown.kind, shown.n, shown.right_told) == ("all", 5, 5), "an undefined success is not wrong"


def without_a_point(run: SequenceRun) -> SequenceRun:
    """The run, whose first search has no usable point under the paper's rule."""
    first, *others = run.end.searches
    if first.measures is not None:
        rules = {**first.measures.rules, "paper": None}
        first = first.model_copy(update={"measures": first.measures.model_copy(update={"rules": rules})})
    return run.model_copy(update={"end": run.end.model_copy(update={"searches": (first, *others)})})


def test_a_person_who_withdraws_vanishes_from_export_and_report(
    finished: Path, home: TrialHome, tmp_path: Path
) -> None:
    folder, out = Path(shutil.copytree(finished / "study", tmp_path / "study")), tmp_path / "out"
    with read_study(folder) as reader:
        plan = reader.plan
    with open_planned(folder, CONFIG, plan) as store:
        store.withdraw("p01")
    export_study(folder, out)
    assert import_check(out, lambda _: home).agrees
    done = {("pan", "history_hidden"), ("pog", "history_visible"), ("pog", "history_hidden")}
    conditions = {line["participant"]: (line["task"], line["condition"]) for line in table_of(out, "trials")}
    lines = table_of(out, "searches")
    assert {conditions[line["participant"]] for line in lines} == done
    assert len(lines) == 3 * 6
    for one in (folder, out):
        source = read_sequences([one])
        assert source is not None
        rows = sequence_report(source).rows
        assert {(row.row.task, row.row.condition) for row in rows} == done
        assert {row.num_people for row in rows} == {1}


def test_nobody_meets_a_home_twice_even_where_others_leave(tmp_path: Path) -> None:
    design = {"kind": "house-once", "raters_per_episode": 1, "overbook": 2.0}
    dataset = {"sha256": "0" * 64, "max_per_scene": None}
    config = sequence_study(
        task=("pan",), design=design, dataset=dataset, sequences={"sha256": "0" * 64, "history": "both"}
    )
    keys = [EpisodeKey("hard", name, str(number)) for name in "ABC" for number in range(2)]
    plan = make_plan(config, [StudyScene(name=name, kind="invented") for name in "ABC"], keys, is_pilot=True)
    with open_planned(tmp_path, config, plan) as store:
        codes = [person.code for person in plan.participants]
        do_next(store, codes[0])
        store.withdraw(codes[0])
        homes: dict[str, list[str]] = {}
        for code in codes[1:]:
            while (trial := store.next_trial(code)) is not None:
                homes.setdefault(code, []).append(trial.key.scene)
                do_next(store, code)
    assert sum(map(len, homes.values())) == 2 * len(keys), "the homes of the person who left are done by others"
    assert [met for met in homes.values() if len(set(met)) < len(met)] == []


def test_the_command_writes_the_report(finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from personal_viz.cli.study.report import StudyReportVerb

    source = read_sequences([finished / "out"])
    assert source is not None
    write_agent(tmp_path / "elsewhere", source.people[0][1][0], sequences="6" * 64)
    assert StudyReportVerb((finished / "out", tmp_path / "elsewhere"), out=tmp_path / "report").run() == 0
    printed = capsys.readouterr().out
    assert "PAN: Human (history" in printed
    assert "Left out: elsewhere: is on other sequences" in printed
    assert {path.name for path in (tmp_path / "report").iterdir()} == {
        "report.md", "report.html", "report.csv", "report.json",
    }  # fmt: skip
    with pytest.raises(StudyError, match="expected neither"):
        StudyReportVerb((finished / "out",), overlays=True).run()


def test_a_changed_row_of_a_search_is_found(finished: Path, home: TrialHome, tmp_path: Path) -> None:
    out = Path(shutil.copytree(finished / "out", tmp_path / "out"))
    text = (out / "searches.jsonl").read_text().replace('"is_told":true', '"is_told":false', 1)
    (out / "searches.jsonl").write_text(text)
    manifest = Manifest.model_validate_json((out / MANIFEST_FILE).read_bytes())
    entry = manifest.files["searches.jsonl"]
    files = {**manifest.files, "searches.jsonl": exported_file(text.encode(), entry.num_rows)}
    (out / MANIFEST_FILE).write_text(manifest.model_copy(update={"files": files}).model_dump_json())
    (problem,) = import_check(out, lambda _: home).problems
    assert "is_told is stored as False, recomputed as True" in problem


def test_sequences_are_drawn_evenly_over_homes_whatever_their_split() -> None:
    pool = [EpisodeKey(split, home, str(n)) for home in "ABC" for split in ("easy", "hard") for n in range(4)]
    drawn = sample_episodes(sequence_study(sequences={"sha256": "0", "number": 7}), pool)
    assert sorted(sum(key.scene == home for key in drawn) for home in "ABC") == [2, 2, 3]
    everything = sequence_study(sequences={"sha256": "0"}, dataset={"sha256": "0", "max_per_scene": None})
    assert sample_episodes(everything, pool) == tuple(sorted(pool))
    with pytest.raises(StudyError, match=r"sequences\.number asks for 24, the set with at most 5 of one home gives 15"):
        sample_episodes(sequence_study(), pool)


def test_a_study_without_the_block_is_as_before(tmp_path: Path) -> None:
    without = StudyConfig.model_validate(json.loads(CONFIG.model_dump_json()) | {"sequences": None})
    assert "sequences" not in json.loads(without.canonical_json())
    assert "\nsequences:" not in (save_study(tmp_path / "old", without)).read_text()
    assert load_study(tmp_path / "old") == without
    assert "\nsequences:\n" in (save_study(tmp_path / "new", CONFIG)).read_text()
    assert load_study(tmp_path / "new") == CONFIG
    with open_planned(tmp_path / "store", study()), read_study(tmp_path / "store") as reader:
        (stored,) = reader.rows("SELECT config FROM study")
    assert "sequences" not in json.loads(stored[0])


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"memory": {"arms": ("none", "topdown")}}, "one of memory.arms beside sequences"),
        ({"pog": {"conditions": ("map_open", "map_2d")}}, "one of pog.conditions beside sequences"),
        ({"confidence": True}, "confidence: false beside sequences"),
        ({"primary": ("human_minus_agent_SR",)}, "no primary beside sequences"),
    ],
)
def test_choices_that_do_not_go_with_sequences_are_refused(changes: dict, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        sequence_study(**changes)

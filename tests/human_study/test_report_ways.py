"""The ways of trials in a report: beside the shortest path, of two people, and of people and agents."""

import csv
import io
import math
from collections.abc import Sequence

import numpy as np
import pytest

from human_study.report.render import csv_text, markdown
from human_study.report.report import StudyReport, report_groups, report_of
from human_study.report.source import ReportSource
from human_study.report.ways import ShortestPaths, ways_csv
from sim.tasks.run_files import Run
from sim.types import EpisodeKey

from .report_examples import pan_episode, run_info

ONE, TWO = EpisodeKey("easy", "Home", "1"), EpisodeKey("hard", "Home", "2")
METRE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A shortest path of one metre along z, with a place every 25 cm."""


def run(who: str, paths: dict[EpisodeKey, int], code: str | None = None) -> Run:
    """A run whose walks have these numbers of steps of 25 cm along z, of 10 steps in all."""
    episodes = [pan_episode(key, success=True, steps=10, code=code, path=path) for key, path in paths.items()]
    return Run(info=run_info(f"run-{who}-{code}", who), episodes=tuple(episodes))


RUNS = [run("human", {ONE: 4, TWO: 4}, "p01"), run("human", {ONE: 8, TWO: 4}, "p02"), run("walker", {ONE: 4})]


def reported(runs: Sequence[Run], shortest: ShortestPaths | None = None) -> tuple[StudyReport, list[dict[str, str]]]:
    """The report, and the lines of `pan-ways.csv`."""
    source = ReportSource(tuple(runs))
    groups = report_groups(source, shortest=shortest)
    lines = csv.DictReader(io.StringIO(ways_csv((*groups.people, *groups.agents), groups.pairs)))
    return report_of(source, groups), list(lines)


def test_trials_are_compared_with_the_shortest_path_in_tables_with_intervals() -> None:
    found, lines = reported(RUNS, {ONE: METRE, TWO: METRE})
    values = {(row.who, row.split, row.measure): row.value for row in found.rows}
    # p02 walks 9 places, of which the last four are 0.25, 0.5, 0.75 and 1 m beyond the end of the path's 5 places
    assert values["human", "easy", "dtw"] == pytest.approx((0 + 2.5 / 9) / 2)
    assert values["human", "easy", "ndtw"] == pytest.approx((1 + math.exp(-2.5 / 5)) / 2)
    assert values["human", "easy", "end_apart"] == pytest.approx(0.5)
    assert values["human", "hard", "ndtw"] == pytest.approx(1)
    assert values["walker", "easy", "ndtw"] == pytest.approx(1)
    assert values["human - walker", "easy", "end_apart"] == pytest.approx(0.5)
    beside = {(line["participant"], line["episode"]): line for line in lines if line["other"] == "shortest path"}
    assert len(beside) == 5
    assert float(beside["run-human-p02/p02", str(ONE)]["ndtw"]) == pytest.approx(math.exp(-0.5))
    text = markdown(found)
    assert "| nDTW with the shortest path | easy | hard | total |" in text
    assert "ndtw" in csv_text(found)


def test_two_people_and_a_person_and_an_agent_are_compared_without_homes() -> None:
    found, lines = reported(RUNS)
    assert not any(row.measure == "ndtw" for row in found.rows)
    people, beside = found.ways
    assert (people.who, people.num_episodes, people.num_pairs, people.num_same) == ("human", 2, 2, 1)
    assert people.dtw_m == pytest.approx((2.5 / 36, 2.5 / 18, 2.5 / 12))  # quartiles of 0 and 2.5 / 9
    assert people.end_m == pytest.approx((0.25, 0.5, 0.75))
    assert people.decision == (5, 5, 5)  # the fifth step moved one of them only
    assert (beside.who, beside.num_episodes, beside.num_pairs, beside.num_same) == ("human - walker", 1, 2, 1)
    assert beside.end_m == pytest.approx((0.5, 0.5, 0.5))
    pair = next(line for line in lines if line["other"] == "run-human-p02/p02" and line["episode"] == str(ONE))
    assert (pair["participant"], pair["decision"], pair["ndtw"]) == ("run-human-p01/p01", "5", "")
    assert float(pair["dtw_m"]) == pytest.approx(2.5 / 9)
    assert "| Human | scan | 2 | 2 | 0.14 (0.07 to 0.21) | 0.50 (0.25 to 0.75) | 5 (5 to 5) | 1 |" in markdown(found)
    assert "| Human and walker | scan | 1 | 2 |" in markdown(found)


def test_a_person_alone_at_every_episode_has_no_pair_and_no_section() -> None:
    found, lines = reported(RUNS[:1])
    assert found.ways == ()
    assert lines == []
    assert "Ways of two trials" not in markdown(found)

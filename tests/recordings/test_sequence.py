"""One recording of runs of a home sequence, read back with Rerun's own reader."""

from pathlib import Path

import numpy as np
import pytest

from recordings.read import read_recorded
from recordings.scene import OLD_RGB
from recordings.sequences.recording import OUTCOME_RGB, PERSON_RGB, THING_RGB, log_sequence
from recordings.traces import best_two, common_sequence, rgba_u32, select_sequence_traces
from sim.episodes.sequence_files import HomeSequence
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.sequences.runs import SequenceRun
from sim.tasks.run_files import RunInfo
from sim.types import Action, EndReason

from .conftest import info
from .reading import SMALL, Tables, column, tables, view_names
from .sequence_worlds import GIVES_UP, KEY, STAYS, lent, pointed, told, walked

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")
Runs = list[tuple[RunInfo, tuple[SequenceRun, ...]]]
FIRST, SECOND, POINTS = "/runs/stays", "/runs/gives-up", "/runs/points"


@pytest.fixture(scope="module")
def runs(home: Scene) -> Runs:
    """Two agents that walk, of which the second one ignores messages, and a grounder."""
    sequence = told()
    return [
        (info("stays"), (walked(home, sequence, STAYS),)),
        (info("gives-up", condition="messages ignored"), (walked(home, sequence, GIVES_UP),)),
        (info("points", scene_kind="oracle-map"), (pointed(sequence),)),
    ]


def recorded(out: Path, runs: Runs, home: Scene, *, sequence: HomeSequence | None = None) -> Tables:
    story = sequence or told()
    log_sequence(runs, sequence=story, scene=home, out=out, renderer=None, with_pixels=False, camera=SMALL)
    return tables(out)


@pytest.fixture(scope="module")
def rrd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("rrd") / "told.rrd"


@pytest.fixture(scope="module")
def found(rrd: Path, runs: Runs, home: Scene) -> Tables:
    return recorded(rrd, runs, home)


def test_messages_and_queries_come_when_the_search_begins_for_all_runs(found: Tables) -> None:
    log = found[("/sequence/told", False)]
    texts = [row[0] for row in log["TextLog:text"]]
    assert list(zip(log["together"], log["step"], texts, strict=True)) == [
        (0, 0, "intro: Nell owns the red table. Ivo owns the blue table."),
        (0, 0, "search 1 (fresh): Find Nell's table"),
        (41, 40, "swap: Nell and Ivo swapped tables."),
        (41, 40, "search 2 (changed): Find Nell's table"),
        (44, 41, "search 3 (changed): Find Ivo's table"),
    ]


def test_the_end_of_a_loan_has_its_line_and_its_graph(home: Scene, tmp_path: Path) -> None:
    loan = lent()
    found = recorded(tmp_path / "loan.rrd", [(info("points"), (pointed(loan),))], home, sequence=loan)
    texts = [row[0] for row in found[("/sequence/told", False)]["TextLog:text"]]
    assert texts[-2:] == ["loan ends: Nell lent Una a table for one search.", "search 3 (revisit): Find Ivo's table"]
    assert "table_3 (was Una's)" in found[("/sequence/owners", False)]["GraphNodes:labels"][-1]


def test_a_person_stands_beside_the_best_agent_with_their_code(home: Scene, tmp_path: Path) -> None:
    sequence = told()
    run = walked(home, sequence, GIVES_UP)
    person = run.model_copy(update={"start": run.start.model_copy(update={"participant": "p01"})})
    human = info("people", who="human", who_kind="human", condition="history_visible")
    agents = [(info(name), (walked(home, sequence, STAYS),)) for name in ("stays", "again")]
    traces = select_sequence_traces([*agents, (human, (person,))], KEY)
    assert [trace.title for trace in best_two(traces)] == ["human-p01, history_visible", "stays"]
    recorded(tmp_path / "people.rrd", [*agents, (human, (person,))], home)
    views = view_names(tmp_path / "people.rrd")
    assert {"human-p01, history_visible sees", "stays sees"} <= views
    assert "again sees" not in views


def test_the_graph_shows_edges_before_and_after_a_message_and_what_changed_hands(found: Tables) -> None:
    graph = found[("/sequence/owners", False)]
    assert graph["together"] == [0, 41, 44]
    first, swapped = {("Nell", "table_3"), ("Ivo", "table_4")}, {("Nell", "table_4"), ("Ivo", "table_3")}
    assert [{tuple(edge.values()) for edge in row} for row in graph["GraphEdges:edges"]] == [first, swapped, swapped]
    was = ["Nell", "Ivo", "table_3 (was Nell's)", "table_4 (was Ivo's)"]
    assert graph["GraphNodes:labels"] == [
        ["Nell", "Ivo", "table_3", "table_4"],
        was,
        ["Nell", "Ivo", "table_3", "table_4"],
    ]
    people, thing, changed = rgba_u32(PERSON_RGB), rgba_u32(THING_RGB), rgba_u32(OLD_RGB)
    assert graph["GraphNodes:colors"] == [[people] * 2 + [rgb] * 2 for rgb in (thing, changed, thing)]
    assert graph["GraphNodes:positions"][0] == graph["GraphNodes:positions"][1]


def test_each_search_has_its_own_way_and_each_found_its_mark(found: Tables) -> None:
    steps = [found[(f"{FIRST}/trail/search_{number}", False)]["step"] for number in (1, 2, 3)]
    assert steps == [list(range(1, 41)), [41], [42]]
    assert found[(f"{FIRST}/trail/search_2", False)]["together"] == [42]
    colors = [found[(f"{FIRST}/trail/search_{number}", True)]["LineStrips3D:colors"] for number in (1, 2, 3)]
    assert len({str(color) for color in colors}) == 3
    marks = found[(f"{FIRST}/found_marks", False)]
    assert marks["step"] == [40, 41, 42]
    assert [row[0] for row in marks["Points3D:labels"]] == ["1 right", "2 at the old object", "3 right"]
    rgbs = [rgba_u32(OUTCOME_RGB[outcome]) for outcome in ("right", "at the old object", "right")]
    assert [row[0] for row in marks["Points3D:colors"]] == rgbs
    assert found[(f"{FIRST}/map/storey_0/found_marks", False)]["together"] == [40, 42, 45]
    assert [row[0] for row in found[(f"{SECOND}/found_marks", False)]["Points3D:labels"]] == ["1 wrong", "2 wrong"]
    told_of = [row[0] for row in found[(f"{SECOND}/outcomes", False)]["TextLog:text"]]
    assert told_of[-1] == "gives-up, messages ignored, search 3: STOP, wrong, 1 steps, 0.0 m"


def test_the_right_object_and_the_old_one_change_with_the_search(found: Tables) -> None:
    assert column(found, "/goal/centre", "Points3D:labels") == [["table_3"], ["table_4"], ["table_3"]]
    assert column(found, "/goal/old", "Points3D:labels") == [[], ["before: table_3"], ["before: table_4"]]
    apart = [row[0] for row in found[(f"{FIRST}/centre_distance", False)]["Scalars:scalars"]]
    assert [apart[40], apart[41], apart[42]] == pytest.approx([np.hypot(0.1, 0.75), np.hypot(5.9, 0.75), apart[40]])


def test_points_of_a_pog_run_stand_on_the_same_time_line_and_go_with_the_next_search(found: Tables) -> None:
    points = found[(f"{POINTS}/map/storey_0/candidates", False)]
    shown = dict(zip(points["together"], points["Points2D:labels"], strict=True))
    assert shown == {
        1: ["points 1: right", "points 2"],
        41: [],
        42: [],
        44: [],
        45: ["points 1: at the old object"],
    }
    assert [row[0] for row in found[(f"{POINTS}/outcomes", False)]["TextLog:text"]][1] == (
        "points, search 2: gave up, wrong"
    )


def test_searches_of_people_that_end_without_found_have_their_outcome(home: Scene, tmp_path: Path) -> None:
    actions: list[Action | EndReason] = [Action.LEFT, "giveup", "giveup", Action.LEFT, "timeout"]
    found = recorded(tmp_path / "people.rrd", [(info("stays"), (walked(home, told(), actions),))], home)
    log = found[(f"{FIRST}/outcomes", False)]
    assert [row[0] for row in log["TextLog:text"]] == [
        "stays, search 1: gave up, wrong, 1 steps, 0.0 m",
        "stays, search 2: gave up, wrong, 0 steps, 0.0 m",
        "stays, search 3: out of time, wrong, 1 steps, 0.0 m",
    ]
    assert log["together"] == [1, 2, 5]


def test_the_layout_has_a_map_for_each_run_and_the_text_a_table_of_searches(rrd: Path, found: Tables) -> None:
    assert {
        *("Who owns what", "Told, asked, found", "Home", "stays sees", "gives-up, messages ignored sees"),
        *("Map: stays", "Map: gives-up, messages ignored", "Map: points"),
    } <= view_names(rrd)
    text = found[("/task", True)]["TextDocument:text"][0][0]
    results = "at the old object, 1 steps, 0.0 m | wrong, 2 steps, 0.0 m | gave up, wrong"
    assert f"| 2 | changed | Find Nell's table | {results} |" in text
    assert "BoxHouse (invented home)" in text


def test_runs_come_back_and_are_recorded_with_the_same_content_again(
    rrd: Path, found: Tables, runs: Runs, home: Scene, tmp_path: Path
) -> None:
    back = read_recorded(rrd)
    assert (list(back.sequences), back.runs, back.incomplete) == (runs, [], ())
    assert recorded(tmp_path / "again.rrd", runs, home) == found


def test_a_grounder_alone_is_asked_and_answers_at_its_own_steps(runs: Runs, home: Scene, tmp_path: Path) -> None:
    found = recorded(tmp_path / "points.rrd", runs[2:], home)
    assert found[("/sequence/owners", False)]["step"] == [0, 2, 4]
    assert found[(f"{POINTS}/outcomes", False)]["step"] == [1, 3, 5]


def test_the_common_sequence_is_chosen_and_others_are_refused(runs: Runs, home: Scene, tmp_path: Path) -> None:
    assert common_sequence(runs) == KEY
    with pytest.raises(
        RecordingError, match=r"stays, other: found no sequence that all hold \(stays has 1, other has 0\)"
    ):
        common_sequence([runs[0], (info("other"), ())])
    with pytest.raises(
        RecordingError, match="other: found no run of sequence hard/BoxHouse/told; expected at least one"
    ):
        recorded(tmp_path / "a.rrd", [(info("other"), ())], home)

"""Paths and marks from above: what is drawn where, and the same text every time."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from human_study.report.overlays import floors_needed, overlay_keys, overlay_name, overlay_svg
from human_study.report.trials import TrialGroup, trial_frame
from sim.page_style import light_token
from sim.plan_view.storey import StoreyMap
from sim.tasks.run_files import Answer
from sim.types import EpisodeKey, GridSpec

from .report_examples import pan_episode

KEY = EpisodeKey("easy", "Home", "1")
OTHER = EpisodeKey("hard", "Home", "2")


def walked(key: EpisodeKey, who: str, *, hit: bool, path: int) -> dict[str, object]:
    item = pan_episode(key, success=hit, steps=path, code=who, path=path)
    return {"key": key, "participant": who, "sr": 100.0 * hit, "item": item}


PEOPLE = TrialGroup(
    *("pan", "scan", "human", "human", "none"),
    trial_frame(
        [
            walked(KEY, "p01", hit=True, path=4),
            walked(KEY, "p02", hit=False, path=2),
            walked(OTHER, "p01", hit=True, path=3),
        ]
    ),
)
AGENT = TrialGroup(
    "pan", "scan", "walker & co", "agent", "none", trial_frame([walked(KEY, "walker", hit=False, path=8)])
)


def parts(drawn: str) -> tuple[str, str]:
    """(picture, legend)"""
    picture, frame, legend = drawn.partition(f'fill="none" stroke="{light_token("edge")}"/>')
    assert frame
    return picture, legend


def ends(drawn: str) -> list[tuple[float, str]]:
    """(x, fill) of every mark of the picture."""
    found = re.findall(r'class="mark" (?:d="M|cx=")(-?[\d.]+)[^>]*?fill="([^"]+)"', parts(drawn)[0])
    return [(float(x), fill) for x, fill in found]


def test_everybody_is_drawn_once_with_a_filled_end_for_success() -> None:
    drawn = overlay_svg([PEOPLE, AGENT], KEY, "pan")
    picture, legend = parts(drawn)
    assert (picture.count("<polyline"), legend.count("<polyline")) == (3, 2)
    assert (picture.count("stroke-dasharray"), legend.count("stroke-dasharray")) == (1, 1)  # the agent
    assert sorted(fill == "white" for _, fill in ends(drawn)) == [False, True, True]
    assert "Human: 1 of 2 succeed" in drawn
    assert "walker &amp; co: 0 of 1 succeed" in drawn
    assert overlay_svg([PEOPLE, AGENT], KEY, "pan") == drawn


def test_a_path_has_the_length_that_was_walked() -> None:
    """8 steps of a quarter of a metre are 2 m; the scale is a metre long."""
    drawn = overlay_svg([AGENT], KEY, "pan")
    points = re.search(r'points="([^"]+)"', drawn)
    scale = re.search(r'd="M10 \d+ h([\d.]+)"', drawn)
    places = [tuple(float(x) for x in point.split(",")) for point in points[1].split()]
    assert len(places) == 9
    assert places[-1][1] - places[0][1] == pytest.approx(2 * float(scale[1]), abs=0.3)
    assert places[-1][0] == pytest.approx(places[0][0])
    assert ">1 m</text>" in drawn


def test_a_known_floor_lies_under_the_paths() -> None:
    free = np.zeros((4, 6), bool)
    free[1, 1:5] = free[2, 1:3] = free[2, 4] = True
    storey = StoreyMap(0, 0.0, free, GridSpec((-1.0, -0.5), 0.5, (4, 6)))
    drawn = overlay_svg([PEOPLE], KEY, "pan", storey=storey, targets=[(0.0, 1.0)])
    cells = re.search(r'<path d="([^"]+)" fill="#ffffff"/>', drawn)
    assert cells[1].count("M") == 3  # one run of cells in the first row, two in the second
    assert drawn.count('stroke-dasharray="5 4"') == 1
    assert drawn.index("#ffffff") < drawn.index("<polyline")
    assert "White: where the robot can stand" in drawn
    assert "Right object" in drawn
    bare = overlay_svg([PEOPLE], KEY, "pan")
    assert "The floor is not drawn" in bare
    assert "Right object" not in bare


def test_marks_are_drawn_where_people_pointed() -> None:
    answers = [
        Answer(split="easy", scene="Home", episode_id="1", candidates=((x, 0.4, 2.0),), participant="p01", t_s=3.0)
        for x in (1.0, 3.0)
    ]
    answers.append(answers[0].model_copy(update={"candidates": ()}))
    trials = [{"key": KEY, "participant": f"p0{n}", "sr": 0.0, "item": one} for n, one in enumerate(answers)]
    group = TrialGroup("pog", "scan", "human", "human", "map_open", trial_frame(trials))
    drawn = overlay_svg([group], KEY, "pog")
    assert "<polyline" not in drawn
    centres = [x for x, _ in ends(drawn)]
    scale = re.search(r'd="M10 \d+ h([\d.]+)"', drawn)
    assert max(centres) - min(centres) == pytest.approx(2 * float(scale[1]), abs=0.2)
    assert floors_needed([group], [KEY]) == {KEY: 0.4}


@pytest.mark.parametrize(
    ("kind", "label"),
    [
        ("scan", ""),
        ("invented", "Invented homes, made from a seed: no human baseline for PersONAL"),
        ("schematic", "Schematic homes, recovered from the episode files: no human baseline for PersONAL"),
    ],
)
def test_the_picture_says_which_episode_it_is_and_that_a_home_is_no_scan(kind: str, label: str) -> None:
    drawn = overlay_svg([replace(PEOPLE, scene_kind=kind), replace(AGENT, scene_kind=kind)], KEY, "pan")
    assert 'font-weight="bold">PAN easy/Home/1</text>' in drawn
    assert ("baseline" in drawn) == bool(label)
    assert f">{label}<" in drawn or not label


def test_rows_differ_in_shape_and_in_colour() -> None:
    rows = [replace(PEOPLE, who=f"row {n}", kind="agent", trials=PEOPLE.trials[:1]) for n in range(5)]
    samples = re.findall(
        r'class="mark" (?:d="M22.0 0.0 ([^"]+)"|cx="22.0") ?[^>]*?fill="(#\w+)"', overlay_svg(rows, KEY, "pan")
    )
    assert len({shape for shape, _ in samples}) == 5
    assert len({colour for _, colour in samples}) == 5


def test_the_drawing_of_a_large_home_has_a_longer_scale_and_of_a_narrow_one_room_for_its_legend() -> None:
    far = walked(KEY, "p01", hit=True, path=120)
    assert ">5 m</text>" in overlay_svg([replace(PEOPLE, trials=trial_frame([far]))], KEY, "pan")
    width = re.search(r'<svg [^>]*width="(\d+)"', overlay_svg([AGENT], KEY, "pan"))
    assert int(width[1]) >= 460


def test_every_overlay_is_a_whole_document() -> None:
    storey = StoreyMap(0, 0.0, np.ones((3, 3), bool), GridSpec((-1.0, -0.5), 0.5, (3, 3)))
    for drawn in (
        overlay_svg([PEOPLE, AGENT], KEY, "pan", storey=storey, targets=[(0.0, 0.5)]),
        overlay_svg([], OTHER, "pog"),
    ):
        assert ElementTree.fromstring(drawn).tag == "{http://www.w3.org/2000/svg}svg"


def test_episodes_on_which_people_differ_come_first() -> None:
    assert overlay_keys([PEOPLE, AGENT], "pan", most=1) == [KEY]
    assert overlay_keys([PEOPLE, AGENT], "pan", most=9) == [KEY, OTHER]
    assert overlay_keys([PEOPLE, AGENT], "pog", most=9) == []
    assert overlay_name(KEY, "pan") == "overlay-pan-easy-Home-1.svg"

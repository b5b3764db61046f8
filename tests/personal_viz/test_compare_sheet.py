"""The contact sheet: every storey in use, names as they are, and the end of each run told apart by shape."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from personal_viz.compare.episode_folder import traces_of
from personal_viz.compare.sheet import figures_of, mark_of, sheet_png, thumbnail_jpeg
from personal_viz.compare.sheet_map import STYLES, end_marker, floors_of, style_of
from recordings.scene import goal_region
from sim.homes.renderers import renderer_of
from sim.tasks.run_files import Run

from .compared_runs import Compared

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """A home of two storeys."""
    return Compared(tmp_path_factory.mktemp("sheet"), seed=1)


def test_a_storey_is_drawn_for_each_on_which_somebody_or_the_goal_is(made: Compared) -> None:
    episode = made.episodes[0]
    above, goal = made.scene.navigation.storey_heights[1], goal_region(episode, made.scene.navigation)
    near = Run(info=made.info("near"), answers=(made.answer(episode, (0.2, 0.0, 0.0)),))
    upstairs = Run(info=made.info("up"), answers=(made.answer(episode, (0.0, above, 0.0)),))
    one = floors_of(made.scene, goal, traces_of([near], episode.key), has_map=True)
    two = floors_of(made.scene, goal, traces_of([near, upstairs], episode.key), has_map=True)
    assert [floor.index for floor in one] == [0]
    assert [floor.index for floor in two] == [0, 1]
    sizes = [sheet_size(made, runs) for runs in ([near], [near, upstairs])]
    assert [width for width, _ in sizes] == [1900, 1900]


def sheet_size(made: Compared, runs: list[Run]) -> tuple[int, int]:
    episode = made.episodes[0]
    png = sheet_png(made.scene, episode, traces_of(runs, episode.key), renderer=renderer_of(made.scene))
    return Image.open(io.BytesIO(png)).size


def test_names_that_look_like_mathematics_or_are_in_other_letters_do_no_harm(made: Compared) -> None:
    episode = made.episodes[0]
    walk = made.walk(episode, to_goal=True)
    runs = [Run(info=made.info(f"r{n}", who=who), episodes=(walk,)) for n, who in enumerate((r"$\frac$", "走る人"))]
    assert sheet_size(made, runs)[0] == 1900


def test_more_runs_make_the_sheet_longer_and_keep_its_width(made: Compared) -> None:
    walk = made.walk(made.episodes[0], to_goal=True)
    runs = [Run(info=made.info(f"r{number}"), episodes=(walk,)) for number in range(12)]
    few, many = sheet_size(made, runs[:2]), sheet_size(made, runs)
    assert few[0] == many[0] == 1900
    assert few[1] < many[1] < 5000


def test_runs_that_share_a_colour_differ_in_line(made: Compared) -> None:
    key = made.episodes[0].key
    walk = made.walk(made.episodes[0], to_goal=True)
    traces = traces_of([Run(info=made.info(f"r{number}"), episodes=(walk,)) for number in range(20)], key)
    looks = {(trace.rgb, style_of(traces, place)) for place, trace in enumerate(traces)}
    assert len(looks) == 20
    assert style_of(traces, 0) == STYLES[0] == "solid"


def test_the_line_of_a_run_says_how_it_went(made: Compared, tmp_path: Path) -> None:
    episode = made.episodes[0]
    walk = made.walk(episode, to_goal=True, participant="P01")
    idle = made.walk(episode, to_goal=False)
    failed = idle.model_copy(update={"end": idle.end.model_copy(update={"reason": "technical"})})
    runs = [Run(info=made.info(f"r{number}"), episodes=(run,)) for number, run in enumerate((walk, idle, failed))]
    person, agent, broken = traces_of(runs, episode.key)
    assert [mark_of(trace) for trace in (person, agent, broken)] == [
        "\u2713 success",
        "\u2717 no success",
        "not scored",
    ]
    assert figures_of(agent) == ("0", "1", "0.0", "-")
    assert figures_of(person)[3] == f"{0.5 * len(walk.steps):.0f}"
    assert len({end_marker(success=success) for success in (True, False, None)}) == 3


def test_the_thumbnail_shows_the_goal_and_the_run(made: Compared) -> None:
    episode = made.episodes[0]
    traces = traces_of([Run(info=made.info("r"), episodes=(made.walk(episode, to_goal=True),))], episode.key)
    picture = Image.open(io.BytesIO(thumbnail_jpeg(made.scene, episode, traces, has_map=True)))
    rgb = np.asarray(picture).astype(int)
    assert max(picture.size) == 240
    assert (np.abs(rgb - traces[0].rgb).sum(axis=2) < 60).sum() > 20
    assert (rgb[..., 0] - rgb[..., 1] > 100).sum() > 20  # the star; nothing else is that red

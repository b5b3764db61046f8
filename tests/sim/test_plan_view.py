"""Floor plans from above: corners and sizes computed by hand, and the free floor as one path."""

from pathlib import Path

import numpy as np
import pytest

from sim.plan_view.heat import heat_colours, heat_shares
from sim.plan_view.storey import cropped_map
from sim.plan_view.svg import drawn_svg, free_path
from sim.plan_view.view import PlanView
from sim.types import GridSpec


def test_a_view_includes_all_places_with_a_margin_and_each_run_of_free_cells_is_one_rectangle() -> None:
    view = PlanView.around(np.array([[0.0, 0.0], [3.0, 1.0]]), margin=0.5, longest=400)
    assert (view.low, view.scale, view.width, view.height) == ((-0.5, -0.5), 100.0, 400, 200)
    assert view.pixels((-0.5, -0.5)).tolist() == [0, 0]
    assert view.pixels([(3.5, 1.5), (0.0, 0.0)]).tolist() == [[400, 200], [50, 50]]
    assert PlanView.around(np.zeros((1, 2)), margin=1.0, longest=10, least=16).width == 16
    view = PlanView((0.0, 0.0), 10.0, 40, 20)
    free = np.array([[True, True, False, True], [False, False, False, False]])
    drawn = free_path(view, free, GridSpec((0.0, 0.0), 1.0, (2, 4)))
    assert drawn == "M0.0 0.0h20.0v10.3h-20.0zM30.0 0.0h10.0v10.3h-10.0z"
    assert view.pixels((2.0, 1.0)) == pytest.approx([20, 10])
    free = np.zeros((40, 40), bool)
    free[20, 22:24] = True
    shown = cropped_map(1, 3.0, free, GridSpec((-2.0, -2.0), 0.1, free.shape), around=free)
    assert (shown.name, shown.free.shape, shown.free.sum()) == ("storey_1", (11, 12), 2)
    assert shown.grid.origin_xz == pytest.approx((-0.3, -0.5))
    assert shown.pixels(np.array([-0.3, 9.0, -0.4])) == pytest.approx([0, 1])


def test_drawings_escape_their_texts_and_share_macros(tmp_path: Path) -> None:
    template = tmp_path / "drawing.svg.j2"
    template.write_text(
        '{% import "plan.svg.j2" as plan %}\n\n{{ plan.ring(x, 2, 10.04, "red") }}\n<text>{{ words }}</text>'
    )
    circle, more, text = drawn_svg(template, x=1, words="<&>").splitlines()
    assert circle.startswith('<circle cx="1.0" cy="2.0" r="10.0"')
    assert (more.strip(), text) == ('stroke-dasharray="5 4"/>', "<text>&lt;&amp;&gt;</text>")


def test_heat_colours_span_dark_blue_to_yellow_for_any_range() -> None:
    shares = heat_shares(np.array([-3.0, np.nan, 1.0, -1.0]))
    assert shares[[0, 2, 3]].tolist() == [0.0, 1.0, 0.5]
    assert np.isnan(shares[1])
    assert heat_shares(np.array([2.0, 2.0])).tolist() == [1.0, 1.0]
    assert heat_colours(np.array([0.0, 0.5, 1.0])).tolist() == [[68, 1, 84], [33, 145, 140], [253, 231, 37]]

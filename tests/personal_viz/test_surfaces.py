"""What the browser is told to draw for a mark on an object: the outline, the label, and a dot at the click."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from human_study.trial.views import Mark, MarkedObject
from personal_viz.study_app.home.surfaces import MapView, SceneView, Surface

BED = MarkedObject("bed", (-2.0, 0.5, 1.0), (1.2, 1.0, 0.4))
MARK = Mark((-2.0, 0.5, 1.0), (-1.5, 1.0, 1.1), 0, BED)


class Scene:
    """viser's scene, which keeps what is drawn by its name."""

    def __init__(self) -> None:
        self.shown: dict[str, Any] = {}

    def configure_default_lights(self, is_on: bool, *, cast_shadow: bool) -> None: ...

    def add_line_segments(self, name: str, points: Any, colors: Any, *, thickness: float) -> Any:
        return self._keep(name, points=points)

    def add_icosphere(self, name: str, radius: float, color: Any, *, position: Any, **_: Any) -> Any:
        return self._keep(name, position=position, radius=radius)

    def add_label(self, name: str, text: str, *, position: Any, anchor: str = "") -> Any:
        return self._keep(name, text=text, position=position)

    def _keep(self, name: str, **fields: Any) -> Any:
        def remove() -> None:
            for shown in [shown for shown in self.shown if f"{shown}/".startswith(f"{name}/")]:
                del self.shown[shown]

        self.shown[name] = SimpleNamespace(**fields, remove=remove)
        return self.shown[name]


def surface_with(kind: type) -> tuple[Surface, dict[str, Any]]:
    """A surface with the mark, and all that its browser shows."""
    client: Any = SimpleNamespace(scene=Scene(), camera=None, flush=lambda: None)
    surface = kind(client, ())
    surface.show_marks([(MARK, "your mark: bed")])
    return surface, client.scene.shown


def test_a_mark_on_an_object_of_the_home_has_its_box_its_label_and_a_dot_at_the_click() -> None:
    _, shown = surface_with(SceneView)
    lines = shown["/mark0/outline"].points
    assert lines.shape == (12, 2, 3)
    assert lines.min(axis=(0, 1)) == pytest.approx((-2.6, 0.0, 0.8))
    assert lines.max(axis=(0, 1)) == pytest.approx((-1.4, 1.0, 1.2))
    assert shown["/mark0/ball"].position == pytest.approx((-2.0, 1.12, 1.0)), "the ball stands on the object"
    assert shown["/mark0/ball/label"].text == "your mark: bed"
    assert shown["/mark0/hit"].position == (-1.5, 1.0, 1.1)
    assert shown["/mark0/hit"].radius < shown["/mark0/ball"].radius


def test_a_mark_on_an_object_of_the_map_has_its_outline_from_above_its_label_and_a_dot_at_the_click() -> None:
    _, shown = surface_with(MapView)
    lines = shown["/mark0/outline"].points
    assert lines.shape == (4, 2, 3)
    assert lines.min(axis=(0, 1)) == pytest.approx((-2.6, 0.02, 0.8))
    assert lines.max(axis=(0, 1)) == pytest.approx((-1.4, 0.02, 1.2))
    assert shown["/mark0/dot"].position == pytest.approx((-2.0, 0.02, 1.0)), "the middle, on the floor"
    assert shown["/mark0/label"].text == "your mark: bed"
    assert shown["/mark0/hit"].position == pytest.approx((-1.5, 1.02, 1.1))


@pytest.mark.parametrize("kind", [SceneView, MapView])
def test_a_nudge_moves_the_dot_and_nothing_of_the_old_mark_is_left(kind: type) -> None:
    surface, shown = surface_with(kind)
    before = dict(shown)
    surface.show_marks([(Mark(MARK.point, (-1.4, 1.0, 1.1), 0, BED), "your mark: bed")])
    assert shown.keys() == before.keys()
    assert np.subtract(shown["/mark0/hit"].position, before["/mark0/hit"].position) == pytest.approx((0.1, 0.0, 0.0))
    surface.show_marks([(Mark((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0), "your mark")])
    assert "/mark0/hit" not in shown, "a mark on no object is at the click itself"
    assert "/mark0/outline" not in shown
    surface.hide_marks()
    assert shown == {}

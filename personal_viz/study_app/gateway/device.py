"""The device check: decides from the findings of the page's script whether a computer can show the study."""

from collections.abc import Mapping
from dataclasses import dataclass

from human_study.design.study import PanCondition, PogCondition, StudyConfig
from human_study.journey import Person

MIN_WIDTH, MIN_HEIGHT = 1000, 600
"""Smallest page in pixels; the device check asks people with a smaller one to widen their window."""
SMALLER = 0.95
"""Share of the smallest page that is still accepted, because browsers' own bars take some room."""
MOST_PIXELS = 100_000
IN_3D: tuple[PanCondition | PogCondition, ...] = ("glb", "map_first", "map_open", "map_2d")
"""Views in which the browser draws the home itself and needs WebGL."""


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """The findings of the device check; stored coarsely."""

    webgl2: bool
    width: int
    height: int
    has_pressed: bool
    """Whether a press of the key W arrived."""

    @property
    def is_large_enough(self) -> bool:
        """Whether the page has room for the picture and the texts."""
        return self.width >= SMALLER * MIN_WIDTH and self.height >= SMALLER * MIN_HEIGHT

    def can_show(self, *, needs_webgl: bool) -> bool:
        """Whether the graphics and the window are good enough."""
        return self.is_large_enough and (self.webgl2 or not needs_webgl)

    def detail(self) -> dict[str, bool | int]:
        """The stored findings, with rounded sizes and nothing that tells one computer from another."""
        return {
            "webgl2": self.webgl2,
            "width": 100 * round(self.width / 100),
            "height": 100 * round(self.height / 100),
            "keyboard": self.has_pressed,
        }


def needs_webgl(config: StudyConfig, person: Person) -> bool:
    """Whether a participant will meet a home in 3-D."""
    return any(config.view_in(trial.task, trial.condition) in IN_3D for trial in person.kept)


def device_report(form: Mapping[str, str]) -> DeviceReport | None:
    """The findings that the page's script wrote into its form; None where there are none or the form is damaged."""
    sizes = [form.get(name, "") for name in ("width", "height")]
    if not all(size.isascii() and size.isdecimal() and len(size) <= 6 for size in sizes):
        return None
    width, height = (min(int(size), MOST_PIXELS) for size in sizes)
    return DeviceReport(form.get("webgl2") == "1", width, height, form.get("pressed") == "1")

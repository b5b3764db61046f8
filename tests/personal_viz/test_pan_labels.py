"""The labels of the PAN screen's buttons."""

import pytest

from human_study.texts.catalogue import catalogue_of
from personal_viz.study_app.screens.pan import button_label
from sim.types import Action


@pytest.mark.parametrize(
    ("action", "own_keys", "label"),
    [
        (Action.FORWARD, {}, "Forward (W or Up)"),
        (Action.FORWARD, {"forward": "KeyI"}, "Forward (I)"),
        (Action.LEFT, {"forward": "KeyI"}, "Turn left (A or Left)"),
        (Action.LOOK_UP, {"look_up": "Digit1"}, "Look up (1)"),
        (Action.RIGHT, {"right": "ArrowUp"}, "Turn right (Up)"),
        (Action.STOP, {}, "STOP here (Enter twice)"),
        (Action.STOP, {"stop": "Space"}, "STOP here (Space twice)"),
    ],
)
def test_buttons_name_the_keys_that_do_the_same(action: Action, own_keys: dict[str, str], label: str) -> None:
    assert button_label(action, catalogue_of("en"), own_keys) == label

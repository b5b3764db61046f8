"""The picture of a recording for the README: Rerun's web viewer in Chromium shows our recording."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from personal_viz.browser import find_chromium
from personal_viz.screenshots.rerun_page import screenshot_rrd
from recordings.replay import log_comparison
from recordings.traces import RUN_COLORS, Rgb
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.run_files import Run


def share(png: Path, rgb: Rgb) -> float:
    """Share of pixels that differ from a colour by at most 12 in every channel."""
    pixels = np.asarray(Image.open(png).convert("RGB")).astype(int)
    return float((np.abs(pixels - rgb).max(axis=-1) <= 12).mean())


@pytest.mark.browser
@pytest.mark.slow
def test_the_viewer_shows_home_paths_and_pictures(
    tmp_path: Path, home: Scene, episode: Episode, renderer: Raycaster, agent_run: Run, human_run: Run
) -> None:
    if find_chromium() is None:
        pytest.skip("no Chromium is installed")
    rrd = log_comparison(
        [agent_run, human_run],
        episode=episode,
        scene=home,
        out=tmp_path / "box.rrd",
        renderer=renderer,
        with_pixels=False,
    )
    png = screenshot_rrd(rrd, tmp_path / "box.png", at_end=True, size=(1200, 700))
    assert Image.open(png).size == (1200, 700)
    assert share(png, (150, 60, 40)) > 0.02, "the table fills the last picture of the agent"
    assert share(png, (236, 236, 232)) > 0.02, "the map shows free space"
    for rgb in RUN_COLORS[:2]:
        assert share(png, rgb) > 0.0003, "the path of the run"


def test_a_missing_recording_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("playwright")
    with pytest.raises(RecordingError, match=r"none\.rrd: found no file"):
        screenshot_rrd(tmp_path / "none.rrd", tmp_path / "a.png")

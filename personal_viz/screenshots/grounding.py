"""Pictures of grounding: an exploration and answers on an explored map in Rerun, and the POG report's page.

Part of screenshots; alone: `python -m personal_viz.screenshots.grounding`.
"""

import tempfile
from pathlib import Path

from sim.authoring.generation import invent_dataset
from sim.tasks.run_files import read_run

from ..browser import open_chromium
from ..cli.verbs import parse
from .rerun_page import screenshot_rrd

HOME, HOME_SEED = "Invented3", 3
METHODS = ("center", "qs", "rpg", "phrase", "joint")
_SHOWN = ("rpg", "joint")
"""Methods whose answers are replayed."""
_STEPS = 300
"""Of the pictured exploration."""
_PAGE = (1500, 1100)


def picture_grounding(pictures: Path, folder: Path) -> None:
    """Writes explore.png, ground-explored.png and pog-report.png.

    Args:
        pictures: Where to.
        folder: For what is made on the way.
    """
    dataset, runs = folder / "homes", folder / "runs"
    invent_dataset(dataset, name=HOME, seed=HOME_SEED)
    exploration = folder / "explore.rrd"
    options = ["--dataset", str(dataset), "--max-steps", str(_STEPS), "--out", str(folder / "walks")]
    _work("explore", *options, "--rerun", str(exploration))
    screenshot_rrd(exploration, pictures / "explore.png", at_end=True)
    for method in METHODS:
        options = ["--dataset", str(dataset), "--out", str(runs), "--run-id", method]
        _work("ground", *options, "--method", method, "--map", "explore")
    pair = folder / "pair.rrd"
    chosen = [str(runs / method) for method in _SHOWN]
    _work("replay", "--dataset", str(dataset), "--episode", _parting(runs), "--out", str(pair), "--runs", *chosen)
    screenshot_rrd(pair, pictures / "ground-explored.png", at_end=True)
    report = folder / "report"
    _work("pog-report", *(str(runs / method) for method in METHODS), "--dataset", str(dataset), "--out", str(report))
    with open_chromium(width=_PAGE[0], height=_PAGE[1]) as browser:
        page = browser.new_page()
        page.goto((report / "index.html").as_uri())
        page.screenshot(path=pictures / "pog-report.png")


def _parting(runs: Path) -> str:
    """The first episode that the better of the two shown methods alone got right, else the first of all."""
    worse, better = (read_run(runs / method).answers for method in _SHOWN)
    right = [
        str(good.key)
        for bad, good in zip(worse, better, strict=True)
        if good.measures and bad.measures and good.measures.success and not bad.measures.success
    ]
    return right[0] if right else str(better[0].key)


def _work(*arguments: str) -> None:
    if parse(list(arguments)).work():
        raise RuntimeError(f"personal-viz {' '.join(arguments)} failed")


def main() -> None:
    """Writes the three pictures into `docs/pictures`."""
    pictures = Path(__file__).parents[2] / "docs" / "pictures"
    with tempfile.TemporaryDirectory(prefix="personal-grounding-") as folder:
        picture_grounding(pictures, Path(folder))


if __name__ == "__main__":
    main()

"""What scripts of pictures do with the running program: run its verbs, serve a study, press, walk, and point."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect

from human_study.design.study import StudyEthics
from sim.authoring.generation import invent_dataset
from sim.authoring.sequences.generation import draw_sequences, write_sequences
from sim.episodes.dataset import PersonalDataset

from ..bots.site import make_pilot
from ..cli.verbs import parse
from ..study_app.operator.served import ServedStudy, serve_command, served

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
WAIT_MS = 120_000
"""Longest wait for a page."""


@contextlib.contextmanager
def served_study(folder: Path, *, num_sequences: int = 0, **choices: Any) -> Iterator[ServedStudy]:
    """A pilot on one invented home, until the end of the block.

    Args:
        folder: For the study and its episodes.
        num_sequences: Number of home sequences that are done instead of episodes; 0 = episodes.
        choices: Fields of StudyConfig.
    """
    dataset = folder / "dataset"
    invent_dataset(dataset, name="PictureHome", seed=5)
    make_pilot(
        folder / "study",
        dataset,
        participants=1,
        sequence_set=make_set(dataset, folder / "set", count=num_sequences) if num_sequences else None,
        splits={"easy": 4},
        study="picture-study",
        ethics=StudyEthics(institution="Example University", contact="study@example.org", duration_min=30),
        **choices,
    )
    with served(serve_command(folder / "study", dataset, workers=1)) as program:
        yield program


def make_set(dataset: Path, out: Path, *, count: int) -> Path:
    """Writes a set of home sequences of a dataset's homes; returns `out`."""
    scenes = PersonalDataset(dataset).scenes
    write_sequences(out, draw_sequences(dataset, scenes, scenes_dir=None, count=count, seed=5, starts="released"))
    return out


def run_agent(agent: str, dataset: Path, runs: Path, *more: str, seed: int = 1) -> Path:
    """Runs an agent over the episodes that further options name; its run folder."""
    name = agent.partition(":")[0].rpartition(".")[2]
    options = ["--dataset", str(dataset), "--out", str(runs), "--run-id", name, "--seed", str(seed)]
    work("run", "--agent", agent, *options, *more)
    return runs / name


def work(*arguments: str) -> None:
    if parse(list(arguments)).run():
        raise RuntimeError(f"personal-viz {' '.join(arguments)} failed")


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click(timeout=WAIT_MS)


def keep(page: Page, name: str) -> None:
    page.mouse.move(5, 5)
    page.wait_for_timeout(500)  # colours of buttons fade
    page.screenshot(path=PICTURES / name)


def walk(page: Page, keys: Sequence[str] = "ddd", *, first: int = 0) -> None:
    """Presses keys, each when the picture of the one before is there; without others, turns to a view of the room."""
    picture = page.get_by_alt_text("What the robot sees")
    expect(picture).to_have_attribute("data-step", str(first))
    for number, key in enumerate(keys, start=first + 1):
        page.keyboard.press(key, delay=60)  # sessions drop presses within 50 ms of the last one
        expect(picture).to_have_attribute("data-step", str(number))


def see_map(page: Page) -> None:
    expect(page.get_by_text("Look at the home from above")).to_be_visible()
    page.wait_for_timeout(1500)


def see_home(page: Page) -> None:
    expect(page.get_by_text("Look around in the home")).to_be_visible()
    page.wait_for_timeout(4000)  # the home is drawn some time after it has arrived; nothing in the page tells when


def point(page: Page, right: float = 0.49, down: float = 0.62) -> None:
    """A mark at this place of the picture; without another, on the floor of the hall, where nothing hides it."""
    expect(page.get_by_text("Click the middle of the object")).to_be_visible()
    page.wait_for_timeout(4000)
    canvas = page.locator("canvas").last.bounding_box()
    assert canvas is not None
    page.mouse.click(canvas["x"] + canvas["width"] * right, canvas["y"] + canvas["height"] * down)
    expect(page.get_by_text("Click again to move your mark")).to_be_visible()
    page.wait_for_timeout(2000)

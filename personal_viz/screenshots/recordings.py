"""Pictures of recordings: a person beside an agent in Rerun, and the page of `compare`. Part of screenshots."""

from pathlib import Path

from human_study.design.plan import load_plan
from human_study.design.study import load_study
from sim.types import Action, EpisodeKey, Split

from ..browser import open_chromium
from ..cli.compare import Compare
from ..cli.replay import Replay
from ..cli.run import Run
from ..cli.study.export import StudyExport
from .rerun_page import screenshot_rrd

AGENT = "personal_viz.examples.example_1_explaining_agent:make"
KEYS = {Action.FORWARD: "w", Action.LEFT: "a", Action.RIGHT: "d"}
"""What a participant presses; STOP is Enter twice."""
_PAGE = (1600, 1000)


def first_walk(study: Path) -> EpisodeKey:
    """The first episode of the study's PAN participant."""
    plan = load_plan(study, load_study(study))
    return next(person.trials[0].key for person in plan.participants if person.trials[0].task == "pan")


def run_agent(
    agent: str, *, dataset: Path, runs: Path, name: str, key: EpisodeKey | None = None, split: Split = "easy"
) -> Path:
    """Runs an agent over one episode, or without a key over a split; its run folder."""
    Run(
        agent=agent,
        dataset=dataset,
        out=runs,
        scenes_dir=None,
        scene=(),
        split=(split,),
        limit=None,
        seed=1,
        jobs=1,
        run_id=name,
        episode=None if key is None else str(key),
    ).work()
    return runs / name


def picture_recordings(pictures: Path, study: Path, *, dataset: Path, folder: Path) -> None:
    """Writes replay.png and compare.png: the trial that `study` holds beside an exploring agent.

    Args:
        pictures: Where to.
        study: A study whose PAN participant has finished the first trial.
        dataset: Its episodes.
        folder: For what is made on the way.
    """
    key = first_walk(study)
    StudyExport(study=study, out=folder / "people").work()
    agent = run_agent(AGENT, key=key, dataset=dataset, runs=folder / "agents", name="explorer")
    people = tuple(sorted(path for path in (folder / "people").iterdir() if (path / "steps.jsonl").is_file()))
    rrd = folder / "pair.rrd"
    Replay(runs=(*people, agent), out=rrd, dataset=dataset, scenes_dir=None, episode=str(key)).work()
    screenshot_rrd(rrd, pictures / "replay.png", at_end=True)
    page = folder / "page"
    agents = [
        run_agent(agent, dataset=dataset, runs=folder / "agents", name=name, split=key.split)
        for agent, name in ((AGENT, "explorer-all"), ("random", "random-all"), ("shortest-path", "shortest-all"))
    ]
    Compare(runs=(*people, *agents), dataset=dataset, out=page).work()
    with open_chromium(width=_PAGE[0], height=_PAGE[1]) as browser:
        tab = browser.new_page()
        tab.goto((page / "index.html").as_uri())
        tab.wait_for_function("[...document.images].slice(0, 3).every((image) => image.naturalWidth > 0)")
        tab.screenshot(path=pictures / "compare.png")

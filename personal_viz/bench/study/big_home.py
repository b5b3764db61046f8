"""One participant opens a home of a million triangles; how long do the others' keys take meanwhile?"""

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.design.plan import PlannedParticipant, StudyPlan, load_plan, save_plan
from human_study.design.study import (
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyMemory,
    StudyPractice,
    save_study,
)
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.types import SPLITS

from ...bots.records import BotKind, count_bots
from ...bots.run import quantile
from ...bots.site import HOME, Site
from ...study_app.study_files import plan_study
from ..harness import Progress, Values
from .big_scan import BIG_HOME, write_big_scan
from .crowd import Crowd, crowd
from .server import Server, held_by


class BigHomeSettings(BaseModel):
    """How big, and who plays beside it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    faces: int = 1_000_000
    """The home on disk has at least as many triangles."""
    bots: int = 20
    """Who walk in a small home."""
    rate: float = 2.0
    kinds: tuple[BotKind, ...] = ("random",)
    before_s: float = 30.0
    """How long the others' keys are measured with nobody opening anything."""
    seed: int = 23


@dataclass(frozen=True, slots=True)
class _Window:
    """From when to when something happened, `time.perf_counter()`."""

    begin_s: float
    end_s: float

    def acks_ms(self, bots: Crowd) -> list[float]:
        """Of the keys that were sent in it and whose answer came."""
        presses = [press for log in bots.logs for press in log.presses]
        return [
            1e3 * (press.counted_s - press.sent_s)
            for press in presses
            if press.counted_s is not None and self.begin_s <= press.sent_s <= self.end_s
        ]


def measure_big_home(settings: BigHomeSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Others walk; one participant opens the big home, then another one.

    Args:
        settings: How big.
        folder: An empty one.
        dataset: Of one invented home; it is copied.
        progress: Told what is done now.

    Returns:
        `participants`, the others; `faces` and `scan_mb` of the home on disk, `browser_mb` of its largest storey's
        browser copy; `opening_s` of the first participant, from the link to walking, the 3-D look included, with
        nothing in the cache, and `opening_again_s` of the second, for whom the copies are there; the others' keys:
        `before_ack_..._ms` with nobody opening anything, `while_ack_..._ms` those sent while the first participant
        opened the home, `again_ack_p99_ms` with the second; `peak_mb`, the largest resident memory of all processes.

    Raises:
        StudyError: The study cannot be served, or bots do not come in.
        SceneError: The home cannot be made.
    """
    progress(f"making a home of {settings.faces} triangles")
    data, scans = folder / "dataset", folder / "scans"
    shutil.copytree(dataset, data)
    invent_dataset(data, name=BIG_HOME, seed=settings.seed)
    scans.mkdir()
    for path in (data / "scenes").glob(f"{HOME}.*"):
        shutil.copy(path, scans)
    scan = write_big_scan(data, scans, num_faces=settings.faces, seed=settings.seed)
    openers, others = _plan(folder / "study", data, scans, num_others=settings.bots, seed=settings.seed)
    with Server(folder / "study", data, scenes_dir=scans, cache=folder / "cache") as server:
        site = server.start()
        with crowd(site, others, kinds=settings.kinds, rate=settings.rate, seed=settings.seed) as bots:
            bots.arrive()
            bots.begin()
            began_s = time.perf_counter()
            time.sleep(settings.before_s)  # the others act; nothing else is waited for
            before = _Window(began_s, time.perf_counter())
            first, again = (_opening(site, code, settings, progress) for code in openers)
            bots.halt()
        held = held_by(server.pid)
        keys = count_bots(site.folder, bots.logs)
    acks = {"before": before.acks_ms(bots), "while": first.acks_ms(bots), "again": again.acks_ms(bots)}
    return {
        "participants": settings.bots,
        "faces": scan.faces,
        "scan_mb": scan.file_mb,
        "browser_mb": max(path.stat().st_size for path in (folder / "cache").glob("glb/*.glb")) / 1e6,
        "opening_s": first.end_s - first.begin_s,
        "opening_again_s": again.end_s - again.begin_s,
        "before_ack_p50_ms": quantile(acks["before"], 0.5),
        "before_ack_p99_ms": quantile(acks["before"], 0.99),
        "while_ack_p50_ms": quantile(acks["while"], 0.5),
        "while_ack_p99_ms": quantile(acks["while"], 0.99),
        "while_ack_max_ms": quantile(acks["while"], 1.0),
        "again_ack_p99_ms": quantile(acks["again"], 0.99),
        "peak_mb": held["peak_mb"],
        "lost": len(keys.lost),
        "duplicated": keys.duplicated,
        "problems": (*bots.problems, *keys.lost),
    }


def _opening(site: Site, code: str, settings: BigHomeSettings, progress: Progress) -> _Window:
    """One participant comes in, looks at the home in 3-D, and stands in it."""
    progress(f"{code} opens the big home")
    with crowd(site, [code], kinds=("random",), rate=settings.rate, seed=settings.seed) as opener:
        began_s = time.perf_counter()
        opener.arrive()
        return _Window(began_s, time.perf_counter())


def _plan(study: Path, data: Path, scans: Path, *, num_others: int, seed: int) -> tuple[Sequence[str], Sequence[str]]:
    """Writes the plan; (two who begin in the big home, which they see in 3-D first; others, in the small one)."""
    config = StudyConfig(
        study="big-home",
        dataset=StudyDataset(
            sha256=PersonalDataset(data).digest(),
            splits=dict.fromkeys(SPLITS, "all"),
            stratify="none",
            max_per_scene=None,
            seed=seed,
        ),
        task=("pan",),
        design=StudyDesign(kind="crossed", raters_per_episode=num_others + 2),
        memory=StudyMemory(arms=("none", "glb")),
        practice=StudyPractice(pan=0, pog=0),
        checks=StudyChecks(every=None),
        breaks=StudyBreaks(every=None, sitting_max=None),
    )
    save_study(study, config)
    plan_study(study, data, scans, pilot=True)
    plan: StudyPlan = load_plan(study, config)
    people = [one.code for one in plan.participants if plan.conditions_of(config, one)[BIG_HOME] == "glb"]
    openers, others = people[:2], people[2 : 2 + num_others]
    scene = dict.fromkeys(openers, BIG_HOME) | dict.fromkeys(others, HOME)
    changed = tuple(_only(one, scene[one.code]) if one.code in scene else one for one in plan.participants)
    save_plan(study, plan.model_copy(update={"participants": changed}))
    return openers, others


def _only(person: PlannedParticipant, scene: str) -> PlannedParticipant:
    """The participant with the trials of one home."""
    trials = [trial for trial in person.trials if trial.scene == scene]
    numbered = tuple(trial.model_copy(update={"order_no": number}) for number, trial in enumerate(trials, start=1))
    return person.model_copy(update={"trials": numbered})

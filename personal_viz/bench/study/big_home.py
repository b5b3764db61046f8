"""Measures how long the others' keys take while one participant opens a home of a million triangles."""

import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from human_study.design.plan import PlannedParticipant, StudyPlan, load_plan, save_plan
from human_study.design.study import StudyBreaks, StudyDesign, StudyMemory, StudyPractice
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene

from ...bots.crowd import Crowd
from ...bots.figures import quantile
from ...bots.records import count_bots
from ...bots.server import Server
from ...bots.site import HOME, Person, Site, make_pilot
from ..harness import Progress, Values, held_by
from ..sim.scenes import like_scan, write_bench_glb
from .crew import CrewSettings

BIG_HOME = "WideHome"
"""A name that sorts after the small home's, so that workers open the small one first."""


class BigHomeSettings(CrewSettings):
    """Size of the big home, and the bots beside it."""

    faces: int = 1_000_000
    """Number of triangles of the home on disk."""
    bots: int = 20
    """Number of bots that walk in a small home."""
    before_s: float = 30.0
    """Seconds for which the others' keys are measured while nobody opens anything."""
    seed: int = 23

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"keys of {self.bots} bots while somebody opens a home of {self.faces} triangles."


class _Window(NamedTuple):
    """Start and end of an event, `time.perf_counter()`."""

    begin_s: float
    end_s: float

    def acks_ms(self, bots: Crowd) -> list[float]:
        """Times of the keys that were sent within the window and answered, milliseconds."""
        presses = [press for log in bots.logs for press in log.presses]
        return [
            1e3 * (press.counted_s - press.sent_s)
            for press in presses
            if press.counted_s is not None and self.begin_s <= press.sent_s <= self.end_s
        ]


def measure_big_home(settings: BigHomeSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Lets bots walk while one participant opens the big home, and then a second one.

    Returns:
        `participants`, the number of the others; `faces` and `scan_mb` of the home on disk, `browser_mb` of its largest
        storey's browser copy; `opening_s` of the first participant, from the link to walking, with the 3-D look and an
        empty cache, and `opening_again_s` of the second, for whom the copies exist; the others' keys:
        `before_ack_..._ms` while nobody opens anything, `while_ack_..._ms` sent while the first participant opened the
        home, `again_ack_p99_ms` while the second did; `peak_mb`, the largest resident memory of all processes.

    Raises:
        SceneError: The home cannot be made.
    """
    progress(f"making a home of {settings.faces} triangles")
    data, scans = folder / "dataset", folder / "scans"
    shutil.copytree(dataset, data)
    invent_dataset(data, name=BIG_HOME, seed=settings.seed)
    scans.mkdir()
    for path in (data / "scenes").glob(f"{HOME}.*"):
        shutil.copy(path, scans)
    scan = scans / f"{BIG_HOME}.glb"
    num_faces = _write_scan(scan, data, num_faces=settings.faces, seed=settings.seed)
    openers, others = _plan(folder / "study", data, scans, num_others=settings.bots, seed=settings.seed)
    with Server(folder / "study", data, scenes_dir=scans, cache=folder / "cache") as server:
        site = server.start()
        people = {person.code: person for person in site.everybody}
        with settings.crowd(site, [people[code] for code in others]) as bots:
            bots.arrive()
            bots.begin()
            began_s = time.perf_counter()
            time.sleep(settings.before_s)  # the measured time itself: the others act
            before = _Window(began_s, time.perf_counter())
            first, again = (_opening(site, people[code], settings, progress) for code in openers)
            bots.halt()
        held = held_by(server.pid)
        found = count_bots(site.folder, bots.logs)
    acks = {"before": before.acks_ms(bots), "while": first.acks_ms(bots), "again": again.acks_ms(bots)}
    return {
        "participants": settings.bots,
        "faces": num_faces,
        "scan_mb": scan.stat().st_size / 1e6,
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
        "lost": len(found.lost),
        "duplicated": found.duplicated,
        "problems": (*bots.problems, *found.lost),
    }


def _write_scan(path: Path, dataset: Path, *, num_faces: int, seed: int) -> int:
    """Writes BIG_HOME of a dataset as a scan; returns its number of triangles."""
    home = open_scene(PersonalDataset(dataset), BIG_HOME).mesh
    mesh = like_scan(home.vertices, home.faces, home.face_instance, num_faces=num_faces, seed=seed, texture_size=512)
    write_bench_glb(path, mesh)
    return len(mesh.faces)


def _opening(site: Site, person: Person, settings: BigHomeSettings, progress: Progress) -> _Window:
    """Times one participant who comes in, looks at the home in 3-D, and then stands in it."""
    progress(f"{person.code} opens the big home")
    with settings.crowd(site, [person]) as opener:
        began_s = time.perf_counter()
        opener.arrive()
        return _Window(began_s, time.perf_counter())


def _plan(study: Path, data: Path, scans: Path, *, num_others: int, seed: int) -> tuple[Sequence[str], Sequence[str]]:
    """Writes the plan; returns two participants for the big home, which they see in 3-D first, and the others."""
    config = make_pilot(
        study,
        data,
        name="big-home",
        scenes_dir=scans,
        seed=seed,
        task=("pan",),
        design=StudyDesign(kind="crossed", raters_per_episode=num_others + 2),
        memory=StudyMemory(arms=("none", "glb")),
        practice=StudyPractice(pan=0, pog=0),
        breaks=StudyBreaks(every=None, sitting_max=None),
    )
    plan: StudyPlan = load_plan(study, config)
    people = [one.code for one in plan.participants if plan.conditions_of(config, one)[BIG_HOME] == "glb"]
    openers, others = people[:2], people[2 : 2 + num_others]
    scene = dict.fromkeys(openers, BIG_HOME) | dict.fromkeys(others, HOME)
    changed = tuple(_only(one, scene[one.code]) if one.code in scene else one for one in plan.participants)
    save_plan(study, plan.model_copy(update={"participants": changed}))
    return openers, others


def _only(person: PlannedParticipant, scene: str) -> PlannedParticipant:
    """The participant with only the trials in one home."""
    trials = [trial for trial in person.trials if trial.scene == scene]
    numbered = tuple(trial.model_copy(update={"order_no": number}) for number, trial in enumerate(trials, start=1))
    return person.model_copy(update={"trials": numbered})

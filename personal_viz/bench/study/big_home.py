"""Measures how long other participants' keys take while one participant opens a home of a million triangles."""

import shutil
import time
from collections.abc import Sequence
from pathlib import Path

from human_study.design.plan import PlannedParticipant, load_plan, save_plan
from human_study.design.study import StudyMemory
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene

from ...bots.figures import quantiles_ms
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


def measure_big_home(settings: BigHomeSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Lets bots walk while one participant opens the big home, and then while a second participant does.

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
    for path in (*(data / "scenes").glob(f"{HOME}.*"), data / "scenes" / f"{BIG_HOME}.stage_config.json"):
        shutil.copy(path, scans)
    scan = scans / f"{BIG_HOME}.glb"
    num_faces = write_scan(scan, data, BIG_HOME, num_faces=settings.faces, seed=settings.seed)
    openers, others = _plan(folder / "study", data, scans, num_others=settings.bots, seed=settings.seed)
    with Server(folder / "study", data, scenes_dir=scans, cache=folder / "cache") as server:
        site = server.start()
        people = {person.code: person for person in site.everybody}
        with settings.crowd(site, [people[code] for code in others]) as bots:
            bots.arrive()
            bots.begin()
            began_s = time.perf_counter()
            time.sleep(settings.before_s)  # the measured time itself: the others act
            spans = {"before": (began_s, time.perf_counter())}
            for name, code in zip(("while", "again"), openers, strict=True):
                progress(f"{code} opens the big home")
                spans[name] = _opening(site, people[code], settings)
            bots.halt()
        held = held_by(server.pid)
        found = count_bots(site.folder, bots.logs)
    presses = [press for log in bots.logs for press in log.presses]
    acks = {
        name: [press.counted_ms for press in presses if begin_s <= press.sent_s <= end_s]
        for name, (begin_s, end_s) in spans.items()
    }
    return {
        "participants": settings.bots,
        "faces": num_faces,
        "scan_mb": scan.stat().st_size / 1e6,
        "browser_mb": max(path.stat().st_size for path in (folder / "cache").glob("glb/*.glb")) / 1e6,
        "opening_s": spans["while"][1] - spans["while"][0],
        "opening_again_s": spans["again"][1] - spans["again"][0],
        **quantiles_ms("before_ack", acks["before"], 50, 99),
        **quantiles_ms("while_ack", acks["while"], 50, 99, 100),
        **quantiles_ms("again_ack", acks["again"], 99),
        "peak_mb": held["peak_mb"],
        "lost": len(found.lost),
        "duplicated": found.duplicated,
        "problems": (*bots.problems, *found.lost),
    }


def write_scan(path: Path, dataset: Path, name: str, *, num_faces: int, seed: int) -> int:
    """Writes a home of a dataset as a scan; returns its number of triangles."""
    home = open_scene(PersonalDataset(dataset), name).mesh
    mesh = like_scan(home.vertices, home.faces, home.face_instance, num_faces=num_faces, seed=seed, texture_size=512)
    write_bench_glb(path, mesh)
    return len(mesh.faces)


def _opening(site: Site, person: Person, settings: BigHomeSettings) -> tuple[float, float]:
    """`time.perf_counter()` when a participant came in, and when they stood in the home after a look at it in 3-D."""
    with settings.crowd(site, [person]) as opener:
        began_s = time.perf_counter()
        opener.arrive()
        return began_s, time.perf_counter()


def _plan(study: Path, data: Path, scans: Path, *, num_others: int, seed: int) -> tuple[Sequence[str], Sequence[str]]:
    """Writes the plan; returns two participants for the big home, which they see in 3-D first, and the others."""
    config = make_pilot(
        study,
        data,
        participants=num_others + 2,
        scenes_dir=scans,
        seed=seed,
        memory=StudyMemory(arms=("none", "glb")),
    )
    plan = load_plan(study, config)
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

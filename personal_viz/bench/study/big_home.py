"""Measures how long the others' keys take while one participant opens a home of a million triangles."""

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from human_study.design.plan import PlannedParticipant, StudyPlan, load_plan, save_plan
from human_study.design.study import StudyBreaks, StudyDesign, StudyMemory, StudyPractice
from sim.authoring.generation import invent_dataset
from sim.copies.glb_writer import glb_from_mesh
from sim.episodes.dataset import PersonalDataset
from sim.frames import glb_zup_from_world
from sim.homes.open_home import open_scene
from sim.mesh import TriangleMesh

from ...bots.run import quantile
from ...bots.site import HOME, Site, make_pilot
from ..harness import Progress, Values
from ..sim.scenes import displacement
from .crowd import CrewSettings, Crowd, crowd
from .records import kept
from .server import Server, held_by

BIG_HOME = "WideHome"
"""A name that sorts after the small home's, so that workers open the small one first."""


class BigHomeSettings(CrewSettings):
    """Size of the big home, and the bots beside it."""

    faces: int = 1_000_000
    """The home on disk has at least as many triangles."""
    bots: int = 20
    """Number of bots that walk in a small home."""
    before_s: float = 30.0
    """Seconds for which the others' keys are measured while nobody opens anything."""
    seed: int = 23

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"keys of {self.bots} bots while somebody opens a home of {self.faces} triangles."


@dataclass(frozen=True, slots=True)
class BigScan:
    """Size of the scan that was written."""

    faces: int
    file_mb: float
    """MB of 10^6 bytes."""


@dataclass(frozen=True, slots=True)
class _Window:
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
    scan = write_big_scan(data, scans, num_faces=settings.faces, seed=settings.seed)
    openers, others = _plan(folder / "study", data, scans, num_others=settings.bots, seed=settings.seed)
    with Server(folder / "study", data, scenes_dir=scans, cache=folder / "cache") as server:
        site = server.start()
        with crowd(site, others, settings) as bots:
            bots.arrive()
            bots.begin()
            began_s = time.perf_counter()
            time.sleep(settings.before_s)  # the measured time itself: the others act
            before = _Window(began_s, time.perf_counter())
            first, again = (_opening(site, code, settings, progress) for code in openers)
            bots.halt()
        held = held_by(server.pid)
        found = kept(site.folder, bots)
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
        "lost": found.lost,
        "duplicated": found.keys.duplicated,
        "problems": found.problems,
    }


def write_big_scan(dataset: Path, scans: Path, *, num_faces: int, seed: int) -> BigScan:
    """Writes the scan of BIG_HOME into `scans`; its episodes and plan are in the dataset.

    Args:
        dataset: A dataset with BIG_HOME.
        scans: Folder of scans.
        num_faces: Least number of triangles.
        seed: Seed of the surface's unevenness.

    Raises:
        DatasetError, SceneError: The dataset does not have the home.
    """
    mesh = open_scene(PersonalDataset(dataset), BIG_HOME).mesh
    while len(mesh.faces) < num_faces:
        mesh = divided(mesh)
    uneven = mesh.vertices + displacement(mesh.vertices.astype(np.float64), np.random.default_rng(seed))
    zup = glb_zup_from_world(uneven).astype(np.float32)
    path = scans / f"{BIG_HOME}.glb"
    path.write_bytes(glb_from_mesh(replace(mesh, vertices=zup)))
    return BigScan(len(mesh.faces), path.stat().st_size / 1e6)


def divided(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface with each triangle divided into four; neighbours stay joined."""
    corners = mesh.faces.astype(np.int64)
    ends = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges, edge_of = np.unique(ends[:, 0] * len(mesh.vertices) + ends[:, 1], return_inverse=True)
    first, second = edges // len(mesh.vertices), edges % len(mesh.vertices)
    ab, bc, ca = len(mesh.vertices) + edge_of.reshape(3, -1)
    a, b, c = corners.T
    faces = np.concatenate([np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    rgb = mesh.vertex_rgb
    return TriangleMesh(
        np.concatenate([mesh.vertices, (mesh.vertices[first] + mesh.vertices[second]) / 2]).astype(np.float32),
        faces.astype(np.int32),
        np.tile(mesh.face_rgb, (4, 1)),
        np.tile(mesh.face_instance, 4),
        np.tile(mesh.face_texture, 4),
        _divided_uv(mesh.face_uv),
        mesh.textures,
        None if rgb is None else np.concatenate([rgb, ((rgb[first].astype(int) + rgb[second]) // 2).astype(np.uint8)]),
    )


def _opening(site: Site, code: str, settings: BigHomeSettings, progress: Progress) -> _Window:
    """Times one participant who comes in, looks at the home in 3-D, and then stands in it."""
    progress(f"{code} opens the big home")
    with crowd(site, [code], settings) as opener:
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


def _divided_uv(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """(4 F, 3, 2) texture coordinates of the corners, in the order of `divided`."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(three, axis=1) for three in parts]).astype(np.float32)

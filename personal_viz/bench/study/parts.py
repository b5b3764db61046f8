"""Runs the parts of the study benchmark: the time of a key, and kills, crowds, restarts and big homes."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import psutil

from sim.authoring.generation import invent_dataset
from sim.errors import StudyError

from ...bots.site import HOME
from ..harness import Findings, Plan, Progress, Target, Values
from .big_home import BigHomeSettings, measure_big_home
from .browser import BrowserSettings, measure_browser
from .kills import KillSettings, measure_kills
from .load import LoadSettings, measure_load
from .pog_view import PogViewSettings, measure_pog_view
from .restart import RestartSettings, measure_restarts
from .soak import SoakSettings, measure_soak
from .store import StoreSettings, measure_store

PLAN = Plan(
    targets={
        "store.ack_p95_ms": Target(50.0),
        "load.ack_p95_ms": Target(50.0),
        "load.key_to_frame_p95_ms": Target(250.0),
        "load.lost": Target(0.0),
        "load.duplicated": Target(0.0),
        "browser.alone_p50_ms": Target(60.0),
        "browser.key_to_image_p50_ms": Target(100.0),
        "browser.key_to_image_p95_ms": Target(200.0),
        "browser.delayed_p50_over_round_trip_ms": Target(60.0),
        "pogview.fps": Target(15.0, at_least=True),
        "pogview.click_mm_p99": Target(20.0),
        "kills.lost_after_kill": Target(0.0),
        "kills.duplicated_after_kill": Target(0.0),
        "kills.unknown_after_kill": Target(0.0),
        "kills.chain_failures": Target(0.0),
        "kills.resumed_elsewhere": Target(0.0),
        "people.lost": Target(0.0),
        "people.duplicated": Target(0.0),
        "big_home.while_ack_p99_ms": Target(150.0),
        "big_home.lost": Target(0.0),
        "big_home.duplicated": Target(0.0),
        "restart.drain_s": Target(10.0),
        "restart.processes_left": Target(0.0),
        "restart.lost": Target(0.0),
        "restart.duplicated": Target(0.0),
        "restart.resumed_elsewhere": Target(0.0),
        "soak.lost": Target(0.0),
        "soak.duplicated": Target(0.0),
        "soak.fds_growth": Target(16.0),
        "soak.threads_growth": Target(16.0),
        "soak.clients_growth": Target(0.0),
        "soak.clients_left": Target(0.0),
        "soak.leases_left": Target(0.0),
        "soak.gateway_drift_percent": Target(10.0),
        "soak.workers_drift_percent": Target(10.0),
    }
)
"""Targets of HUMAN_STUDY.md, section 10. Thread pools of the serving process and workers may still add 16 threads and
file descriptors after the soak's first measurement."""
_SEED = 5


class PartSettings(Protocol):
    """Settings of a part."""

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        ...


class Part(NamedTuple):
    """A part of the benchmark, with its settings for a full and a quick run."""

    measure: Callable[..., Values]
    full: PartSettings
    quick: PartSettings


_MANY = LoadSettings(bots=200, seconds=60.0, kinds=("random",), rate=4.0, seed=17)
"""More keys than two cores can render pictures for."""
PARTS = {
    "store": Part(measure_store, StoreSettings(), StoreSettings(seconds=3.0)),
    "load": Part(measure_load, LoadSettings(), LoadSettings(seconds=20.0)),
    "browser": Part(measure_browser, BrowserSettings(), BrowserSettings(keys=15)),
    "pogview": Part(measure_pog_view, PogViewSettings(), PogViewSettings(faces=100_000, seconds=3.0, moves=10)),
    "kills": Part(measure_kills, KillSettings(), KillSettings(kills=6, bots=3)),
    "people": Part(measure_load, _MANY, _MANY.model_copy(update={"bots": 60, "seconds": 10.0})),
    "big-home": Part(measure_big_home, BigHomeSettings(), BigHomeSettings(faces=100_000, bots=5, before_s=8.0)),
    "restart": Part(measure_restarts, RestartSettings(), RestartSettings(restarts=2, bots=5, acted_keys=10)),
    "soak": Part(measure_soak, SoakSettings(), SoakSettings(seconds=30.0, bots=8)),
}
"""The parts in the order in which they are measured."""
FULL = {name: part.full for name, part in PARTS.items()}
QUICK = {name: part.quick for name, part in PARTS.items()}


def measure(settings: Mapping[str, PartSettings], progress: Progress, *, parts: Sequence[str] = ()) -> Findings:
    """Measures some parts, each in its own study, one after the other.

    Args:
        settings: FULL or QUICK, or others by the parts' names.
        progress: Gets a line about the current work.
        parts: Names in PARTS, which are measured in its order; () = all.

    Returns:
        Values of each part by its name; `load_of`, the machine's load average before each part, which earlier parts may
        have raised; and at the top, the most important figures of the load and browser cases.

    Raises:
        StudyError: A part is unknown, a study cannot be served, or bots cannot come back to it.
    """
    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise StudyError(f"--parts {' '.join(unknown)}: is none of the parts; expected some of {', '.join(PARTS)}.")
    chosen = [part for part in PARTS if part in (parts or PARTS)]
    found: dict[str, Values] = {}
    load_of: dict[str, float] = {}
    notes = ["Studies on an invented home, served by their own gateway and workers; all share the cores."]
    with tempfile.TemporaryDirectory(prefix="personal-bench-study-") as name:
        dataset = Path(name) / "dataset"
        for part in chosen:
            progress(f"part {part}")
            load_of[part] = psutil.getloadavg()[0]
            if part != "store" and not dataset.exists():
                invent_dataset(dataset, name=HOME, seed=_SEED)
            folder = Path(name) / part
            folder.mkdir()
            own = settings[part]
            key = part.replace("-", "_")
            found[key] = PARTS[part].measure(own, folder=folder, dataset=dataset, progress=progress)
            notes.append(f"{part}: {own.words} Load average before it: {load_of[part]:.2f}.")
    return Findings(
        {**_asked_for(found), **found, "load_of": load_of},
        notes,
        left_out=[part for part in PARTS if part not in chosen],
        problems=[f"{part}: {line}" for part, values in found.items() for line in values.get("problems", ())],
    )


def _asked_for(found: dict[str, Values]) -> dict[str, Any]:
    load, browser = found.get("load", {}), found.get("browser", {})
    names = ("participants", "ack_p50_ms", "ack_p95_ms", "lost", "duplicated")
    values = {name: load.get(name) for name in names}
    values |= {name: browser.get(name) for name in ("key_to_image_p50_ms", "key_to_image_p95_ms")}
    view = found.get("pogview", {})
    return values | {name: view.get(name) for name in ("fps", "p95_ms", "click_mm_p99")}

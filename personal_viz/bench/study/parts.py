"""What a study costs its participants, and what it stands: a key's time, and kills, crowds, restarts, big homes."""

import os
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from sim.authoring.generation import invent_dataset
from sim.render.raycast import own_cores

from ...bots.run import BotFigures
from ...bots.site import HOME
from .big_home import measure_big_home
from .figures import FULL as FULL
from .figures import LIMITS as LIMITS
from .figures import PARTS as PARTS
from .figures import QUICK as QUICK
from .figures import BrowserFigures, Part, StoreFigures, StoreSettings, StudyFigures
from .figures import StudySettings as StudySettings
from .figures import figure_rows as figure_rows
from .figures import markdown as markdown
from .figures import missed as missed
from .kills import measure_kills
from .online import measure_browser, measure_load
from .people import measure_people
from .restart import measure_restarts
from .soak import measure_soak
from .store import store_acks_ms

_SEED = 5
_MEASURES: dict[Part, Callable[..., BaseModel | None]] = {
    "load": measure_load,
    "browser": measure_browser,
    "kills": measure_kills,
    "people": measure_people,
    "big-home": measure_big_home,
    "restart": measure_restarts,
    "soak": measure_soak,
}
"""Of parts that serve a study."""


def measure_study(settings: StudySettings, *, progress: Callable[[str], None]) -> StudyFigures:
    """Measures the parts that were asked for, each in a study of its own, one after the other.

    Args:
        settings: How much.
        progress: Told what is done now.

    Raises:
        StudyError: A study cannot be served, or bots do not find back into it.
    """
    load_before = os.getloadavg()[0]
    found: dict[str, Any] = {}
    loads: dict[Part, float] = {}
    with tempfile.TemporaryDirectory(prefix="personal-bench-study-") as name:
        dataset = Path(name) / "dataset"
        for part in settings.parts:
            progress(f"part {part}")
            loads[part] = os.getloadavg()[0]
            if part == "store":
                found[part] = _store(settings.store)
                continue
            if not dataset.exists():
                invent_dataset(dataset, name=HOME, seed=_SEED)
            folder = Path(name) / part
            folder.mkdir()
            own = getattr(settings, part.replace("-", "_"))
            found[part.replace("-", "_")] = _MEASURES[part](own, folder=folder, dataset=dataset, progress=progress)
    load: BotFigures | None = found.get("load")
    browser: BrowserFigures | None = found.get("browser")
    return StudyFigures(
        settings=settings,
        participants=load.participants if load else None,
        ack_p50_ms=load.ack_p50_ms if load else None,
        ack_p95_ms=load.ack_p95_ms if load else None,
        key_to_image_p50_ms=browser.key_to_image_p50_ms if browser else None,
        key_to_image_p95_ms=browser.key_to_image_p95_ms if browser else None,
        lost=load.lost if load else None,
        duplicated=load.duplicated if load else None,
        **found,
        cores=own_cores(),
        load_before=load_before,
        load_of=loads,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _store(settings: StoreSettings) -> StoreFigures:
    acks = store_acks_ms(participants=settings.participants, rate=settings.rate, seconds=settings.seconds)
    return StoreFigures(ack_p50_ms=float(np.quantile(acks, 0.5)), ack_p95_ms=float(np.quantile(acks, 0.95)))

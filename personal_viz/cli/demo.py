"""Verb `demo`: an invented home and a study on it."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from personal_viz.study_app.gateway.options import ServeOptions
from sim.authoring.generation import invent_dataset
from sim.errors import StudyError

from .refusals import require_folder
from .study.serve import StudyServe

HOME = "DemoHome"


@dataclass
class Demo:
    """Invent a home, serve a study on it, and print two personal links."""

    out: Path = Path("runs/demo")
    seed: int = 5
    port: Annotated[str, arg(help="Also from the environment variable PORT; 0 takes a free one.")] = field(
        default_factory=lambda: os.environ.get("PORT", "8080")
    )

    def run(self) -> int:
        dataset = self.out / "dataset"
        if not (dataset / "scenes" / f"{HOME}.plan.json").is_file():
            require_folder(self.out)
            print(f"Inventing a home with episodes in {dataset} ...", flush=True)
            invent_dataset(dataset, name=HOME, seed=self.seed)
        port = _port_from(self.port)
        serving = ServeOptions(port=port)
        return StudyServe(dataset, scene=HOME, out=self.out / "study", seed=self.seed, serving=serving).run()


def _port_from(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise StudyError(f"PORT is {text!r}; expected a number from 0 to 65535. Start again: make demo PORT=8090")
    return int(text)

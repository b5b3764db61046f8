"""The bots that act in a study while something is measured, and whether they come back to where they were."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Act, Key

from ...bots.crowd import Crowd, crowd
from ...bots.records import BotKind, BotLog, trial_events
from ...bots.server import Server
from ...bots.site import Person, Site, make_bot_study
from ...bots.walker import PATIENCE_S


class CrewSettings(BaseModel):
    """The bots that act in a study while something is measured."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bots: int
    kinds: tuple[BotKind, ...] = ("random",)
    """Kinds of bots, dealt out in turn."""
    rate: float = 2.0
    """Keys per second that each bot should press."""
    seed: int
    """Seed of the plan and of the bots' choices."""

    @contextmanager
    def crowd(self, site: Site, people: Sequence[Person]) -> Iterator[Crowd]:
        """Yields bots that come back by themselves, one for each of some participants."""
        with crowd(site, people, kinds=self.kinds, rate=self.rate, seed=self.seed, patience_s=PATIENCE_S) as found:
            yield found


@contextmanager
def staffed(
    folder: Path, dataset: Path, crew: CrewSettings, *, workers: int | None = None
) -> Iterator[tuple[Server, Site, Crowd]]:
    """Yields a served study with its own plan, and its bots, which have not come yet; at the block's end all leave.

    Args:
        folder: An empty folder.
        dataset: Dataset of one invented home.
        crew: Number of bots, and how they behave.
        workers: Number of the server's workers; None = the usual number.
    """
    make_bot_study(folder, participants=crew.bots, seed=crew.seed, dataset=dataset)
    with Server(folder / "study", dataset, workers=workers) as server:
        site = server.start()
        with crew.crowd(site, site.people(("pan",))) as bots:
            yield server, site, bots


def resumed_elsewhere(folder: Path, logs: Sequence[BotLog]) -> tuple[int, tuple[str, ...]]:
    """Number of returns that could be compared, and those after which a bot stood at a step not in the records.

    The first picture of a new connection shows a step; the key that the bot pressed next must be stored after the same
    number of steps. Returns after which no key was stored, because the next kill came first, are left out.
    """
    compared, wrong = 0, []
    with read_study(folder) as reader:
        for log in logs:
            steps_before = _steps_before_keys(reader, log.code)
            for step, place in log.resumed:
                mark = log.presses[place].mark if place < len(log.presses) else None
                if mark not in steps_before:
                    continue
                compared += 1
                if steps_before[mark] != step:
                    wrong.append(f"{log.code}: shown step {step}, stored {steps_before[mark]}")
    return compared, tuple(wrong)


def _steps_before_keys(reader: StudyReader, code: str) -> dict[float, int]:
    """Number of steps in the trial before each key, by the key's own time."""
    found: dict[float, int] = {}
    for events in trial_events(reader, code):
        steps = 0
        for event in events:
            steps += isinstance(event, Act)
            if isinstance(event, Key) and event.t_cli_ms is not None:
                found.setdefault(event.t_cli_ms, steps)
    return found

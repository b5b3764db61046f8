"""The bots that act in a study while something is measured, and whether the records hold all that they did.

A page's counter says "Step 7" when seven steps are on disk: a step is lost if the counter has shown it and it is not
stored. `bots.records` searches for keys.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Act, Key, Open

from ...bots.crowd import Crowd, crowd
from ...bots.records import BotCount, BotKind, BotLog, count_bots, events_of
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
    folder: Path, dataset: Path, crew: CrewSettings, *, spare: int = 0, workers: int | None = None
) -> Iterator[tuple[Server, Site, Crowd]]:
    """Yields a served study with its own plan, and its bots, which have not come yet; at the block's end all leave.

    Args:
        folder: An empty folder.
        dataset: Dataset of one invented home.
        crew: Number of bots, and how they behave.
        spare: Number of participants without a bot, at the end of the list.
        workers: Number of the server's workers; None = the usual number.
    """
    make_bot_study(folder, participants=crew.bots + spare, seed=crew.seed, dataset=dataset)
    with Server(folder / "study", dataset, workers=workers) as server:
        site = server.start()
        with crew.crowd(site, site.people(("pan",))[: crew.bots]) as bots:
            yield server, site, bots


@dataclass(frozen=True, slots=True)
class Kept:
    """How many of the keys and steps that a crowd sent are in the records."""

    keys: BotCount
    missing: tuple[str, ...]
    """Result of `missing_steps`."""
    bot_problems: tuple[str, ...]

    @property
    def lost(self) -> int:
        """Number of keys and steps that were acknowledged and are not stored."""
        return len(self.keys.lost) + len(self.missing)

    @property
    def problems(self) -> tuple[str, ...]:
        """Everything that went wrong, in words."""
        return (*self.bot_problems, *self.keys.lost, *self.missing)


def kept(folder: Path, bots: Crowd) -> Kept:
    """Compares a crowd's actions with the records.

    Raises:
        StudyError: The database is damaged.
    """
    return Kept(count_bots(folder, bots.logs), missing_steps(folder, bots.logs), bots.problems)


def missing_steps(folder: Path, logs: Sequence[BotLog]) -> tuple[str, ...]:
    """Steps that a bot's page has counted but that are not stored now; all hash chains are checked.

    Raises:
        StudyError: The database is damaged.
    """
    counted = [log.step_counted for log in logs]  # must be read before the records
    missing = []
    with read_study(folder) as reader:
        reader.check()
        for log, step in zip(logs, counted, strict=True):
            opened = [status.trial_id for status in reader.trials(log.code) if status.trial_id is not None]
            steps = [sum(isinstance(line.event, Act) for line in reader.events(trial)) for trial in opened[-2:]]
            stored = max(steps, default=0)  # of the last two trials: the page may still show the previous one
            if stored < step:
                missing.append(f"{log.code}: step {step} was counted, {stored} are stored")
    return tuple(missing)


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
                mark = log.presses[place].t_cli_ms if place < len(log.presses) else None
                if mark not in steps_before:
                    continue
                compared += 1
                if steps_before[mark] != step:
                    wrong.append(f"{log.code}: shown step {step}, stored {steps_before[mark]}")
    return compared, tuple(wrong)


def _steps_before_keys(reader: StudyReader, code: str) -> dict[float | None, int]:
    """Number of steps in the trial before each key, by the key's own time."""
    found: dict[float | None, int] = {}
    steps = 0
    for event in events_of(reader, code):
        steps = 0 if isinstance(event, Open) else steps + isinstance(event, Act)
        if isinstance(event, Key) and event.t_cli_ms is not None:
            found.setdefault(event.t_cli_ms, steps)
    return found

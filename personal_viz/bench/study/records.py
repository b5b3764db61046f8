"""Checks a study's records after kills and crowds: they hold each acknowledged step, and all bots are where they were.

A page's counter says "Step 7" when seven steps are on disk: a step is lost if the counter has shown it and it is not
stored. `bots.records` searches for keys.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from human_study.store.records import StudyReader, read_study
from human_study.trial.events import Act, Event, Key, Open
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.tasks.pan import PanEnv

from ...bots.records import BotCount, count_bots, events_of
from ...study_app.home.trial_homes import open_trial_home
from .crowd import Crowd, StayingBot


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
    return Kept(count_bots(folder, bots.logs), missing_steps(folder, bots.bots), bots.problems)


def missing_steps(folder: Path, bots: Sequence[StayingBot]) -> tuple[str, ...]:
    """Steps that a bot's page has counted but that are not stored now; all hash chains are checked.

    Raises:
        StudyError: The database is damaged.
    """
    shown = [bot.step_counted for bot in bots]  # must be read before the records
    missing = []
    with read_study(folder) as reader:
        reader.check()
        for bot, step in zip(bots, shown, strict=True):
            # the page may still show the previous trial
            stored = max((len(steps) for steps in _last_steps(reader, bot.log.code)), default=0)
            if stored < step:
                missing.append(f"{bot.log.code}: step {step} was counted, {stored} are stored")
    return tuple(missing)


def resumed_elsewhere(folder: Path, bots: Sequence[StayingBot]) -> tuple[int, tuple[str, ...]]:
    """Number of returns that could be compared, and those after which a bot stood at a step not in the records.

    The first picture of a new connection shows a step; the key that the bot pressed next must be stored after the same
    number of steps. Returns after which no key was stored, because the next kill came first, are left out.
    """
    compared, wrong = 0, []
    with read_study(folder) as reader:
        for bot in bots:
            steps_before = _steps_before_keys(reader, bot.log.code)
            for step, place in bot.resumed:
                mark = bot.log.presses[place].t_cli_ms if place < len(bot.log.presses) else None
                if mark not in steps_before:
                    continue
                compared += 1
                if steps_before[mark] != step:
                    wrong.append(f"{bot.log.code}: shown step {step}, stored {steps_before[mark]}")
    return compared, tuple(wrong)


def poses_elsewhere(folder: Path, dataset: Path) -> tuple[int, tuple[str, ...]]:
    """Number of replayed steps, and the trials in which a step leads to another pose than the stored one.

    Each trial is replayed from its start in one go: a session that resumed at another pose would not fit.
    """
    steps, wrong = 0, []
    episodes = PersonalDataset(dataset)
    with read_study(folder) as reader:
        homes = {scene.name: open_trial_home(episodes, scene, None) for scene in reader.plan.scenes}
        for code in reader.codes():
            for status in reader.trials(code):
                events = [line.event for line in reader.events(status.trial_id)] if status.trial_id else []
                if not any(isinstance(event, Open) for event in events):
                    continue
                home = homes[status.key.scene]
                env = PanEnv(home.episode(status.key).start, home.navigation, renderer=None)
                found = first_other_step(events, env)
                steps += sum(isinstance(event, Act) for event in events)
                if found is not None:
                    wrong.append(f"{code}, trial {status.order_no}: step {found} leads elsewhere than stored")
    return steps, tuple(wrong)


def first_other_step(events: Sequence[Event], env: PanEnv) -> int | None:
    """The first step, from 1, whose pose differs from the stored one in any bit.

    Raises:
        StudyError: There are steps after the end.
    """
    env.reset()
    for number, act in enumerate((event for event in events if isinstance(event, Act)), start=1):
        if env.is_over:
            raise StudyError(f"step {number}: is stored after the trial's end; expected none. Restore a backup.")
        env.step(act.action)
        step = env.steps[-1]
        if (step.position, step.yaw, step.tilt) != (act.position, act.yaw, act.tilt):
            return number
    return None


def _last_steps(reader: StudyReader, code: str) -> list[list[Act]]:
    """Steps of the last two opened trials."""
    opened = [status.trial_id for status in reader.trials(code) if status.trial_id is not None]
    return [[line.event for line in reader.events(trial) if isinstance(line.event, Act)] for trial in opened[-2:]]


def _steps_before_keys(reader: StudyReader, code: str) -> dict[float | None, int]:
    """Number of steps in the trial before each key, by the key's own time."""
    found: dict[float | None, int] = {}
    steps = 0
    for event in events_of(reader, code):
        steps = 0 if isinstance(event, Open) else steps + isinstance(event, Act)
        if isinstance(event, Key) and event.t_cli_ms is not None:
            found.setdefault(event.t_cli_ms, steps)
    return found

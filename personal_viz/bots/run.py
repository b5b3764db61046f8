"""Lets many bots take part at once and says what came of it."""

import asyncio
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence

from sim.errors import StudyError
from sim.types import TaskKind

from .count import count_keys
from .figures import BotFigures as BotFigures
from .figures import Spent, figures_of
from .figures import quantile as quantile
from .flow import right_answers
from .goal import GoalFinder
from .homes import BotHomes
from .log import BotKind
from .pan import PanBot
from .pog import PogBot
from .site import Person, Site, cpu_seconds
from .walker import Bot
from .way import WayFinder

_ARRIVE_TOGETHER = 10
"""Bots that come in at the same time."""


def run_bots(
    site: Site,
    *,
    participants: int,
    seconds: float,
    rate: float,
    kinds: Sequence[BotKind],
    seed: int,
    tasks: Sequence[TaskKind] = ("pan",),
    progress: Callable[[str], None] = lambda _: None,
    on_acting: Callable[[], None] = lambda: None,
) -> BotFigures:
    """Everybody comes in and answers the pages; then all do their trials for so many seconds, or until they are done.

    Args:
        site: The study that is being served.
        participants: How many of those who do one of the tasks, in the plan's order.
        seconds: From the first key on.
        rate: Actions per second and bot.
        kinds: Dealt out in turns, in each task by itself.
        seed: Of the bots' choices.
        tasks: Whom bots stand for.
        progress: Told what is done now.
        on_acting: Called when all are in and the first key is pressed.

    Raises:
        StudyError: The study has too few participants, a bot is not let in, or the database is damaged.
    """
    people = site.people(tasks)
    if len(people) < participants:
        names = " and ".join(task.upper() for task in tasks)
        raise StudyError(
            f"{site.folder}: has {len(people)} {names} participants; expected at least {participants}. "
            "Plan more, or give a smaller --participants."
        )
    bots = _bots(site, people[:participants], rate=rate, kinds=kinds, seed=seed)
    return asyncio.run(
        _run(site, bots, seconds=seconds, rate=rate, kinds=kinds, progress=progress, on_acting=on_acting)
    )


def _bots(
    site: Site,
    people: Sequence[Person],
    *,
    rate: float,
    kinds: Sequence[BotKind],
    seed: int,
) -> list[Bot]:
    """A bot for each of the people."""
    homes = BotHomes(site)
    ways, goals = WayFinder(homes), GoalFinder(homes)
    numbers: Counter[TaskKind] = Counter()
    bots: list[Bot] = []
    for number, (code, task, link) in enumerate(people):
        kind = kinds[numbers[task] % len(kinds)]
        numbers[task] += 1
        knows = kind == "shortest"
        answers, own_seed = right_answers(homes.config, task), seed + number
        if task == "pan":
            way = ways.way if knows else None
            bots.append(PanBot(code, link, kind, rate=rate, seed=own_seed, answers=answers, way=way))
        else:
            goal = goals.goal if knows else None
            bots.append(
                PogBot(
                    code,
                    link,
                    kind,
                    rate=rate,
                    seed=own_seed,
                    answers=answers,
                    goal=goal,
                    anywhere=goals.anywhere,
                )
            )
    return bots


async def _run(
    site: Site,
    bots: Sequence[Bot],
    *,
    seconds: float,
    rate: float,
    kinds: Sequence[BotKind],
    progress: Callable[[str], None],
    on_acting: Callable[[], None],
) -> BotFigures:
    progress(f"{len(bots)} bots come in")
    for first in range(0, len(bots), _ARRIVE_TOGETHER):
        await asyncio.gather(*(bot.arrive() for bot in bots[first : first + _ARRIVE_TOGETHER]))
    progress(f"all are in; they act for {seconds:g} s")
    load_before = os.getloadavg()[0]
    served_cpu = cpu_seconds(site.pid) if site.pid is not None else None
    on_acting()
    own_cpu, began_s = time.process_time(), time.perf_counter()
    await asyncio.gather(*(bot.act(began_s + seconds) for bot in bots))
    elapsed_s, own_cpu = time.perf_counter() - began_s, time.process_time() - own_cpu
    if served_cpu is not None and site.pid is not None:
        served_cpu = cpu_seconds(site.pid) - served_cpu
    progress("comparing with the database")
    logs = [bot.log for bot in bots]
    counted = await asyncio.to_thread(count_keys, site.folder, logs)
    return figures_of(logs, counted, Spent(elapsed_s, own_cpu, served_cpu, load_before), kinds=kinds, rate=rate)

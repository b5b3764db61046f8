"""What `bench study` measures and finds: settings and figures of all parts, and which figures meet their limits."""

from collections.abc import Iterator
from typing import Literal

from pydantic import BaseModel, ConfigDict

from ...bots.run import BotFigures
from .big_home import BigHomeFigures, BigHomeSettings
from .kills import KillFigures, KillSettings
from .online import BrowserFigures as BrowserFigures
from .online import BrowserSettings, LoadSettings
from .people import PeopleFigures, PeopleSettings
from .restart import RestartFigures, RestartSettings
from .soak import SoakFigures, SoakSettings

Part = Literal["store", "load", "browser", "kills", "people", "big-home", "restart", "soak"]
PARTS: tuple[Part, ...] = ("store", "load", "browser", "kills", "people", "big-home", "restart", "soak")
_GROWTH = 16.0
"""Threads and file descriptors that pools of serving process and workers may still add after the first look."""
LIMITS = {
    "store.ack_p95_ms": 50.0,
    "load.ack_p95_ms": 50.0,
    "load.key_to_frame_p95_ms": 250.0,
    "load.lost": 0.0,
    "load.duplicated": 0.0,
    "browser.alone_p50_ms": 60.0,
    "browser.key_to_image_p50_ms": 100.0,
    "browser.key_to_image_p95_ms": 200.0,
    "browser.delayed_p50_over_round_trip_ms": 60.0,
    "kills.lost_after_kill": 0.0,
    "kills.duplicated_after_kill": 0.0,
    "kills.unknown_after_kill": 0.0,
    "kills.chain_failures": 0.0,
    "kills.resumed_elsewhere": 0.0,
    "people.lost": 0.0,
    "people.duplicated": 0.0,
    "big_home.while_ack_p99_ms": 150.0,
    "big_home.lost": 0.0,
    "big_home.duplicated": 0.0,
    "restart.drain_s": 10.0,
    "restart.processes_left": 0.0,
    "restart.lost": 0.0,
    "restart.duplicated": 0.0,
    "restart.resumed_elsewhere": 0.0,
    "soak.lost": 0.0,
    "soak.duplicated": 0.0,
    "soak.fds_growth": _GROWTH,
    "soak.threads_growth": _GROWTH,
    "soak.clients_growth": 0.0,
    "soak.clients_left": 0.0,
    "soak.leases_left": 0.0,
}
"""Most that figures may be: the issue's targets, and HUMAN_STUDY.md, section 10."""


class StoreSettings(BaseModel):
    """The store alone."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int = 50
    rate: float = 2.0
    """Keys per second of each."""
    seconds: float = 10.0


class StoreFigures(BaseModel):
    """The store alone: from handing over a key and its step until they are on disk."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    ack_p50_ms: float
    ack_p95_ms: float


class StudySettings(BaseModel):
    """How much is measured."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    parts: tuple[Part, ...] = PARTS
    store: StoreSettings = StoreSettings()
    load: LoadSettings = LoadSettings()
    browser: BrowserSettings = BrowserSettings()
    kills: KillSettings = KillSettings()
    people: PeopleSettings = PeopleSettings()
    big_home: BigHomeSettings = BigHomeSettings()
    restart: RestartSettings = RestartSettings()
    soak: SoakSettings = SoakSettings()


FULL = StudySettings()
QUICK = StudySettings(
    store=StoreSettings(seconds=3.0),
    load=LoadSettings(seconds=20.0),
    browser=BrowserSettings(keys=15),
    kills=KillSettings(kills=6, bots=3),
    people=PeopleSettings(bots=60, seconds=10.0),
    big_home=BigHomeSettings(faces=100_000, bots=5, before_s=8.0),
    restart=RestartSettings(restarts=2, bots=5, acted_keys=10),
    soak=SoakSettings(seconds=30.0, bots=8),
)


class StudyFigures(BaseModel):
    """What `bench study --json` prints; a part that was not run is None."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    benchmark: Literal["study"] = "study"
    settings: StudySettings
    participants: int | None
    """Bots of the load case, of which `ack_*`, `lost` and `duplicated` are."""
    ack_p50_ms: float | None
    """Load case, at the bot: from sending a key to the step counter that follows the commit."""
    ack_p95_ms: float | None
    key_to_image_p50_ms: float | None
    """Real Chromium, some participants acting at once: from keydown until the new picture is drawn. None also where
    there is no Chromium or no Playwright."""
    key_to_image_p95_ms: float | None
    lost: int | None
    """Keys of the load case that were sent and are not in the database."""
    duplicated: int | None
    """Keys of the load case that are in the database more than once."""
    store: StoreFigures | None = None
    load: BotFigures | None = None
    browser: BrowserFigures | None = None
    kills: KillFigures | None = None
    people: PeopleFigures | None = None
    big_home: BigHomeFigures | None = None
    restart: RestartFigures | None = None
    soak: SoakFigures | None = None
    cores: int
    load_before: float
    """The machine's load average before anything was measured."""
    load_of: dict[Part, float] = {}
    """The load average before each part, which what ran before may have raised."""
    created_utc: str

    def part(self, part: Part) -> BaseModel | None:
        """A part's figures."""
        return getattr(self, part.replace("-", "_"))


def figure_rows(figures: StudyFigures) -> list[tuple[str, ...]]:
    """Heads, then each figure of each part that was asked for, with its limit, where it has one."""
    rows = [("figure", "found", "limit", "result")]
    for part in figures.settings.parts:
        found = figures.part(part)
        name = part.replace("-", "_")
        if found is not None:
            rows += [_row(f"{name}.{figure}", value) for figure, value in _numbers(found)]
        else:
            rows += [(figure, "-", f"<= {limit:g}", "not measured") for figure, limit in _limits_of(name)]
    return rows


def markdown(figures: StudyFigures) -> str:
    """The table, and what was measured."""
    heads, *rows = ("| " + " | ".join(row) + " |" for row in figure_rows(figures))
    used = figures.settings
    text = (
        f"{figures.created_utc}, {figures.cores} cores, load average {figures.load_before:.2f} before it began. "
        "Studies on an invented home, served by their own gateway and workers; all share the cores."
    )
    lines = [f"- {part}: {_words(used, part)}{_load_words(figures, part)}" for part in used.parts]
    problems = [f"- {part}: {line}" for part in used.parts for line in _problems(figures.part(part))]
    more = ["## Problems", "", *problems, ""] if problems else []
    return "\n".join(["# Human study", "", text, "", *lines, "", heads, "|---|---|---|---|", *rows, "", *more])


def _words(used: StudySettings, part: Part) -> str:
    """What a part does."""
    load, browser, soak = used.load, used.browser, used.soak
    match part:
        case "store":
            return f"the store alone, {used.store.participants} people for {used.store.seconds:g} s."
        case "load":
            return (
                f"{load.bots} bots ({', '.join(load.kinds)}), {load.rate:g} keys a second each, for {load.seconds:g} "
                "s; random ones press on when a picture is late (these keys have no effect), the others wait."
            )
        case "browser":
            return (
                f"{browser.keys} keys in Chromium, at most one each half second, from keydown until the new picture "
                f"is drawn: alone, with {browser.together - 1} bots acting beside it, and over a line with a round "
                f"trip of {browser.round_trip_ms:g} ms."
            )
        case "kills":
            return (
                f"kill -9 at {used.kills.kills} random instants, of the serving process or of a worker, while "
                f"{used.kills.bots} bots walk."
            )
        case "people":
            return (
                f"{used.people.bots} bots, {used.people.rate:g} keys a second asked of each, for "
                f"{used.people.seconds:g} s: more than two cores can show pictures to."
            )
        case "big-home":
            return f"keys of {used.big_home.bots} bots while somebody opens a home of {used.big_home.faces} triangles."
        case "restart":
            return f"{used.restart.restarts} times, by SIGTERM and SIGINT in turns, {used.restart.bots} bots online."
        case "soak":
            return f"{soak.bots} bots that come and go ({', '.join(soak.kinds)}) for {soak.seconds:g} s."


def _load_words(figures: StudyFigures, part: Part) -> str:
    load = figures.load_of.get(part)
    return "" if load is None else f" Load average before it: {load:.2f}."


def missed(figures: StudyFigures) -> list[str]:
    """Figures that are above their limits."""
    return [row[0] for row in figure_rows(figures) if row[3] == "missed"]


def _row(name: str, value: float) -> tuple[str, ...]:
    limit = LIMITS.get(name)
    verdict = "" if limit is None else "met" if value <= limit else "missed"
    return (name, f"{value:.1f}" if isinstance(value, float) else f"{value}", _bound(limit), verdict)


def _bound(limit: float | None) -> str:
    return "" if limit is None else f"<= {limit:g}"


def _limits_of(part: str) -> list[tuple[str, float]]:
    return [(name, limit) for name, limit in LIMITS.items() if name.partition(".")[0] == part]


def _numbers(found: BaseModel) -> Iterator[tuple[str, float]]:
    for name, value in found:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield name, value


def _problems(found: BaseModel | None) -> tuple[str, ...]:
    """What bots say went wrong; people's is one level down."""
    load = getattr(found, "load", found)
    return tuple(getattr(load, "problems", ()))

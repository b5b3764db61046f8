"""Measures the cost of recordings: an episode logged live, beside a loop that only encodes it, and a big comparison."""

import contextlib
import io
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict

from recordings.observer import RerunObserver
from recordings.replay import log_comparison
from recordings.sinks import LiveSink
from recordings.viewer.web import serve_file
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import MissingDependencyError
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.render.renderer import JPEG_QUALITY, Renderer, jpeg_bytes
from sim.tasks.pan import PanEnv
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import Run
from sim.tasks.runner import run_from_env
from sim.types import Action, Observation, WhoKind

from ..browser import open_chromium
from .harness import Findings, Plan, Progress, Target, Timing, interleaved

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext

PLAN = Plan(
    targets={
        "cost_over_encoding": Target(1.3),
        "cost_over_fast_encoding": Target(1.3),
        "mb_with_pixels": Target(35.0),
        "mb_without": Target(2.0),
        "compare_build_s": Target(10.0),
        "compare_open_s": Target(10.0),
    },
    references={"steps_per_s": "encode_only_steps_per_s"},
    units=dict.fromkeys(("mb_with_pixels", "mb_without", "compare_mb"), "MB"),
)

_WATCH_VIEWER = """
window.viewerAtRest = new Promise((rest, never) => {
  const [width, height, restful, longestMs] = [320, 200, 30, 180000];
  const pixels = new OffscreenCanvas(width, height).getContext("2d", {willReadFrequently: true});
  pixels.imageSmoothingEnabled = false;
  const next = window.requestAnimationFrame.bind(window);
  const frames = [];
  let idle = 0;
  window.requestAnimationFrame = (callback) => next((at) => {
    const before = performance.now();
    callback(at);
    const canvas = document.getElementById("the_canvas_id");
    if (!canvas || !canvas.width || idle > restful) return;
    idle = performance.now() - before < 2 ? idle + 1 : 0;
    if (idle === 0) {
      pixels.drawImage(canvas, 0, 0, width, height);
      const colours = new Set(new Uint32Array(pixels.getImageData(0, 0, width, height).data.buffer)).size;
      frames.push([performance.now(), colours]);
    } else if (idle === restful) frames.length ? rest(frames) : idle = 0;
  });
  setTimeout(() => never(Error(`the viewer still draws after ${longestMs} ms`)), longestMs);
});
"""
"""Notes the time (ms) and the number of colours of each frame, until no more come; reading a frame waits for it."""
_FILLED = 0.9
"""A recording counts as shown when the picture has this share of its final number of colours."""


_SEED = 5
_HOME = "BenchHome"
_SECONDS_PER_STEP = 0.8
"""Approximate time that a person takes for a step."""
_TURN_SHARE = 0.1
"""Probability that a walker turns although it could go on."""
_MOST_TURNS = 5
"""Largest number of turns in a row: 150 degrees."""


class RecordingSettings(BaseModel):
    """Sizes and numbers of the recorded runs."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    agent_steps: int = 500
    person_steps: int = 80
    num_people: int = 5
    num_agents: int = 3
    repeats: int = 5


FULL = RecordingSettings()
QUICK = RecordingSettings(num_people=2, num_agents=1, repeats=2)


@dataclass(frozen=True, slots=True)
class RecordedHome:
    """An invented home and the episode that all walkers play in it."""

    scene: Scene
    episode: Episode


@dataclass(frozen=True, slots=True)
class Played:
    """One walker's run and its observations."""

    run: Run
    observations: tuple[Observation, ...]
    """Observations at the start and after each step."""


def measure(settings: RecordingSettings, progress: Progress) -> Findings:
    """Measures everything on one invented home.

    Args:
        settings: Sizes and numbers of the runs.
        progress: Gets a line about the current work.

    Returns:
        Values: `steps_per_s`, an episode's steps per elapsed second of the live observer that
        writes a file (picture, map, texts, distances); `encode_only_steps_per_s` of a loop that only encodes the same
        JPEGs with Pillow; `encode_only_fast_steps_per_s` with the observer's own encoder, which gives equal bytes;
        `cost_over_encoding`, `cost_over_fast_encoding` and `cpu_cost_over_encoding`, the observer's seconds over those
        of the loops; `mb_with_pixels` and `mb_without`, the size of the episode's file for a scan, with pictures and
        with poses and figures alone; `compare_build_s` to write one recording of all people and agents, with rendered
        pictures; `compare_open_s` until Rerun's web viewer shows it with all pictures in a headless Chromium that draws
        on the CPU (None without Chromium or Playwright); `compare_mb`; and `compare_pictures`, the number of poses with
        a picture.
    """
    progress("inventing a home")
    home = recorded_home()
    renderer = renderer_of(home.scene)
    progress(f"an episode of {settings.agent_steps} steps")
    played = _play(home, renderer, num_steps=settings.agent_steps)
    runs = _compared_runs(home, settings)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        progress("logging it live")
        timings = _live_timings(home, played, folder / "live.rrd", repeats=settings.repeats)
        with_pixels, without = (
            _scan_size(home, played, folder / "scan.rrd", with_pixels=flag) for flag in (True, False)
        )
        progress(f"{settings.num_people} people and {settings.num_agents} agents in one recording")
        build_s = _build_s(home, runs, renderer, folder / "compare.rrd")
        compared = (folder / "compare.rrd").stat().st_size
        open_s = _median_opening_s(folder / "compare.rrd", repeats=settings.repeats)
    log, encode, fast = timings["log"], timings["encode"], timings["encode fast"]
    pictures = sum(len(run.episodes[0].poses) for run in runs)
    values = {
        "steps_per_s": settings.agent_steps / log.wall_s,
        "encode_only_steps_per_s": settings.agent_steps / encode.wall_s,
        "encode_only_fast_steps_per_s": settings.agent_steps / fast.wall_s,
        "cost_over_encoding": log.wall_s / encode.wall_s,
        "cost_over_fast_encoding": log.wall_s / fast.wall_s,
        "cpu_cost_over_encoding": log.core_s / encode.core_s,
        "mb_with_pixels": with_pixels / 1e6,
        "mb_without": without / 1e6,
        "compare_build_s": build_s,
        "compare_open_s": open_s,
        "compare_mb": compared / 1e6,
        "compare_pictures": pictures,
    }
    note = (
        f"One episode of {settings.agent_steps} steps in an invented home, logged by the observer of `run --rerun` "
        "into a file, beside loops that encode the same JPEGs, with Pillow and (fast) with our own encoder: medians of "
        f"{settings.repeats} episodes each, in turn. Then {settings.num_people} walkers of {settings.person_steps} "
        f"steps and {settings.num_agents} of {settings.agent_steps} in one recording: {pictures} poses, each with its "
        "picture, rendered again."
    )
    return Findings(values, (note,))


def recorded_home(*, seed: int = _SEED) -> RecordedHome:
    """The invented home of a seed with its first episode; the same seed gives the same home."""
    with tempfile.TemporaryDirectory() as folder:
        invent_dataset(Path(folder), name=_HOME, seed=seed)
        dataset = PersonalDataset(folder)
        return RecordedHome(open_scene(dataset, _HOME, scenes_dir=None), next(dataset.episodes(splits=("easy",))))


def walked(home: RecordedHome, who: str, *, who_kind: WhoKind, num_steps: int, seed: int) -> Run:
    """A run of exactly `num_steps` actions, STOP last: straight ahead, with turns at walls and now and then.

    Args:
        home: The home to walk in.
        who: Name of the run and of the walker.
        who_kind: Kind of walker; people take _SECONDS_PER_STEP for each step and have a code.
        num_steps: Number of actions.
        seed: Seed of the turns.
    """
    rng = np.random.default_rng(seed)
    episode, navigation = home.episode, home.scene.navigation
    env = PanEnv(episode.start, navigation, renderer=None, max_steps=num_steps)
    turns: list[Action] = []
    while len(env.steps) < num_steps - 1:
        collided = bool(env.steps) and env.steps[-1].collided
        if not turns and (collided or rng.random() < _TURN_SHARE):
            side = (Action.LEFT, Action.RIGHT)[int(rng.integers(2))]
            turns = [side] * int(rng.integers(1, _MOST_TURNS + 1))
        env.step(turns.pop() if turns else Action.FORWARD, t_s=_t_s(env, who_kind))
    env.step(Action.STOP, t_s=_t_s(env, who_kind))
    run = run_from_env(episode, env, scene_digest=home.scene.digest, navigation=navigation)
    if who_kind == "human":
        run = run.model_copy(update={"start": run.start.model_copy(update={"participant": "P01"})})
    info = make_run_info(who, who=who, who_kind=who_kind, scene_kind=home.scene.kind, dataset_digest="bench")
    return Run(info=info, episodes=(run,))


def _t_s(env: PanEnv, who_kind: WhoKind) -> float:
    return _SECONDS_PER_STEP * (len(env.steps) + 1) if who_kind == "human" else 0.0


def _play(home: RecordedHome, renderer: Renderer, *, num_steps: int) -> Played:
    """An agent's run and all its observations."""
    run = walked(home, "agent", who_kind="agent", num_steps=num_steps, seed=0)
    env = PanEnv(home.episode.start, home.scene.navigation, renderer=renderer, max_steps=num_steps)
    actions = [step.action for step in run.episodes[0].steps]
    return Played(run, (env.reset(), *(env.step(action) for action in actions)))


def _live_timings(home: RecordedHome, played: Played, out: Path, *, repeats: int) -> dict[str, Timing]:
    """Medians over whole episodes; one of each runs first without being counted."""
    pictures = [observation.rgb for observation in played.observations if observation.rgb is not None]
    work = {
        "encode": lambda _: [_pillow_jpeg(rgb) for rgb in pictures],
        "encode fast": lambda _: [jpeg_bytes(rgb) for rgb in pictures],
        "log": lambda _: _log_live(home, home.scene, played, out, with_pixels=False),
    }
    return interleaved(work, calls=repeats, warm_ups=1)


def _pillow_jpeg(rgb: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=JPEG_QUALITY)
    return buffer.getvalue()


def _log_live(home: RecordedHome, scene: Scene, played: Played, out: Path, *, with_pixels: bool) -> None:
    """Logs the whole episode into a file with the observer that `run --rerun` uses."""
    info = played.run.info.model_copy(update={"scene_kind": scene.kind})
    observer = RerunObserver(scene, LiveSink("file", str(out)), info, with_pixels=with_pixels)
    (run,) = played.run.episodes
    observer.on_reset(home.episode, played.observations[0])
    for step, observation in zip(run.steps, played.observations[1:], strict=True):
        observer.on_step(step, observation, None)
    observer.on_end(run)


def _scan_size(home: RecordedHome, played: Played, out: Path, *, with_pixels: bool) -> int:
    """Size in bytes of the episode's file if the home is treated as a licensed scan."""
    _log_live(home, replace(home.scene, kind="scan"), played, out, with_pixels=with_pixels)
    return out.stat().st_size


def _compared_runs(home: RecordedHome, settings: RecordingSettings) -> list[Run]:
    people = [
        walked(home, f"person-{k}", who_kind="human", num_steps=settings.person_steps, seed=k)
        for k in range(settings.num_people)
    ]
    agents = [
        walked(home, f"agent-{k}", who_kind="agent", num_steps=settings.agent_steps, seed=100 + k)
        for k in range(settings.num_agents)
    ]
    return people + agents


def _build_s(home: RecordedHome, runs: list[Run], renderer: Renderer, out: Path) -> float:
    """Elapsed seconds to write the comparison; browser copies and compiled code exist since the first live episode."""
    before = time.perf_counter()
    log_comparison(runs, episode=home.episode, scene=home.scene, out=out, renderer=renderer, with_pixels=False)
    return time.perf_counter() - before


def _median_opening_s(rrd: Path, *, repeats: int) -> float | None:
    """Median seconds to open the recording, each time in a fresh browser; None without a browser."""
    seconds = []
    try:
        for _ in range(repeats):
            with open_chromium() as browser:
                seconds.append(_opening_s(browser, rrd))
    except MissingDependencyError:
        return None
    return float(np.median(seconds))


def _opening_s(browser: "BrowserContext", rrd: Path) -> float:
    """Seconds until Rerun's web viewer shows a recording with all its pictures and no longer changes."""
    with serve_file(rrd) as site, contextlib.closing(browser.new_page()) as page:
        page.add_init_script(_WATCH_VIEWER)
        page.goto(f"{site.of_file(rrd.name)}&renderer=webgl")
        frames = page.evaluate("window.viewerAtRest")
    unfilled = [at for at, (_, colours) in enumerate(frames) if colours < _FILLED * frames[-1][1]]
    return frames[unfilled[-1] + 1 if unfilled else 0][0] / 1000

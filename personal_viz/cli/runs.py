"""Verbs `run` and `metrics`: agents over episodes, and tables from stored runs."""

import json as json_module
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.progress import Progress
from rich.table import Table

from grounding.report.sources import pog_notes
from personal_viz.printed import Console
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError, PersonalVizError
from sim.homes.kind import common_kind, scene_label
from sim.mesh import Scene
from sim.tasks.metrics import MetricRow, metric_rows, read_runs, reading_notes, require_comparable, rule_warnings
from sim.tasks.observers import Observer
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import RunInfo, fitting_name, fitting_run_id
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import AgentJob, run_agent
from sim.types import SPLITS, ClutterLevel, EpisodeKey, Split, SuccessRule

from ..study_app.checked_options import check_options, key_from_text, require_no_scan

MIN_TABLE_WIDTH = 150
"""Columns that the paper's table needs; narrower terminals wrap it, files and pipes do not."""
SHORT_NAMES = {"random-frontier": "grounding.agents.random_frontier:random_frontier"}
"""Agents of ours that the simulator loads as plug-ins; run files hold the short name."""


def run(
    *,
    agent: str,
    dataset: Path,
    out: Path,
    scenes_dir: Path | None,
    scene: tuple[str, ...],
    split: tuple[Split, ...],
    limit: int | None,
    seed: int,
    jobs: int,
    run_id: str | None,
    sample_seed: int = 0,
    clutter: ClutterLevel = 0,
    episode: str | None = None,
    rerun: str | None = None,
    with_pixels: bool = False,
    rule: SuccessRule | None = None,
) -> int:
    """Runs an agent over episodes into `out/<run_id>`; a second call goes on. Tables keep clutter levels apart."""
    made_for = _made_for(agent, rule)
    check_options(run_id=run_id, limit=limit, jobs=jobs, seed=seed, sample_seed=sample_seed)
    episodes = PersonalDataset(dataset)
    chosen = _chosen(episodes, episode, scenes=scene, splits=split, limit=limit, sample_seed=sample_seed)
    kind = common_kind(episodes, {item.key.scene for item in chosen}, scenes_dir)
    require_no_scan(kind, clutter=clutter)
    by_scene = _by_scene(chosen, scenes_dir)
    level = f"-clutter{clutter}" if clutter else ""
    who = agent if made_for in (None, "paper") else f"{agent}-{made_for}"
    run_id = run_id or fitting_run_id(f"{who.replace(':', '.')}-{kind}{level}-seed{seed}")
    info = make_run_info(
        run_id,
        who=fitting_name(who),
        who_kind="agent",
        condition=f"clutter {clutter}" if clutter else "none",
        scene_kind=kind,
        dataset_digest=episodes.digest(),
        seed=seed,
        config={"actions": "paper6", "clutter": clutter},
        made_for=made_for,
    )
    writer = RunWriter(out / run_id, info)
    left = [item.key for item in chosen if item.key not in writer.done]
    print(f"{len(chosen)} episodes in {len(by_scene)} scenes ({kind}), {len(chosen) - len(left)} of them done before")
    with _observing(rerun, left, info, with_pixels=with_pixels) as make_observer:
        work = [
            AgentJob(
                dataset,
                name,
                tuple(keys),
                scenes_dir=scenes_dir,
                agent=SHORT_NAMES.get(agent, agent),
                seed=seed,
                clutter=clutter,
                make_observer=make_observer,
                rule=made_for or "paper",
            )
            for name, keys in sorted(by_scene.items())
        ]
        with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
            bar = progress.add_task(who, total=len(left))
            run_agent(work, writer, processes=jobs, on_episode=lambda: progress.update(bar, advance=1))
        print(f"Written to {out / run_id}; see it with: personal-viz metrics {out / run_id}")
    return 0


def _made_for(agent: str, rule: SuccessRule | None) -> SuccessRule | None:
    """The success rule that the agent walks for; None where it knows no goal. Raises AgentError for other names."""
    if agent == "shortest-path":
        return rule or "paper"
    if agent not in ("random", *SHORT_NAMES) and ":" not in agent:
        raise AgentError(
            f"--agent is {agent!r}; expected random, random-frontier, shortest-path, or your own as "
            "package.module:factory."
        )
    if rule is not None:
        raise AgentError(
            f"--rule: found {rule!r} for --agent {agent}; expected it with --agent shortest-path only, since no other "
            "knows the goal. Leave it out; personal-viz metrics --rule chooses the rule of the table."
        )
    return None


def _chosen(
    episodes: PersonalDataset,
    episode: str | None,
    *,
    scenes: tuple[str, ...],
    splits: tuple[Split, ...],
    limit: int | None,
    sample_seed: int,
) -> list[Episode]:
    """The named episode, or a sample of splits and scenes; raises PersonalVizError where these hold none."""
    if episode is not None:
        return [episodes.episode(key_from_text(episode))]
    chosen = episodes.sample(splits=splits or SPLITS, scenes=scenes or None, per_split=limit, seed=sample_seed)
    if not chosen:
        raise PersonalVizError(
            f"{episodes.root}: the chosen splits and scenes hold no episode; expected one. Choose others."
        )
    return chosen


def _by_scene(chosen: Sequence[Episode], scenes_dir: Path | None) -> dict[str, list[EpisodeKey]]:
    """The episodes' keys, scene by scene; raises SceneError when a scene has no scan below `scenes_dir`."""
    found: dict[str, list[EpisodeKey]] = {}
    for episode in chosen:
        found.setdefault(episode.key.scene, []).append(episode.key)
    if scenes_dir is not None:
        from sim.homes.open_home import find_scan

        for name in found:
            find_scan(name, scenes_dir)
    return found


@contextmanager
def _observing(
    rerun: str | None, left: Sequence[EpisodeKey], info: RunInfo, *, with_pixels: bool
) -> Iterator[Callable[[Scene], Observer] | None]:
    """What makes observers for the option `--rerun`; what it needs is checked, or started, before any episode."""
    if rerun is None or not left:
        if rerun is not None:
            print("No episode is left to run, so nothing is recorded. Give another --run-id to run them again.")
        yield None
        return
    from recordings.live import live_sink
    from recordings.observer import ObserveRuns

    if info.scene_kind == "scan" and not with_pixels:
        print("The homes are licensed scans: geometry and pictures are left out. --with-pixels stores them.")
    with live_sink(rerun, left) as sink:
        yield ObserveRuns(sink, info.model_dump_json(), with_pixels=with_pixels)
        if sink.kind != "address":
            print(f"Recorded to {sink.where}; see it with: rerun {sink.where}")


def metrics(*, runs: tuple[Path, ...], rule: SuccessRule, json: bool) -> int:
    """Prints the paper's tables of people and agents from run folders."""
    found = read_runs(runs)
    require_comparable(run.info for run in found if run.episodes)
    require_comparable(run.info for run in found if run.answers)
    rows = metric_rows(found, rule=rule)
    warnings = rule_warnings(rows)
    if json:
        print(json_module.dumps([_labelled(row) for row in rows], indent=2))
        for line in warnings:
            print(line, file=sys.stderr)
        return 0
    console = Console(file=sys.stdout, width=max(MIN_TABLE_WIDTH, Console().width))
    for task, title in (("pan", f"PAN, rule {rule}"), ("pog", "POG, planar distance <= 1 m on the target's storey")):
        for kind in dict.fromkeys(row.scene_kind for row in rows if row.task == task):
            shown = [row for row in rows if row.task == task and row.scene_kind == kind]
            console.print(_table(title, shown))
            label = scene_label(kind)
            answered = [run.info for run in found if run.answers and run.info.scene_kind == kind]
            maps = pog_notes(answered) if task == "pog" else ()
            for line in [*([f"{label}."] if label else []), *reading_notes(shown), *maps]:
                print(line)
    for line in warnings:
        print(line)
    for row in rows:
        if row.unreachable or row.undefined:
            print(
                f"{row.who}, {row.split}: {row.unreachable} trials without a path to the goal (left out of DTG), "
                f"{row.undefined} without a usable point under the rule, or measured before the rule (left out of all)"
            )
    return 0


def _labelled(row: MetricRow) -> dict[str, Any]:
    return row.model_dump() | {"scene_label": scene_label(row.scene_kind)}


def _table(title: str, rows: Sequence[MetricRow]) -> Table:
    """The paper's layout: one line per row name, groups Easy, Medium, Hard, Total."""
    table = Table(title=f"{title}; scenes: {rows[0].scene_kind}", box=SIMPLE_HEAD, padding=(0, 1), title_justify="left")
    table.add_column("\nMethod", overflow="fold", max_width=44)
    groups = [split for split in (*SPLITS, "total") if any(row.split == split for row in rows)]
    heads = ("SR", "k/n", "SPL", "DTG") if rows[0].task == "pan" else ("SR", "k/n", "top-3")
    for group in groups:
        for head in heads:
            table.add_column(f"{group.capitalize() if head == 'SR' else ''}\n{head}", justify="right", no_wrap=True)
    for name in dict.fromkeys((row.who, row.condition) for row in rows):
        cells = [name[0] if name[1] == "none" else f"{name[0]} ({name[1]})"]
        for group in groups:
            row = next((row for row in rows if (row.who, row.condition) == name and row.split == group), None)
            cells += [""] * len(heads) if row is None else _cells(row)
        table.add_row(*cells)
    return table


def _cells(row: MetricRow) -> list[str]:
    figures = [_figure(row.sr, 1), f"{row.k}/{row.n}"]
    return figures + ([_figure(row.spl, 1), _figure(row.dtg, 2)] if row.task == "pan" else [_figure(row.top3, 1)])


def _figure(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"

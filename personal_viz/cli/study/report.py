"""Verb `study report`: writes a study's figures as tables and pictures."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.text import Text
from tyro.conf import Positional, arg

from human_study.report.glmm import glmm_csv, glmm_script
from human_study.report.overlays import floors_needed, overlay_keys, overlay_name, overlay_svg
from human_study.report.render import csv_text, html_text, latex, markdown, summary
from human_study.report.report import ReportGroups, StudyReport, report_groups, report_of
from human_study.report.source import read_source
from personal_viz.printed import Console
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.homes.open_home import open_scene
from sim.homes.plan import HOMES_VERSION
from sim.plan_view.storey import StoreyMap, storey_map
from sim.tasks.run_files import Run
from sim.types import EpisodeKey, SuccessRule, TaskKind
from sim.walk.storeys import nearest_storey

from ..options import Evidence, ScenesDir
from ..output import say, table_of, write_report
from ..refusals import check_options, require_same_dataset

COLUMNS = 80
"""Width of what the command prints."""
CHOSEN_OVERLAYS = 4
"""Number of episodes of each task to draw from above unless all are asked for."""


@dataclass
class StudyReportVerb:
    """Tables and pictures of people and agents on the same episodes, every number with its interval."""

    runs: Positional[tuple[Path, ...]]
    """Study folders, exports, run folders of people and of agents, or folders that hold them."""
    out: Annotated[Path, arg(help="Folder for the report in all its forms.")] = Path("runs/report")
    rule: Annotated[SuccessRule | None, arg(help="Rule of success; the study's own by default, else paper.")] = None
    dataset: Annotated[
        Path | None, arg(help="For floors under overlays, chosen objects, and dataset_weighted totals.")
    ] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    overlays: Annotated[bool, arg(help="Draw the ways and clicks of all episodes, not of a few.")] = False
    json: bool = False

    def run(self) -> int:
        check_options(self)
        if self.scenes_dir is not None and self.dataset is None:
            raise StudyError(
                f"--scenes-dir: found {str(self.scenes_dir)!r} without --dataset; expected both. Give --dataset."
            )
        source = read_source(self.runs)
        episodes, split_sizes, objects = None, None, None
        if self.dataset is not None:
            episodes = PersonalDataset(self.dataset, evidence=self.evidence)
            require_same_dataset(episodes, {run.info.dataset_digest for run in source.runs}, whose="the runs'")
            split_sizes = dict(Counter(episode.key.split for episode in episodes.episodes()))
            objects = _objects(episodes, _scenes_of(source.runs))
        groups = report_groups(source, rule=self.rule)
        found = report_of(source, groups, split_sizes=split_sizes, objects=objects)
        if (
            episodes is not None
            and self.scenes_dir is None
            and source.records.homes_version not in (None, HOMES_VERSION)
        ):
            say(
                f"The study was done in homes of version {source.records.homes_version}, this program makes version "
                f"{HOMES_VERSION}: no floor is drawn under the overlays."
            )
            episodes = None
        pictures = _pictures(found, groups) | _overlays(
            groups, episodes, self.scenes_dir, _digests(source.runs), draws_all=self.overlays
        )
        document = found.model_dump_json(indent=2) + "\n"
        files = _texts(found, groups, pictures) | {"report.json": document} | pictures
        write_report(self.out, files, earlier=("overlay-*.svg",))
        if self.json:
            print(document, end="")
        else:
            _print_summary(found)
            others = ", ".join(name for name in files if name != "report.html")
            _console().print(Text(f"The whole report: {self.out / 'report.html'}. In the same folder: {others}."))
        return 0


def _console() -> Console:
    return Console(file=sys.stdout, width=COLUMNS)


def _print_summary(found: StudyReport) -> None:
    """Prints the report's summary within `COLUMNS`."""
    told, console = summary(found), _console()
    for line in told.labels:
        console.print(Text(line, "bold"))
    console.print(table_of(told.heads, told.rows))
    for line in told.remarks:
        console.print(Text(line, overflow="fold"))


def _scenes_of(runs: Sequence[Run]) -> set[str]:
    """Names of the homes in which people did trials."""
    people = [run for run in runs if run.info.who_kind == "human"]
    return {item.key.scene for run in people for item in (*run.episodes, *run.answers)}


def _texts(found: StudyReport, groups: ReportGroups, pictures: dict[str, str]) -> dict[str, str]:
    texts = {
        "report.md": markdown(found, pictures),
        "report.html": html_text(found, pictures),
        "report.csv": csv_text(found),
        "report.tex": latex(found),
    }
    for task in _tasks(found):
        texts[f"{task}-trials.csv"] = glmm_csv(groups.people, task)
        texts[f"{task}-glmm.R"] = glmm_script(groups.people, task)
    return texts


def _pictures(found: StudyReport, groups: ReportGroups) -> dict[str, str]:
    from human_study.report.figures import effort_svg, flow_svg, order_svg, outcome_matrix_svg, person_dots_svg

    pictures, shown = {}, (*groups.people, *groups.averaged)
    for task in _tasks(found):
        pictures[f"{task}-people.svg"] = person_dots_svg(shown, task)
        pictures[f"{task}-episodes.svg"] = outcome_matrix_svg(shown, task)
        pictures[f"{task}-effort.svg"] = effort_svg(shown, task)
        if any(row.task == task for row in found.blocks):
            pictures[f"{task}-order.svg"] = order_svg(found, task)
    if found.flow:
        pictures["flow.svg"] = flow_svg(found)
    return pictures


def _overlays(
    groups: ReportGroups,
    episodes: PersonalDataset | None,
    scenes_dir: Path | None,
    digests: Mapping[str, set[str]],
    *,
    draws_all: bool,
) -> dict[str, str]:
    """Drawings of paths and marks from above, by file name; over the free floor if the dataset is given."""
    shown = (*groups.people, *groups.agents)
    tasks: list[TaskKind] = [group.task for group in groups.people]
    pictures = {}
    for task in dict.fromkeys(tasks):
        of_task = [group for group in shown if group.task == task]
        keys = overlay_keys(of_task, task, most=10**6 if draws_all else CHOSEN_OVERLAYS)
        storeys, targets = {}, {}
        if episodes is not None:
            storeys = _storeys(episodes, floors_needed(of_task, keys), scenes_dir, digests)
            targets = {
                key: [(goal.position[0], goal.position[2]) for goal in episodes.episode(key).targets] for key in storeys
            }
        for key in keys:
            drawn = overlay_svg(of_task, key, task, storey=storeys.get(key), targets=targets.get(key, ()))
            pictures[overlay_name(key, task)] = drawn
    return pictures


def _storeys(
    episodes: PersonalDataset,
    heights: Mapping[EpisodeKey, float],
    scenes_dir: Path | None,
    digests: Mapping[str, set[str]],
) -> dict[EpisodeKey, StoreyMap]:
    """The storey at each episode's height; each home is opened only once, and left out if no run was made in it."""
    found = {}
    for scene in sorted({key.scene for key in heights}):
        home = open_scene(episodes, scene, scenes_dir=scenes_dir)
        if home.digest not in digests.get(scene, {home.digest}):
            say(f"Home {scene} is another version now than that of the runs: no floor is drawn under its overlays.")
            continue
        for key in (key for key in heights if key.scene == scene):
            index = int(nearest_storey(heights[key], home.navigation.storey_heights))
            found[key] = storey_map(home.navigation, index)
    return found


def _digests(runs: Sequence[Run]) -> dict[str, set[str]]:
    """The versions of each home in which PAN runs were made."""
    found: dict[str, set[str]] = {}
    for item in (item for run in runs for item in run.episodes):
        if item.end.measures is not None:
            found.setdefault(item.key.scene, set()).add(item.end.measures.scene_digest)
    return found


def _tasks(found: StudyReport) -> list[TaskKind]:
    tasks: list[TaskKind] = [row.task for row in found.rows if row.kind == "human"]
    return list(dict.fromkeys(tasks))


def _objects(episodes: PersonalDataset, scenes: set[str]) -> dict[str, list[tuple[str, tuple[float, float]]]]:
    """(name, middle on the floor plan) of each captioned object of the homes."""
    return {
        scene: sorted((name, (goal.position[0], goal.position[2])) for name, goal in episodes.goals(scene).items())
        for scene in sorted(scenes)
    }

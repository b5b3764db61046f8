"""Verb `study report`: writes a study's figures as tables and pictures."""

import itertools
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.text import Text
from tyro.conf import Positional, arg

from human_study.report.glmm import glmm_csv, glmm_script
from human_study.report.measures import WAYS
from human_study.report.overlays import floors_needed, overlay_keys, overlay_name, overlay_svg
from human_study.report.page import label_lines
from human_study.report.render import csv_text, html_text, latex, markdown, summary
from human_study.report.report import ReportGroups, StudyReport, report_groups, report_of
from human_study.report.source import ReportSource, read_source
from human_study.report.ways import ShortestPaths, ways_csv
from human_study.sequence_report.measures import KINDS, sequence_report
from human_study.sequence_report.source import SequenceSource, read_sequences
from human_study.sequence_report.text import sequence_csv, sequence_html, sequence_markdown, summary_lines
from personal_viz.printed import Console
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.homes.open_home import open_scene
from sim.homes.plan import HOMES_VERSION
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap, storey_map
from sim.tasks.rules import success_region
from sim.tasks.run_files import Run
from sim.types import ClutterLevel, EpisodeKey, SuccessRule, TaskKind
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
        Path | None, arg(help="For shortest paths, floors under overlays, chosen objects, dataset_weighted totals.")
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
        told = read_sequences(self.runs)
        if told is not None:
            return self._report_sequences(told)
        source = read_source(self.runs)
        episodes, split_sizes, objects = None, None, None
        if self.dataset is not None:
            episodes = PersonalDataset(self.dataset, evidence=self.evidence)
            require_same_dataset(episodes, {run.info.dataset_digest for run in source.runs}, whose="the runs'")
            split_sizes = dict(Counter(episode.key.split for episode in episodes.episodes()))
            objects = _objects(episodes, _scenes_of(source.runs))
        homes_version = source.records.homes_version
        if episodes is not None and self.scenes_dir is None and homes_version not in (None, HOMES_VERSION):
            say(
                f"The study was done in homes of version {homes_version}, this program makes version {HOMES_VERSION}: "
                "ways are not compared with shortest paths, and no floor is drawn under the overlays."
            )
            episodes = None
        config, homes = source.records.config, None
        if episodes is not None:
            clutter = config.clutter if config and self.scenes_dir is None else 0
            homes = _Homes(episodes, self.scenes_dir, clutter, _digests(source.runs))
        groups = report_groups(source, rule=self.rule, shortest=homes and _shortest_paths(homes, source, self.rule))
        found = report_of(source, groups, split_sizes=split_sizes, objects=objects)
        pictures = _pictures(found, groups) | _overlays(groups, homes, draws_all=self.overlays)
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

    def _report_sequences(self, source: SequenceSource) -> int:
        """Writes the report of a study of home sequences."""
        if self.dataset is not None or self.overlays:
            raise StudyError(
                "study report: found --dataset or --overlays for a study of home sequences; expected neither, because "
                "its report has no floors and no shortest paths. Leave them out."
            )
        found = sequence_report(source, rule=self.rule)
        document = found.model_dump_json(indent=2) + "\n"
        texts = {"report.md": sequence_markdown(found), "report.html": sequence_html(found)}
        files = texts | {"report.csv": sequence_csv(found), "report.json": document}
        write_report(self.out, files, earlier=("overlay-*.svg",))
        if self.json:
            print(document, end="")
            return 0
        for line in label_lines(found.scene_labels, is_pilot=found.is_pilot, num_open=found.num_open):
            _console().print(Text(line, "bold"))
        heads = ("who", "n", "SR", *KINDS, "at old")
        _console().print(table_of(heads, summary_lines(found)))
        for left in found.left_out_runs:
            _console().print(Text(f"Left out: {left.run}: {left.reason}."))
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


@dataclass(frozen=True, slots=True)
class _Homes:
    """The homes of the runs as they are now."""

    episodes: PersonalDataset
    scenes_dir: Path | None
    clutter: ClutterLevel
    """Amount of furniture without a caption in homes that are no scans."""
    digests: Mapping[str, set[str]]
    """Versions of each home in which PAN runs were made."""

    def opened(self, keys: Iterable[EpisodeKey]) -> Iterator[tuple[Scene | None, list[EpisodeKey]]]:
        """Each home of these episodes, opened once, with its episodes; None where no run was made in this version."""
        for name, found in itertools.groupby(sorted(keys, key=lambda key: key.scene), key=lambda key: key.scene):
            home = open_scene(self.episodes, name, scenes_dir=self.scenes_dir, clutter=self.clutter)
            yield home if home.digest in self.digests.get(name, {home.digest}) else None, list(found)


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
    if found.ways or any(row.measure in WAYS for row in found.rows):
        texts["pan-ways.csv"] = ways_csv((*groups.people, *groups.agents), groups.pairs)
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


def _overlays(groups: ReportGroups, homes: _Homes | None, *, draws_all: bool) -> dict[str, str]:
    """Drawings of paths and marks from above, by file name; over the free floor if the homes are at hand."""
    shown = (*groups.people, *groups.agents)
    tasks: list[TaskKind] = [group.task for group in groups.people]
    pictures = {}
    for task in dict.fromkeys(tasks):
        of_task = [group for group in shown if group.task == task]
        keys = overlay_keys(of_task, task, most=10**6 if draws_all else CHOSEN_OVERLAYS)
        storeys, targets = {}, {}
        if homes is not None:
            storeys = _storeys(homes, floors_needed(of_task, keys))
            targets = {
                key: [(goal.position[0], goal.position[2]) for goal in homes.episodes.episode(key).targets]
                for key in storeys
            }
        for key in keys:
            drawn = overlay_svg(of_task, key, task, storey=storeys.get(key), targets=targets.get(key, ()))
            pictures[overlay_name(key, task)] = drawn
    return pictures


def _storeys(homes: _Homes, heights: Mapping[EpisodeKey, float]) -> dict[EpisodeKey, StoreyMap]:
    """The storey at each episode's height, in homes that are as they were."""
    found = {}
    for home, keys in homes.opened(heights):
        if home is None:
            continue
        for key in keys:
            index = int(nearest_storey(heights[key], home.navigation.storey_heights))
            found[key] = storey_map(home.navigation, index)
    return found


def _shortest_paths(homes: _Homes, source: ReportSource, rule: SuccessRule | None) -> ShortestPaths:
    """The shortest path of each episode of PAN that people did, to the success region of the report's rule."""
    config, found = source.records.config, {}
    rule = rule or (config.success if config else "paper")
    people = [run for run in source.runs if run.info.who_kind == "human"]
    for home, keys in homes.opened({item.key for run in people for item in run.episodes}):
        if home is None:
            say(
                f"Home {keys[0].scene} is another version now than that of the runs: their ways are not compared with "
                "shortest paths, and no floor is drawn under its overlays."
            )
            continue
        for episode in map(homes.episodes.episode, keys):
            region = success_region(episode, home.navigation, rule=rule)
            path = home.navigation.shortest_path(np.array(episode.start.position), region) if len(region) else None
            if path is not None:
                found[episode.key] = path
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

"""Verb `run`: runs an agent over PAN episodes into a run folder."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from grounding.agents.goal_text import GoalText
from grounding.encoders.protocol import ModelOptions
from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.episodes.schema import Episode
from sim.homes.kind import common_kind
from sim.mesh import Scene
from sim.tasks.agent_makers import AgentMaker
from sim.tasks.observers import Observer
from sim.tasks.provenance import evidence_config, make_run_info
from sim.tasks.run_files import RunInfo, fitting_name, fitting_run_id
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import AgentJob, run_agent
from sim.types import EpisodeKey, SceneKind, SuccessRule
from sim.words.english import how_many

from ...progress import counted
from ..options import (
    Clutter,
    Dataset,
    Evidence,
    Jobs,
    Label,
    Labels,
    Limit,
    ModelAutocast,
    ModelDevice,
    Rerun,
    RunId,
    SampleSeed,
    Scenes,
    ScenesDir,
    Splits,
    WithPixels,
)
from ..output import recorded
from ..refusals import check_options, require_no_scan, sampled
from .named_agents import AgentOptions, NamedAgent, named_agent


@dataclass
class Run:
    """Run an agent over PAN episodes."""

    dataset: Dataset
    agent: Annotated[
        str,
        arg(
            help="random, random-frontier; vlfm, onemap, frontier-geometry or nearest-frontier (these with "
            "--perception); shortest-path (knows the goal); or your own as package.module:factory."
        ),
    ]
    perception: Annotated[
        str | None,
        arg(
            help="Agents that see: with what. oracle, oracle:mild or oracle:strong (the simulator's ids, with "
            "errors); encoder=clip:ID,detector=owlv2:ID (models by id or folder; also siglip:, blip2-itc256:, "
            "grounding-dino:, yolox:FILE); or your own as package.module:factory."
        ),
    ] = None
    goal_text: Annotated[
        GoalText,
        arg(
            help="Agents that see: what they look for. phrase (the thing's words in the description), query, or "
            "caption (the authors' protocol: ground truth, named in every row)."
        ),
    ] = "phrase"
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    out: Path = Path("runs")
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    sample_seed: SampleSeed = 0
    seed: int = 0
    jobs: Jobs = 1
    run_id: RunId = None
    label: Label = None
    clutter: Clutter = 0
    labels: Labels = "off"
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID: this episode only, instead of --scene and --split.")] = (
        None
    )
    rerun: Rerun = None
    with_pixels: WithPixels = False
    rule: Annotated[
        SuccessRule | None,
        arg(help="shortest-path only: the success rule it walks for, by default paper; habitat = to a view point."),
    ] = None

    def run(self) -> int:
        agent = self._agent()
        check_options(self)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        chosen = self._chosen(episodes)
        kind = common_kind(episodes, {item.key.scene for item in chosen}, self.scenes_dir)
        require_no_scan(kind, clutter=self.clutter)
        by_scene = keys_by_scene(chosen, self.scenes_dir)
        info = self._info(episodes, kind, agent)
        folder = self.out / info.run_id
        writer = RunWriter(folder, info)
        left = [item.key for item in chosen if item.key not in writer.done]
        print(
            f"{how_many(len(chosen), 'episode')} in {how_many(len(by_scene), 'scene')} ({kind}), "
            f"{len(chosen) - len(left)} done before"
        )
        with _observing(self.rerun, left, info, with_pixels=self.with_pixels) as make_observer:
            jobs = self._jobs(by_scene, make_observer, agent.maker)
            with counted(info.who, len(left)) as progress:
                run_agent(jobs, writer, processes=self.jobs, on_episode=progress.add)
            print(f"Written to {folder}; see it with: personal-viz metrics {folder}")
        return 0

    def check(self) -> None:
        """Raises AgentError if no agent has this name, or a user's own cannot be built."""
        self._agent()

    def _agent(self) -> NamedAgent:
        model = ModelOptions(self.device, autocast=self.autocast)
        options = AgentOptions(self.rule, self.perception, self.goal_text, model)
        return named_agent(self.agent, options, seed=self.seed)

    def _chosen(self, episodes: PersonalDataset) -> list[Episode]:
        """The named episode, or a sample of splits and scenes; raises PersonalVizError if these hold no episode."""
        if self.episode is not None:
            return [episodes.episode(key_from_text(self.episode, where="--episode"))]
        return sampled(episodes, splits=self.split, scenes=self.scene, limit=self.limit, seed=self.sample_seed)

    def _info(self, episodes: PersonalDataset, kind: SceneKind, agent: NamedAgent) -> RunInfo:
        """The contents of run.json."""
        who = self.label or agent.who
        sight = f"-{self.perception}-{self.goal_text}" if self.perception else ""
        level = f"{'-evidence' if self.evidence else ''}{f'-clutter{self.clutter}' if self.clutter else ''}"
        level += "-labels" if self.labels == "on" else ""
        name = f"{who}{sight}".replace(":", ".")
        conditions = [f"clutter {self.clutter}" if self.clutter else "", agent.condition]
        return make_run_info(
            self.run_id or fitting_run_id(f"{name}-{kind}{level}-seed{self.seed}"),
            who=fitting_name(who),
            who_kind="agent",
            condition=", ".join(filter(None, conditions)) or "none",
            scene_kind=kind,
            dataset_digest=episodes.digest(),
            seed=self.seed,
            config={"actions": "paper6", "clutter": self.clutter, **evidence_config(episodes), **agent.config},
            made_for=agent.made_for,
            labels=self.labels == "on",
        )

    def _jobs(
        self,
        by_scene: Mapping[str, Sequence[EpisodeKey]],
        make_observer: Callable[[Scene], Observer] | None,
        maker: AgentMaker,
    ) -> list[AgentJob]:
        """One job per scene, in order of their names."""
        return [
            AgentJob(
                self.dataset,
                name,
                tuple(keys),
                evidence=self.evidence,
                scenes_dir=self.scenes_dir,
                agent=maker,
                seed=self.seed,
                clutter=self.clutter,
                labels=self.labels == "on",
                make_observer=make_observer,
            )
            for name, keys in sorted(by_scene.items())
        ]


def keys_by_scene(chosen: Sequence[Episode], scenes_dir: Path | None) -> dict[str, list[EpisodeKey]]:
    """The episodes' keys, scene by scene; raises SceneError if a scene has no scan below `scenes_dir`."""
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
    """Yields a function that makes observers for `--rerun`; checks files, and starts viewers, before any episode."""
    if rerun is None or not left:
        if rerun is not None:
            print("No episode is left to run, so nothing is recorded. Give another --run-id to run them again.")
        yield None
        return
    from recordings.observer import ObserveRuns

    if info.scene_kind == "scan" and not with_pixels:
        print("The homes are licensed scans: geometry and pictures are left out. --with-pixels stores them.")
    with recorded(rerun, left, said_to=sys.stdout) as sink:
        yield ObserveRuns(sink, info.model_dump_json(), with_pixels=with_pixels)

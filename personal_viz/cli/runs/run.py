"""Verb `run`: runs an agent over PAN episodes into a run folder."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.homes.kind import common_kind
from sim.mesh import Scene
from sim.plugins import is_plugin, own_name, plugin_digest
from sim.tasks.agents import load_agent
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

SHORT_NAMES = {"random-frontier": "grounding.agents.random_frontier:random_frontier"}
"""Our own agents that the simulator loads as plug-ins; run files hold the short name."""


@dataclass
class Run:
    """Run an agent over PAN episodes."""

    dataset: Dataset
    agent: Annotated[
        str, arg(help="random, random-frontier, shortest-path (knows the goal), or your own as package.module:factory.")
    ]
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
        made_for, who, code = self._agent()
        check_options(self)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        chosen = self._chosen(episodes)
        kind = common_kind(episodes, {item.key.scene for item in chosen}, self.scenes_dir)
        require_no_scan(kind, clutter=self.clutter)
        by_scene = keys_by_scene(chosen, self.scenes_dir)
        info = self._info(episodes, kind, made_for, who=who, code=code)
        folder = self.out / info.run_id
        writer = RunWriter(folder, info)
        left = [item.key for item in chosen if item.key not in writer.done]
        print(
            f"{how_many(len(chosen), 'episode')} in {how_many(len(by_scene), 'scene')} ({kind}), "
            f"{len(chosen) - len(left)} done before"
        )
        with _observing(self.rerun, left, info, with_pixels=self.with_pixels) as make_observer:
            jobs = self._jobs(by_scene, make_observer, rule=made_for or "paper")
            with counted(info.who, len(left)) as progress:
                run_agent(jobs, writer, processes=self.jobs, on_episode=progress.add)
            print(f"Written to {folder}; see it with: personal-viz metrics {folder}")
        return 0

    def check(self) -> None:
        """Raises AgentError if no agent has this name, or a user's own cannot be built."""
        self._agent()

    def _chosen(self, episodes: PersonalDataset) -> list[Episode]:
        """The named episode, or a sample of splits and scenes; raises PersonalVizError if these hold no episode."""
        if self.episode is not None:
            return [episodes.episode(key_from_text(self.episode, where="--episode"))]
        return sampled(episodes, splits=self.split, scenes=self.scene, limit=self.limit, seed=self.sample_seed)

    def _agent(self) -> tuple[SuccessRule | None, str, dict[str, str]]:
        """The rule that the agent walks for, its row name, and the digest of a user's own agent.

        Raises:
            AgentError: No agent has this name, or a user's own cannot be built.
        """
        made_for = _made_for(self.agent, self.rule)
        who = self.agent if made_for in (None, "paper") else f"{self.agent}-{made_for}"
        if ":" not in self.agent:
            return made_for, self.label or who, {}
        own = own_name(load_agent(self.agent), who)
        return made_for, self.label or own, {"agent_code": f"{self.agent}@{plugin_digest(self.agent)}"}

    def _info(
        self,
        episodes: PersonalDataset,
        kind: SceneKind,
        made_for: SuccessRule | None,
        *,
        who: str,
        code: dict[str, str],
    ) -> RunInfo:
        """The contents of run.json."""
        level = f"{'-evidence' if self.evidence else ''}{f'-clutter{self.clutter}' if self.clutter else ''}"
        level += "-labels" if self.labels == "on" else ""
        return make_run_info(
            self.run_id or fitting_run_id(f"{who.replace(':', '.')}-{kind}{level}-seed{self.seed}"),
            who=fitting_name(who),
            who_kind="agent",
            condition=f"clutter {self.clutter}" if self.clutter else "none",
            scene_kind=kind,
            dataset_digest=episodes.digest(),
            seed=self.seed,
            config={"actions": "paper6", "clutter": self.clutter, **evidence_config(episodes), **code},
            made_for=made_for,
            labels=self.labels == "on",
        )

    def _jobs(
        self,
        by_scene: Mapping[str, Sequence[EpisodeKey]],
        make_observer: Callable[[Scene], Observer] | None,
        *,
        rule: SuccessRule,
    ) -> list[AgentJob]:
        """One job per scene, in order of their names."""
        return [
            AgentJob(
                self.dataset,
                name,
                tuple(keys),
                evidence=self.evidence,
                scenes_dir=self.scenes_dir,
                agent=SHORT_NAMES.get(self.agent, self.agent),
                seed=self.seed,
                clutter=self.clutter,
                labels=self.labels == "on",
                make_observer=make_observer,
                rule=rule,
            )
            for name, keys in sorted(by_scene.items())
        ]


def _made_for(agent: str, rule: SuccessRule | None) -> SuccessRule | None:
    """The success rule that the agent walks for; None if it knows no goal. Raises AgentError for other names."""
    if agent == "shortest-path":
        return rule or "paper"
    if agent not in ("random", *SHORT_NAMES) and not is_plugin(agent):
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

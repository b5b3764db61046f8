"""Verb `run`: runs an agent over PAN episodes into a run folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro import MISSING
from tyro.conf import arg

from grounding.agents.by_name import CONTROLS, MakesSeeing
from grounding.agents.goal_text import GoalText
from grounding.chat.budget import Budget
from grounding.chat.endpoint import Endpoint, llm_options
from grounding.encoders.protocol import ModelOptions
from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.episodes.schema import Episode
from sim.errors import PersonalVizError
from sim.homes.kind import common_kind
from sim.tasks.provenance import evidence_config, make_run_info
from sim.tasks.run_files import RunInfo, fitting_name, fitting_run_id
from sim.tasks.run_folders import BESIDE
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import run_agent
from sim.tasks.shards import shard_from_text
from sim.tasks.workers import Workers
from sim.types import EpisodeKey, SceneKind, SuccessRule
from sim.words.english import how_many

from ...progress import counted
from ..chat_cost import print_chat_use, require_chat_for_limits
from ..options import (
    Address,
    Clutter,
    DatasetOrStudy,
    Evidence,
    IgnoreMessages,
    Jobs,
    Label,
    Labels,
    Limit,
    LlmKeyEnv,
    LlmModel,
    LlmUrl,
    MaxCalls,
    MaxTokens,
    ModelAutocast,
    ModelDevice,
    On,
    Out,
    Price,
    Rerun,
    RunId,
    SampleSeed,
    Scenes,
    ScenesDir,
    Sequences,
    Shard,
    Splits,
    StudyFolder,
    WithPixels,
    workers_of,
)
from ..refusals import check_options, require_dataset, require_no_scan, sampled
from .episode_walks import EpisodeWalks, keys_by_scene, observing
from .metrics import Metrics
from .named_agents import AgentOptions, NamedAgent, named_agent
from .sequence_walks import play_sequences, require_options_of_sequences, walks_of_set

if TYPE_CHECKING:
    from ...study_app.planned_study import PlannedStudy
    from .study_walks import StudyWalk


@dataclass
class Run:
    """Run an agent over PAN episodes."""

    dataset: DatasetOrStudy = None
    agent: Annotated[
        str,
        arg(
            help="random, random-frontier; vlfm, onemap, vlfm-geometry, frontier-geometry, nearest-frontier, "
            "instance-memory or frontier-vlm (these with --perception, frontier-vlm with --llm-url and --llm-model "
            "too, and always beside frontier-geometry); "
            "shortest-path (knows the goal); or your own as package.module:factory."
        ),
    ] = MISSING
    study: StudyFolder = None
    sequences: Sequences = None
    memory: Annotated[
        Literal["on", "off"],
        arg(help="Home sequences: whether the agent keeps what it knows of the home from one search to the next."),
    ] = "off"
    ignore_messages: IgnoreMessages = False
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
    llm_url: LlmUrl = ""
    llm_model: LlmModel = ""
    llm_key_env: LlmKeyEnv = ""
    max_calls: MaxCalls = None
    max_tokens: MaxTokens = None
    price: Price = None
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    out: Out = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    sample_seed: SampleSeed = 0
    seed: int = 0
    jobs: Jobs = 1
    on: On = "processes"
    address: Address = None
    shard: Shard = None
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
        agent, control = self._agent(), self._control()
        if control is None:
            self._run(agent)
            return 0
        self._require_chat(agent)
        folders = (*control._run(control._agent()), *self._run(agent))
        Metrics(folders, rule=self.rule or "paper").run()
        print_chat_use(folders, price=self.price)
        return 0

    def _require_chat(self, agent: NamedAgent) -> None:
        """Refuses wrong limits, a missing key and a missing package before the control runs for hours.

        Raises:
            PersonalVizError: One of them is wrong.
        """
        check_options(self)
        require_chat_for_limits(self, has_chat=True)
        assert isinstance(agent.maker, MakesSeeing)
        assert agent.maker.llm is not None, "refused before"
        Endpoint(agent.maker.llm)

    def _control(self) -> "Run | None":
        """The same command for the agent that is always run beside this one; None if there is none."""
        if self.agent not in CONTROLS or self._is_of_sequences:
            return None
        name = CONTROLS[self.agent]
        return replace(
            self, agent=name, llm_url="", llm_model="", llm_key_env="", max_calls=None, max_tokens=None, price=None,
            rerun=None, run_id=self.run_id and fitting_run_id(f"{self.run_id}-{name}"),
            label=self.label and f"{self.label} {name}",
        )  # fmt: skip

    def _run(self, agent: NamedAgent) -> list[Path]:
        """Plays all episodes that are left; returns the run folders."""
        check_options(self)
        require_chat_for_limits(self, has_chat=bool(self.llm_url and self.llm_model))
        if self._is_of_sequences:
            return [self._run_sequences(agent)]
        if self.memory == "on" or self.ignore_messages:
            raise PersonalVizError(
                "--memory on, --ignore-messages: found no --sequences; expected it too, or a --study of home "
                "sequences. Give it, or leave them out."
            )
        if self.study is not None:
            return self._run_study(agent)
        episodes = PersonalDataset(require_dataset(self.dataset), evidence=self.evidence)
        keys = [item.key for item in self._chosen(episodes)]
        kind = common_kind(episodes, {key.scene for key in keys}, self.scenes_dir)
        require_no_scan(kind, clutter=self.clutter)
        self._workers()
        settings = EpisodeWalks(episodes, self.scenes_dir, self.clutter, self.labels == "on", agent.maker)
        return [self._play(settings, keys, self._info(episodes, kind, agent), out=self.out or Path("runs"))]

    def check(self) -> None:
        """Raises AgentError if no agent has this name, or a user's own cannot be built."""
        self._agent()

    def _agent(self) -> NamedAgent:
        model = ModelOptions(self.device, autocast=self.autocast)
        llm = (
            llm_options(self.llm_url, self.llm_model, self.llm_key_env)
            if self.llm_url or self.llm_model or self.llm_key_env
            else None
        )
        options = AgentOptions(self.rule, self.perception, self.goal_text, model, llm)
        return named_agent(self.agent, options, seed=self.seed)

    def _workers(self) -> Workers:
        """The workers; raises PersonalVizError for options that do not fit together."""
        if self.on == "ray" and self.rerun is not None:
            raise PersonalVizError(
                f"--rerun is {self.rerun!r} beside --on ray; expected one of them, because episodes are shown by this "
                "machine's processes. Leave one out; personal-viz replay shows runs afterwards."
            )
        return workers_of(self.on, jobs=self.jobs, address=self.address, device=self.device)

    def _chosen(self, episodes: PersonalDataset) -> list[Episode]:
        """The named episode, or a sample of splits and scenes; raises PersonalVizError if these hold no episode."""
        if self.episode is not None:
            return [episodes.episode(key_from_text(self.episode, where="--episode"))]
        return sampled(episodes, splits=self.split, scenes=self.scene, limit=self.limit, seed=self.sample_seed)

    def _info(self, episodes: PersonalDataset, kind: SceneKind, agent: NamedAgent) -> RunInfo:
        """The contents of run.json."""
        control = self._control()
        beside = {} if control is None else {BESIDE: control._info(episodes, kind, control._agent()).run_id}
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
            config={
                "actions": "paper6",
                "clutter": self.clutter,
                **evidence_config(episodes),
                **agent.config,
                **beside,
            },
            made_for=agent.made_for,
            labels=self.labels == "on",
        )

    @property
    def _is_of_sequences(self) -> bool:
        """Whether home sequences are done, of a set or of the study."""
        if self.sequences is not None or self.study is None:
            return self.sequences is not None
        from human_study.design.study import load_study

        return load_study(self.study).sequences is not None

    def _run_sequences(self, agent: NamedAgent) -> Path:
        """Plays the home sequences of the set, or those of the study's people; returns the run folder."""
        require_options_of_sequences(self)
        if self.study is None:
            assert self.sequences is not None
            return play_sequences(self, walks_of_set(self, self.sequences), agent, processes=self._workers())
        from ...study_app.planned_study import agent_runs
        from .study_walks import walks_of_study

        study = self._planned()
        walks = walks_of_study(study, out=agent_runs(study, self.out))
        return play_sequences(self, walks, self._for_study(study, agent), processes=self._workers())

    def _planned(self) -> "PlannedStudy":
        """The planned study whose people walk; raises PersonalVizError as `_run_study`."""
        from ...study_app.planned_study import open_planned, require_plans_choices

        require_plans_choices(self, ("scene", "split", "limit", "sample_seed", "clutter", "labels", "episode"))
        return open_planned(self, "pan")

    def _for_study(self, study: "PlannedStudy", agent: NamedAgent) -> NamedAgent:
        """The agent, which walks for the study's success rule unless it is told another one."""
        if self.agent == "shortest-path" and self.rule is None:
            return replace(self, rule=study.config.success)._agent()
        return agent

    def _run_study(self, agent: NamedAgent) -> list[Path]:
        """Plays what the study's people do: once without a look at the home, and once for each look that it can take.

        Returns:
            The run folders.

        Raises:
            PersonalVizError: An option contradicts the plan, or the study, its dataset or a home cannot be used.
        """
        from ...study_app.planned_study import agent_runs
        from .study_walks import study_walks, walk_terms

        study = self._planned()
        agent = self._for_study(study, agent)
        out, homes = agent_runs(study, self.out), study.scenes("pan")
        kind = common_kind(study.dataset, {home.name for home in homes}, study.scenes_dir)
        clutter, labels = homes[0].clutter, homes[0].labels
        settings = EpisodeWalks(study.dataset, study.scenes_dir, clutter, labels, agent.maker, walk_terms(study))
        folders, walks = [], study_walks(study, agent.looks, out=out, seed=self.seed)
        if self.rerun is not None and len(walks) > 1:
            raise PersonalVizError(
                f"--rerun is {self.rerun!r} beside --study; expected none, because this agent does the same episodes "
                f"with {len(walks)} looks at the home, whose recordings would replace each other. Leave it out, and "
                "give personal-viz replay one of the run folders."
            )
        for walk in walks:
            info = self._study_info(study, walk, kind, agent)
            folders.append(self._play(replace(settings, look_at=walk.look_at), walk.keys, info, out=out))
        return folders

    def _play(self, settings: EpisodeWalks, keys: Sequence[EpisodeKey], whole: RunInfo, *, out: Path) -> Path:
        """Plays the episodes of this shard of `whole` that its folder does not hold yet; returns the folder."""
        workers, shard = self._workers(), shard_from_text(self.shard)
        by_scene = keys_by_scene(keys, settings.scenes_dir)
        info, by_scene = shard.run_info(whole, by_scene), shard.part(by_scene)
        folder = shard.folder(out, info)
        maker = settings.maker
        if isinstance(maker, MakesSeeing) and maker.llm is not None:
            budget = Budget(folder, max_calls=self.max_calls, max_tokens=self.max_tokens)
            settings = replace(settings, maker=replace(maker, budget=budget))
        writer = RunWriter(folder, info)
        own = [key for key in keys if key.scene in by_scene]
        left = [key for key in own if key not in writer.done]
        print(
            f"{how_many(len(own), 'episode')} in {how_many(len(by_scene), 'scene')} ({info.scene_kind}), "
            f"{len(own) - len(left)} done before"
        )
        with observing(self.rerun, left, info, with_pixels=self.with_pixels) as make_observer:
            jobs = settings.jobs(by_scene, make_observer, seed=self.seed)
            with counted(info.who, len(left)) as progress:
                run_agent(jobs, writer, processes=workers, on_episode=progress.add)
            print(f"Written to {folder}; see it with: personal-viz metrics {folder}")
        return folder

    def _study_info(self, study: "PlannedStudy", walk: "StudyWalk", kind: SceneKind, agent: NamedAgent) -> RunInfo:
        """The contents of run.json for episodes of a study."""
        from human_study.export.runs import study_facts

        control = self._control()
        beside = {} if control is None else {BESIDE: control._study_info(study, walk, kind, control._agent()).run_id}
        who, home = self.label or agent.who, study.scenes("pan")[0]
        parts = [study.config.study, who, *([self.perception, self.goal_text] if self.perception else [])]
        told = [self.run_id] if self.run_id else [*parts, f"seed{self.seed}"]
        told += [] if walk.condition == "none" else [walk.condition.replace(" ", "-")]
        return make_run_info(
            fitting_run_id("-".join(told).replace(":", ".")),
            who=fitting_name(who),
            who_kind="agent",
            condition=", ".join(part for part in (walk.condition, agent.condition) if part not in ("", "none"))
            or "none",
            scene_kind=kind,
            dataset_digest=study.config.dataset.sha256,
            seed=self.seed,
            config={
                "actions": study.config.actions,
                "max_steps": study.config.steps,
                "clutter": home.clutter,
                **study_facts(study.config, walk.conditions),
                **evidence_config(study.dataset),
                **agent.config,
                **beside,
            },
            made_for=agent.made_for,
            labels=home.labels,
        )

"""Verb `ground`: runs a grounder over POG episodes, writes run folders and prints the paper's table; sweeps noise."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro import MISSING
from tyro.conf import arg

from grounding.chat.budget import Budget
from grounding.encoders.by_name import encoder_called, is_model, plain_name, require_no_model_options
from grounding.encoders.protocol import ModelOptions
from grounding.evaluation.evaluate import GroundJob, evaluate, select_jobs
from grounding.evaluation.home_maps import MapFolders
from grounding.evaluation.sequences import SequenceGroundJob
from grounding.evaluation.settings import CELLS, GroundSettings
from grounding.methods.by_name import require_method, takes_objects
from grounding.phrases.sources import phrases_called
from sim.episodes.dataset import PersonalDataset
from sim.homes.kind import common_kind
from sim.plugins import own_name
from sim.tasks.metrics import metric_rows
from sim.tasks.provenance import evidence_config, make_run_info
from sim.tasks.run_files import RunInfo, fitting_name, read_run
from sim.tasks.run_writer import RunWriter
from sim.tasks.shards import shard_from_text
from sim.tasks.workers import RayCluster, Workers
from sim.types import SPLITS, EpisodeKey

from ...progress import counted
from ..chat_cost import require_chat_for_limits
from ..options import (
    Address,
    Clutter,
    DatasetOrStudy,
    Evidence,
    IgnoreMessages,
    Jobs,
    Json,
    Label,
    Limit,
    LlmKeyEnv,
    LlmModel,
    LlmUrl,
    MaxCalls,
    MaxTokens,
    ModelAutocast,
    ModelBatch,
    ModelDevice,
    On,
    Out,
    Price,
    RunId,
    SampleSeed,
    Scenes,
    ScenesDir,
    Sequences,
    Shard,
    Splits,
    StudyFolder,
    workers_of,
)
from ..output import print_json
from ..refusals import check_options, nothing_chosen, require_dataset, sampled_sequences
from ..runs.metrics import Metrics
from .ground_maps import cell_of_maps, layout_of_maps
from .ground_names import beside_truth, grounder_facts, map_name, plugin_codes, run_name, swept, swept_run_id
from .ground_sequences import ground_sequences, require_options_of_sequences, sequence_info
from .ground_tables import GroundResult, ground_document, print_ground_table

if TYPE_CHECKING:
    from ...study_app.planned_study import PlannedStudy

EXPLORATIONS = "explorations"
"""Folder below --out that all maps of explored homes share."""
_EXPLORED = "Explored maps: "


@dataclass
class Ground:
    """Ground POG episodes on oracle maps, on maps of homes that our explorer walks, or on maps made before."""

    dataset: DatasetOrStudy = None
    method: Annotated[
        str,
        arg(
            help="random, center, qs, rpg, rpg-authors, rpg-literal, phrase, dual, dual-smooth, dual-smooth-point or "
            "joint; object-phrase or object-dual on maps of objects; with a chat model (--llm-url, --llm-model) "
            "object-list-llm or map-image-vlm on maps of objects, and frames-vlm on explored homes; or your own as "
            "package.module:factory, which gets the map's encoder."
        ),
    ] = MISSING
    study: StudyFolder = None
    sequences: Sequences = None
    ignore_messages: IgnoreMessages = False
    map: Annotated[
        str,
        arg(help="oracle (texts of the episode files), explore (walk each home, map it), or a folder of <Scene>.npz."),
    ] = "oracle"
    encoder: Annotated[
        str,
        arg(
            help="hashed, minilm (on explored maps: oracle perception in their space), or clip:, siglip:, "
            "blip2-itc256:, blip2-hidden768: and a model id or a folder; or your own as package.module:factory."
        ),
    ] = "hashed"
    phrases: Annotated[
        str,
        arg(
            help="Who owns what: dataset (its own, ground truth), rules (that parse the text), llm (a language model "
            "reads it), or your own as package.module:factory."
        ),
    ] = "dataset"
    llm_url: LlmUrl = ""
    llm_model: LlmModel = ""
    llm_key_env: LlmKeyEnv = ""
    max_calls: MaxCalls = None
    max_tokens: MaxTokens = None
    price: Price = None
    all_storeys: Annotated[bool, arg(help="Do not tell the target's storey.")] = False
    layout: Annotated[
        Literal["grid", "fine", "objects"] | None,
        arg(help=_EXPLORED + "cells of 1 m (grid, by default) or 0.25 m (fine), or objects; map files say theirs."),
    ] = None
    features: Annotated[Literal["patches", "images"], arg(help=_EXPLORED + "what is encoded of each view.")] = "patches"
    blur: Annotated[float, arg(help="Oracle maps: how far objects spread (sigma, metres).")] = 0.0
    object_noise: Annotated[float, arg(help="Error of each object's cosines (standard deviation).")] = 0.0
    cell_noise: Annotated[float, arg(help="Oracle maps: error of each cell's cosines (standard deviation).")] = 0.0
    clutter_texts: Annotated[bool, arg(help="Oracle maps: empty observed cells hold objects of other homes.")] = False
    view_noise: Annotated[float, arg(help=_EXPLORED + "error of each patch in each view.")] = 0.0
    confusion: Annotated[float, arg(help=_EXPLORED + "share of objects that are mistaken for another one.")] = 0.0
    background: Annotated[bool, arg(help=_EXPLORED + "walls and objects without a name get random features.")] = False
    paraphrase: Annotated[
        Literal[0, 1, 2, 3],
        arg(help=_EXPLORED + "captions as they are, reworded, with half of the attributes, or the category only."),
    ] = 0
    clutter: Clutter = 0
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    sweep: Annotated[str | None, arg(help="NAME=V1,V2,...: one run per value, e.g. object-noise=0,0.1,0.2.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    out: Out = None
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
    json: Json = False

    def check(self) -> None:
        """Refuses unknown names, and plug-ins that cannot be built, before anything is opened.

        Raises:
            AgentError: A name is refused; the message names the option.
        """
        encoder_called(self.encoder)
        require_method(self.method)
        takes_objects(self.method)
        phrases_called(self.phrases)

    def run(self) -> int:
        self.check()
        self._workers()
        if self.study is not None:
            return self._of_study().run()
        require_options_of_sequences(self, is_of_sequences=self.sequences is not None)
        episodes = PersonalDataset(require_dataset(self.dataset), evidence=self.evidence)
        settings = self.settings(episodes)
        check_options(self)
        require_chat_for_limits(self, has_chat=settings.has_chat)
        if not is_model(self.encoder):
            require_no_model_options(f"--encoder {self.encoder}", self._model)
        if self.sequences is not None:
            return self._on_sequences(self.sequences, episodes, settings)
        documents = []
        for each in self._swept(settings):
            found = [self._grounded(episodes, one) for one in (each, *beside_truth(each))]
            if self.json:
                document, *beside = [ground_document(result) for result in found]
                documents.append({**document, "with_rule_phrases": next(iter(beside), None)})
            else:
                print_ground_table(found)
        if self.json:
            print_json(documents if self.sweep else documents[0])
        return 0

    def settings(self, episodes: PersonalDataset) -> GroundSettings:
        """The settings to evaluate; the layout of existing maps is read from their files.

        Raises:
            PersonalVizError: Options do not fit together, or map files do not.
        """
        layout = self.layout or "grid"
        if self._folder is not None:
            layout = layout_of_maps(self._folder, episodes, scenes=self.scene, method=self.method, asked=self.layout)
        same = {field.name for field in fields(GroundSettings)} & {field.name for field in fields(self)}
        values = {name: getattr(self, name) for name in same - {"map", "layout"}}
        values["encoder"] = plain_name(self.encoder)
        kind = "files" if self._folder else "explore" if self.map == "explore" else "oracle"
        return GroundSettings(map=kind, layout=layout, home_clutter=self.clutter, **values)

    def _of_study(self) -> "_GroundStudy":
        """The same on what the study's people point at: in its homes, without being told the target's storey.

        Raises:
            PersonalVizError: An option contradicts the plan, or the study, its dataset or a home cannot be used.
        """
        from ...study_app.planned_study import agent_runs, open_planned, require_plans_choices
        from .ground_study import study_places

        check_options(self)
        require_plans_choices(self, ("scene", "split", "limit", "sample_seed", "clutter"))
        study = open_planned(self, "pog")
        require_options_of_sequences(self, is_of_sequences=study.sequences is not None)
        same = {field.name: getattr(self, field.name) for field in fields(self)}
        placed = study_places(study, explores=self.map == "explore", out=agent_runs(study, self.out))
        return _GroundStudy(**{**same, **placed}, planned=study)

    def _on_sequences(self, root: Path, episodes: PersonalDataset, settings: GroundSettings) -> int:
        """Answers the searches of home sequences, and prints their table."""
        keys, query_index = self._asked(root)
        folders = []
        for each in (settings, *beside_truth(settings)):
            whole = self._info(episodes, each)
            named = self.run_id is not None
            info = sequence_info(whole, root, ignores_messages=self.ignore_messages, is_named=named)
            budget = Budget(self._out / info.run_id, self.max_calls, self.max_tokens) if each.has_chat else None
            job = SequenceGroundJob(
                episodes.root,
                "",
                (),
                each,
                self._folders(each, whole),
                self._model,
                budget,
                evidence=self.evidence,
                query_index=query_index,
                sequences=root,
                ignores_messages=self.ignore_messages,
            )
            folders.append(ground_sequences(job, keys, info, out=self._out, processes=self._workers()))
        return Metrics(tuple(folders), json=self.json).run()

    def _asked(self, root: Path) -> tuple[Sequence[EpisodeKey], int]:
        """The sequences of the set `root` that are answered, and which paraphrase of each query is read."""
        return sampled_sequences(root, splits=self.split, scenes=self.scene, limit=self.limit, seed=self.sample_seed), 0

    @property
    def _out(self) -> Path:
        return self.out or Path("runs")

    @property
    def _folder(self) -> Path | None:
        """The folder of map files, for `--map PATH`; otherwise None."""
        return None if self.map in ("oracle", "explore") else Path(self.map)

    def _workers(self) -> Workers:
        """The workers; raises PersonalVizError for options that do not fit together."""
        return workers_of(self.on, jobs=self.jobs, address=self.address, device=self.device)

    @property
    def _model(self) -> ModelOptions:
        """Options of a real encoder."""
        return ModelOptions(self.device, self.batch, self.autocast)

    def _grounded(self, episodes: PersonalDataset, settings: GroundSettings) -> GroundResult:
        """Makes or continues one run, and returns it with its figures."""
        whole = self._info(episodes, settings)
        jobs = {job.scene: job for job in self._work(episodes, settings, whole)}
        if not jobs:
            raise nothing_chosen(require_dataset(self.dataset))
        shard, keys = shard_from_text(self.shard), {name: job.keys for name, job in jobs.items()}
        info = shard.run_info(whole, keys)
        folder = shard.folder(self._out, info)
        budget = Budget(folder, self.max_calls, self.max_tokens) if settings.has_chat else None
        work = [replace(jobs[name], budget=budget) for name in shard.part(keys)]
        self._answer(work, folder, info)
        run = read_run(folder)
        chosen = {key for job in work for key in job.keys}
        answers = tuple(answer for answer in run.answers if answer.key in chosen)
        rows = {row.split: row for row in metric_rows([run.model_copy(update={"answers": answers})])}
        fallbacks = sum(answer.fell_back for answer in answers)  # of all processes and earlier calls
        usage = None if budget is None else budget.used()
        return GroundResult(settings, info, rows, folder, fell_back=fallbacks, chat=usage, price=self.price)

    def _answer(self, work: Sequence[GroundJob], folder: Path, info: RunInfo) -> None:
        """Answers the episodes that the run folder does not hold yet."""
        writer = RunWriter(folder, info)
        workers = self._workers()
        keys = [key for job in work for key in job.keys]
        with counted(info.run_id, len(keys)) as progress:
            progress.add(sum(key in writer.done for key in keys))
            notes = None if isinstance(workers, RayCluster) else progress.notes  # other machines cannot write there
            noted = [replace(job, folders=job.folders and replace(job.folders, notes=notes)) for job in work]
            evaluate(noted, writer, processes=workers, on_episode=progress.add)

    def _work(self, episodes: PersonalDataset, settings: GroundSettings, info: RunInfo) -> list[GroundJob]:
        """One job per scene."""
        return select_jobs(
            episodes,
            settings,
            splits=self.split or SPLITS,
            scenes=self.scene or None,
            limit=self.limit,
            sample_seed=self.sample_seed,
            folders=self._folders(settings, info),
            model=self._model,
        )

    def _folders(self, settings: GroundSettings, info: RunInfo) -> MapFolders | None:
        """Folders of maps and explorations; None for oracle maps."""
        if settings.map == "oracle":
            return None
        maps = self._folder or self._out / str(info.config["maps"])
        return MapFolders(maps, self._out / EXPLORATIONS, self.scenes_dir, swept=self._swept_maps(settings, info))

    def _info(self, episodes: PersonalDataset, settings: GroundSettings) -> RunInfo:
        """The contents of run.json."""
        grounder = grounder_facts(settings)
        phrases = phrases_called(settings.phrases) if grounder.uses_phrases else "none"
        storey = "all storeys" if settings.all_storeys else "storey given"
        digest = episodes.digest()
        kind, condition = "oracle-map", settings.condition
        config = {**settings.config, "phrases": phrases, "frame": grounder.frame, **plugin_codes(settings)}
        if "encoder_code" in config:
            config["encoder"] = encoder_called(settings.map_encoder)
        who = fitting_name(self.label or own_name(grounder, settings.method))
        if who != settings.method:
            config["method"] = settings.method
        if settings.map != "oracle":
            kind = common_kind(episodes, self.scene or episodes.scenes, self.scenes_dir)
            if self._folder is None:
                config |= evidence_config(episodes)
            config["maps"] = str(self._folder or f"{map_name(settings, digest, kind)}/maps")
        cell = cell_of_maps(self._folder, episodes, scenes=self.scene) if self._folder else None
        if cell is not None and cell not in CELLS.values():
            config["cell"] = cell  # no layout has this cell size
            condition += f", cells of {cell:g} m"
        return make_run_info(
            (self.run_id and swept_run_id(self.run_id, settings, self.sweep, phrases=self.phrases))
            or run_name(settings, label=self.label),
            who=who,
            who_kind="agent",
            condition=f"{condition}, phrases {phrases}, {storey}",
            scene_kind=kind,
            dataset_digest=digest,
            seed=settings.seed,
            config=config,
        )

    def _swept(self, settings: GroundSettings) -> list[GroundSettings]:
        """The settings of each value of the sweep; these alone without one."""
        return [settings] if self.sweep is None else swept(settings, self.sweep)

    def _swept_maps(self, settings: GroundSettings, info: RunInfo) -> tuple[tuple[GroundSettings, Path], ...]:
        """The settings of the sweep's other values, and the folders of their maps; none where maps are files."""
        if self._folder is not None or self.sweep is None:
            return ()
        maps = {f"{map_name(each, info.dataset_digest, info.scene_kind)}/maps": each for each in self._swept(settings)}
        return tuple((each, self._out / name) for name, each in maps.items() if name != info.config["maps"])


@dataclass
class _GroundStudy(Ground):
    """`Ground` on the episodes or home sequences of a planned study; its other options are those of the plan."""

    planned: "PlannedStudy | None" = None

    def _work(self, episodes: PersonalDataset, settings: GroundSettings, info: RunInfo) -> list[GroundJob]:
        from .ground_study import study_jobs

        assert self.planned is not None
        return study_jobs(self.planned, settings, folders=self._folders(settings, info), model=self._model)

    def _asked(self, root: Path) -> tuple[Sequence[EpisodeKey], int]:
        assert self.planned is not None
        return self.planned.keys("pog"), self.planned.config.query_index

    def _info(self, episodes: PersonalDataset, settings: GroundSettings) -> RunInfo:
        from .ground_study import study_info

        assert self.planned is not None
        return study_info(self.planned, super()._info(episodes, settings), is_named=bool(self.run_id))

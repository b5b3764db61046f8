"""Verb `ground`: a grounder over POG episodes into a run folder, and the paper's POG table of it; sweeps over noise."""

import hashlib
import json
import re
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from grounding.agents.explore import EXPLORER_VERSION
from grounding.encoders.by_name import encoder_slug, is_model, make_encoder, require_no_model_options
from grounding.encoders.protocol import ModelOptions
from grounding.evaluate import GroundJob, evaluate, select_jobs
from grounding.home_maps import MAP_VERSION, MapFolders
from grounding.methods.by_name import make_grounder
from grounding.settings import CELLS, GroundSettings
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, PersonalVizError
from sim.homes.kind import common_kind
from sim.homes.plan import HOMES_VERSION
from sim.tasks.metrics import metric_rows
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import RunInfo, fitting_run_id, read_run
from sim.tasks.run_writer import RunWriter
from sim.types import SPLITS, Split

from ..study_app.checked_options import check_options
from .ground_maps import cell_of_maps
from .ground_progress import ground_progress
from .ground_tables import GroundResult, ground_document, print_ground_table

EXPLORATIONS = "explorations"
"""Folder below --out that all maps of explored homes share."""
_NOT_OF_THE_MAP = ("method", "phrases", "all_storeys", "llm_url", "llm_model", "llm_key_env")
"""Settings that the same map serves."""


@dataclass(frozen=True, slots=True)
class GroundCall:
    """One call of the verb."""

    dataset: Path
    settings: GroundSettings
    maps: Path | None
    """Folder of map files, for `--map PATH`."""
    model: ModelOptions
    """How a real encoder runs."""
    scenes_dir: Path | None
    out: Path
    run_id: str | None
    scene: tuple[str, ...] | None
    split: tuple[Split, ...] | None
    limit: int | None
    sample_seed: int
    jobs: int
    json: bool
    sweep: str | None
    """`NAME=V1,V2,...`: one run per value of this setting."""


def ground(call: GroundCall) -> int:
    """Grounds episodes into `out/<run_id>`; a second call goes on where the first stopped. Prints the figures.

    Raises:
        PersonalVizError: Bad options, dataset or folder.
    """
    check_options(
        run_id=call.run_id, limit=call.limit, jobs=call.jobs, seed=call.settings.seed, sample_seed=call.sample_seed
    )
    if call.model.batch_size < 1:
        raise PersonalVizError(f"--batch is {call.model.batch_size}; expected a whole number from 1. Leave it out.")
    if not is_model(call.settings.encoder):
        require_no_model_options(f"--encoder {call.settings.encoder}", call.model)
    episodes = PersonalDataset(call.dataset)
    documents = []
    for settings in [call.settings] if call.sweep is None else swept(call.settings, call.sweep):
        found = [_grounded(call, episodes, each) for each in (settings, *_beside(settings))]
        if call.json:
            document, *beside = [ground_document(result) for result in found]
            documents.append({**document, "with_rule_phrases": next(iter(beside), None)})
        else:
            print_ground_table(found)
    if call.json:
        print(json.dumps(documents if call.sweep else documents[0], indent=2))
    return 0


def _beside(settings: GroundSettings) -> list[GroundSettings]:
    """The same with phrases read by rules, where they are the dataset's: ground truth never stands alone."""
    uses_phrases = make_grounder(settings.method, make_encoder("hashed"), seed=settings.seed).uses_phrases
    return [replace(settings, phrases="rules")] if uses_phrases and settings.phrases == "dataset" else []


def _grounded(call: GroundCall, episodes: PersonalDataset, settings: GroundSettings) -> GroundResult:
    info, folder = _ground_once(call, episodes, settings)
    run = read_run(folder)
    chosen = {key for job in _work(call, episodes, settings, info) for key in job.keys}
    answers = tuple(answer for answer in run.answers if answer.key in chosen)
    rows = {row.split: row for row in metric_rows([run.model_copy(update={"answers": answers})])}
    fallbacks = sum(answer.phrases_fell_back for answer in answers)  # of all processes and earlier calls
    return GroundResult(settings, info, rows, folder, phrases_by_rules=fallbacks)


def swept(settings: GroundSettings, sweep: str) -> list[GroundSettings]:
    """The settings with each value of `NAME=V1,V2,...` in turn.

    Raises:
        AgentError: The name is no setting with numbers, or a value is none.
    """
    name, _, values = sweep.partition("=")
    name = name.strip().replace("-", "_")
    numbers = {
        field.name: field.type for field in fields(settings) if field.type in (float, int) or name == "paraphrase"
    }
    if name not in numbers or name == "seed" or not values:
        raise AgentError(
            f"--sweep is {sweep!r}; expected NAME=V1,V2,... with object-noise, cell-noise, blur, view-noise, confusion "
            "or paraphrase. Example: --sweep object-noise=0,0.1,0.2."
        )
    try:
        parsed = [int(value) if name == "paraphrase" else float(value) for value in values.split(",")]
    except ValueError:
        raise AgentError(f"--sweep is {sweep!r}; expected numbers behind {name}=. Separate them by commas.") from None
    return [replace(settings, **{name: value}) for value in parsed]


def _ground_once(call: GroundCall, episodes: PersonalDataset, settings: GroundSettings) -> tuple[RunInfo, Path]:
    info = _info(call, episodes, settings)
    work = _work(call, episodes, settings, info)
    if not work:
        raise PersonalVizError(
            f"{call.dataset}: the chosen splits and scenes hold no episode; expected one. Choose others."
        )
    folder = call.out / info.run_id
    writer = RunWriter(folder, info)
    total = sum(len(job.keys) for job in work)
    left = sum(key not in writer.done for job in work for key in job.keys)
    with ground_progress() as (progress, notes):
        bar = progress.add_task(info.run_id, total=total, completed=total - left)
        noted = [replace(job, folders=job.folders and replace(job.folders, notes=notes)) for job in work]
        evaluate(noted, writer, processes=call.jobs, on_episode=lambda: progress.update(bar, advance=1))
    return info, folder


def _work(call: GroundCall, episodes: PersonalDataset, settings: GroundSettings, info: RunInfo) -> list[GroundJob]:
    folders = None
    if settings.map != "oracle":
        maps = call.maps or call.out / str(info.config["maps"])
        folders = MapFolders(maps, call.out / EXPLORATIONS, call.scenes_dir)
    return select_jobs(
        episodes,
        settings,
        splits=call.split or SPLITS,
        scenes=call.scene,
        limit=call.limit,
        sample_seed=call.sample_seed,
        folders=folders,
        model=call.model,
    )


def _info(call: GroundCall, episodes: PersonalDataset, settings: GroundSettings) -> RunInfo:
    grounder = make_grounder(settings.method, make_encoder("hashed"), seed=settings.seed)  # its facts, no answers
    phrases = settings.phrases if grounder.uses_phrases else "none"
    storey = "all storeys" if settings.all_storeys else "storey given"
    digest = episodes.digest()
    kind, condition = "oracle-map", settings.condition
    config = {**settings.config, "phrases": phrases, "frame": grounder.frame}
    if settings.map != "oracle":
        kind = common_kind(episodes, call.scene or episodes.scenes, call.scenes_dir)
        config["maps"] = str(call.maps) if call.maps else f"{map_name(settings, digest, kind)}/maps"
    cell = cell_of_maps(call.maps, episodes, scenes=call.scene or ()) if call.maps else None
    if cell is not None and cell not in CELLS.values():
        config["cell"] = cell  # no layout has it
        condition += f", cells of {cell:g} m"
    return make_run_info(
        (call.run_id and _swept_id(call, settings)) or run_name(settings),
        who=settings.method,
        who_kind="agent",
        condition=f"{condition}, phrases {phrases}, {storey}",
        scene_kind=kind,
        dataset_digest=digest,
        seed=settings.seed,
        config=config,
    )


def run_name(settings: GroundSettings) -> str:
    """Folder name of a run: what is usual stays unsaid; a long name is shortened with a digest."""
    storey = "all-storeys" if settings.all_storeys else "storey-given"
    parts = [settings.method, settings.map, encoder_slug(settings.encoder), *_unusual(settings), storey]
    if settings.phrases != "dataset":
        parts.append(settings.phrases + re.sub(r"[^A-Za-z0-9.]", "", settings.llm_model)[:20])
    return fitting_run_id(f"ground-{'-'.join(parts)}-seed{settings.seed}")


def map_name(settings: GroundSettings, dataset_digest: str, kind: str) -> str:
    """Folder name of the maps of explored homes that runs with these settings and versions of their makers share."""
    made_of = {name: value for name, value in asdict(settings).items() if name not in _NOT_OF_THE_MAP}
    text = json.dumps([made_of, dataset_digest, kind, MAP_VERSION, EXPLORER_VERSION, HOMES_VERSION], sort_keys=True)
    parts = [encoder_slug(settings.encoder), *_unusual(settings), kind]
    return fitting_run_id(f"map-{'-'.join(parts)}-seed{settings.seed}-{hashlib.sha256(text.encode()).hexdigest()[:8]}")


def _unusual(settings: GroundSettings) -> list[str]:
    """Words for the settings of the map that are not their defaults."""
    skipped = {"map", "encoder", "seed", *_NOT_OF_THE_MAP}
    changed = [field for field in fields(settings) if field.name not in skipped]
    return [
        f"{field.name.replace('_', '')}{'' if value is True else value}"
        for field in changed
        if (value := getattr(settings, field.name)) != field.default
    ]


def _swept_id(call: GroundCall, settings: GroundSettings) -> str:
    """The run's own name; behind it the value of the swept setting, and phrases that were not asked for."""
    phrases = "" if settings.phrases == call.settings.phrases else f"-{settings.phrases}"
    if call.sweep is None:
        return fitting_run_id(f"{call.run_id}{phrases}")
    name = call.sweep.partition("=")[0].strip().replace("-", "_")
    return fitting_run_id(f"{call.run_id}-{name.replace('_', '-')}{getattr(settings, name)}{phrases}")

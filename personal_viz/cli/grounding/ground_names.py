"""Names of `ground`'s runs and maps, the plug-ins among its settings, and the settings of a sweep."""

import hashlib
import json
import re
from dataclasses import asdict, fields, replace

from grounding.encoders.by_name import PLUGIN, encoder_slug, make_encoder, parse_encoder_name
from grounding.evaluation.home_maps import MAP_VERSION
from grounding.evaluation.settings import GroundSettings
from grounding.methods.by_name import Grounder, make_grounder
from grounding.phrases.sources import phrases_called
from sim.errors import AgentError
from sim.homes.plan import HOMES_VERSION
from sim.plugins import is_plugin, own_name, plugin_digest
from sim.tasks.run_files import fitting_run_id

_NOT_OF_THE_MAP = ("method", "phrases", "all_storeys", "llm_url", "llm_model", "llm_key_env")
"""Settings that do not change the map."""


def grounder_facts(settings: GroundSettings) -> Grounder:
    """The settings' grounder, only to read its properties, not to get answers."""
    return make_grounder(settings.method, make_encoder("hashed"), seed=settings.seed)


def swept(settings: GroundSettings, sweep: str) -> list[GroundSettings]:
    """The settings with each value of `NAME=V1,V2,...` in turn.

    Raises:
        AgentError: The name is not a setting with numbers, or a value is not a number.
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


def swept_run_id(run_id: str, settings: GroundSettings, sweep: str | None, *, phrases: str) -> str:
    """A run's own name, followed by the swept setting's value, and by the phrases if others were asked for."""
    told = "" if settings.phrases == phrases else f"-{settings.phrases}"
    if sweep is None:
        return fitting_run_id(f"{run_id}{told}")
    name = sweep.partition("=")[0].strip().replace("-", "_")
    return fitting_run_id(f"{run_id}-{name.replace('_', '-')}{getattr(settings, name)}{told}")


def beside_truth(settings: GroundSettings) -> list[GroundSettings]:
    """The same settings with phrases read by rules, if they are the dataset's: ground truth never stands alone."""
    is_truth = settings.phrases == "dataset" and grounder_facts(settings).uses_phrases
    return [replace(settings, phrases="rules")] if is_truth else []


def plugin_codes(settings: GroundSettings) -> dict[str, str]:
    """Digests of the plug-ins among the settings."""
    parts = parse_encoder_name(settings.encoder)
    plugins = {
        "encoder": parts.source if parts.family == PLUGIN else "",
        "method": settings.method,
        "phrases": settings.phrases,
    }
    return {f"{option}_code": f"{name}@{plugin_digest(name)}" for option, name in plugins.items() if is_plugin(name)}


def run_name(settings: GroundSettings, *, label: str | None = None) -> str:
    """Folder name of a run: defaults are left out, and a long name is shortened with a digest."""
    storey = "all-storeys" if settings.all_storeys else "storey-given"
    who = label or own_name(grounder_facts(settings), settings.method)
    parts = [who, settings.map, encoder_slug(settings.encoder), *_unusual(settings), storey]
    if settings.phrases != "dataset" or settings.has_chat:
        source = "" if settings.phrases == "dataset" else phrases_called(settings.phrases)
        parts.append(source + re.sub(r"[^A-Za-z0-9.]", "", settings.llm_model)[:20])
    return fitting_run_id(f"ground-{'-'.join(parts)}-seed{settings.seed}")


def map_name(settings: GroundSettings, dataset_digest: str, kind: str) -> str:
    """Folder name of maps of explored homes, shared by all runs with these settings and the same program versions."""
    from grounding.agents.explore import EXPLORER_VERSION  # takes half a second to import, for explored homes only

    made_of = {name: value for name, value in asdict(settings).items() if name not in _NOT_OF_THE_MAP}
    versions = [MAP_VERSION, EXPLORER_VERSION, HOMES_VERSION]
    code = [plugin_codes(settings)["encoder_code"]] if "encoder_code" in plugin_codes(settings) else []
    text = json.dumps([made_of, dataset_digest, kind, *versions, *code], sort_keys=True)
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

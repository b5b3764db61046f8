"""Asks a run's grounder again: run files hold only the answers, but views show how the grounder found them.

The grounder answers with the settings in `run.json` and must give the same points.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.plugins import is_plugin
from sim.tasks.run_files import Answer, RunInfo

from ..encoders.by_name import PLUGIN, parse_encoder_name
from ..evaluation.evaluate import SceneGrounder
from ..evaluation.home_maps import MapFolders
from ..evaluation.settings import GroundSettings
from ..maps.home_map import Memory
from ..methods.chat_grounders import CHAT_METHODS
from ..types import Grounding

_SETTINGS = TypeAdapter(GroundSettings)
_NEEDED = ("map", "encoder", "all_storeys")
"""Config keys that must be present; they are never guessed."""
_SAME = 1e-6
"""Largest distance between two equal answers, metres."""


@dataclass(frozen=True, slots=True)
class AnswerAgain:
    """An answer given again, or the reason why there is none."""

    memory: Memory | None = None
    """The map on which the grounder answered."""
    grounding: Grounding | None = None
    map_file: Path | None = None
    """The file of the home's map; None for oracle maps."""
    problem: str = ""
    """Why there is no answer, as a sentence without its subject; empty if there is one."""


def settings_of(info: RunInfo) -> GroundSettings | None:
    """The settings with which `personal-viz ground` made a run; None if another program or a plug-in made it."""
    names = {field.name for field in fields(GroundSettings)} - {"method", "seed"}
    config = {name: value for name, value in info.config.items() if name in names}
    if config.get("phrases") == "none":  # the method uses none
        del config["phrases"]
    config["method"] = info.config.get("method", info.who)  # the run's own name may differ from the method's
    if any(name not in config for name in _NEEDED) or _names_plugin(config):
        return None
    try:
        return _SETTINGS.validate_python({"seed": info.seed, **config})
    except (ValidationError, AgentError):
        return None


def _names_plugin(config: Mapping[str, object]) -> bool:
    """Whether a run was made with a user's own code, which merely viewing a file must not start."""
    with suppress(AgentError):
        if parse_encoder_name(str(config["encoder"])).family == PLUGIN:
            return True
    return any(is_plugin(str(config.get(name, ""))) for name in ("method", "phrases"))


class AskAgain:
    """Keeps a grounder per scene and map, so that many answers are quick. Maps are read only, never made."""

    def __init__(self, dataset: PersonalDataset, *, beside: Sequence[Path] = ()) -> None:
        """Takes the data set of the runs, and the folders that hold their run folders and maps."""
        self._dataset = dataset
        self._beside = tuple(dict.fromkeys(beside))
        self._made: dict[tuple[str, GroundSettings, Path | None], SceneGrounder] = {}

    def ask(self, info: RunInfo, answer: Answer, episode: Episode) -> AnswerAgain:
        """The answer once more, with its map and layers.

        Raises:
            PersonalVizError: The episode's files are damaged, or its map cannot be loaded.
        """
        settings = settings_of(info)
        if settings is None:
            return AnswerAgain(problem="is none of our grounders, so it cannot be asked again")
        if settings.method in CHAT_METHODS:
            return AnswerAgain(problem="came from a chat model, which is not asked again; chat.jsonl holds its words")
        scene = episode.key.scene
        folders = self._folders(info, scene)
        if settings.map != "oracle" and folders is None:
            return AnswerAgain(problem=f"cannot be asked again: its map of {scene} is no longer beside its run folder")
        where = (scene, settings, folders and folders.maps)
        if where not in self._made:
            self._made[where] = SceneGrounder(self._dataset, scene, settings, folders=folders)
        grounding = self._made[where].ground(episode)
        again = np.array([candidate.position for candidate in grounding.candidates], float).reshape(-1, 3)
        stored = np.array(answer.candidates, float).reshape(-1, 3)
        if again.shape != stored.shape or not np.allclose(again, stored, rtol=0, atol=_SAME):
            return AnswerAgain(problem="gives other points now than its run file holds")
        map_file = None if folders is None else folders.map_file(scene)
        return AnswerAgain(self._made[where].memory(episode), grounding, map_file)

    def _folders(self, info: RunInfo, scene: str) -> MapFolders | None:
        """The folders of a run's map of a scene; None for oracle maps, and if the map is missing."""
        maps = info.config.get("maps")
        if not isinstance(maps, str):
            return None
        places = [MapFolders(parent / maps, parent) for parent in (*self._beside, Path())]
        return next((folders for folders in places if folders.map_file(scene).is_file()), None)

"""The settings of a grounding run: method, map, encoder, phrases, noise; options set them, run.json keeps them."""

import math
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Literal

from sim.errors import AgentError
from sim.types import ClutterLevel

from ..encoders.by_name import encoder_called, is_model, sees
from ..encoders.protocol import ORACLE_SUFFIX, Autocast
from ..methods.by_name import require_method, takes_objects
from ..methods.chat_grounders import CHAT_METHODS
from ..perception.paraphrase import ParaphraseLevel
from ..phrases.sources import PhraseSourceName

if TYPE_CHECKING:
    from ..chat.budget import Budget
    from ..chat.endpoint import Endpoint, LlmOptions

MapName = Literal["oracle", "explore", "files"]
"""`oracle` = texts of the episode files; `explore` = our explorer walks each home first; `files` = maps made before."""
MapLayout = Literal["grid", "fine", "objects"]
"""The paper's 1 m cells, 0.25 m cells, or an object map."""
CELLS: dict[MapLayout, float] = {"grid": 1.0, "fine": 0.25}
"""Sides of the cells, metres."""
_SAID_ELSEWHERE = (
    "method", "map", "encoder", "seed", "all_storeys", "phrases", "features", "llm_url", "llm_model", "llm_key_env",
)  # fmt: skip
_ORACLE_ONLY = ("blur", "cell_noise", "clutter_texts")
_EXPLORED_ONLY = ("view_noise", "confusion", "background", "paraphrase", "home_clutter", "features")
_PERCEIVED = ("view_noise", "object_noise", "confusion", "background", "paraphrase")
"""Settings of oracle perception on explored maps; it replaces an encoder of pictures."""


@dataclass(frozen=True, slots=True)
class GroundSettings:
    """Settings of an evaluation; the same settings always give the same answers. Flat, as in run.json."""

    method: str
    """Name of a grounder (`GrounderName`), or a user's own."""
    map: MapName = "oracle"
    encoder: str = "hashed"
    seed: int = 0
    all_storeys: bool = False
    """Merge the storeys into one map instead of giving the target's storey."""
    phrases: PhraseSourceName = "dataset"
    llm_url: str = ""
    """With phrases `llm` or a chat method: the endpoint, without secrets."""
    llm_model: str = ""
    llm_key_env: str = ""
    """Name of the environment variable that holds the key, never the key; "" where the server needs no key."""
    layout: MapLayout = "grid"
    features: Literal["patches", "images"] = "patches"
    """A vector for each patch, or one for the whole picture in each cell that it shows (as in the authors' code)."""
    blur: float = 0.0
    """Oracle maps: metres over which an object spreads (GROUNDING.md, section 0)."""
    object_noise: float = 0.0
    """Noise of each object's vector, the same in all views; standard deviation of the cosine's error."""
    cell_noise: float = 0.0
    """Oracle maps: noise of each cell's vector."""
    clutter_texts: bool = False
    """Oracle maps: observed cells without an object get the text of an object of another home."""
    view_noise: float = 0.0
    """Explored maps: noise of each patch in each view."""
    confusion: float = 0.0
    """Explored maps: share of objects that always get the caption of another object of the home."""
    background: bool = False
    """Explored maps: walls and things without a caption get random texts instead of nothing."""
    paraphrase: ParaphraseLevel = 0
    """Explored maps: 0 captions as they are, 1 reworded, 2 half of the attributes, 3 category only."""
    home_clutter: ClutterLevel = 0
    """Explored maps: amount of furniture without a caption in homes without a scan."""
    autocast: Autocast = "off"
    """Arithmetic of a real model; its vectors depend on it a little."""

    def __post_init__(self) -> None:
        for name in ("blur", "object_noise", "cell_noise", "view_noise", "confusion"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise AgentError(f"--{_option(name)} is {value!r}; expected a number of at least 0. Give another one.")
        if self.confusion > 1:
            raise AgentError(f"--confusion is {self.confusion!r}; expected a share of 0 to 1. Give another one.")
        if self.paraphrase not in range(4):
            raise AgentError(f"--paraphrase is {self.paraphrase!r}; expected 0 to 3. Give another one.")
        given = (self.llm_url, self.llm_model, self.llm_key_env)
        if self.has_chat != bool(self.llm_url and self.llm_model) or (any(given) and not self.has_chat):
            raise AgentError(
                f"--method is {self.method!r} and --phrases is {self.phrases!r} with --llm-url {self.llm_url!r} and "
                f"--llm-model {self.llm_model!r}; expected both for phrases llm and for {', '.join(CHAT_METHODS)}, and "
                "none, nor --llm-key-env, for the others. Add or leave them out."
            )
        _ = self.llm  # an invalid address is refused before anything is written
        self._require_meaning()
        if self.map == "oracle" and self.layout != "grid":
            raise AgentError(
                f"--layout is {self.layout!r} on oracle maps; expected grid: they have 1 m cells (GROUNDING.md, "
                "section 0). Give --map explore, or leave --layout out."
            )
        require_method(self.method)
        if takes_objects(self.method) != (self.layout == "objects"):
            raise AgentError(
                f"--method {self.method} with --layout {self.layout}; expected object-phrase, object-dual, "
                "object-list-llm and map-image-vlm with --layout objects, and the other methods with grid or fine. "
                "Change one of them."
            )
        if self.method == "frames-vlm" and self.map != "explore":
            raise AgentError(
                f"--method is {self.method!r} with --map {self.map}; expected --map explore, whose walks give the "
                "pictures. Change one of them."
            )
        if self.method in CHAT_METHODS and self.layout == "objects" and self.map == "explore" and sees(self.encoder):
            raise AgentError(
                f"--method is {self.method!r} with --encoder {self.encoder}, which gives things no words; expected "
                "oracle perception, whose captions the model reads. Give --encoder hashed, or --method frames-vlm."
            )

    def _require_meaning(self) -> None:
        """Refuses options that would be ignored: the run's file would suggest that they had an effect."""
        map_text = "--map PATH, whose maps are made" if self.map == "files" else f"--map {self.map}"
        has_eyes = sees(self.encoder)
        encoder_text = f"--encoder {self.encoder}"
        self._refuse(self.map != "oracle", _ORACLE_ONLY, map_text, "--map oracle")
        self._refuse(self.map != "explore", _EXPLORED_ONLY, map_text, "--map explore")
        self._refuse(self.map == "files", ("object_noise",), map_text, "--map oracle or explore")
        self._refuse(
            self.map == "explore" and has_eyes, _PERCEIVED, encoder_text, "oracle perception: --encoder hashed, minilm"
        )
        self._refuse(self.layout == "objects", ("features",), "--layout objects", "--layout grid or fine")
        self._refuse(not is_model(self.encoder), ("autocast",), encoder_text, "a model's encoder")

    def _refuse(self, is_other: bool, names: tuple[str, ...], found: str, where: str) -> None:
        defaults = {field.name: field.default for field in fields(self)}
        for name in names if is_other else ():
            if getattr(self, name) != defaults[name]:
                raise AgentError(
                    f"--{_option(name)} is {getattr(self, name)!r} with {found}; expected it with {where} only. "
                    "Leave it out."
                )

    @property
    def map_encoder(self) -> str:
        """Name of the space of map and queries; its suffix marks a text encoder with oracle perception on a walk."""
        is_seen = self.map == "oracle" or sees(self.encoder) or self.encoder.endswith(ORACLE_SUFFIX)
        return self.encoder if is_seen else self.encoder + ORACLE_SUFFIX

    @property
    def llm(self) -> "LlmOptions | None":
        """Address of the chat model; None for settings without one.

        Raises:
            AgentError: The address or a name is not valid.
        """
        if not self.has_chat:
            return None
        from ..chat.endpoint import llm_options

        return llm_options(self.llm_url, self.llm_model, self.llm_key_env)

    @property
    def has_chat(self) -> bool:
        """Whether the method or the phrases ask a chat model."""
        return self.phrases == "llm" or self.method in CHAT_METHODS

    def endpoint(self, budget: "Budget | None" = None) -> "Endpoint | None":
        """The chat model; None for settings without one.

        Raises:
            AgentError: The key's environment variable is not set.
            MissingDependencyError: The extra `llm` is not installed.
        """
        from ..chat.endpoint import Endpoint

        return None if (options := self.llm) is None else Endpoint(options, budget=budget)

    @property
    def config(self) -> dict[str, str | int | float | bool | None]:
        """The `config` of run.json: every field except method and seed, which have fields of their own there."""
        return {name: value for name, value in asdict(self).items() if name not in ("method", "seed")}

    @property
    def condition(self) -> str:
        """Words for map, encoder and phrases in tables; two runs with the same words may share a row."""
        changed = [
            f"{field.name.replace('_', ' ')} {getattr(self, field.name)}"
            for field in fields(self)
            if field.name not in _SAID_ELSEWHERE and getattr(self, field.name) != field.default
        ]
        features = ["whole pictures"] if self.features == "images" else []
        asked = [f"chat model {self.llm_model}"] if self.method in CHAT_METHODS else []
        return ", ".join(
            [f"{self.map} map", f"{encoder_called(self.map_encoder)} encoder", *features, *changed, *asked]
        )


def _option(name: str) -> str:
    return name.removeprefix("home_").replace("_", "-")

"""The perception known by name: oracle perception with a level of errors, real models, or a user's own.

oracle | oracle:mild | oracle:strong,encoder=minilm
encoder=clip:ID,detector=owlv2:ID          also grounding-dino:ID, yolox:FILE, or package.module:factory
...,segmenter=package.module:factory,scorer=package.module:factory         instead of depth, and of the encoder's cosine
package.module:factory                     your own, which returns a `Perception`
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sim.errors import AgentError, did_you_mean
from sim.mesh import Scene
from sim.plugins import build_plugin, is_plugin, own_name
from sim.types import Frame, Observation, Pose

from ..encoders.by_name import PLUGIN, encoder_called, make_encoder, make_image_encoder, parse_encoder_name
from ..encoders.protocol import ModelOptions
from .encoder_scorer import EncoderScorer
from .oracle_detector import oracle_level
from .protocol import Detector, ImageTextScorer, Perception, Segmenter
from .segmenters import DepthRegion

PerceptionName = str
DETECTOR_FAMILIES = ("owlv2", "grounding-dino", "yolox")
_ORACLE = "oracle"
_PARTS = ("encoder", "detector", "segmenter", "scorer")


@dataclass(frozen=True, slots=True)
class EpisodeTruth:
    """What oracle perception knows of an episode. Ground truth: made on the researcher's side, never for an agent."""

    scene: Scene
    start: Pose
    """The pose in whose frame all observations will be; in a home sequence the first start that an agent remembers."""
    captions: Mapping[int, str]
    """Instance id to text, as `grounding.maps.oracle_map.object_texts` gives them."""


def make_perception(
    name: PerceptionName,
    *,
    truth: EpisodeTruth | None = None,
    options: ModelOptions | None = None,
    seed: int = 0,
) -> Perception:
    """The perception of this name.

    Args:
        name: As the module says.
        truth: The episode's home, start and captions; needed for oracle perception, unused by models.
        options: Device and arithmetic of real models.
        seed: Of the errors of oracle perception.

    Raises:
        AgentError: The name is unknown, a model cannot be loaded, or oracle perception got no truth.
        MissingDependencyError: The extra of a model is not installed.
    """
    if is_oracle(name):
        return replace(_oracle(name, truth, options, seed), name=perception_called(name))
    if is_plugin(name):
        made = build_plugin(name, option="--perception")
        if not isinstance(made, Perception):
            raise AgentError(
                f"--perception {name}: made {type(made).__name__}; expected grounding.perception.protocol.Perception. "
                "Return one from the factory."
            )
        return made
    return _models(name, options)


def is_oracle(name: PerceptionName) -> bool:
    """Whether the name is that of oracle perception, which needs an `EpisodeTruth`."""
    return name.partition(",")[0].partition(":")[0] == _ORACLE


def check_perception_name(name: PerceptionName) -> None:
    """Refuses a name that no perception has, without loading models.

    Raises:
        AgentError: The name is unknown.
    """
    if is_oracle(name):
        oracle_level(_level(name))
        _oracle_encoder(name)
    elif not is_plugin(name):
        detector = _parts(name, needed=("encoder", "detector"))["detector"]
        _require_detector(detector, detector.partition(":")[0])


def perception_called(name: PerceptionName) -> str:
    """The perception's name in runs and tables, with every setting of an oracle's faults; loads no model.

    Raises:
        AgentError: The name is unknown, or a user's own cannot be built.
    """
    check_perception_name(name)
    if is_oracle(name):
        level, encoder = _level(name), _oracle_encoder(name)
        return f"{_ORACLE}:{level} ({oracle_level(level).settings}) in {encoder_called(encoder)}"
    if is_plugin(name):
        return own_name(make_perception(name), name)
    parts = _parts(name, needed=("encoder", "detector"))
    return " + ".join([encoder_called(parts["encoder"]), *(parts[part] for part in _PARTS[1:] if part in parts)])


def own_parts(name: PerceptionName) -> dict[str, str]:
    """The user's own code in a known name: `package.module:factory` by part, or by "perception" if it is the whole."""
    if is_plugin(name) and not is_oracle(name):
        return {"perception": name}
    parts = {"encoder": _oracle_encoder(name)} if is_oracle(name) else _parts(name, needed=("encoder", "detector"))
    encoder = parse_encoder_name(parts["encoder"])
    parts["encoder"] = encoder.source if encoder.family == PLUGIN else ""
    if parts.get("detector", "").partition(":")[0] in DETECTOR_FAMILIES:
        del parts["detector"]
    return {part: value for part, value in parts.items() if value}


def make_detector(name: str, *, options: ModelOptions | None = None) -> Detector:
    """The detector `owlv2:ID`, `grounding-dino:ID`, `yolox:FILE`, or a user's own as package.module:factory.

    Raises:
        AgentError: The name is unknown, or the model cannot be loaded.
        MissingDependencyError: The extra of the model is not installed.
    """
    family, _, source = name.partition(":")
    _require_detector(name, family)
    match family:
        case "owlv2":
            from .owlv2 import Owlv2  # torch

            return Owlv2(source, options=options)
        case "grounding-dino":
            from .grounding_dino import GroundingDino

            return GroundingDino(source, options=options)
        case "yolox":
            from .yolox import Yolox

            return Yolox(source)
        case _:
            return build_plugin(name, option="detector", methods=("set_query", "detect"))


def frame_of_observation(observation: Observation) -> Frame:
    """The picture of an observation in the start frame, without ids; depth 0 where the robot has none.

    Raises:
        AgentError: The observation has no colours or no depth.
    """
    rgb, depth_m = observation.rgb, observation.depth_m
    if rgb is None or depth_m is None:
        raise AgentError(
            "perception: an observation has no picture; expected colours and depth. Run the agent with pictures."
        )
    return Frame(rgb, depth_m, observation.T_start_camera, observation.camera)


def _oracle(name: str, truth: EpisodeTruth | None, options: ModelOptions | None, seed: int) -> Perception:
    from .oracle_view import oracle_perception_of

    level = _level(name)
    oracle_level(level)
    encoder_name = _oracle_encoder(name)
    if truth is None:
        raise AgentError(
            f"--perception {name!r}: got no home and no start; expected them, because it reads the simulator's ids. "
            "Use models for pictures of a robot."
        )
    encoder = make_encoder(encoder_name, options=options)
    return oracle_perception_of(truth.scene, truth.start, truth.captions, text_encoder=encoder, level=level, seed=seed)


def _level(name: str) -> Any:
    """The level in an oracle's name, not yet checked."""
    return name.partition(",")[0].partition(":")[2] or "clean"


def _oracle_encoder(name: str) -> str:
    """The encoder in an oracle's name; raises AgentError if it names other parts."""
    parts = _parts(name, needed=())
    if set(parts) - {"encoder"}:
        raise AgentError(f"--perception {name!r}: found {sorted(parts)}; expected encoder= alone. Leave the rest out.")
    return parts.get("encoder", "hashed")


def _models(name: str, options: ModelOptions | None) -> Perception:
    parts = _parts(name, needed=("encoder", "detector"))
    encoder = make_image_encoder(parts["encoder"], options=options)
    detector = make_detector(parts["detector"], options=options)
    segmenter: Segmenter = DepthRegion()
    if "segmenter" in parts:
        segmenter = build_plugin(parts["segmenter"], option="segmenter", methods=("mask",))
    scorer: ImageTextScorer = EncoderScorer(encoder)
    names = [encoder_called(parts["encoder"]), own_name(detector, parts["detector"]), own_name(segmenter, "own")]
    if "scorer" in parts:
        scorer = build_plugin(parts["scorer"], option="scorer", methods=("score",))
        names.append(own_name(scorer, parts["scorer"]))
    return Perception(
        name=" + ".join(names),
        frame_of=frame_of_observation,
        scorer=scorer,
        encoder=encoder,
        detector=detector,
        segmenter=segmenter,
    )


def _parts(name: str, *, needed: tuple[str, ...]) -> dict[str, str]:
    """The values of `part=value,part=value`, after the level in an oracle's name.

    Raises:
        AgentError: A part is unknown, stands twice, or a needed one is missing.
    """
    text = name.partition(",")[2] if is_oracle(name) else name
    pairs = [item.strip().partition("=") for item in text.split(",") if item.strip()]
    parts = {key: value for key, _, value in pairs}
    if set(parts) <= set(_PARTS) and len(parts) == len(pairs) and all(parts.values()) and set(needed) <= set(parts):
        return parts
    wrong = next((part for part in parts if part not in _PARTS), "")
    meant = did_you_mean(wrong, _PARTS if "=" in text else ("oracle", "oracle:mild", "oracle:strong"))
    raise AgentError(
        f"--perception is {name!r}; expected oracle, oracle:mild, oracle:strong, your own as package.module:factory, "
        "or encoder=NAME,detector=NAME, with segmenter= and scorer=package.module:factory if you have them."
        f"{meant} Example: encoder=clip:openai/clip-vit-large-patch14,"
        "detector=owlv2:google/owlv2-base-patch16-ensemble."
    )


def _require_detector(name: str, family: str) -> None:
    is_known = bool(name.partition(":")[2]) if family in DETECTOR_FAMILIES else is_plugin(name)
    if not is_known:
        families = ", ".join(f"{known}:" for known in DETECTOR_FAMILIES)
        raise AgentError(
            f"detector {name!r}: is not known; expected {families} and a model id, folder or file, or your own as "
            f"package.module:factory.{did_you_mean(family, DETECTOR_FAMILIES)} Example: "
            "owlv2:google/owlv2-base-patch16-ensemble."
        )

"""The encoders known by name."""

import re
from functools import lru_cache
from typing import Any

from sim.errors import AgentError
from sim.plugins import build_plugin, is_plugin, own_name, require_methods

from .protocol import (
    MODEL_FAMILIES,
    ORACLE_SUFFIX,
    PLUGIN,
    SPACES,
    TEXT_ENCODERS,
    CachedTextEncoder,
    DenseEncoder,
    EncoderName,
    ModelOptions,
    TextEncoder,
)

_MAX_SLUG = 40


def make_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> TextEncoder:
    """The text encoder of this name, with a cache by text.

    Args:
        name: A name as described at `EncoderName`.
        options: Options of a real model; `hashed` and `minilm` have none.

    Raises:
        AgentError: The name is unknown, or the model cannot be loaded.
        MissingDependencyError: The encoder's extra is not installed.
    """
    space, source = parse_encoder_name(name)
    if name.endswith(ORACLE_SUFFIX):
        from ..perception.oracle_perception import OraclePerception

        return OraclePerception(make_encoder(name.removesuffix(ORACLE_SUFFIX), options=options), {})
    if space == "hashed":
        from .hashed import HashedWords

        return CachedTextEncoder(HashedWords())
    if space == "minilm":
        from .minilm import stored_minilm  # torch, transformers

        return CachedTextEncoder(stored_minilm())
    if space == PLUGIN:
        return CachedTextEncoder(_plugin(source))
    return CachedTextEncoder(_model(space, source, options or ModelOptions()))


def make_image_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> DenseEncoder:
    """The real model of this name, or a user's own, for building maps from pictures.

    Raises:
        AgentError: The encoder does not see, or cannot be loaded.
        MissingDependencyError: Extra `models` is not installed.
    """
    space, source = parse_encoder_name(name)
    if space in TEXT_ENCODERS or name.endswith(ORACLE_SUFFIX):
        raise AgentError(
            f"encoder {name!r}: cannot see; expected {_families()}. Name a model, or use "
            "grounding.perception.oracle_perception.OraclePerception, which needs the home's captions."
        )
    if space == PLUGIN:
        return require_methods(_plugin(source), ("encode_images",), where=name, need="a map of pictures")
    return _model(space, source, options or ModelOptions())


def parse_encoder_name(name: EncoderName) -> tuple[str, str]:
    """The text encoder, family or `PLUGIN`, and the model id, folder or plug-in ("" for text encoders); loads nothing.

    Raises:
        AgentError: The name is unknown.
    """
    plain = plain_name(name).removesuffix(ORACLE_SUFFIX)
    space, colon, source = plain.partition(":")
    if space not in (*MODEL_FAMILIES, *TEXT_ENCODERS) and is_plugin(plain):
        return PLUGIN, plain
    if (space in TEXT_ENCODERS and not colon) or (space in MODEL_FAMILIES and source):
        return space, source
    raise AgentError(
        f"encoder {name!r}: is not known; expected {', '.join(TEXT_ENCODERS)}, or {_families()}, or your own as "
        "package.module:factory. "
        "Example: clip:openai/clip-vit-large-patch14."
    )


def is_model(name: EncoderName) -> bool:
    """Whether the name is that of a real model, which encodes pictures and takes `ModelOptions`.

    Raises:
        AgentError: No encoder has this name.
    """
    return parse_encoder_name(name)[0] in MODEL_FAMILIES and not name.endswith(ORACLE_SUFFIX)


def sees(name: EncoderName) -> bool:
    """Whether an encoder also encodes pictures: real models do, a user's own does if it has `encode_images`.

    Raises:
        AgentError: No encoder has this name, or the plug-in cannot be built.
    """
    space, source = parse_encoder_name(name)
    if space == PLUGIN and not name.endswith(ORACLE_SUFFIX):
        return hasattr(_plugin(source), "encode_images")
    return is_model(name)


def plain_name(name: EncoderName) -> EncoderName:
    """The name as an option gives it: `hashed` or `minilm` in place of a space's name from a map file."""
    suffix = ORACLE_SUFFIX if name.endswith(ORACLE_SUFFIX) else ""
    plain = name.removesuffix(ORACLE_SUFFIX)
    return SPACES.get(plain, plain) + suffix


def encoder_called(name: EncoderName) -> str:
    """The encoder's name in runs and tables: that of the option, or the `name` of a user's own encoder.

    Raises:
        AgentError: No encoder has this name, or the plug-in cannot be built.
    """
    space, source = parse_encoder_name(name)
    suffix = ORACLE_SUFFIX if name.endswith(ORACLE_SUFFIX) else ""
    if space == PLUGIN:
        return own_name(_plugin(source), source) + suffix
    return f"{space}:{source}{suffix}" if source else space + suffix


def require_no_model_options(where: str, options: ModelOptions) -> None:
    """Refuses model options for an encoder without a model, which would ignore them.

    Args:
        where: The option that names the encoder, with its value.
        options: All must be the defaults.

    Raises:
        AgentError: An option is not the default.
    """
    for option, name in (("--device", "device"), ("--autocast", "autocast"), ("--batch", "batch_size")):
        value = getattr(options, name)
        if value != getattr(ModelOptions(), name):
            raise AgentError(
                f"{option} is {value!r} with {where}, which runs no model of ours; expected {_families()}. Leave it "
                "out, or name a model."
            )


def encoder_slug(name: EncoderName) -> str:
    """The name in a form for file and run names: `clip-clip-vit-large-patch14`.

    Raises:
        AgentError: No encoder has this name.
    """
    space, source = parse_encoder_name(name)
    suffix = ORACLE_SUFFIX.replace("+", "-") if name.endswith(ORACLE_SUFFIX) else ""
    if space == PLUGIN:
        return re.sub(r"[^A-Za-z0-9_.-]", "-", own_name(_plugin(source), source))[:_MAX_SLUG] + suffix
    last = re.sub(r"[^A-Za-z0-9_.-]", "-", source.rstrip("/").rsplit("/", 1)[-1])
    return f"{space}{'-' if last else ''}{last[:_MAX_SLUG]}{suffix}"


def _families() -> str:
    return f"one of {', '.join(f'{family}:' for family in MODEL_FAMILIES)} and a model id or a folder"


@lru_cache(maxsize=1)
def _plugin(name: str) -> Any:
    """The user's encoder; the last one is kept, as in `_model`."""
    return build_plugin(name, option="--encoder", methods=("encode_texts",))


@lru_cache(maxsize=1)
def _model(family: str, source: str, options: ModelOptions) -> DenseEncoder:
    """The model; the last one is kept, because a process uses it for queries, pictures and its next scenes."""
    match family:  # torch, transformers
        case "clip":
            from .clip import Clip

            return Clip(source, options=options)
        case "siglip":
            from .siglip import Siglip

            return Siglip(source, options=options)
        case _:
            from .blip2 import Blip2

            return Blip2(source, space="itc256" if family == "blip2-itc256" else "hidden768", options=options)

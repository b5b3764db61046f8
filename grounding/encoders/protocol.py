"""The protocols of encoders and the options of real models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

EncoderName = str
"""`hashed`, `minilm`, `clip:`, `siglip:`, `blip2-itc256:`, `blip2-hidden768:` and a model id or a folder, or a user's
own as `package.module:factory`. With the suffix `+oracle-perception` it encodes the queries to maps that oracle
perception made in that space. Names of map files, such as `hashed-words-768`, stand for `hashed` and `minilm` too."""
TEXT_ENCODERS = ("hashed", "minilm")
SPACES = {"hashed-words-768": "hashed", "minilm-l6-v2-384": "minilm"}
"""Names of vector spaces, as map files carry them, and the encoders that make them."""
PLUGIN = "plug-in"
"""The name that `parse_encoder_name` returns for a user's own encoder."""
MODEL_FAMILIES = ("clip", "siglip", "blip2-itc256", "blip2-hidden768")
ORACLE_SUFFIX = "+oracle-perception"


class TextEncoder(Protocol):
    """Texts to unit vectors. `grounding.checks.check_encoder` tests a plug-in."""

    @property
    def name(self) -> str:
        """Names the vector space: maps and queries match only when their encoders' names are equal."""
        ...

    @property
    def dim(self) -> int:
        """E, the length of a vector."""
        ...

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows, one per text, independent of the other texts; a zero row for a text without content."""
        ...


class TextImageEncoder(TextEncoder, Protocol):
    """Whole pictures and texts to unit vectors of one space. `grounding.checks.check_image_encoder` tests a plug-in."""

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows, one per picture; zero for a picture without content. Real models read `rgb` only."""
        ...


class DenseEncoder(TextImageEncoder, Protocol):
    """Also gives a vector for each patch of a picture."""

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of patches that tile each picture evenly; zero for a patch without content."""
        ...


Device = Literal["cpu", "cuda"]
Autocast = Literal["off", "bfloat16", "float16"]


@dataclass(frozen=True, slots=True)
class ModelOptions:
    """Options of a real model. Only `autocast` changes the vectors, by about 1e-2."""

    device: Device = "cpu"
    batch_size: int = 8
    """Number of texts or pictures per batch."""
    autocast: Autocast = "off"
    """Arithmetic of the large products; float16 on cuda only."""
    download: bool = True
    """Whether a model id may be fetched; False = the local cache only."""

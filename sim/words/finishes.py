"""Materials and patterns of surfaces, as captions and plans name them."""

from typing import Annotated, Literal

from pydantic import Field

Byte = Annotated[int, Field(ge=0, le=255)]
Rgb = tuple[Byte, Byte, Byte]
Material = Literal[
    "wood", "fabric", "leather", "metal", "ceramic", "stone", "glass", "plastic", "paper", "leaf", "wicker", "plaster",
    "tile", "carpet", "picture",
]  # fmt: skip
Pattern = Literal["plain", "striped", "plaid", "floral", "dotted", "checked", "patterned"]

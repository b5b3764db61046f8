"""The JSON part of glTF 2.0, limited to the fields for unlit pictures and navigation. Read by gltf_file.py."""

from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, FailFast, Field
from pydantic.alias_generators import to_camel
from pydantic_core import PydanticCustomError

_MAX_ATTRIBUTES = 1024
_Item = TypeVar("_Item")


def _whole(value: object) -> object:
    """4.0 as 4, since JSON Schema counts it as an integer; other values unchanged."""
    return int(value) if type(value) is float and value.is_integer() else value


def _few(value: object) -> object:
    """Refuses objects with very many keys, because their values have no `FailFast`."""
    if isinstance(value, dict) and len(value) > _MAX_ATTRIBUTES:
        raise PydanticCustomError("too_many", "At most {most} attributes", {"most": _MAX_ATTRIBUTES})
    return value


_Whole = BeforeValidator(_whole)
Int = Annotated[int, _Whole]
Index = Annotated[int, Field(ge=0, le=2**31), _Whole]
Length = Annotated[int, Field(ge=0, le=2**48), _Whole]
Items = Annotated[list[_Item], FailFast()]
"""The first wrong item ends the reading: an error for each of a million takes seconds and gigabytes."""
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
REPEAT, CLAMP_TO_EDGE, MIRRORED_REPEAT = 10497, 33071, 33648


class Json(BaseModel):
    """An object of the file; other keys than the fields are not read."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False, alias_generator=to_camel)


class Buffer(Json):
    byte_length: Length
    uri: str | None = None


class BufferView(Json):
    buffer: Index
    byte_length: Length
    byte_offset: Length = 0
    byte_stride: Length | None = None


class SparseIndices(Json):
    buffer_view: Index
    component_type: Int
    byte_offset: Length = 0


class SparseValues(Json):
    buffer_view: Index
    byte_offset: Length = 0


class Sparse(Json):
    count: Length
    indices: SparseIndices
    values: SparseValues


class Accessor(Json):
    component_type: Int
    count: Length
    type: str
    buffer_view: Index | None = None
    byte_offset: Length = 0
    normalized: bool = False
    sparse: Sparse | None = None


class Image(Json):
    uri: str | None = None
    buffer_view: Index | None = None


class Sampler(Json):
    wrap_s: Int = REPEAT
    wrap_t: Int = REPEAT


class TextureSource(Json):
    source: Index


class TextureExtensions(Json):
    google: TextureSource | None = Field(default=None, alias="GOOGLE_texture_basis")
    khronos: TextureSource | None = Field(default=None, alias="KHR_texture_basisu")
    webp: TextureSource | None = Field(default=None, alias="EXT_texture_webp")


class Texture(Json):
    source: Index | None = None
    sampler: Index | None = None
    extensions: TextureExtensions = TextureExtensions()


class Transform(Json):
    """KHR_texture_transform."""

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    tex_coord: Index | None = None


class TextureInfoExtensions(Json):
    transform: Transform | None = Field(default=None, alias="KHR_texture_transform")


class TextureInfo(Json):
    index: Index
    tex_coord: Index = 0
    extensions: TextureInfoExtensions = TextureInfoExtensions()


class Pbr(Json):
    base_color_factor: Four | None = None
    base_color_texture: TextureInfo | None = None


class Glossiness(Json):
    """KHR_materials_pbrSpecularGlossiness, used by older exports instead of the base colour."""

    diffuse_factor: Four | None = None
    diffuse_texture: TextureInfo | None = None


class MaterialExtensions(Json):
    glossiness: Glossiness | None = Field(default=None, alias="KHR_materials_pbrSpecularGlossiness")


class Material(Json):
    pbr_metallic_roughness: Pbr | None = None
    extensions: MaterialExtensions = MaterialExtensions()


class DracoPart(Json):
    buffer_view: Index
    attributes: Annotated[dict[str, Index], BeforeValidator(_few)]
    """Draco's unique id of each attribute."""


class PrimitiveExtensions(Json):
    draco: DracoPart | None = Field(default=None, alias="KHR_draco_mesh_compression")


class Primitive(Json):
    attributes: Annotated[dict[str, Index], BeforeValidator(_few)]
    extensions: PrimitiveExtensions = PrimitiveExtensions()
    indices: Index | None = None
    material: Index | None = None
    mode: Annotated[Literal[0, 1, 2, 3, 4, 5, 6], _Whole] = 4


class Mesh(Json):
    primitives: Items[Primitive]


class Node(Json):
    mesh: Index | None = None
    children: Items[Index] = []
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: Three = (0.0, 0.0, 0.0)
    rotation: Four = (0.0, 0.0, 0.0, 1.0)
    scale: Three = (1.0, 1.0, 1.0)


class SceneNodes(Json):
    nodes: Items[Index] = []


class Asset(Json):
    version: Annotated[str, Field(pattern=r"^2\.")]


class Document(Json):
    """The whole JSON part."""

    asset: Asset = Asset(version="2.0")
    extensions_used: Items[str] = []
    extensions_required: Items[str] = []
    buffers: Annotated[Items[Buffer], Field(max_length=4096)] = []
    buffer_views: Items[BufferView] = []
    accessors: Items[Accessor] = []
    images: Items[Image] = []
    samplers: Items[Sampler] = []
    textures: Items[Texture] = []
    materials: Items[Material] = []
    meshes: Items[Mesh] = []
    nodes: Items[Node] = []
    scenes: Items[SceneNodes] = []
    scene: Index | None = None

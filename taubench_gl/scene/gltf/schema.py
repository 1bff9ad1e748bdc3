"""The JSON of glTF 2.0 as typed structs: types, ranges and required properties are checked while decoding.

Names are those of the specification in snake case.  Unknown properties are ignored, as the specification requires.
``extras`` are ignored except for the values that this package writes into ``asset.extras``.  References between objects
are checked where they are used.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from msgspec import Meta, Struct

T = TypeVar("T")
Index = Annotated[int, Meta(ge=0)]
Count = Annotated[int, Meta(ge=1)]
Filled = Annotated[list[T], Meta(min_length=1)]  # glTF forbids empty arrays
Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Unit = Annotated[float, Meta(ge=0, le=1)]
Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Vec4 = tuple[float, float, float, float]
Matrix = Annotated[list[float], Meta(min_length=16, max_length=16)]
Extensions = dict[str, dict[str, Any]]


class Property(Struct, rename="camel", kw_only=True):
    """Properties of every glTF object."""

    name: str = ""
    extensions: Extensions = {}


class Asset(Struct, rename="camel"):
    version: str
    min_version: str | None = None
    generator: str = ""
    copyright: str = ""
    extras: Any = None  # {"taubench_gl": {"name", "stand_in", "camera", "exposure" ...}} in files of this package


class Buffer(Property):
    byte_length: Index  # at least 1, checked where the bytes are read
    uri: str | None = None


class BufferView(Property):
    buffer: Index
    byte_length: Index  # at least 1
    byte_offset: Index = 0
    byte_stride: Count | None = None  # a multiple of 4, 4 to 252
    target: int | None = None


ComponentType = Literal[5120, 5121, 5122, 5123, 5125, 5126]


class SparseIndices(Property):
    buffer_view: Index
    component_type: Literal[5121, 5123, 5125]
    byte_offset: Index = 0


class SparseValues(Property):
    buffer_view: Index
    byte_offset: Index = 0


class Sparse(Property):
    count: Count
    indices: SparseIndices
    values: SparseValues


class Accessor(Property):
    component_type: ComponentType
    count: Index  # at least 1
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    buffer_view: Index | None = None
    byte_offset: Index = 0
    normalized: bool = False
    max: list[float] | None = None
    min: list[float] | None = None
    sparse: Sparse | None = None


class Primitive(Property):
    attributes: dict[str, Index]  # at least one
    indices: Index | None = None
    material: Index | None = None
    mode: Literal[0, 1, 2, 3, 4, 5, 6] = 4
    targets: Filled[dict[str, Index]] | None = None


class Mesh(Property):
    primitives: list[Primitive]  # at least one
    weights: Filled[float] | None = None


class TextureInfo(Property):
    index: Index
    tex_coord: Index = 0
    scale: float = 1.0  # normalTexture only
    strength: Unit = 1.0  # occlusionTexture only


class MetallicRoughness(Property):
    base_color_factor: tuple[Unit, Unit, Unit, Unit] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: TextureInfo | None = None
    metallic_factor: Unit = 1.0
    roughness_factor: Unit = 1.0
    metallic_roughness_texture: TextureInfo | None = None


class Material(Property):
    pbr_metallic_roughness: MetallicRoughness | None = None
    normal_texture: TextureInfo | None = None
    occlusion_texture: TextureInfo | None = None
    emissive_texture: TextureInfo | None = None
    emissive_factor: tuple[Unit, Unit, Unit] = (0.0, 0.0, 0.0)
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: NonNegative = 0.5
    double_sided: bool = False


class Image(Property):
    uri: str | None = None
    mime_type: str | None = None
    buffer_view: Index | None = None


class TextureSampler(Property):
    mag_filter: Literal[9728, 9729] | None = None
    min_filter: Literal[9728, 9729, 9984, 9985, 9986, 9987] | None = None
    wrap_s: Literal[33071, 33648, 10497] = 10497
    wrap_t: Literal[33071, 33648, 10497] = 10497


class Texture(Property):
    sampler: Index | None = None
    source: Index | None = None


class Perspective(Property):
    yfov: Positive
    znear: Positive
    aspect_ratio: Positive | None = None
    zfar: Positive | None = None


class Orthographic(Property):
    xmag: float
    ymag: float
    zfar: Positive
    znear: NonNegative


class Camera(Property):
    type: Literal["perspective", "orthographic"]
    perspective: Perspective | None = None
    orthographic: Orthographic | None = None


class Node(Property):
    camera: Index | None = None
    children: Filled[Index] | None = None
    skin: Index | None = None
    matrix: Matrix | None = None
    mesh: Index | None = None
    rotation: Vec4 | None = None
    scale: Vec3 | None = None
    translation: Vec3 | None = None
    weights: Filled[float] | None = None


class Scene(Property):
    nodes: Filled[Index] | None = None


class Skin(Property):
    joints: list[Index]  # at least one
    inverse_bind_matrices: Index | None = None
    skeleton: Index | None = None


class ChannelTarget(Property):
    path: str
    node: Index | None = None


class Channel(Property):
    sampler: Index
    target: ChannelTarget


class AnimationSampler(Property):
    input: Index
    output: Index
    interpolation: str | int = "LINEAR"  # int: a known exporter bug, accepted with a note


class Animation(Property):
    channels: list[Channel]  # at least one
    samplers: list[AnimationSampler]  # at least one


class Root(Property):
    """The top level of a glTF document."""

    asset: Asset
    accessors: Filled[Accessor] | None = None
    animations: Filled[Animation] | None = None
    buffers: Filled[Buffer] | None = None
    buffer_views: Filled[BufferView] | None = None
    cameras: Filled[Camera] | None = None
    images: Filled[Image] | None = None
    materials: Filled[Material] | None = None
    meshes: Filled[Mesh] | None = None
    nodes: Filled[Node] | None = None
    samplers: Filled[TextureSampler] | None = None
    scenes: Filled[Scene] | None = None
    skins: Filled[Skin] | None = None
    textures: Filled[Texture] | None = None
    scene: Index | None = None
    extensions_used: Filled[str] | None = None
    extensions_required: Filled[str] | None = None


# Extensions, decoded on use (Document.extension).


class LightReference(Struct):
    light: Index


class Visibility(Struct):
    visible: bool = True


class Instancing(Struct):
    attributes: dict[str, Index]


class Spot(Struct, rename="camel"):
    inner_cone_angle: NonNegative = 0.0
    outer_cone_angle: NonNegative = 0.7853981633974483


class PunctualLight(Struct):
    type: Literal["directional", "point", "spot"]
    name: str = ""
    color: tuple[NonNegative, NonNegative, NonNegative] = (1.0, 1.0, 1.0)
    intensity: NonNegative = 1.0
    range: Positive | None = None
    spot: Spot | None = None


class PunctualLights(Struct):
    lights: Filled[PunctualLight]


class TextureTransform(Struct, rename="camel"):
    offset: Vec2 = (0.0, 0.0)
    rotation: float = 0.0
    scale: Vec2 = (1.0, 1.0)
    tex_coord: Index | None = None


class EmissiveStrength(Struct, rename="camel"):
    emissive_strength: NonNegative = 1.0


class Specular(Struct, rename="camel"):
    specular_factor: Unit = 1.0
    specular_texture: TextureInfo | None = None
    specular_color_factor: tuple[NonNegative, NonNegative, NonNegative] = (1.0, 1.0, 1.0)
    specular_color_texture: TextureInfo | None = None


class Ior(Struct):
    ior: NonNegative = 1.5


class Transmission(Struct, rename="camel"):
    transmission_factor: Unit = 0.0
    transmission_texture: TextureInfo | None = None


class Volume(Struct, rename="camel"):
    thickness_factor: NonNegative = 0.0
    attenuation_distance: Positive | None = None
    attenuation_color: tuple[Unit, Unit, Unit] = (1.0, 1.0, 1.0)


class PbrSpecularGlossiness(Struct, rename="camel"):
    diffuse_factor: tuple[Unit, Unit, Unit, Unit] = (1.0, 1.0, 1.0, 1.0)
    diffuse_texture: TextureInfo | None = None
    specular_factor: tuple[Unit, Unit, Unit] = (1.0, 1.0, 1.0)
    glossiness_factor: Unit = 1.0
    specular_glossiness_texture: TextureInfo | None = None


class TextureSource(Struct):
    source: Index


class AnimationPointer(Struct):
    pointer: str


class Draco(Struct, rename="camel"):
    buffer_view: Index
    attributes: dict[str, Index]


class Meshopt(Struct, rename="camel"):
    buffer: Index
    byte_length: Count
    byte_stride: Annotated[int, Meta(ge=1, le=256)]
    count: Count
    mode: Literal["ATTRIBUTES", "TRIANGLES", "INDICES"]
    byte_offset: Index = 0
    filter: str = "NONE"

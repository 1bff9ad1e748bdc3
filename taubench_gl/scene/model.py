"""The immutable Scene that every reader produces and all other packages use.  No GL, no files.

Arrays are read-only views where the file allows it.  Units are glTF's: meters, radians, seconds, candela and lux.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from taubench_gl.errors import printable

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Note:
    """A decision of the reader, something it ignores or repairs.  ``where``: JSON pointer, file:line, or ''.

    ``kind`` and ``count``: for a counted note, a name of ``scene.notes`` and the number of findings; ``where`` is then
    the first of them.  ``materials``: those that look different because of it.
    """

    message: str
    where: str = ""
    kind: str = ""
    count: int = 0
    materials: frozenset[int] = frozenset()

    def __str__(self) -> str:
        first = "first: " if self.count > 1 else ""
        return printable(f"{self.message} [{first}{self.where}]" if self.where else self.message)


@dataclass(frozen=True, slots=True)
class Sampler:
    """Texture sampler with GL enumerants.  Defaults are glTF's."""

    mag_filter: int = 9729  # LINEAR
    min_filter: int = 9987  # LINEAR_MIPMAP_LINEAR
    wrap_s: int = 10497  # REPEAT
    wrap_t: int = 10497


@dataclass(frozen=True, slots=True)
class Image:
    """An image of the file, decoded on demand."""

    name: str
    size: tuple[int, int]  # width, height, from the header; limited when the scene is read
    decode: Callable[[], Array]  # -> (h, w, 4) uint8, row 0 = top; raises SceneError


@dataclass(frozen=True, slots=True)
class Texture:
    """Sampling of an image: texture-coordinate set and transform, uv' = uv_transform @ (u, v, 1)."""

    image: int
    sampler: Sampler = Sampler()
    texcoord: int = 0
    uv_transform: Array = field(default_factory=lambda: np.eye(2, 3))  # (2, 3) float64


@dataclass(frozen=True, slots=True)
class Material:
    """glTF metallic-roughness, linear colors; ``emissive``: radiance (factor x KHR_materials_emissive_strength)."""

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: Texture | None = None
    metallic: float = 1.0
    roughness: float = 1.0
    metallic_roughness_texture: Texture | None = None
    normal_texture: Texture | None = None
    normal_scale: float = 1.0
    occlusion_texture: Texture | None = None
    occlusion_strength: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emissive_strength: float = 1.0  # KHR_materials_emissive_strength, part of ``emissive``
    emissive_texture: Texture | None = None
    alpha_mode: str = "OPAQUE"  # OPAQUE | MASK | BLEND
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    specular: float = 1.0  # KHR_materials_specular: scales the dielectric lobe, 0 = Lambert
    # Path-traced light alone has what follows.
    specular_texture: Texture | None = None  # alpha scales ``specular``
    specular_color: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of that lobe at normal incidence; may be above 1
    specular_color_texture: Texture | None = None
    ior: float = 1.5  # index of refraction; 0: infinite, a dielectric lobe that reflects all light
    transmission: float = 0.0  # share of the light under the dielectric lobe that goes through the surface
    transmission_texture: Texture | None = None  # red scales ``transmission``
    thick: bool = False  # the surface bounds a volume (KHR_materials_volume, thickness above 0); else it is thin
    attenuation_color: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of white light after the attenuation distance
    attenuation_distance: float = np.inf  # meters in the volume
    unlit: bool = False
    # BLEND: present with a probability of alpha (``--blend stochastic``) instead of where alpha is at least 0.5
    stochastic: bool = False


@dataclass(frozen=True, slots=True)
class MorphTarget:
    """Displacements of one morph target; ``None`` where the target does not change the attribute."""

    positions: Array | None = None  # (V, 3) float32
    normals: Array | None = None  # (V, 3) float32
    tangents: Array | None = None  # (V, 3) float32


@dataclass(frozen=True, slots=True)
class Primitive:
    """Triangles of one material.  Readers convert strips and fans to lists and remove points and lines."""

    positions: Array  # (V, 3) float32, finite
    triangles: Array  # (T, 3) uint32, < V
    material: int = -1  # -1: glTF's default material
    normals: Array | None = None  # (V, 3) float32; None: flat, one normal per triangle
    tangents: Array | None = None  # (V, 4) float32, w = handedness
    texcoords: tuple[Array | None, Array | None] = (None, None)  # (V, 2) float32 each
    colors: Array | None = None  # (V, 4) float32, linear
    joints: Array | None = None  # (V, 4 k) uint32 into the skin's joints
    weights: Array | None = None  # (V, 4 k) float32, rows sum to 1
    targets: tuple[MorphTarget, ...] = ()


@dataclass(frozen=True, slots=True)
class Mesh:
    name: str
    primitives: tuple[Primitive, ...]
    weights: Array = field(default_factory=lambda: np.zeros(0))  # (M,) float64 default morph weights


@dataclass(frozen=True, slots=True)
class Skin:
    name: str
    joints: Array  # (J,) int32 node indices
    inverse_bind: Array  # (J, 4, 4) float64: joint_from_mesh


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics.  ``yfov`` radians; ``xmag``, ``ymag`` half-extents, meters; ``zfar`` can be inf (perspective)."""

    name: str = ""
    kind: str = "perspective"  # perspective | orthographic
    yfov: float = np.pi / 4
    aspect: float | None = None  # of the file; the viewport's aspect has precedence, as in glTF viewers
    xmag: float = 1.0
    ymag: float = 1.0
    znear: float = 0.1
    zfar: float = np.inf

    @property
    def parallel(self) -> bool:
        return self.kind == "orthographic"


@dataclass(frozen=True, slots=True)
class Light:
    """KHR_lights_punctual: candela for point and spot, lux for directional; linear RGB; angles in radians."""

    name: str = ""
    kind: str = "point"  # point | spot | directional
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    range: float = np.inf
    inner_cone: float = 0.0
    outer_cone: float = np.pi / 4
    constant: bool = False  # AFF: no attenuation with distance; ``intensity`` is lux on a facing surface


@dataclass(frozen=True, slots=True)
class Channel:
    """One animated property.

    ``target`` is ``node``, ``camera`` or ``light``; ``index`` is its index in the scene.  ``path``:
    node: translation rotation scale weights visible; camera: yfov znear zfar xmag ymag; light: color intensity range
    inner_cone outer_cone.  ``values`` is (K, n) float64, for CUBICSPLINE (K, 3, n): in-tangent, value, out-tangent.
    """

    target: str
    index: int
    path: str
    interpolation: str  # STEP | LINEAR | CUBICSPLINE
    times: Array  # (K,) float64 seconds, in order, K >= 1; two keys at one time are a jump
    values: Array
    resampled: Array | None = None  # (K,) bool: keys that the reader added between those of the file; None: none


@dataclass(frozen=True, slots=True)
class Animation:
    name: str
    channels: tuple[Channel, ...]

    @property
    def duration(self) -> float:
        """Duration in seconds: the time of the latest key."""
        return max((float(c.times[-1]) for c in self.channels), default=0.0)


@dataclass(frozen=True, slots=True)
class Nodes:
    """All nodes as arrays of length N, in file order.  ``parent`` is -1 for roots; index -1 elsewhere means none."""

    names: tuple[str, ...]
    parent: Array  # (N,) int32
    translation: Array  # (N, 3) float64
    rotation: Array  # (N, 4) float64 xyzw
    scale: Array  # (N, 3) float64
    matrix: Array  # (N, 4, 4) float64, used where has_matrix
    has_matrix: Array  # (N,) bool
    mesh: Array  # (N,) int32
    skin: Array  # (N,) int32
    camera: Array  # (N,) int32
    light: Array  # (N,) int32
    visible: Array  # (N,) bool, own KHR_node_visibility (not inherited)
    in_scene: Array  # (N,) bool, reachable from the chosen scene
    weights: Mapping[int, Array] = field(default_factory=dict)  # node's own morph weights
    # EXT_mesh_gpu_instancing: node -> (K, 4, 4) node_from_instance
    instances: Mapping[int, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.names)

    def levels(self) -> list[Array]:
        """Node indices by depth, parents before children, to compose world matrices level by level."""
        depth = np.zeros(len(self), dtype=np.int64)
        ancestor = self.parent.copy()
        while np.any(ancestor >= 0):
            depth += ancestor >= 0
            ancestor = np.where(ancestor >= 0, self.parent[np.maximum(ancestor, 0)], -1)
        return [np.flatnonzero(depth == d) for d in range(int(depth.max(initial=-1)) + 1)]


@dataclass(frozen=True, slots=True)
class Scene:
    """The content of one file, for one of its scenes and one selection of animations."""

    name: str
    nodes: Nodes
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    images: tuple[Image, ...] = ()
    skins: tuple[Skin, ...] = ()
    cameras: tuple[Camera, ...] = ()
    lights: tuple[Light, ...] = ()
    animations: tuple[Animation, ...] = ()  # all of the file
    channels: tuple[Channel, ...] = ()  # of all playing animations
    playing: tuple[str, ...] = ()  # names of the playing animations
    notes: tuple[Note, ...] = ()
    path: Path | None = None
    sha256: str | None = None  # of all source files (``scene.files.Identity``); None for a scene made in memory
    files: int = 0  # number of source files; 0 for a scene made in memory
    scene_names: tuple[str, ...] = ()
    generator: str = ""  # program that wrote the file, as it names itself (glTF asset.generator)
    image_based_light: bool = False  # the file names an image-based light, which is not simulated
    stand_in: str | None = None  # name of the scene that this one is a stand-in for
    default_camera: str | None = None  # name of the default camera of the file
    # of the file: the path of an image or a uniform radiance, linear RGB
    environment: str | tuple[float, float, float] | None = None
    exposure: float | None = None  # recorded in the file, for intensities as written
    # nodes that replace another surface when they become visible: their pixels have no history
    replacements: frozenset[int] = frozenset()

    @property
    def duration(self) -> float:
        """Duration in seconds: the time of the latest playing key; 0 for a still scene."""
        return max((float(c.times[-1]) for c in self.channels), default=0.0)

    @property
    def camera_nodes(self) -> Array:
        """Nodes of this scene with a camera, in file order.  (C,) int."""
        return np.flatnonzero(self.nodes.in_scene & (self.nodes.camera >= 0))

    @property
    def light_nodes(self) -> Array:
        """Nodes of this scene with a punctual light, in file order.  (L,) int."""
        return np.flatnonzero(self.nodes.in_scene & (self.nodes.light >= 0))

    @property
    def mesh_nodes(self) -> Array:
        """Nodes of this scene with a mesh, in file order.  (M,) int."""
        return np.flatnonzero(self.nodes.in_scene & (self.nodes.mesh >= 0))

    @property
    def joint_nodes(self) -> Array:
        """Nodes that are joints of a skin on a mesh node of this scene, ascending.  (J,) int64."""
        skins = np.unique(self.nodes.skin[self.mesh_nodes])
        return np.unique(np.concatenate([np.zeros(0, np.int64), *(self.skins[s].joints for s in skins if s >= 0)]))

    def primitives(self, node: int) -> list[Primitive]:
        """The primitives of mesh node ``node`` that have triangles."""
        return [p for p in self.meshes[self.nodes.mesh[node]].primitives if len(p.triangles)]

    def drawn(self) -> list[tuple[int, Primitive]]:
        """(node, primitive) of everything that has triangles, in node order; instances are not repeated."""
        return [(node, p) for node in self.mesh_nodes.tolist() for p in self.primitives(node)]

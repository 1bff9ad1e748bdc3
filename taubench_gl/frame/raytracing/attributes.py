"""What a ray finds at a hit: tables and textures on the GPU, and how a pass declares them.

The shaders are ``shaders/raytracing/surface.glsl``, ``alpha.glsl`` and ``emitters.glsl``; ``hit_tables`` has the layout
of the tables.  Only what the scene's materials need is stored and compiled.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.materials import texture_of
from taubench_gl.frame.raytracing import hit_tables
from taubench_gl.frame.raytracing.atlas import ATLAS_BYTES, atlas_pixels, plan_atlas
from taubench_gl.frame.raytracing.emitters import EMITTER, EmitterGroups, emitter_table
from taubench_gl.frame.raytracing.hit_tables import (
    COLOR_SLOTS,
    DIELECTRIC_SLOTS,
    DRAW_TEXELS,
    HIT_SLOTS,
    MATERIAL_TEXELS,
    ROW_BITS,
    SLOT_TEXELS,
    DrawnPool,
    HitOptions,
    build_tables,
    emitter_cell_count,
    hit_slots,
)  # fmt: skip
from taubench_gl.frame.raytracing.texels import write_texels
from taubench_gl.frame.spec import bound_times
from taubench_gl.gpu.declare import ComputePass, Resource
from taubench_gl.scene.model import Material, Scene

if TYPE_CHECKING:
    import moderngl

    from taubench_gl.frame.renderer import Renderer

Array = np.ndarray
ALL = HitOptions()
NO_EMITTERS = np.zeros(0, EMITTER)
_TABLES = "tables of ray hits"
_HINT = "trace fewer triangles, or choose the raster method of light"

_SLOTS = HIT_SLOTS + DIELECTRIC_SLOTS
_CONSTANTS = (
    f"const int HIT_ROW_BITS = {ROW_BITS}, HIT_ROW_MASK = {(1 << ROW_BITS) - 1};",
    f"const uint DRAW_TEXELS = {DRAW_TEXELS}u, MATERIAL_TEXELS = {MATERIAL_TEXELS}u, SLOT_TEXELS = {SLOT_TEXELS}u;",
    *(
        f"const uint DRAW_{n} = {getattr(hit_tables, n)}u;"
        for n in ("POSED", "MIRRORED", "VISIBLE", "ALPHA_TEST", "UV1", "COLORS")
    ),
    *(f"const uint WRAP_{n} = {getattr(hit_tables, n)}u;" for n in ("REPEAT", "CLAMP", "MIRROR")),
    *(f"const uint {n} = {getattr(hit_tables, n)}u;" for n in ("MAP_UV1", "MAP_TRANSFORMED", "MAP_NEAREST")),
    f"const uint MATERIAL_UNLIT = {hit_tables.UNLIT}u;",
    f"const uint MATERIAL_THICK = {hit_tables.THICK}u;",
    f"const uint MATERIAL_MAPS = {hit_tables.THICK - hit_tables.FIRST_MAP}u;",
    *(f"const uint SLOT_{s.upper()} = {i}u;" for i, s in enumerate(_SLOTS)),
    *(f"const uint MATERIAL_{s.upper()}_MAP = {hit_tables.FIRST_MAP << i}u;" for i, s in enumerate(_SLOTS)),
)


class _StoredHits:
    """What hits find in a scene on the GPU, wherever its draws are: all that look at hits of the scene share it."""

    def __init__(self, renderer: Renderer, draws: tuple[Draw, ...], options: HitOptions, atlas_bytes: int):
        self._renderer, self.scene = renderer, renderer.scene
        context, scene = renderer.context, renderer.scene
        images = _images(scene, draws, options)
        sizes = {image: scene.images[image].size for image in images}
        self.atlas = plan_atlas(sizes, context.gpu.ctx.info["GL_MAX_TEXTURE_SIZE"], atlas_bytes)
        states = [renderer.poser.sample(float(t)) for t in bound_times(scene)] if options.emission != "none" else []
        self.emitters = emitter_table(scene, draws, states, options, self._pixels) if states else NO_EMITTERS
        pools = {
            posed: DrawnPool(buffers, [d for d in draws if d.posed == posed])
            for posed, buffers in renderer.buffers.pools.items()
        }
        self.tables = build_tables(scene, draws, pools, self.atlas, options, self.emitters)
        static = self.tables.static
        wanted = [Resource.texture("hit_static", static.size, dtype="u4", what=_TABLES, hint=_HINT)]
        if self.atlas.places:
            what = "textures of ray hits"
            wanted.append(Resource.texture("hit_atlas", self.atlas.size, dtype="f1", what=what, hint=_HINT))
        self.textures: dict[str, moderngl.Texture] = {r.name: context.allocate(r) for r in wanted}
        static.write(self.textures["hit_static"])
        colors = [image for image, color in images.items() if color]
        for viewport, texels in atlas_pixels(self.atlas, self._pixels, colors):
            self.textures["hit_atlas"].write(np.ascontiguousarray(texels), viewport=viewport)
        del self._renderer

    def _pixels(self, image: int) -> Array:
        pixels = self._renderer.materials.pixels(image)
        return self._renderer.scene.images[image].decode() if pixels is None else pixels

    def release(self) -> None:
        for texture in self.textures.values():
            texture.release()


class HitAttributes:
    """Tables, atlas and emitters of one scene, for every pass that looks at hits.

    Hits name draws by their rows in ``Renderer.draws``.
    """

    def __init__(self, renderer: Renderer, options: HitOptions = ALL, *, atlas_bytes: int = ATLAS_BYTES):
        """``atlas_bytes``: memory of all textures; the largest are halved until they fit.

        Raises GraphicsError where the device has no room for the scene.
        """
        self._renderer, self.options, scene = renderer, options, renderer.scene
        looked_at = options.surfaces or options.emission != "none" or options.alpha_test
        self._draws = draws = renderer.draws if looked_at else ()
        self._stored = renderer.context.gpu.shared.hold(
            scene.nodes,
            ("hits", id(scene.meshes), id(scene.materials), id(scene.channels), options, atlas_bytes),
            lambda: _StoredHits(renderer, draws, options, atlas_bytes),
        )
        stored = self._stored.value
        self.atlas = stored.atlas
        self.emitters = stored.emitters
        """Rows of the emitter table, ``emitters.EMITTER``."""
        self.groups = EmitterGroups(self.emitters, draws)
        placed = replace(stored.tables.draws)  # of which each has its own rows
        placed.rows = stored.tables.draws.rows.copy()
        self._tables = replace(stored.tables, draws=placed)
        resource = Resource.texture("hit_draws", placed.size, dtype="u4", what=_TABLES, hint=_HINT)
        self._placed = renderer.context.allocate(resource)
        write_texels(self._placed, 0, placed.texels)
        self._textures = stored.textures | {"hit_draws": self._placed}

    def declare(self, p: ComputePass) -> ComputePass:
        """Add to ``p`` what ``raytracing/surface.glsl``, ``alpha.glsl`` and ``emitters.glsl`` need."""
        t, posed = self._tables, any(d.posed for d in self._draws)
        software = self._renderer.context.gpu.software
        p.define(
            HIT_TEXTURES=bool(self.atlas.places), HIT_UV1=t.second_uv, HIT_UV_TRANSFORMS=t.transformed,
            HIT_COLORS=t.colors, HIT_ALPHA=t.alpha_test, HIT_POSED=posed, HIT_NORMAL_MAPS=t.slots["normal"],
            HIT_METALLIC_ROUGHNESS_MAPS=t.slots["metallic_roughness"], HIT_EMISSIVE_MAPS=t.slots["emissive"],
            HIT_EMISSION=t.emission, HIT_DIELECTRICS=self.options.dielectrics,
            **{f"HIT_{s.upper()}_MAPS": t.slots.get(s, False) for s in DIELECTRIC_SLOTS},
        )  # fmt: skip
        p.glsl(
            *_CONSTANTS,
            f"const uint HIT_MATERIAL_TEXELS = {self.options.material_texels}u;",
            f"const int EMITTERS_AT = {t.places['emitters']}, EMITTER_CELLS_AT = {t.places['cells']};",
            f"const int EMITTER_COUNT = {t.emitters}, EMITTER_CELLS = {emitter_cell_count(t.emitters)};",
            f"const int EMITTER_GROUP = {self.groups.size};",
        )
        for name in ("hit_static", "hit_draws"):
            # llvmpipe reads an image for half the price of a texture; GPUs have few units for images.
            if software:
                p.image(name, "rgba32ui", filled=True)
            else:
                p.texture(name, "usampler2D", filled=True)
        if self.atlas.places:
            p.texture("hit_atlas", filled=True)
        for name in self._posed_buffers:
            p.buffer(name, "float", filled=True)
        return p

    @property
    def _posed_buffers(self) -> dict[str, moderngl.Buffer]:
        """Vertices that the deform pass writes."""
        if not any(d.posed for d in self._draws):
            return {}
        pool, names = self._renderer.buffers.pools[True], ("positions", "normals")
        names += ("tangents",) if self._tables.slots["normal"] else ()
        return {f"posed_{name}": pool[name] for name in names}

    def update(self, frame: FrameContext) -> None:
        """Take over the transforms and visibility of ``frame``."""
        if self._draws and self._tables.draws.place(frame.placement):
            write_texels(self._placed, 0, self._tables.draws.texels)

    @property
    def resources(self) -> dict[str, Any]:
        """Textures and buffers that shaders of hits read, by name."""
        return {**self._textures, **self._posed_buffers}

    @property
    def memory(self) -> dict[str, int]:
        """GPU memory of tables and atlas, bytes by name."""
        texels = sum(t.width * t.height for name, t in self._textures.items() if name != "hit_atlas")
        return {_TABLES: 16 * texels} | ({"textures of ray hits": self.atlas.bytes} if self.atlas.places else {})

    @property
    def notes(self) -> list[str]:
        """What hits have less of than the scene, one line each."""
        reduced, count = len(self.atlas.reduced), len(self.atlas.places)
        if not reduced:
            return []
        return [
            f"{reduced} of {count} images are stored smaller for hits of rays: the atlas has {self.atlas.bytes} bytes"
        ]

    def release(self) -> None:
        self._placed.release()
        self._stored.release()


def _images(scene: Scene, draws: tuple[Draw, ...], options: HitOptions) -> dict[int, bool]:
    """Images that hits on ``draws`` need -> whether they are colors."""
    materials, out = (Material(), *scene.materials), {}
    for m in sorted({d.material + 1 for d in draws}):
        for slot in hit_slots(materials[m], options):
            image = texture_of(materials[m], slot).image
            out[image] = out.get(image, False) or slot in COLOR_SLOTS
    return out

"""Indirect light.  Method ``rsm``: VPLs without visibility, one bounce; ``probes``: visibility, four bounces.

Both start from virtual point lights (VPLs): every texel of the reflective shadow maps of the most significant lights,
and both sides of surface patches (frame/patches.py), which get the light of all other lights.
Nothing is random: the same frame gives the same result, and while lights and surfaces stand still only the ``apply``
pass runs, wherever the camera is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.frame.casters import ShadowMapCache
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW
from taubench_gl.frame.materials import MaterialKey
from taubench_gl.frame.passes.gbuffer import channel_pass, geometry_pass, geometry_variant
from taubench_gl.frame.passes.shadows import AnchoredRecords, FaceDrawer, Variant, fixed_draws
from taubench_gl.frame.patches import PATCH, Patches, lamps_of
from taubench_gl.frame.scene_buffers import Group
from taubench_gl.frame.shadow_faces import FACE, Face, FaceTable, faces_of, first_faces, pack
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.frame.tuning import NARROW, PATCH_LIGHT_CHUNK, VPL_CHUNK, WIDE
from taubench_gl.gpu.declare import CONSTANTS, UPDATE, WRITE, ComputePass, Pass, RasterPass, Resource, Use, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.lobes import COMMON_LOBES, lobe_channels
from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE
from taubench_gl.metrics.shading_rate import RATES, invocations, phase

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray

INDIRECT = Struct(
    "IndirectRecord",
    Field("scene_from_relative", "vec4", "xyz: current camera - center of the scene's bounds, meters"),
    Field("parallel_view", "vec4", "xyz: unit, towards a parallel camera; w: 1 if the camera is parallel"),
    Field("grid_origin", "vec4", "xyz: low corner of the occupancy grid, scene space; w: size of a voxel, meters"),
    Field("probe_origin", "vec4", "xyz: first probe, scene space"),
    Field("probe_step", "vec4", "xyz: distance between probes along each axis, meters"),
    Field("probe_counts", "ivec4", "xyz: probes along each axis"),
    Field("size", "ivec4", "xy: pixels, zw: pixels of the small irradiance image"),
    Field("counts", "ivec4", "x: VPLs, y: phase of the shading rate, z: faces of lights, w: first VPL of a patch"),
)
VPL = Struct(
    "VirtualPointLight",
    Field("position", "vec4", "xyz: scene space, meters; w: area of its patch, m2, 0 = none"),
    Field("normal", "vec4", "xyz: unit, world axes; w: height above the patch that visibility rays aim at, meters"),
    Field("flux", "vec4", "xyz: reflected flux, linear"),
    Field("albedo", "vec4", "xyz: diffuse albedo of its patch; w: 1 / lights that see it, its share of later bounces"),
)
CHANNEL_NAMES = ("position", "normal", "base_color", "material")
"""Channels of the reflective shadow maps, and those that indirect light reads."""

FIXED = "rsm_fixed_"
"""Prefix of the reflective shadow maps of what no animation moves: what moves is drawn over a copy of them."""

LOBES = lobe_channels(COMMON_LOBES, ("indirect",))

VPL_ROW = 64
"""VPLs in a row of their texture, a texel for each of the four fields."""

GRID = 96
"""Voxels of the occupancy grid along its longest side."""

VPL_LIFT = 1.75
"""Voxels between a VPL and the point above it that visibility rays aim at."""

BRICKS = GRID // 4
"""Bricks of 4 x 4 x 4 voxels along a side: the strides of visibility rays."""

SCALE = 8
"""Pixels from one gathered pixel to the next, along both axes, in method rsm."""

MIN_TEXELS = 4
"""Texels along a side of a reflective shadow map: fewer miss what is near a light, which patches do not."""

BOUNCES = 4
"""Bounces after the first scattering: VPLs light each other three more times."""

_LABEL = "indirect buffers"


# ------------------------------------------------------------------------------------------------------------- layout
def scene_center(spec: FrameSpec) -> Array:
    """(3,) world: origin of scene space, in which VPLs and probes are."""
    low, high = spec.animated.box
    return 0.5 * (low + high)


def indirect_layout(box: tuple[Array, Array], size: tuple[int, int], probes: int) -> Array:
    """An INDIRECT record with grid, probes and sizes.

    ``box``: low and high corner (3,) of all geometry, world; ``size``: pixels; ``probes``: about so many.
    """
    center = 0.5 * (box[0] + box[1])
    low, high = box[0] - center, box[1] - center
    extent = np.maximum(high - low, 1e-6 * max(float((high - low).max()), 1e-6))
    record = INDIRECT.zeros()
    voxel = float(extent.max()) * 1.02 / (GRID - 2)
    record["grid_origin"] = (*(low - voxel), voxel)
    # As cubic as the number of probes allows: one spacing for all axes.
    spacing = float((extent.prod() / max(probes, 8)) ** (1.0 / 3.0))
    spacing = max(spacing, float(extent.max()) / 64.0)
    counts = np.clip(np.ceil(extent / spacing).astype(int), 2, 64)
    step = extent / counts  # probes at cell centers: none lies on the outer walls
    record["probe_origin"][:3], record["probe_step"][:3] = low + 0.5 * step, step
    record["probe_counts"][:3] = counts
    record["size"] = (*size, *_small(size))
    return record


def _small(size: tuple[int, int]) -> tuple[int, int]:
    return -(-size[0] // SCALE), -(-size[1] // SCALE)


def mapped_lights(spec: FrameSpec) -> list[int]:
    """Rows of the lights with reflective shadow maps, ascending; all other lights shine on patches.

    As many of the most significant lights with shadows as leave each face MIN_TEXELS along a side.
    """
    room, rows = spec.settings.lighting.indirect_samples // MIN_TEXELS**2, []
    for row in spec.ranked_shadows:
        room -= sum(f.resolution**2 for f in spec.light_faces(1, rows=[row]))
        if room < 0:
            break
        rows.append(row)
    return sorted(rows)


def rsm_resolution(spec: FrameSpec) -> int:
    """Texels along a face so that all lights together give about ``indirect_samples`` VPLs, at least 2."""
    weight = sum(f.resolution**2 for f in spec.light_faces(1, rows=mapped_lights(spec)))
    return max(2, int(np.sqrt(spec.settings.lighting.indirect_samples / max(weight, 1))))


def rsm_faces(spec: FrameSpec) -> list[Face]:
    return spec.light_faces(rsm_resolution(spec), rows=mapped_lights(spec))


def patch_count(spec: FrameSpec) -> int:
    """Surface patches: as many sides as ``indirect_samples``; 0 where all lights have maps."""
    all_mapped = len(mapped_lights(spec)) == len(spec.light_kinds)
    return 0 if all_mapped else -(-spec.settings.lighting.indirect_samples // 2)


def vpl_count(spec: FrameSpec) -> int:
    return sum(f.resolution**2 for f in rsm_faces(spec)) + 2 * patch_count(spec)


def vpl_size(count: int) -> tuple[int, int]:
    """Texels of the texture of ``count`` VPLs, one for each of their fields."""
    return len(VPL.fields) * VPL_ROW, -(-count // VPL_ROW)


def _probe_count(layout: Array) -> int:
    return int(np.prod(layout["probe_counts"][:3]))


# ------------------------------------------------------------------------------------------------------------- passes
class Declarations:
    """The passes of one ``spec``, by what they do."""

    def __init__(self, spec: FrameSpec):
        self._spec, self.layout = spec, indirect_layout(spec.animated.box, spec.size, spec.settings.lighting.probes)
        self.center, self.count, self.patch_count = scene_center(spec), vpl_count(spec), patch_count(spec)
        self.probes, self._faces = spec.indirect_method == "probes", len(rsm_faces(spec))

    def all(self) -> list[Pass]:
        """All passes of indirect light in the order in which they run."""
        out: list[Pass] = [self.rsm(), self.place_fixed()] if self.mapped else []
        if self.probes:
            out += [self.voxels("voxels_fixed"), self.voxels("voxels_moving"), *self.bricks()]
        out += [self.vpls()] * self.mapped + [self.patches()] * bool(self.patch_count)
        if self.probes:
            out += [self.visibility(), self.receive(first=True), self.bounce(), self.receive(first=False)]
        if not self._spec.shading.stochastic:  # then random VPLs are summed up by the stochastic pass
            out += [*self.gather(), self.apply()]
        return out

    @property
    def mapped(self) -> bool:
        """Whether a light has reflective shadow maps."""
        return self._faces > 0

    def record(self, frame: FrameContext) -> Array:
        """The INDIRECT record of ``frame``."""
        shading_phase = phase(self._spec.shading.rate, frame.number)
        self.layout["counts"] = self.count, shading_phase, self._faces, self.count - 2 * self.patch_count
        self.layout["scene_from_relative"][:3] = frame.view.position - self.center
        self.layout["parallel_view"] = frame.view.towards_parallel_camera
        return self.layout

    def _compute(self, shader: str) -> ComputePass:
        sizes = f"const int GRID = {GRID}, SCALE = {SCALE}, VPL_ROW = {VPL_ROW}, LIGHT_ROW = {LIGHT_ROW};"
        p = ComputePass("indirect", (f"indirect/{shader}.comp.glsl",)).define(**self._spec.tuning.defines)
        lengths = f"const float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE}, VPL_LIFT = {VPL_LIFT};"
        p.glsl(VPL, LIGHT, FACE, sizes, lengths)
        return p.constants("P", INDIRECT, self.record)

    def rsm(self) -> RasterPass:
        """Reflective shadow maps: what each mapped light sees, and of it what no animation moves (``FIXED``)."""
        size, room = self._map_size(), self._room()
        p = channel_pass("indirect", CHANNEL_NAMES, self._spec, resources={c: f"rsm_{c}" for c in CHANNEL_NAMES})
        for prefix in ("rsm_", FIXED):
            for channel in CHANNEL_NAMES:
                form = {"components": CHANNELS[channel].components, "dtype": CHANNELS[channel].dtype}
                p.allocate(Resource.texture(prefix + channel, size, **form, label=_LABEL, **room))
            p.allocate(Resource.texture(f"{prefix}depth", size, dtype="depth", label=_LABEL, **room))
        return p

    def _map_size(self) -> tuple[int, int]:
        return pack(rsm_faces(self._spec), self._spec.tuning.texture_limit)[1]

    def place_fixed(self) -> ComputePass:
        """Positions of what no animation moves, from scene space to the camera."""
        return (
            self._compute("rsm_position")
            .texture("fixed_position", resource=f"{FIXED}position", filled=True)
            .image("position_out", access=WRITE, resource="rsm_position")
            .dispatch(self._map_size(), self._spec.tuning.pixel_group)
        )

    def _room(self) -> dict[str, str]:
        """Text and hint of the error of a device that has no room for the virtual point lights."""
        places = [f"{self._faces} reflective shadow map{'s' * (self._faces != 1)}"] * self.mapped
        places += [f"{self.patch_count} surface patches"] * bool(self.patch_count)
        what = f"{self.count} virtual point lights in {' and '.join(places)}"
        return {"what": what, "hint": "lower --shadow-lights or --vpls"}

    def voxels(self, name: str) -> RasterPass:
        """Occupancy bits, set by fragments, of what no animation moves (voxels_fixed) or of the rest."""
        p = geometry_pass("indirect", "indirect/voxelize.frag.glsl", ()).glsl(INDIRECT, f"const int GRID = {GRID};")
        p.use(Use(CONSTANTS, "P", INDIRECT.name, filled=True))
        p.buffer("voxels", "uint", access=UPDATE, resource=name)
        p.drawn += [_voxel_variant(posed)[0] for posed in sorted({posed for posed, _ in self._spec.draw_kinds})]
        return p.allocate(Resource.buffer(name, GRID**3 // 8, label=_LABEL))

    def bricks(self) -> tuple[ComputePass, ComputePass]:
        """Bits of bricks of voxels, then the distance of each to the nearest that is not empty."""
        pack_bits = (
            self._compute("bricks")
            .define(DISTANCES=False)
            .buffer("still", "uint", resource="voxels_fixed")
            .buffer("moving", "uint", resource="voxels_moving")
            .image("bricks", "rgba32ui", access=WRITE)
            .image("rows", "r32ui", access=WRITE)
            .allocate(Resource.texture("bricks", (BRICKS, BRICKS**2), dtype="u4", label=_LABEL))
            .allocate(Resource.texture("rows", (BRICKS, BRICKS), components=1, dtype="u4", label=_LABEL))
            .dispatch(BRICKS**2, NARROW)
        )
        distances = (
            self._compute("bricks")
            .define(DISTANCES=True)
            .image("bricks", "rgba32ui", access=UPDATE)
            .image("rows", "r32ui")
            .dispatch(BRICKS**2, NARROW)
        )
        return pack_bits, distances

    def vpls(self) -> ComputePass:
        """Every texel that a light sees becomes a VPL."""
        p = (
            self._compute("vpl")
            .define(PROBES=self.probes)
            .buffer("texels", "uvec4", filled=True)
            .buffer("faces", FACE, resource="rsm_faces", filled=True)
            .texture("light_table", filled=True)
            .image("vpl_out", access=WRITE, resource="vpls")
            .allocate(self._vpl_texture())
            .dispatch(self.count - 2 * self.patch_count, WIDE)
        )
        for channel in CHANNEL_NAMES:
            p.texture(channel, resource=f"rsm_{channel}")
        return p.image("bricks", "rgba32ui") if self.probes else p

    def _vpl_texture(self) -> Resource:
        return Resource.texture("vpls", vpl_size(self.count), label=_LABEL, **self._room())

    def patches(self) -> ComputePass:
        """Both sides of every patch become VPLs."""
        p = (
            self._compute("patches")
            .define(PROBES=self.probes)
            .glsl(PATCH)
            .buffer("patches", PATCH, filled=True)
            .buffer("patch_lights", LIGHT, filled=True)
            .image("vpls", access=UPDATE)
            .dispatch(2 * self.patch_count, NARROW)
        )
        if not self.mapped:
            p.allocate(self._vpl_texture())
        return (
            p.buffer("faces", FACE, resource="rsm_faces", filled=True).image("bricks", "rgba32ui") if self.probes else p
        )

    def visibility(self) -> ComputePass:
        """Which VPLs each probe sees: the same for every bounce."""
        probes, words = _probe_count(self.layout), -(-self.count // 32)
        room = {
            "what": f"the visibility of {self._room()['what']} from {probes} probes",
            "hint": "lower --probes or --vpls",
        }
        p = (
            self._compute("visibility")
            .define(MAPPED=self.mapped)
            .image("vpls")
            .image("bricks", "rgba32ui")
            .buffer("visibility", "uint", access=WRITE)
            .allocate(Resource.buffer("visibility", 4 * probes * words, label=_LABEL, **room))
            .dispatch((probes, words), (NARROW, 1))
        )
        if not self.mapped:
            return p
        p.buffer("texels", "uvec4", filled=True).buffer("faces", FACE, resource="rsm_faces", filled=True)
        for channel in ("position", "normal"):
            p.texture(channel, resource=f"rsm_{channel}")
        return p

    def receive(self, *, first: bool) -> ComputePass:
        """Irradiance of the probes; ``first``: by the flux of the VPLs themselves, else by that of the last bounce."""
        p = (
            self._compute("probes")
            .define(FIRST_BOUNCE=first)
            .image("vpls")
            .image("bricks", "rgba32ui")
            .image("probes", access=UPDATE)
            .buffer("visibility", "uint")
            .dispatch(_probe_count(self.layout), NARROW)
        )
        if not first:
            return p.image("flux")
        x, y, z = (int(n) for n in self.layout["probe_counts"][:3])
        return p.allocate(Resource.texture("probes", (6 * x, y * z), label=_LABEL))

    def bounce(self) -> ComputePass:
        """Flux of the VPLs with one more bounce."""
        columns, rows = vpl_size(self.count)
        return (
            self._compute("bounce")
            .image("vpls")
            .image("probes")
            .image("flux_out", access=WRITE, resource="flux")
            .allocate(Resource.texture("flux", (columns // len(VPL.fields), rows), label=_LABEL))
            .dispatch(self.count, WIDE)
        )

    def gather(self) -> tuple[ComputePass, ...]:
        """Irradiance of all VPLs at every SCALE-th pixel."""
        if self.probes or self._spec.shading.gather_each:
            return ()
        return (
            self._compute("gather")
            .use(*self._spec.channels("position", "normal", images=True))
            .image("vpls")
            .image("irradiance_out", access=WRITE, resource="irradiance")
            .allocate(Resource.texture("irradiance", _small(self._spec.size), label=_LABEL))
            .dispatch(_small(self._spec.size), self._spec.tuning.pixel_group),
        )

    def apply(self) -> ComputePass:
        """Radiance of every pixel from the irradiance around it."""
        spec = self._spec
        lobes = bool(set(LOBES) & set(spec.extra))
        p = (
            self._compute("apply")
            .define(PROBES=self.probes, GATHER_EACH=spec.shading.gather_each, GLOSSY="glossy" in spec.enabled)
            .define(SHADING_RATE=RATES.index(spec.shading.rate), SPLIT_LOBES=lobes)
            .use(*spec.channels(*CHANNEL_NAMES, images=not lobes))  # a pass has eight images at most
            .use(*spec.outputs("indirect", *(LOBES if lobes else ())))
            .dispatch(invocations(spec.shading.rate, spec.size), spec.tuning.pixel_group)
        )
        spec.declare_directions(p)
        if self.probes:
            return p.image("probes")
        return p.image("vpls") if spec.shading.gather_each else p.image("vpls").texture("irradiance")


@stage("indirect", "direct", options=("shadows", "glossy", "normal_maps", "alpha_mask", "skinning", "morphing"))
def indirect_light(spec: FrameSpec) -> Sequence[Pass]:
    return Declarations(spec).all() if spec.raster_indirect else ()


def _voxel_variant(posed: bool) -> Variant:
    return geometry_variant(MaterialKey((), False, True), posed), ()


# ---------------------------------------------------------------------------------------------------------- execution
class IndirectPass(Owner):
    """Runs the passes of ``Declarations``; what it computes is kept while lights and surfaces stand still.

    ``hold``: frames for which it is kept at least, although they move.
    """

    def __init__(self, context: GpuContext, spec: FrameSpec, draws: tuple[Draw, ...]):
        """``draws``: of the scene, in the order of their casters.

        Raises GraphicsError where the VPLs need a larger texture or buffer than the device has.
        """
        super().__init__()
        passes = Declarations(spec)
        gpu = self._gpu = context.gpu
        self._spec, self._passes = spec, passes
        self.tables = context.allocate_all(passes.all())
        self._resolution = rsm_resolution(spec)
        faces = rsm_faces(spec)
        self._offsets, _ = pack(faces, spec.tuning.texture_limit)
        ctx = gpu.ctx
        self._rows = FACE.zeros(max(len(faces), 1))
        self.tables["rsm_faces"] = ctx.buffer(reserve=self._rows.nbytes, dynamic=True)
        self._mapped = mapped_lights(spec)
        if passes.mapped:
            self._drawer, self._fixed_drawer = (self._drawing(context, prefix) for prefix in ("rsm_", FIXED))
            self._place = self.own(context.compute(passes.place_fixed()))
            self._fixed, self._cache = fixed_draws(spec.scene, draws), ShadowMapCache(len(faces))
            self._anchor = self.own(AnchoredRecords(gpu, draws, passes.center))
            self.tables["texels"] = ctx.buffer(_texel_table(faces, self._offsets).tobytes())
            self._vpls = self.own(context.compute(passes.vpls()))
        inputs = context, spec, passes, self.tables, draws
        self._patches = self.own(PatchLight(*inputs) if passes.patch_count else None)
        self.grid = self.own(ProbeGrid(*inputs) if passes.probes else None)
        shade = () if spec.shading.stochastic else (*passes.gather(), passes.apply())
        self._shade = [self.own(context.compute(p)) for p in shade]
        for table in self.tables.values():
            self.own(table)
        self.hold = 1
        self._solved: bytes | None = None
        self._age = 0  # frames since

    def _targets(self, prefix: str) -> list[moderngl.Texture]:
        """The channels of the maps whose names begin with ``prefix``."""
        return [self.tables[prefix + channel] for channel in CHANNEL_NAMES]

    def _drawing(self, context: GpuContext, prefix: str) -> FaceDrawer:
        """What draws faces into the maps whose names begin with ``prefix``."""
        framebuffer = self.own(self._gpu.ctx.framebuffer(self._targets(prefix), self.tables[f"{prefix}depth"]))
        return self.own(FaceDrawer(context, framebuffer, self._passes.rsm()))

    def run(self, frame: FrameContext) -> None:
        """Write ``indirect`` of the frame; where the stochastic pass does that, only find the VPLs."""
        spec, rows = self._spec, frame.light_rows[self._mapped]
        frame.tables |= self.tables
        faces = faces_of(spec.scene, frame.state, self._mapped, spec.animated.bounds, self._resolution, spec.sun)
        lit = b"".join(a.tobytes() for a in (rows["color"][:, :3], rows["position"][:, 3], rows["spot"]))
        key = frame.casters.key() + lit + b"".join(FaceTable(faces).keys())
        if self._patches is not None:
            key += self._patches.place_lights(frame)
        self._age += 1
        if self._solved is None or (key != self._solved and self._age >= self.hold):
            self._solved, self._age = key, 0
            self._solve(frame, faces)
        for compiled in self._shade:
            compiled.run(frame, frame.resources)

    def _solve(self, frame: FrameContext, faces: list[Face]) -> None:
        """VPLs of this moment, and with probes the irradiance of every probe."""
        if faces:
            self._draw_maps(frame, faces)
        if self.grid is not None:
            self.grid.fill(frame)
        if faces:
            self._vpls.run(frame, frame.resources)
        if self._patches is not None:
            self._patches.run(frame)
        if self.grid is not None:
            self.grid.light(frame)

    def _draw_maps(self, frame: FrameContext, faces: list[Face]) -> None:
        on = np.any(frame.light_rows["color"][:, :3] != 0.0, axis=1)
        lit, table = np.flatnonzero([on[face.light] for face in faces]), FaceTable(faces)
        keys = self._spec.material_keys(CHANNEL_NAMES)

        @cache
        def variant(group: Group) -> Variant:
            key, colors = keys[group.material + 1], group.material in self._spec.colored
            known = tuple(s for s in key.slots if s in frame.materials.keys[group.material + 1].slots)
            return geometry_variant(key, group.posed, CHANNEL_NAMES, colors), known

        self._keep_fixed(frame, [faces[i] for i in lit], lit, variant)
        moving = [shown.draws for shown in frame.casters.only(~self._fixed).shown_by(table)]
        self._drawer.draw(frame, [(faces[i], self._offsets[i], moving[i]) for i in lit], variant, clear=False)
        # A light that is off has no VPLs: its faces are cleared.
        off, nothing = np.setdiff1d(np.arange(len(faces)), lit), np.zeros(0, dtype=np.int64)
        self._drawer.draw(frame, [(faces[i], self._offsets[i], nothing) for i in off], variant)
        self._gpu.hazards.wrote(self._targets("rsm_"), drawn=True)
        rows, lights = self._rows[: len(faces)], [face.light for face in faces]
        table.fill(rows, self._offsets, frame.view.position)
        rows["extent"][:, 2], rows["extent"][:, 3] = on[lights], lights
        self.tables["rsm_faces"].write(self._rows.tobytes())

    def _keep_fixed(
        self, frame: FrameContext, faces: list[Face], numbers: Array, variant: Callable[[Group], Variant]
    ) -> None:
        """Bring the maps of what no animation moves up to date in ``faces``, and copy all of them."""
        if faces:
            self._anchor.update(frame.placement, frame.buffers.order)
            dirty = self._cache.update(numbers, FaceTable(faces), frame.casters.only(self._fixed))
            of = dict(zip(numbers.tolist(), faces, strict=True))
            stale = [(of[s.number], self._offsets[s.number], s) for s in dirty]
            self._fixed_drawer.draw_stale(frame, stale, variant, self._anchor, ordered=True)
            self._gpu.hazards.wrote(self._targets(FIXED), drawn=True)
        for name in ("depth", *CHANNEL_NAMES):
            source, target = (self.tables[prefix + name] for prefix in (FIXED, "rsm_"))
            self._gpu.copy_texels(source, target, [(0, 0, *source.size)])
        self._place.run(frame, frame.resources)
        self._gpu.hazards.publish()

    def record(self, frame: FrameContext) -> Array:
        """The INDIRECT record of ``frame``."""
        return self._passes.record(frame)

    def notes(self) -> list[str]:
        """Which lights are simulated in a simpler way."""
        lights, mapped = len(self._spec.light_kinds), len(self._mapped)
        if lights == mapped:
            return []
        patches = f"{self._passes.patch_count} surface patches"
        return [
            f"indirect light of {lights - mapped} of {lights} lights starts from {patches}, without maps of its own"
        ]

    def vpls(self) -> Array:
        """The VPLs of this frame, (V,) VPL records in scene space."""
        return np.frombuffer(self.tables["vpls"].read(), dtype=VPL.dtype)[: self._passes.count]


class PatchLight(Owner):
    """Light of the lights without reflective shadow maps on surface patches."""

    def __init__(
        self, context: GpuContext, spec: FrameSpec, passes: Declarations, tables: dict, draws: tuple[Draw, ...]
    ):
        """``tables``: of the indirect pass, to which buffers are added."""
        super().__init__()
        mapped, facts = set(mapped_lights(spec)), spec.animated
        self._rows = [row for row in range(len(spec.light_kinds)) if row not in mapped]
        self._scene, self._center, self._tables = spec.scene, passes.center, tables
        lamps = lamps_of(facts.poser, self._rows, facts.times, spec.sun)
        self._patches = Patches(facts.poser, draws, lamps, passes.patch_count)
        ctx = context.gpu.ctx
        tables["patches"] = ctx.buffer(reserve=PATCH.dtype.itemsize * passes.patch_count, dynamic=True)
        tables["patch_lights"] = ctx.buffer(reserve=LIGHT.dtype.itemsize * max(len(self._rows), 1), dynamic=True)
        self._compiled = self.own(context.compute(passes.patches()))
        self._lit = 0  # lights that are on

    def place_lights(self, frame: FrameContext) -> bytes:
        """Upload the lights that are on, in scene space; bytes that are equal while their light is."""
        rows = frame.light_rows[self._rows]
        nodes = self._scene.light_nodes
        of_scene = [row for row in self._rows if row < len(nodes)]
        rows["position"][: len(of_scene), :3] = frame.state.world[nodes[of_scene]][:, :3, 3] - self._center
        rows["color"][:, 3] = -1.0
        rows = rows[np.any(rows["color"][:, :3] != 0.0, axis=1)]
        self._lit = len(rows)
        if len(rows):
            self._tables["patch_lights"].write(rows.tobytes())
        return rows.tobytes()

    def run(self, frame: FrameContext) -> None:
        """The VPLs of all patches; their lights must be placed."""
        self._tables["patches"].write(self._patches.records(frame.state, frame.placement, self._center).tobytes())
        for first in range(0, max(self._lit, 1), PATCH_LIGHT_CHUNK):
            chunk = first, min(first + PATCH_LIGHT_CHUNK, self._lit)
            self._compiled.run(frame, frame.resources, chunk=chunk)


class ProbeGrid(Owner):
    """A grid of ambient-cube probes in scene space, with what hides VPLs from them."""

    def __init__(
        self,
        context: GpuContext,
        spec: FrameSpec,
        passes: Declarations,
        tables: dict,
        draws: tuple[Draw, ...],
    ):
        """``tables``: allocated resources of ``passes``."""
        super().__init__()
        self._gpu, self._passes, self._tables = context.gpu, passes, tables
        declaration = passes.voxels("voxels_fixed")
        self._bindings = {use.name: binding for use, binding in declaration.bindings()}
        self._bricks = [self.own(context.compute(p)) for p in passes.bricks()]
        self._visibility = self.own(context.compute(passes.visibility()))
        self._bounce = self.own(context.compute(passes.bounce()))
        self._receive = [self.own(context.compute(passes.receive(first=first))) for first in (True, False)]
        self._constants = self.own(context.gpu.ctx.buffer(reserve=INDIRECT.dtype.itemsize, dynamic=True))
        self._drawn: list[bytes | None] = [None, None]
        self._fixed = fixed_draws(spec.scene, draws)
        self._anchor = self.own(AnchoredRecords(context.gpu, draws, passes.center))
        depth = self.own(context.gpu.ctx.depth_texture((2 * GRID, 2 * GRID)))
        target = self.own(context.gpu.ctx.framebuffer(depth_attachment=depth))
        self._drawer = self.own(FaceDrawer(context, target, declaration, depth_test=False))

    def fill(self, frame: FrameContext) -> None:
        """Mark every voxel that a surface passes through.  What no animation moves keeps its marks."""
        self._constants.write(self._passes.record(frame).tobytes())
        self._constants.bind_to_uniform_block(self._bindings["P"])
        self._anchor.update(frame.placement, frame.buffers.order)
        casters, stale = frame.casters, False
        parts = {"voxels_fixed": casters.visible & self._fixed, "voxels_moving": casters.visible & ~self._fixed}
        for k, (name, seen) in enumerate(parts.items()):
            key = seen.tobytes() + casters.versions[seen].tobytes()
            if key == self._drawn[k]:
                continue
            self._drawn[k], stale = key, True
            self._tables[name].clear()
            self._tables[name].bind_to_storage_buffer(self._bindings["voxels"])
            self._mark(frame, np.flatnonzero(seen))
            self._gpu.hazards.wrote([self._tables[name]])
        for compiled in self._bricks if stale else ():
            compiled.run(frame, frame.resources)

    def _mark(self, frame: FrameContext, seen: Array) -> None:
        """Draw ``seen`` into the bound grid along three axes, so that no surface is missed edge-on."""
        if not len(seen):
            return
        layout = self._passes.layout
        origin, voxel = layout["grid_origin"][:3].astype(np.float64), float(layout["grid_origin"][3])
        half = 0.5 * GRID * voxel
        middle = self._passes.center + origin + half
        axes = np.eye(3)
        stale = []
        for k in range(3):
            forward, up = axes[k], axes[(k + 1) % 3]
            start = middle - forward * half
            face = Face(0, True, start, np.cross(forward, up), up, forward, half, 2.0 * half, 2 * GRID)
            stale.append((face, (0, 0), seen))
        self._drawer.draw(frame, stale, lambda group: _voxel_variant(group.posed), anchor=self._anchor)

    def light(self, frame: FrameContext) -> None:
        """Find which VPLs every probe sees, then let light bounce.  ``fill`` must be up to date."""
        resources, count = frame.resources, self._passes.count
        self._visibility.run(frame, resources)
        for bounce in range(BOUNCES):
            if bounce > 0:
                self._bounce.run(frame, resources)
            for first in range(0, count, VPL_CHUNK):
                chunk = first, min(first + VPL_CHUNK, count)
                self._receive[min(bounce, 1)].run(frame, resources, chunk=chunk)

    def occupancy(self) -> Array:
        """Which voxels hold a surface, (GRID, GRID, GRID) bool by z, y, x, as drawn."""
        fixed, moving = (np.frombuffer(self._tables[n].read(), np.uint8) for n in ("voxels_fixed", "voxels_moving"))
        return np.unpackbits(fixed | moving, bitorder="little").reshape(GRID, GRID, GRID).astype(bool)

    def visibility(self) -> Array:
        """Which VPLs each probe sees, (probes, VPLs) bool."""
        probes = _probe_count(self._passes.layout)
        words = np.frombuffer(self._tables["visibility"].read(), np.uint8).reshape(probes, -1)
        return np.unpackbits(words, axis=1, bitorder="little")[:, : self._passes.count].astype(bool)


def _texel_table(faces: list[Face], offsets: list[tuple[int, int]]) -> Array:
    """(V, 4) uint32: atlas x and y, face, first face of the light of every texel."""
    parts, first = [], first_faces(faces)
    for i, (face, (x, y)) in enumerate(zip(faces, offsets, strict=True)):
        at = np.stack(np.meshgrid(np.arange(face.resolution), np.arange(face.resolution)), axis=-1).reshape(-1, 2)
        tail = np.broadcast_to([i, first[face.light]], (len(at), 2))
        parts.append(np.concatenate([at + [x, y], tail], axis=1))
    return np.concatenate(parts).astype(np.uint32)

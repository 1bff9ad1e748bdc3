"""Light: runs the passes that follow the geometry pass, from shadow maps to color."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.effects.lighting import light_unit_in
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.casters import Casters
from taubench_gl.frame.environment import LOBES, MAP, image_of, texels
from taubench_gl.frame.lights import LightTable, LightTexture
from taubench_gl.frame.passes.indirect import IndirectPass, indirect_light
from taubench_gl.frame.passes.lighting import TILE, color, direct_light, light_lists, stochastic_light
from taubench_gl.frame.passes.pathtracing import PathTracing, path_traced_light
from taubench_gl.frame.passes.shadows import ShadowPass, shadow_maps
from taubench_gl.frame.plan import LIGHT
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.shadow_faces import wanted_sizes
from taubench_gl.frame.spec import TO_CAMERA, FrameSpec
from taubench_gl.frame.tuning import MAX_LIGHTS
from taubench_gl.gpu.declare import Stage
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import CompiledCompute
from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.metrics.stochastic import light_choice

Array = np.ndarray


class LightStage(Owner):
    """Lights the frames of one Renderer.  Made only where ``spec`` has a pass that lights."""

    def __init__(self, renderer: Renderer, spec: FrameSpec):
        super().__init__()
        context, scene = renderer.context, renderer.scene
        self._context, self._renderer, self._spec = context, renderer, spec
        self.seed: int | None = None
        """Seed of the random numbers of the frames that follow; None: the seed of ``spec``."""
        self.memory: dict[str, int] = {}
        """GPU memory that the passes allocate, by name, bytes."""
        for resource in (r for declare in LIGHT for p in declare(spec) for r in p.resources):
            self.memory[resource.label] = self.memory.get(resource.label, 0) + resource.bytes
        self.table = LightTable(scene, light_unit_in(spec.settings), spec.sun)
        if len(self.table) > MAX_LIGHTS:
            raise GraphicsError(f"the scene has {len(self.table)} lights, at most {MAX_LIGHTS} can be rendered")
        self._light_texture = self.own(LightTexture(context.gpu, len(self.table)))
        self._tables: dict[str, Any] = {}
        self.shadow = self.own(ShadowPass(context, spec, renderer.draws) if shadow_maps(spec) else None)
        self._casters: Casters | None = None
        if self.shadow is not None or spec.raster_indirect:
            self._casters = Casters(len(renderer.draws))
            self._bounds = renderer.bounds
        self._direct = self._compile(light_lists) + self._compile(direct_light)
        self.indirect = self.own(IndirectPass(context, spec, renderer.draws) if indirect_light(spec) else None)
        self._stochastic = self._compile(stochastic_light)
        self.paths = self.own(PathTracing(renderer, spec) if path_traced_light(spec) else None)
        if self.paths is not None:
            self._tables |= self.paths.tables
            self.memory |= self.paths.memory
        self._color = self._compile(color)
        if "albedo_table" in self._tables:
            self._tables["albedo_table"].write(albedo_table().tobytes())
        for name in {MAP, LOBES} & self._tables.keys():
            self._tables[name].write(texels(spec.environment, name).tobytes())
        if spec.given_directions:
            self._tables[TO_CAMERA] = context.gpu.ctx.texture(spec.size, 4, dtype="f4")
        if self._stochastic:
            self._tables["light_choice"] = context.gpu.ctx.buffer(reserve=8 * max(len(self.table), 1), dynamic=True)
        for table in self._tables.values():
            self.own(table)

    def _compile(self, declare: Stage) -> list[CompiledCompute]:
        passes = declare(self._spec)
        self._tables |= self._context.allocate_all(passes)
        return [self.own(self._context.compute(p)) for p in passes]

    def run(self, number: int = 0) -> None:
        """Light the renderer's frame.  ``number``: of the frame, for shading that differs from frame to frame."""
        frame, timer = self._renderer.frame, self._context.timer
        frame.number, frame.seed = number, self.seed
        frame.light_rows = self.table.update(frame.state, frame.view)
        frame.tables |= self._tables
        frame.tables["light_table"] = self._light_texture.texture
        if self._casters is not None:
            with timer.measure("shadows"):
                world = frame.placement.world
                boxes, poses = self._bounds.boxes(frame.state, world), self._bounds.poses(frame.state, world)
                self._casters.update(boxes, poses, frame.placement.visible)
                frame.casters = self._casters
                if self.shadow is not None:
                    self.shadow.run(frame)
        self._light_texture.write(frame.light_rows)
        if self._direct:
            with timer.measure("direct"):
                for compiled in self._direct:
                    compiled.run(frame, frame.resources)
        if self.indirect is not None:
            with timer.measure("indirect"):
                self.indirect.run(frame)
        if self._stochastic:
            choice = light_choice(frame.light_rows["color"][: len(self.table), :3].max(axis=-1))
            self._tables["light_choice"].write(choice.tobytes() or bytes(8))
        self._run(self._stochastic)
        if self.paths is not None:
            with timer.measure("path tracing"):
                self.paths.run(frame)
        self.run_color()

    def give_directions(self, directions: Array) -> None:
        """Unit directions towards which every point is lit, (h, w, 3), world axes, row 0 at the top.

        Before ``run``, where the spec has ``given_directions``.
        """
        rows = np.zeros((*directions.shape[:2], 4), dtype=np.float32)
        rows[..., :3] = directions[::-1]  # row 0 is the top in arrays and the bottom in GL memory
        self._tables[TO_CAMERA].write(rows)

    def run_color(self) -> None:
        """Compute color from the light of the frame."""
        self._run(self._color)
        self._context.gpu.hazards.publish()

    def _run(self, passes: list[CompiledCompute]) -> None:
        for compiled in passes:
            with self._context.timer.measure(compiled.declaration.name):
                compiled.run(self._renderer.frame, self._renderer.frame.resources)

    @property
    def written(self) -> tuple[str, ...]:
        """Channels that ``relight`` writes: those of the stochastic or the path-traced passes."""
        passes = stochastic_light(self._spec) or path_traced_light(self._spec)
        return tuple(name for name in CHANNELS if any(name in p.writes for p in passes))

    def relight(self, channels: Mapping[str, Any], number: int) -> None:
        """Light other surfaces in this frame's light, by the stochastic or the path-traced passes, after ``run``.

        ``channels``: the surfaces (``passes.lighting.SURFACE``) and what to write (``written``), textures in place of
        those of the frame; ``number``: of the frame whose random numbers to use.
        """
        frame = self._renderer.frame
        kept, frame.number = frame.number, number
        resources = {**frame.resources, **channels}
        for compiled in self._stochastic:
            compiled.run(frame, resources)
        if not self._stochastic and self.paths is not None:
            self.paths.trace(frame, resources)
        frame.number = kept
        self._context.gpu.hazards.publish()

    @property
    def bytes(self) -> int:
        return sum(self.memory.values())

    def vpls(self) -> Array | None:
        """The VPLs of this frame (``passes.indirect.VPL`` records); None without indirect light."""
        return None if self.indirect is None else self.indirect.vpls()

    def tile_lists(self) -> list[Array] | None:
        """Rows of the light table that each tile keeps, tiles row by row from the bottom; None without culling.

        Unrolled lights that have shadow maps are in none.
        """
        if "tile_lists" not in self._tables:
            return None
        lists = np.frombuffer(self._tables["tile_lists"].read(), np.uint32).reshape(-1, len(self.table))
        return [row[:count] for row, count in zip(lists, self.tile_counts().ravel(), strict=True)]

    def tile_counts(self) -> Array | None:
        """Lights kept per tile, (tiles_y, tiles_x) uint32, row 0 at the bottom; None without culling."""
        if "tile_counts" not in self._tables:
            return None
        columns = -(-self._spec.size[0] // TILE)
        return np.frombuffer(self._tables["tile_counts"].read(), np.uint32).reshape(-1, columns)

    def notes(self) -> list[str]:
        """What was left out, for every output."""
        out = []
        left_out = len(self.table) - len(self._spec.shadowed) if self.shadow is not None else 0
        if left_out:
            out.append(f"{left_out} lights shine without shadows: only the most significant get shadow maps")
        if self.shadow is not None:
            out += _smaller_maps(self._spec)
        if self.indirect is not None:
            out += self.indirect.notes()
        if {"sky", "direct"} <= self._spec.enabled:
            out.append("light of the sky is not occluded by the scene and gives no indirect light")
        if self.paths is not None:
            out += self.paths.notes()
        negative = image_of(self._spec.environment).negative if MAP in self._tables else 0
        if negative:
            out.append(f"{negative} values of the environment image are below 0 and count as 0")
        return out


def _smaller_maps(spec: FrameSpec) -> list[str]:
    """A note where shadow maps are smaller than asked for, because all have to fit one texture."""
    sizes = spec.map_sizes
    if sizes == wanted_sizes(spec.ranked_shadows, spec.settings.lighting.shadow_size):
        return []
    faces = {face.light: face.resolution for face in spec.light_faces(sizes)}
    lights = Counter(faces.values())
    listed = ", ".join(f"{lights[n]} lights {n}x{n}" for n in sorted(lights, reverse=True))
    limit = spec.tuning.texture_limit
    return [f"the shadow maps that were asked for do not fit {limit}x{limit} texels; their sizes are: {listed}"]

"""Everything light does to a frame, after the geometry pass: shadows, direct radiance, colour."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation import bounding_box, bounding_sphere
from taubench_gl.effects.decide import Effect, indirect_method
from taubench_gl.frame.draw_bounds import DrawBounds
from taubench_gl.frame.flow import SUMMED
from taubench_gl.frame.lights import LightTable
from taubench_gl.frame.listed_lights import list_lights
from taubench_gl.frame.passes.color import ColorPass
from taubench_gl.frame.passes.faces import Casters
from taubench_gl.frame.passes.indirect import IndirectPass
from taubench_gl.frame.passes.lighting import LightingPass
from taubench_gl.frame.passes.shadows import ShadowPass
from taubench_gl.frame.passes.stochastic import StochasticPass
from taubench_gl.frame.plan import bound_times, significant_lights
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.shading import Shading
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.settings import Settings

Array = np.ndarray
BOUND_MARGIN = 1.05


class LightStage:
    """Lights the frames of one Renderer.  Made only when some radiance column is on."""

    def __init__(
        self,
        renderer: Renderer,
        settings: Settings,
        effects: dict[str, Effect],
        timer: PassTimer,
        shading: Shading | None = None,
    ):
        """``shading``: how to depart from exact light at every pixel; unless ``exact`` there is no colour then."""
        self._shading = shading = shading or Shading()
        gpu, scene = renderer.gpu, renderer.scene
        self._renderer, self._timer = renderer, timer
        self.table = LightTable(scene)
        self.table.rows["color"][:, 3] = -1.0
        times = bound_times(scene)
        center, radius = bounding_sphere(renderer.poser, times)
        self._shadow = None
        self.left_out = 0
        if effects["shadows"].enabled and len(self.table):
            ranked = significant_lights(scene, renderer.poser, renderer.camera, times)
            chosen = sorted(ranked[: settings.lighting.shadow_lights])
            self.left_out = len(self.table) - len(chosen)
            self._shadow = ShadowPass(
                gpu,
                renderer.shaders,
                scene,
                chosen,
                (center, radius * BOUND_MARGIN),
                resolution=settings.lighting.shadow_size,
                colored_materials=renderer.colored,
                draws=renderer.draws,
            )
            self._casters = Casters(len(renderer.draws))
            self._bounds = DrawBounds(scene, renderer.draws)
        split = "direct_diffuse" in renderer.history.current.textures
        on = frozenset(name for name, effect in effects.items() if effect.enabled)
        direct = (gpu, renderer.shaders, renderer.size, len(self.table), settings, on)
        self.lighting = None
        if effects["direct"].enabled and not shading.stochastic:
            maps = ({}, 0) if self._shadow is None else (self._shadow.first_faces, len(self._shadow.rows))
            self.lighting = LightingPass(
                *direct,
                split=split,
                rate=shading.rate,
                listing=list_lights(self.table.kinds, *maps),
            )
        self.indirect = None
        if effects["indirect"].enabled:
            box = bounding_box(renderer.poser, times)
            rung = settings.replace(indirect=indirect_method(settings))
            self.indirect = IndirectPass(
                gpu,
                renderer.shaders,
                scene,
                chosen,
                (center, radius * BOUND_MARGIN),
                box,
                renderer.size,
                rung,
                renderer.colored,
                rate=shading.rate,
                gather_each=shading.gather_each,
                glossy="glossy" in on,
                draws=renderer.draws,
            )
        self._stochastic = None
        if effects["direct"].enabled and shading.stochastic:
            self._stochastic = StochasticPass(
                *direct,
                shading,
                indirect=self.indirect is not None,
            )
        self._color = None
        if effects["color"].enabled and shading.exact:
            inputs = tuple(n for n in SUMMED if effects[n].enabled)
            self._color = ColorPass(gpu, renderer.shaders, renderer.size, settings, inputs)

    def run(self, frame: int = 0) -> None:
        """Light the renderer's current frame.  ``frame``: its number, for shading that differs from frame to frame."""
        drawn = self._renderer.drawn
        state, view, placement = drawn.state, drawn.view, drawn.placement
        textures = self._renderer.history.current.textures
        rows = self.table.update(state, view)
        if self._shadow is not None:
            with self._timer.measure("shadows"):
                world = placement.world
                bounds, poses = self._bounds.at(state, world), self._bounds.poses(state, world)
                self._casters.update(bounds, poses, placement.visible)
                buffers, materials = self._renderer.buffers, self._renderer.materials
                self._shadow.run(state, view, rows, buffers, materials, self._casters, placement)
        if self.lighting is not None:
            with self._timer.measure("direct"):
                self.lighting.run(view, rows, textures, self._shadow, frame)
        if self.indirect is not None:
            with self._timer.measure("indirect"):
                buffers, materials = self._renderer.buffers, self._renderer.materials
                exact = self._stochastic is None
                moved = self._casters, placement
                self.indirect.run(state, view, rows, buffers, materials, *moved, textures, frame, write=exact)
        if self._stochastic is not None:
            with self._timer.measure("stochastic"):
                virtual = (None, 0, np.zeros(3))
                if self.indirect is not None:
                    virtual = self.indirect.virtual_texture, self.indirect.count, self.indirect.scene_from_relative
                self._stochastic.run(frame, view, rows, textures, self._shadow, *virtual)
        if self._color is not None:
            with self._timer.measure("color"):
                self._color.run(textures)

    @property
    def redrawn_faces(self) -> int:
        """Shadow faces drawn for the current frame; the others still held what they should show."""
        return 0 if self._shadow is None else self._shadow.redrawn

    def shadow_depths(self) -> Array | None:
        """The shadow atlas, (h, w) float32 reversed Z, row 0 at the bottom; None without shadows."""
        return None if self._shadow is None else self._shadow.depths()

    @property
    def bytes(self) -> int:
        """GPU memory of shadow maps and light lists, bytes."""
        parts = (self.lighting, self._shadow, self.indirect, self._stochastic)
        return sum(part.bytes for part in parts if part is not None)

    def virtual_lights(self) -> Array | None:
        """The virtual lights of this frame (``passes.indirect.VIRTUAL`` records); None without indirect light."""
        return None if self.indirect is None else self.indirect.virtual_lights()

    def notes(self) -> list[str]:
        """What was left out, for every output."""
        if self.left_out:
            return [f"{self.left_out} lights shine without shadows: only the most significant get shadow maps"]
        return []

    def release(self) -> None:
        for part in (self.lighting, self._shadow, self.indirect, self._stochastic, self._color):
            if part is not None:
                part.release()

"""Passes that make the picture: channel, comparison and masks in one, then lines and arrows over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.effects.decide import Effect
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import column_major
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.display import BACKGROUND, KINDS, scale_glsl
from taubench_gl.report.mask_images import STRIPE_PX
from taubench_gl.report.palette import color_of
from taubench_gl.viewer.state import COMPARISONS, OVERLAYS

Array = np.ndarray
ARROW_STEP_PX = 20
ARROW_COLOR = (1.0, 0.92, 0.35, 1.0)


@dataclass(slots=True)
class Held:
    """The camera that is looked at from outside: its position channel and clip matrix, and where it is from here."""

    position: moderngl.Texture
    clip_from_relative: Array
    delta: Array  # observer - held camera, world, metres


@dataclass(slots=True)
class Content:
    """What one picture is made of.  ``channel``: the texture shown as ``kind``."""

    kind: str
    channel: moderngl.Texture
    position: moderngl.Texture
    mask: moderngl.Texture
    low: float = 0.0
    high: float = 1.0
    shown: tuple[str, ...] = ()
    opacity: float = 1.0
    comparison: str = "off"
    other: moderngl.Texture | None = None
    split: float = 0.5
    gain: float = 1.0
    held: Held | None = None
    prev_clip_from_prev: Array | None = None
    camera_delta: Array | None = None


class Display:
    """Draws pictures of one size into ``texture``, 8 bits, sRGB."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]):
        self._gpu, self.size = gpu, size
        self._shaders = ShaderCache(gpu.ctx)
        self.texture = gpu.ctx.texture(size, 4, dtype="f1")
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._framebuffer = gpu.ctx.framebuffer([self.texture])
        self._arrays: dict[int, moderngl.VertexArray] = {}
        self._lines = gpu.ctx.buffer(reserve=4 * 24 * 64, dynamic=True)

    def draw(self, content: Content) -> None:
        other = content.other if content.comparison != "off" else None
        defines: dict[str, Any] = {f"KIND_{kind.upper()}": i for i, kind in enumerate(KINDS)}
        defines |= {f"COMPARE_{name.upper()}": i for i, name in enumerate(COMPARISONS)}
        defines |= {
            "KIND": KINDS.index(content.kind),
            "COMPARE": 0 if other is None else COMPARISONS.index(content.comparison),
            "OBSERVER": content.held is not None,
            "MAX_REASONS": len(OVERLAYS),
            "STRIPE": STRIPE_PX,
            "BACKGROUND": BACKGROUND,
        }
        program = self._shaders.render("viewer/fullscreen.vert.glsl", "viewer/display.frag.glsl", defines, scale_glsl())
        textures = {"channel": content.channel, "position": content.position, "mask": content.mask}
        if other is not None:
            textures["other"] = other
        values: dict[str, Any] = {
            "value_range": (content.low, content.high),
            "size": self.size,
            "opacity": content.opacity,
            "split_px": content.split * self.size[0],
            "gain": content.gain,
            "reasons": len(content.shown),
        }
        bits, colors = np.zeros(len(OVERLAYS), dtype=np.uint32), np.zeros((len(OVERLAYS), 3), dtype=np.float32)
        for i, name in enumerate(content.shown):
            bits[i], colors[i] = int(OVERLAYS[name]), np.array(color_of(OVERLAYS[name])) / 255.0
        values["all_bits"] = int(np.bitwise_or.reduce(bits))
        values |= {"bits": bits.tolist(), "colors": [tuple(map(float, c)) for c in colors]}
        if content.held is not None:
            textures["held_position"] = content.held.position
            values |= {"held_clip": column_major(content.held.clip_from_relative).ravel().tolist()}
            values["held_delta"] = tuple(map(float, content.held.delta))
        if content.prev_clip_from_prev is not None:
            values["prev_clip_from_prev"] = column_major(content.prev_clip_from_prev).ravel().tolist()
            values["camera_delta"] = tuple(map(float, content.camera_delta))
        for unit, (name, texture) in enumerate(textures.items()):
            if name in program:
                texture.use(unit)
                program[name] = unit
        for name, value in values.items():
            if name in program:  # a compiler drops what a variant does not read
                program[name] = value
        self._begin()
        self._array(program).render(moderngl.TRIANGLES, vertices=3)

    def lines(self, points: Array, colors: Array, view: View, position: moderngl.Texture) -> None:
        """World lines over the picture.  ``points`` (2 K, 3) float64 world, ``colors`` (2 K, 3)."""
        program = self._shaders.render("viewer/lines.vert.glsl", "viewer/lines.frag.glsl")
        rows = np.concatenate([points - view.position, colors], axis=1).astype(np.float32)
        self._lines.orphan(max(rows.nbytes, 4))
        self._lines.write(rows.tobytes())
        program["clip_from_relative"] = column_major(view.clip_from_relative(*self.size)).ravel().tolist()
        program["forward"] = tuple(map(float, -view.world_from_view[:, 2]))
        position.use(0)
        program["position"] = 0
        self._begin()
        self._gpu.ctx.enable(moderngl.BLEND)
        array = self._gpu.ctx.vertex_array(program, [(self._lines, "3f 3f", "in_position", "in_color")])
        array.render(moderngl.LINES, vertices=len(rows))
        array.release()
        self._gpu.ctx.disable(moderngl.BLEND)

    def arrows(self, motion: moderngl.Texture) -> None:
        """Where every so-manieth pixel's surface was in the last frame."""
        program = self._shaders.render("viewer/arrows.vert.glsl", "viewer/arrows.frag.glsl")
        cells = tuple(-(-n // ARROW_STEP_PX) for n in self.size)
        motion.use(0)
        program["motion"], program["size"], program["cells"] = 0, self.size, cells
        program["step_px"], program["arrow_color"] = ARROW_STEP_PX, ARROW_COLOR
        self._begin()
        self._array(program).render(moderngl.LINES, vertices=6, instances=cells[0] * cells[1])

    def read(self) -> Array:
        """The picture, (h, w, 3) uint8, row 0 at the top."""
        width, height = self.size
        self._gpu.finish()  # Mesa 22's llvmpipe may read a texture while its last draw is still under way
        return np.frombuffer(self.texture.read(), np.uint8).reshape(height, width, 4)[::-1, :, :3]

    def release(self) -> None:
        self._gpu.unbind_framebuffer()
        for array in self._arrays.values():
            array.release()
        for item in (self._framebuffer, self.texture, self._lines, self._shaders):
            item.release()

    def _begin(self) -> None:
        ctx = self._gpu.ctx
        self._framebuffer.use()
        ctx.viewport = (0, 0, *self.size)
        ctx.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        if program.glo not in self._arrays:
            self._arrays[program.glo] = self._gpu.ctx.vertex_array(program, [])
        return self._arrays[program.glo]


@dataclass(frozen=True, slots=True)
class Picture:
    """``channel`` is read by the shader as ``kind`` (``metrics.display``); ``needs``: channels it takes besides."""

    channel: str
    kind: str
    doc: str
    needs: tuple[str, ...] = ()
    fixed: tuple[float, float] | None = (0.0, 1.0)  # range when automatic; None: least and largest value there are

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind

    @property
    def channels(self) -> tuple[str, ...]:
        """What a source must have: position and normal always are there, motion is the mask pass's."""
        return tuple(n for n in (self.channel, *self.needs) if n not in ("position", "normal", "motion"))


PICTURES: dict[str, Picture] = {
    "color": Picture("color", "encoded", "as a screen shows it"),
    "direct": Picture("direct", "radiance", "light after one bounce", fixed=None),
    "indirect": Picture("indirect", "radiance", "light after two bounces or more", fixed=None),
    "direct_diffuse": Picture("direct_diffuse", "radiance", "its diffuse lobe", fixed=None),
    "direct_glossy": Picture("direct_glossy", "radiance", "its glossy lobe", fixed=None),
    "emission": Picture("emission", "radiance", "emitted light", fixed=None),
    "shape": Picture("normal", "shape", "a light at the camera"),
    "base_color": Picture("base_color", "radiance", "base colour"),
    "normal": Picture("normal", "unit", "shading normal: x red, y green, z blue"),
    "geometric_normal": Picture("geometric_normal", "unit", "normal of the triangle"),
    "material": Picture("material", "vector", "metallic red, roughness green, occlusion blue"),
    "depth": Picture("position", "depth", "planar depth", fixed=None),
    "position": Picture("position", "vector", "place relative to the camera", fixed=None),
    "ids": Picture("ids", "ids", "one colour per object"),
    "motion": Picture("motion", "motion", "direction as hue, pixels as brightness", fixed=None),
    "motion_error": Picture(
        "prev_position",
        "motion_error",
        "supplied against expected motion, pixels",
        needs=("prev_position",),
        fixed=None,
    ),
}

LIGHT = {"color": "color", "direct": "direct", "indirect": "indirect", "direct_diffuse": "direct",
         "direct_glossy": "direct", "emission": "emission"}  # fmt: skip
"""Pictures that exist only where an effect is on."""


def pictures_of_scene(effects: dict[str, Effect]) -> tuple[str, ...]:
    """Names of the pictures that a scene with these effects can give."""
    return tuple(n for n in PICTURES if n not in LIGHT or effects[LIGHT[n]].enabled)


def pictures_of_channels(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the pictures that a source with fixed channels can give."""
    return tuple(n for n, p in PICTURES.items() if set(p.channels) <= set(channels))

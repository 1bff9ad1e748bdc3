"""The image of the viewer: a channel with comparison and masks in one pass, then outline, lines and arrows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from operator import or_
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.effects.decide import Effect
from taubench_gl.features import TABLE
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import column_major
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.lobes import CHANNEL_EFFECT, SCENE_LOBES, lobe_channels
from taubench_gl.metrics.display import BACKGROUND, KINDS, scale_glsl
from taubench_gl.report.mask_images import STRIPE_PX
from taubench_gl.report.palette import EXACT_COLORS, color_of
from taubench_gl.viewer.state import EXACT_OVERLAYS, OVERLAYS, SHIFT

Array = np.ndarray
Area = tuple[int, int, int, int]  # x, y, width, height
ARROW_STEP_PX = 20
ARROW_COLOR = (1.0, 0.92, 0.35, 1.0)
OUTLINE_COLOR = (0.45, 1.0, 0.2, 1.0)
LIGHT_BITS = Reason(sum(bit for f in TABLE if f.light for bit in (f.bit, *f.details)))
MODES = ("off", "split", "difference", "error", "ghost", "other")
"""How two images are combined.  ghost: the error where the other image has alpha; other: the other image alone."""


@dataclass(slots=True)
class FrozenCamera:
    """The frozen camera, viewed from outside: position channel, clip matrix, offset from the viewing camera."""

    position: moderngl.Texture
    clip_from_relative: Array
    delta: Array  # viewing camera - frozen camera, (3,) world, scene units


@dataclass(frozen=True, slots=True)
class Other:
    """What an image is compared with.  ``motion``: the other image is history, looked up where motion leads."""

    channel: moderngl.Texture
    position: moderngl.Texture
    motion: moderngl.Texture | None = None


@dataclass(slots=True)
class Content:
    """Inputs of one image.  ``channel`` is displayed as ``kind`` in the range ``low`` to ``high``.

    ``comparison``: of MODES.
    """

    kind: str
    channel: moderngl.Texture
    position: moderngl.Texture
    mask: moderngl.Texture
    low: float = 0.0
    high: float = 1.0
    shown: tuple[str, ...] = ()
    opacity: float = 1.0
    comparison: str = "off"
    other: Other | None = None
    split: float = 0.5
    gain: float = 1.0
    frozen: FrozenCamera | None = None
    light_mask: moderngl.Texture | None = None  # of coarse light; a channel of light is as coarse
    prev_clip_from_prev: Array | None = None
    camera_delta: Array | None = None


def _bits(name: str) -> int:
    """The bits of an overlay in the mask texture, where those of exact reasons are shifted by SHIFT."""
    exact = EXACT_OVERLAYS.get(name)
    return int(OVERLAYS[name]) if exact is None else int(exact) << SHIFT


def _bits_of(names: tuple[str, ...]) -> int:
    return reduce(or_, map(_bits, names), 0)


def _packed_color(name: str) -> int:
    """Color of an overlay as an integer that ``unpackUnorm4x8`` reads: red in the lowest byte."""
    exact = EXACT_OVERLAYS.get(name)
    red, green, blue = color_of(OVERLAYS[name]) if exact is None else EXACT_COLORS[exact]
    return red | green << 8 | blue << 16


class Display(Owner):
    """Draws images of one size into ``texture``, RGBA8, sRGB."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]):
        super().__init__()
        self._gpu, self.size = gpu, size
        self._shaders = self.own(ShaderCache(gpu.ctx))
        self.texture = self.own(gpu.ctx.texture(size, 4, dtype="f1"))
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._framebuffer = self.own(gpu.ctx.framebuffer([self.texture]))
        self._arrays: dict[int, moderngl.VertexArray] = {}
        self._lines = self.own(gpu.ctx.buffer(reserve=4 * 24 * 64, dynamic=True))

    def draw(self, content: Content, area: Area | None = None, first: tuple[int, int] = (0, 0)) -> None:
        """Draw ``content`` into ``area`` of the texture (x, y, width, height, y up), all of it for None.

        ``first``: image pixel, y up, that the first pixel of the area shows; pixels outside the image are black.
        """
        area = area or (0, 0, *self.size)
        program, textures, values = self._prepared(content)
        values["origin"] = (first[0] - area[0], first[1] - area[1])
        for unit, (name, texture) in enumerate(textures.items()):
            if name in program:
                texture.use(unit)
                program[name] = unit
        smooth: tuple[moderngl.Texture, ...] = ()
        if content.light_mask is not None and content.kind in ("encoded", "radiance"):
            smooth = tuple(textures[name] for name in ("channel", "other") if name in textures)
        for texture in smooth:  # coarse light between the centers of its pixels
            texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
            texture.repeat_x = texture.repeat_y = False
        for name, value in values.items():
            if name in program:  # compilers remove unused uniforms
                program[name] = value
        self._begin()
        self._gpu.ctx.viewport = area
        self._array(program).render(moderngl.TRIANGLES, vertices=3)
        for texture in smooth:
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def _prepared(self, content: Content) -> tuple[moderngl.Program, dict[str, Any], dict[str, Any]]:
        """Program, textures by name and uniforms by name that draw ``content``."""
        other = content.other if content.comparison != "off" else None
        size = content.position.size
        defines: dict[str, Any] = {f"KIND_{kind.upper()}": i for i, kind in enumerate(KINDS)}
        defines |= {f"COMPARE_{name.upper()}": i for i, name in enumerate(MODES)}
        defines |= {
            "KIND": KINDS.index(content.kind),
            "COMPARE": 0 if other is None else MODES.index(content.comparison),
            "REPROJECTED": other is not None and other.motion is not None,
            "COARSE": content.light_mask is not None,  # a channel of light is as coarse
            "COARSE_MASKS": content.light_mask is not None and bool(_bits_of(content.shown) & int(LIGHT_BITS)),
            "OBSERVER": content.frozen is not None,
            "REASONS": len(content.shown),
            "STRIPE": STRIPE_PX,
            "BACKGROUND": BACKGROUND,
        }
        bits = f"const uint NOT_COMPARABLE = {int(NOT_COMPARABLE)}u, LIGHT_BITS = {int(LIGHT_BITS)}u;"
        lines = f"{scale_glsl()}\n{bits}"
        program = self._shaders.render("viewer/fullscreen.vert.glsl", "viewer/display.frag.glsl", defines, lines)
        textures = {"channel": content.channel, "position": content.position, "mask": content.mask}
        if content.light_mask is not None:
            textures["light_mask"] = content.light_mask
        if other is not None:
            textures |= {"other": other.channel, "other_position": other.position}
            textures |= {} if other.motion is None else {"motion": other.motion}
        values: dict[str, Any] = {
            "value_range": (content.low, content.high),
            "size": size,
            "opacity": content.opacity,
            "split_px": content.split * size[0],
            "gain": content.gain,
        }
        bits, colors = [_bits(name) for name in content.shown], [_packed_color(name) for name in content.shown]
        single = len(bits) == 1  # moderngl takes an array of one as a number
        values["all_bits"] = _bits_of(content.shown)
        values |= {"bits": bits[0] if single else bits, "colors": colors[0] if single else colors}
        if content.frozen is not None:
            textures["frozen_position"] = content.frozen.position
            values |= {"frozen_clip": column_major(content.frozen.clip_from_relative).ravel().tolist()}
            values["frozen_delta"] = tuple(map(float, content.frozen.delta))
        if content.prev_clip_from_prev is not None:
            values["prev_clip_from_prev"] = column_major(content.prev_clip_from_prev).ravel().tolist()
            values["camera_delta"] = tuple(map(float, content.camera_delta))
        return program, textures, values

    def lines(self, points: Array, colors: Array, view: View, position: moderngl.Texture) -> None:
        """Draw lines over the image.  ``points`` (2 K, 3) float64 world space, ``colors`` (2 K, 3) in [0, 1]."""
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
        with Owner() as drawn:
            layout = [(self._lines, "3f 3f", "in_position", "in_color")]
            drawn.own(self._gpu.ctx.vertex_array(program, layout)).render(moderngl.LINES, vertices=len(rows))
        self._gpu.ctx.disable(moderngl.BLEND)

    def arrows(self, motion: moderngl.Texture, scale: float = 1.0) -> None:
        """Draw an arrow from every ARROW_STEP_PX-th pixel towards its position in the previous frame.

        ``scale``: length of an arrow per pixel of motion; with 1 it ends there.
        """
        program = self._shaders.render("viewer/arrows.vert.glsl", "viewer/arrows.frag.glsl")
        cells = tuple(-(-n // ARROW_STEP_PX) for n in self.size)
        motion.use(0)
        program["motion"], program["size"], program["cells"] = 0, self.size, cells
        program["step_px"], program["arrow_color"], program["scale"] = ARROW_STEP_PX, ARROW_COLOR, scale
        self._begin()
        self._array(program).render(moderngl.LINES, vertices=6, instances=cells[0] * cells[1])

    def outline(self, ids: moderngl.Texture, selected: Array) -> None:
        """Outline pixels over the image whose value of ``ids`` is ``selected``, (D + 1,) bool by value."""
        bits = np.packbits(selected, bitorder="little").tobytes()
        program = self._shaders.render("viewer/fullscreen.vert.glsl", "viewer/outline.frag.glsl")
        program["ids"], program["outline_color"] = 0, OUTLINE_COLOR
        ids.use(0)
        self._begin()
        with Owner() as drawn:  # words of 32 bits
            drawn.own(self._gpu.ctx.buffer(bits + bytes(-len(bits) % 4))).bind_to_storage_buffer(0)
            self._array(program).render(moderngl.TRIANGLES, vertices=3)

    def read(self) -> Array:
        """The image, (h, w, 3) uint8, row 0 at the top."""
        width, height = self.size
        self._gpu.finish()  # Mesa 22's llvmpipe may read a texture before its last draw has finished
        # OpenGL's first row is the lowest one.
        return np.frombuffer(self.texture.read(), np.uint8).reshape(height, width, 4)[::-1, :, :3]

    def release(self) -> None:
        self._gpu.unbind_framebuffer()
        super().release()

    def _begin(self) -> None:
        ctx = self._gpu.ctx
        self._framebuffer.use()
        ctx.viewport = (0, 0, *self.size)
        ctx.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        if program.glo not in self._arrays:
            self._arrays[program.glo] = self.own(self._gpu.ctx.vertex_array(program, []))
        return self._arrays[program.glo]


TILES = ("previous", "reprojected", "current")
"""The images that show one pixel magnified: previous frame, reprojected history, current frame."""
Pixel = tuple[int, int]  # x, y up


class Magnifier(Owner):
    """Draws TILES from left to right into ``texture``, each ``side`` pixels of the image wide and high.

    The middle of the first is the history position, the middle of the others the pixel itself.
    """

    def __init__(self, gpu: Gpu):
        super().__init__()
        self._gpu = gpu
        self._display: Display | None = None
        self.side = 0

    @property
    def texture(self) -> moderngl.Texture | None:
        """The three images, RGBA8, (3 side, side) pixels; None before the first ``draw``."""
        return None if self._display is None else self._display.texture

    def draw(self, side: int, current: Content, history: Other | None, pixel: Pixel, at: Pixel | None) -> None:
        """``current``: the image, without comparison; ``history``: the same channel of the previous frame, with the
        motion to it; ``at``: its pixel, None where it has none."""
        if side != self.side:
            display = Display(self._gpu, (len(TILES) * side, side))
            self._display, self.side = self.own(display, instead_of=self._display), side
            self._display.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        off = replace(current, comparison="off", other=None)
        nothing = (off, (-side, -side))  # beside the image: black
        before = nothing if history is None or at is None else (_only(off, replace(history, motion=None)), at)
        moved = nothing if history is None else (_only(off, history), pixel)
        for i, (content, middle) in enumerate((before, moved, (off, pixel))):
            first = (middle[0] - side // 2, middle[1] - side // 2)
            self._display.draw(content, (i * side, 0, side, side), first)


def _only(current: Content, other: Other) -> Content:
    """``current`` with ``other`` in the place of its image, without masks."""
    return replace(current, comparison="other", other=other, shown=())


@dataclass(frozen=True, slots=True)
class Visualization:
    """How a channel is displayed.

    ``channel`` is the texture, displayed as ``kind`` (``metrics.display.KINDS``); ``needs`` are further channels;
    ``fixed`` is the automatic display range, None for smallest to largest value.
    """

    channel: str
    kind: str
    doc: str
    needs: tuple[str, ...] = ()
    fixed: tuple[float, float] | None = (0.0, 1.0)

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the source must have; it always has position and normal, the mask pass writes motion."""
        return tuple(n for n in (self.channel, *self.needs) if n not in ("position", "normal", "motion"))


DIRECT_LOBES = lobe_channels(SCENE_LOBES, ("direct",))
"""Channels of the lobes of direct light."""

VISUALIZATIONS: dict[str, Visualization] = {
    "color": Visualization("color", "encoded", "tone-mapped sRGB"),
    "direct": Visualization("direct", "radiance", "radiance after one bounce", fixed=None),
    "indirect": Visualization("indirect", "radiance", "radiance after two or more bounces", fixed=None),
    **{name: Visualization(name, "radiance", CHANNELS[name].doc, fixed=None) for name in DIRECT_LOBES},
    "emission": Visualization("emission", "radiance", "emitted radiance", fixed=None),
    "headlight": Visualization("normal", "headlight", "headlight shading"),
    "base_color": Visualization("base_color", "radiance", "base color"),
    "normal": Visualization("normal", "unit", "shading normal: x red, y green, z blue"),
    "geometric_normal": Visualization("geometric_normal", "unit", "triangle normal: x red, y green, z blue"),
    "material": Visualization("material", "vector", "metallic red, roughness green, occlusion blue"),
    "depth": Visualization("position", "depth", "planar depth", fixed=None),
    "position": Visualization("position", "vector", "position relative to the camera", fixed=None),
    "ids": Visualization("ids", "ids", "one color per object"),
    "motion": Visualization("motion", "motion", "motion vector: direction as hue, length as brightness", fixed=None),
    "vectors": Visualization("vectors", "motion", "motion vectors that the files have, as motion", fixed=None),
    "object_motion": Visualization(
        "prev_position",
        "object_motion",
        "motion vector without camera motion, pixels",
        needs=("prev_position",),
        fixed=None,
    ),
}

LIGHT = {"color": "color", "direct": "direct", "indirect": "indirect", "emission": "emission",
         **{name: CHANNEL_EFFECT.get(name, "direct") for name in DIRECT_LOBES}}  # fmt: skip
"""Visualization that shows light -> the effect that must be enabled for it."""


def visualizations_of_scene(effects: dict[str, Effect]) -> tuple[str, ...]:
    """Keys of the visualizations of a scene with these effects."""
    drawn = (n for n in VISUALIZATIONS if n != "vectors")
    return tuple(n for n in drawn if n not in LIGHT or effects[LIGHT[n]].enabled)


def visualizations_of_channels(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Keys of the visualizations of a source with fixed channels."""
    return tuple(n for n, p in VISUALIZATIONS.items() if set(p.channels) <= set(channels))

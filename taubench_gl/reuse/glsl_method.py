"""GLSL methods: generated shader text, and the textures, uniforms and dispatches of their passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import moderngl
import numpy as np

from taubench_gl.conventions import GUARD_PX, NOT_COMPARABLE, Reason
from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.pair_record import PAIR_FIELDS, pair_values
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import BUFFER, IMAGE, TEXTURE
from taubench_gl.gpu.layout import Field, Struct, column_major
from taubench_gl.gpu.shader import VERSION, Source, compile_compute, resolve
from taubench_gl.reuse.contract import (
    BLOCK_THREADS,
    FORMATS,
    REPORT_FORMAT,
    REPORTS,
    RESULT,
    RESULT_FORMAT,
    Format,
    Method,
    PassInfo,
    Value,
)
from taubench_gl.reuse.frame import INPUTS, FrameInputs, read_result
from taubench_gl.reuse.scene_light import SceneLight

FRAME = Struct(
    "ReuseFrame",
    *PAIR_FIELDS,
    Field("key_clip_from_key", "mat4", "key frame's clip from position relative to its camera, world axes"),
    Field("shown_clip_from_current", "mat4", "clip of the shown frame from position, world axes: its newest camera"),
    Field("key_delta", "vec4", "xyz: current - key frame's camera position, meters"),
    Field("size", "ivec4", "xy: pixels of the result; zw: of the inputs"),
    Field("jitter_px", "vec2", "pixels, sub-pixel offset of this frame's samples, +x right, +y up"),
    Field("prev_jitter_px", "vec2", "pixels, of the previous frame"),
    Field("time", "float", "seconds"),
    Field("exposure", "float", "factor applied to radiance, not to emission"),
    Field("near", "float", "meters, near plane of the current camera"),
    Field("prev_near", "float", "meters, near plane of the previous camera"),
    Field("index", "int", "number of the frame in its sequence"),
    Field("has_history", "uint", "1 if prev_ values are of the previous frame, 0 if they are zero (first frame, cut)"),
    Field("is_key", "uint", "1 if this frame is the key frame (methods that declare one)"),
    Field("key_age", "int", "frames since the key frame"),
    Field("phase", "float", "0: a rendered frame, else share of the interval between them (methods that generate)"),
)

Stored = moderngl.Texture | moderngl.Buffer
"""A history or buffer of a method: of pixels, or of records."""

_REJECT = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)
_CHANGED = int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR)
_INPUT_FORMAT = {(f.components, f.dtype): f for f in FORMATS.values()}
_SAMPLER = {"f": "sampler2D", "u": "usampler2D"}
_NEAREST_SURFACE = """\
// The pixel of the 3x3 neighborhood whose surface is nearest to the camera; p if none is nearer.
ivec2 nearest_surface(ivec2 p) {
    ivec2 found = p;
    float own = fetch_position(p).w, depth = own > 0.0 ? own : 1.0e30;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            float d = fetch_position(p + ivec2(x, y)).w;
            if (d > 0.0 && d < depth) { depth = d; found = p + ivec2(x, y); }
        }
    return clamp(found, ivec2(0), SIZE - 1);
}"""
_GRIDS = """\
ivec2 input_size() { return frame.size.zw; }
ivec2 output_size() { return frame.size.xy; }
vec2 output_scale() { return vec2(frame.size.xy) / vec2(frame.size.zw); }
vec2 input_from_output(vec2 at) { return (at + 0.5) / output_scale() - 0.5; }
vec2 output_from_input(vec2 at) { return (at + 0.5) * output_scale() - 0.5; }
// The input pixel that contains the center of pixel p of the result.
ivec2 input_pixel(ivec2 p) { return (2 * p + 1) * frame.size.zw / (2 * frame.size.xy); }"""
_SIZE = {"output": "xy", "input": "zw"}
_SWIZZLE = {1: "x", 2: "xy", 4: "xyzw"}


def format_of(method: Method, name: str) -> Format:
    """Format of anything that a pass can read or write."""
    if name in method.reads:
        return _INPUT_FORMAT[INPUTS[name].components, INPUTS[name].dtype]
    if name in REPORTS:
        return REPORT_FORMAT
    formats = {**method.history, **method.buffers, RESULT: RESULT_FORMAT}
    return formats[name if name in formats else name.removeprefix("prev_")]


def has_input_size(method: Method, name: str) -> bool:
    """Whether anything that a pass can read or write has the size of the inputs."""
    return name in method.reads or bool({name, name.removeprefix("prev_")} & method.input_sized)


@dataclass(frozen=True, slots=True)
class Variant:
    """How a pass is compiled.

    ``report``: store the outputs of REPORTS; without it, writing them does nothing.  ``light``: of the frames of a
    method with ``light = "own"``; ``count``: count its samples.
    """

    report: bool = False
    light: SceneLight | None = None
    count: bool = False

    def first(self, form: str) -> int:
        """The first binding that is free for a method, of textures, images or buffers."""
        return 0 if self.light is None else self.light.bound(form)


PLAIN = Variant()


def preamble(method: Method, info: PassInfo, variant: Variant = PLAIN) -> str:
    """GLSL text before the shader of ``info``: frame, settings, and functions to read and write by name."""
    report, places = variant.report, block_places(method, info, variant)
    lines = [FRAME.glsl]
    lines.append(f"layout(std430, binding = {places['frame']}) readonly buffer FrameBlock {{ ReuseFrame frame; }};")
    lines += [text for s in method.structs for text in s.glsl.splitlines()]
    size = f"frame.size.{_SIZE[info.size]}"
    lines += [f"const uint {bit.name} = {bit.value}u;" for bit in Reason]
    lines += [
        f"bool in_image(ivec2 p) {{ return all(greaterThanEqual(p, ivec2(0))) && all(lessThan(p, {size})); }}",
        f"bool inside(vec2 at) {{ return all(greaterThanEqual(at, vec2({-GUARD_PX}))) && "
        f"all(lessThanEqual(at, vec2({size} - 1) + {GUARD_PX})); }}",
    ]
    if info.block:
        lines.append(f"const ivec2 block_size = ivec2({info.block[0]}, {info.block[1]});")
        lines.append(f"const int block_threads = {BLOCK_THREADS};")
    pixel, step = "p", ""  # of the inputs, of a pixel of the pass; pixels of the pass for one of the inputs
    if method.upscales:
        lines += _GRIDS.splitlines()
        lines.append(f"ivec2 pass_size() {{ return {size}; }}")
        if info.size == "output":
            pixel, step = "input_pixel(p)", " * output_scale()"
    lines.append("uniform int iteration; // 0 .. repeat - 1")
    for s in method.settings.values():
        glsl = {"float": "float", "bool": "bool"}.get(s.kind, "int")
        lines.append(f"uniform {glsl} {s.name}; // {' '.join(s.doc.split())}")
        lines += [f"const int {s.name.upper()}_{c.upper()} = {i};" for i, c in enumerate(s.choices)]
    for name in info.reads:
        image_size = _SIZE["input" if method.upscales and has_input_size(method, name) else "output"]
        form = format_of(method, name)
        if form.struct is None:
            lines += _reader(name, form, f"frame.size.{image_size}")
        else:
            lines += _record_reader(name, form, f"frame.size.{image_size}", places[f"reads {name}"])
    if method.own_light:
        lines += _LIGHT_RESULT.replace("BINDING", str(variant.first(TEXTURE))).splitlines()
    for binding, name in enumerate(_images(method, info, report), variant.first(IMAGE)):
        lines += _writer(name, format_of(method, name), binding, method.own_light)
    for name in _records(method, info.writes):
        lines += _record_writer(name, format_of(method, name), size, places[f"writes {name}"])
    if variant.count:
        lines.append(
            f"layout(std430, binding = {places['counts']}) buffer LightCountsBuffer {{ uint light_counts[]; }};"
        )
    if not report:
        lines += [
            f"void write_{name}(ivec2 p, vec{n} v) {{}}" for name in info.writes if name in REPORTS for n in (3, 4)
        ]
    return "\n".join(lines + _conveniences(method, info, pixel, step))


def _conveniences(method: Method, info: PassInfo, pixel: str, step: str) -> list[str]:
    """GLSL functions that are there where a pass reads the inputs that they need.

    ``pixel``: the input pixel of pixel ``p`` of the pass; ``step``: factor from input pixels to pixels of the pass.
    """
    lines: list[str] = []
    masks = {"mask": ("", _REJECT), "exact_mask": ("_exact", _REJECT | _CHANGED), "eye_mask": ("_eye", _REJECT)}
    for name, (suffix, bits) in masks.items():
        if name in info.reads:
            there = "" if suffix == "_eye" else "frame.has_history == 1u && "
            lines.append(f"bool reusable{suffix}(ivec2 p) {{ return {there}(fetch_{name}({pixel}) & {bits}u) == 0u; }}")
    for name, function in (("motion", "previous_px"), ("eye_motion", "eye_px")):
        if name in info.reads:
            lines.append(f"vec2 {function}(ivec2 p) {{ return vec2(p) + fetch_{name}({pixel}){step}; }}")
    if "position" in info.reads:
        lines += _NEAREST_SURFACE.replace("SIZE", "frame.size.zw" if method.upscales else "frame.size.xy").splitlines()
    if "material" in info.reads:
        lines += [f"float {name}(ivec2 p) {{ return fetch_material({pixel}).{component}; }}"
                  for name, component in (("metallic", "x"), ("roughness", "y"))]  # fmt: skip
    if {"diffuse_albedo", "specular_albedo", "emitted"} <= set(info.reads):
        lines.append(f"vec3 remodulate(ivec2 p, vec3 diffuse, vec3 specular) {{ ivec2 i = {pixel}; return "
                     "diffuse * fetch_diffuse_albedo(i).rgb + specular * fetch_specular_albedo(i).rgb + "
                     "fetch_emitted(i).rgb; }")  # fmt: skip
    return lines


def _reader(name: str, form: Format, size: str) -> list[str]:
    swizzle, value = _SWIZZLE[form.components], form.glsl
    texture = f"{name}_texture"
    lines = [
        f"uniform {_SAMPLER[form.dtype[0]]} {texture};",
        f"{value} fetch_{name}(ivec2 p) {{ return texelFetch({texture}, "
        f"clamp(p, ivec2(0), {size} - 1), 0).{swizzle}; }}",
        f"{value} nearest_{name}(vec2 at) {{ return fetch_{name}(ivec2(floor(at + 0.5))); }}",
    ]
    if form.dtype[0] == "f":
        # In float32: texture units have weights in steps of 1/256, and a still pixel must be unchanged bit for bit.
        lines.append(
            f"{value} sample_{name}(vec2 at) {{ ivec2 b = ivec2(floor(at)); vec2 f = at - floor(at); "
            f"return mix(mix(fetch_{name}(b), fetch_{name}(b + ivec2(1, 0)), f.x), "
            f"mix(fetch_{name}(b + ivec2(0, 1)), fetch_{name}(b + ivec2(1, 1)), f.x), f.y); }}"
        )
        lines.append(
            f"{value} cubic_{name}(vec2 at) {{ ivec2 b = ivec2(floor(at)) - 1; vec2 f = at - floor(at); "
            f"vec4 wx = catmull_rom_weights(f.x), wy = catmull_rom_weights(f.y); {value} sum = {value}(0.0); "
            f"for (int j = 0; j < 4; ++j) for (int i = 0; i < 4; ++i) "
            f"sum += wx[i] * wy[j] * fetch_{name}(b + ivec2(i, j)); return sum; }}"
        )
        lines.append(
            f"{value} sample_{name}(vec2 at, int filtering) {{ return filtering == 0 ? nearest_{name}(at) : "
            f"filtering == 1 ? sample_{name}(at) : cubic_{name}(at); }}"
        )
    return lines


def _record_reader(name: str, form: Format, size: str, binding: int) -> list[str]:
    return [
        f"layout(std430, binding = {binding}) readonly buffer Read_{name} {{ {form.glsl} {name}_records[]; }};",
        f"{form.glsl} fetch_{name}(ivec2 p) {{ ivec2 q = clamp(p, ivec2(0), {size} - 1); "
        f"return {name}_records[q.y * {size}.x + q.x]; }}",
    ]


def _record_writer(name: str, form: Format, size: str, binding: int) -> list[str]:
    return [
        f"layout(std430, binding = {binding}) writeonly buffer Write_{name} {{ {form.glsl} {name}_written[]; }};",
        f"void write_{name}(ivec2 p, {form.glsl} v) {{ if (in_image(p)) {name}_written[p.y * {size}.x + p.x] = v; }}",
    ]


def _writer(name: str, form: Format, binding: int, own_light: bool = False) -> list[str]:
    image = f"{name}_image"
    prefix = "u" if form.dtype[0] == "u" else ""
    padded = {1: f"{prefix}vec4(v, 0, 0, 0)", 2: f"{prefix}vec4(v, 0, 0)", 4: "v"}[form.components]
    lines = [
        f"layout({form.name}, binding = {binding}) writeonly uniform {prefix}image2D {image};",
        f"void write_{name}(ivec2 p, {form.glsl} v) {{ imageStore({image}, p, {padded}); }}",
    ]
    if name in REPORTS:
        lines.append(f"void write_{name}(ivec2 p, vec3 v) {{ imageStore({image}, p, vec4(v, 1.0)); }}")
    if name == RESULT and own_light:
        lines[1] = f"void write_result(ivec2 p, vec4 v) {{ imageStore({image}, p, vec4(with_rest(p, v.rgb), v.a)); }}"
        lines.append(f"void write_result(ivec2 p, vec3 v) {{ imageStore({image}, p, vec4(with_rest(p, v), -1.0)); }}")
    elif name == RESULT:  # a = -1: the weight of history is not reported
        lines.append(f"void write_{name}(ivec2 p, vec3 v) {{ imageStore({image}, p, vec4(v, -1.0)); }}")
    return lines


_LIGHT_RESULT = """\
layout(binding = BINDING) uniform sampler2D light_rest;
// The image of direct light, exposure not applied: with the input's indirect light and emission, exposure applied.
vec3 with_rest(ivec2 p, vec3 direct) { return direct * frame.exposure + texelFetch(light_rest, p, 0).rgb; }"""
_COUNT = "for (int i = 0; i < 3; ++i) light_counts[3 * (p.y * SIZE.x + p.x) + i] += light_tally[i];"
_PIXEL_MAIN = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); if (all(lessThan(p, SIZE))) reuse(p); }"
_BLOCK_MAIN = "void main() { reuse_block(ivec2(gl_WorkGroupID.xy), int(gl_LocalInvocationID.x)); }"


def group_size(info: PassInfo, group: tuple[int, int]) -> tuple[int, int]:
    """Work group of a pass; ``group``: that of passes over pixels."""
    return (BLOCK_THREADS, 1) if info.block else group


def group_count(info: PassInfo, size: tuple[int, int], group: tuple[int, int]) -> tuple[int, int]:
    """Number of work groups of a pass.  Of blocks one more each way, so that a shifted grid covers the image."""
    step, border = (info.block, 1) if info.block else (group, 0)
    return -(-size[0] // step[0]) + border, -(-size[1] // step[1]) + border


def _images(method: Method, info: PassInfo, report: bool) -> tuple[str, ...]:
    """The outputs of a pass that have a texture."""
    records = _records(method, info.writes)
    return tuple(name for name in info.writes if (report or name not in REPORTS) and name not in records)


def reporting_passes(method: Method) -> tuple[PassInfo, ...]:
    """The passes that give REPORTS: from the first one to the last that writes some.

    A history, or the result, that they write and a later pass completes would not be whole again: then all passes.
    """
    last = max(index for index, info in enumerate(method.passes) if set(info.writes) & REPORTS.keys())
    some, others = method.passes[: last + 1], method.passes[last + 1 :]
    kept = {name for info in some for name in info.writes} & {*method.history, RESULT}
    return some if kept.isdisjoint(name for info in others for name in info.writes) else method.passes


def _records(method: Method, names: Sequence[str]) -> tuple[str, ...]:
    """The ``names`` among what a pass reads or writes that are buffers of records, not textures."""
    return tuple(name for name in names if format_of(method, name).struct is not None)


def block_places(method: Method, info: PassInfo, variant: Variant) -> dict[str, int]:
    """Binding points of the storage buffers of a pass."""
    names = ["frame", *(f"reads {n}" for n in _records(method, info.reads))]
    names += [f"writes {n}" for n in _records(method, info.writes)] + ["counts"] * variant.count
    return {name: place for place, name in enumerate(names, variant.first(BUFFER))}


def build_source(method: Method, info: PassInfo, group: tuple[int, int], variant: Variant = PLAIN) -> Source:
    """The complete shader of one pass.  Errors refer to file and line of the user.  Raises MethodError."""
    group = group_size(info, group)
    lines = [VERSION.rstrip("\n"), f"layout(local_size_x = {group[0]}, local_size_y = {group[1]}) in;"]
    origin = ["version", "group"]

    def append(text: str, names: Mapping[int, str] | tuple[str, ...]) -> None:
        lines.extend(text.splitlines())
        origin.extend(names)

    size = f"frame.size.{_SIZE[info.size]}"
    common = resolve("common/reuse.glsl") if variant.light is None else variant.light.text
    append("\n".join(common.text.splitlines()[1:]), common.origin[1:])
    generated = preamble(method, info, variant)
    append(generated, tuple(f"generated for {info.shader}, line {i}" for i in range(1, generated.count("\n") + 2)))
    try:
        shader = resolve(info.shader, roots=method.shader_folders)
    except GraphicsError as error:
        raise MethodError(error.what, where=method.label) from None
    append("\n".join(shader.text.splitlines()[1:]), tuple(f"{method.folder.name}/{o}" for o in shader.origin[1:]))
    main = _PIXEL_MAIN.replace("reuse(p);", f"{{ reuse(p); {_COUNT} }}") if variant.count else _PIXEL_MAIN
    append(_BLOCK_MAIN if info.block else main.replace("SIZE", size), ("main",))
    return Source("\n".join(lines) + "\n", tuple(origin))


class GlslPasses(GpuOwner):
    """Programs and textures of one method at one size.  Raises MethodError if a shader does not compile.

    ``size``: of the result; ``input_size``: of the inputs, another only for a method that upscales.
    """

    def __init__(
        self, gpu: Gpu, method: Method, size: tuple[int, int], input_size: tuple[int, int], count: bool = False
    ):
        """Compile the passes.  ``count``: count what a method with ``light = "own"`` samples.

        The programs of such a method depend on the scene, so they are compiled for the first frame.
        """
        super().__init__(gpu)
        self._method, self._variant = method, Variant(count=count and method.own_light)
        self._sizes = {"output": size, "input": input_size}
        self._group = Tuning(gpu.software).shading_group
        self._programs: list[moderngl.ComputeShader] = []
        self._reporting: list[moderngl.ComputeShader] = []  # the same passes, storing REPORTS; compiled on demand
        self._now: dict[str, Stored] = {}
        self._before: dict[str, Stored] = {}
        self._spare: dict[str, Stored] = {}
        self._key_view = None
        self._key_age = 0
        with self.opening():
            if not method.own_light:
                self._programs = [self._compile(info) for info in method.passes]
            if self._variant.count:
                self._counts = self.own(gpu.ctx.buffer(reserve=12 * size[0] * size[1]))
            self._parameters = self.own(gpu.ctx.buffer(reserve=FRAME.dtype.itemsize))
            for name, form in {**method.history, **method.buffers, RESULT: RESULT_FORMAT}.items():
                image_size = self._sizes["input" if name in method.input_sized else "output"]
                self._now[name] = self._texture(form, image_size)
                if name in method.history:
                    self._before[name] = self._texture(form, image_size)
                if name in method.spares:
                    self._spare[name] = self._texture(form, image_size)

    def _compile(self, info: PassInfo, report: bool = False) -> moderngl.ComputeShader:
        source = build_source(self._method, info, self._group, replace(self._variant, report=report))
        try:
            return self.own(compile_compute(self.gpu.ctx, source))
        except GraphicsError as error:
            message = error.what.removesuffix("; candidates are:")  # a list follows, too long for one line
            raise MethodError(message, where=self._method.label) from None

    def _texture(self, form: Format, size: tuple[int, int]) -> Stored:
        if form.struct is not None:
            return self.own(self.gpu.ctx.buffer(reserve=form.bytes * size[0] * size[1]))
        return self.own(self.gpu.texture(size, form.components, form.dtype))

    def clear(self) -> None:
        """Set all history, buffers and the result to 0; the next frame is a key frame."""
        self._key_view = None
        for stored in (*self._now.values(), *self._before.values(), *self._spare.values()):
            if isinstance(stored, moderngl.Buffer):
                stored.clear()
                continue
            width, height = stored.size
            stored.write(np.zeros((height, width * stored.components), dtype=stored.dtype))

    def run(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> moderngl.Texture:
        """Run all passes for one frame.  -> the result.  Swaps the histories: they are ``prev_`` in the next frame."""
        self._write_frame(frame, values, has_history)
        if frame.light is not self._variant.light and self._method.own_light:
            self._variant = replace(self._variant, light=frame.light)
            self._require_bindings()
            self._programs, self._reporting = [self._compile(info) for info in self._method.passes], []
        if self._variant.count:
            self._counts.clear()
        self._run_passes(self._method.passes, self._programs, frame, values)
        self._swap()
        return self._now[RESULT]

    def _run_passes(
        self, passes: Sequence[PassInfo], programs: Sequence[moderngl.ComputeShader], frame: FrameInputs,
        values: Mapping[str, Value], report: bool = False,
    ) -> None:  # fmt: skip
        for info, program in zip(passes, programs, strict=True):
            self._set(program, {name: s.number(values[name]) for name, s in self._method.settings.items()})
            for iteration in range(self._method.number(info.repeat, values)):
                self._set(program, {"iteration": iteration})
                self._dispatch(info, program, frame, report)

    def _swap(self) -> None:
        """Histories of this frame become those of the previous frame."""
        for name in self._method.history:
            self._now[name], self._before[name] = self._before[name], self._now[name]

    def reported(self, frame: FrameInputs, values: Mapping[str, Value]) -> dict[str, np.ndarray]:
        """The outputs of REPORTS of the last ``run``, (h, w, 4) float32, row 0 at the top.

        Runs ``reporting_passes`` once more over the same histories, so that storing the outputs takes no time from
        ``run``.
        """
        if not self._method.reports:
            return {}
        passes = reporting_passes(self._method)
        if not self._reporting:
            self._reporting = [self._compile(info, report=True) for info in passes]
            self._now |= {name: self._texture(REPORT_FORMAT, self._sizes["output"]) for name in self._method.reports}
        # The histories of this frame are those of the previous one already: back, so that the passes read what they
        # read in ``run``, and forward again.
        self._swap()
        self._run_passes(passes, self._reporting, frame, values, report=True)
        self._swap()
        return {name: read_result(self._now[name]) for name in self._method.reports}

    def _dispatch(
        self, info: PassInfo, program: moderngl.ComputeShader, frame: FrameInputs, report: bool = False
    ) -> None:
        variant = self._variant
        unit = variant.first(TEXTURE)
        if variant.light is not None:
            variant.light.bind()
            variant.light.rest.use(unit)
            unit += 1
        self._bind_buffers(info)
        for name in info.reads:
            if f"{name}_texture" in program:  # GL removes unused uniforms
                self._readable(name, frame).use(unit)
                program[f"{name}_texture"] = unit
                unit += 1
        for binding, name in enumerate(_images(self._method, info, report), variant.first(IMAGE)):
            self._target(name, info).bind_to_image(binding, read=False, write=True)
        program.run(*group_count(info, self._sizes[info.size], self._group))
        self.gpu.ctx.memory_barrier()
        # A name that the pass both reads and writes has two textures: what it wrote is what the next pass reads.
        for name in info.writes:
            if name in info.reads:
                self._now[name], self._spare[name] = self._spare[name], self._now[name]

    def _require_bindings(self) -> None:
        """Raise MethodError where a pass and the light of its scene need more than the device has."""
        limits, variant = self.gpu.ctx.info, self._variant
        for info in self._method.passes:
            textures = [name for name in info.reads if name not in _records(self._method, info.reads)]
            for kind, needed, limit in (
                ("textures", variant.first(TEXTURE) + 1 + len(textures), limits["GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS"]),
                ("buffers", max(block_places(self._method, info, variant).values()) + 1,
                 limits["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"]),
            ):  # fmt: skip
                if needed > limit:
                    message = f"{info.shader} needs {needed} {kind} in this scene, the device has {limit}"
                    raise MethodError(message, where=self._method.label, hint="read less in a pass")

    def _bind_buffers(self, info: PassInfo) -> None:
        places = block_places(self._method, info, self._variant)
        self._parameters.bind_to_storage_buffer(places["frame"])
        for name in _records(self._method, info.reads):
            self._readable(name).bind_to_storage_buffer(places[f"reads {name}"])
        for name in _records(self._method, info.writes):
            self._target(name, info).bind_to_storage_buffer(places[f"writes {name}"])
        if self._variant.count:
            self._counts.bind_to_storage_buffer(places["counts"])

    def _target(self, name: str, info: PassInfo) -> Stored:
        """What a pass writes: a second one where it reads the same name."""
        return (self._spare if name in info.reads else self._now)[name]

    def _readable(self, name: str, frame: FrameInputs | None = None) -> Stored:
        if name in self._now:
            return self._now[name]
        history = name.removeprefix("prev_")
        return self._before[history] if history in self._before else frame.textures[name]

    def records(self, name: str) -> np.ndarray:
        """A history of records as the last frame left it, (h, w), row 0 at the top."""
        struct, (width, height) = self._method.history[name].struct, self._sizes["output"]
        # GL's row 0 is at the bottom
        return np.frombuffer(self._before[name].read(), struct.dtype).reshape(height, width)[::-1]

    def light_counts(self) -> np.ndarray:
        """What the last frame sampled in each pixel, as ``MethodRunner.light_counts``."""
        width, height = self._sizes["output"]
        # GL's row 0 is at the bottom
        return np.frombuffer(self._counts.read(), np.uint32).reshape(height, width, 3)[::-1]

    @staticmethod
    def _set(program: moderngl.ComputeShader, uniforms: Mapping[str, float | int | bool]) -> None:
        for name, value in uniforms.items():
            if name in program:
                program[name] = value

    def _write_frame(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> None:
        pair, record = frame.pair, FRAME.zeros()
        every = self._method.number(self._method.keyframe, values)
        if every is not None:
            self._key_age += 1
            if self._key_view is None or not has_history or self._key_age >= every:
                self._key_view, self._key_age = frame.view, 0
            record["key_clip_from_key"] = column_major(self._key_view.clip_from_relative(*self._sizes["input"]))
            record["key_delta"][:3] = frame.view.position - self._key_view.position
            record["is_key"], record["key_age"] = self._key_age == 0, self._key_age
        for name, value in pair_values(pair).items():
            record[name] = value
        record["size"][:2], record["size"][2:] = self._sizes["output"], self._sizes["input"]
        record["jitter_px"], record["prev_jitter_px"] = frame.jitter_px, frame.prev_jitter_px
        record["shown_clip_from_current"] = column_major(frame.shown_clip_from_current(*self._sizes["input"]))
        record["phase"] = frame.phase
        record["time"], record["exposure"] = frame.time, frame.exposure
        record["near"], record["prev_near"] = pair.near, pair.prev_near
        record["index"], record["has_history"] = frame.index, has_history
        self._parameters.write(record.tobytes())

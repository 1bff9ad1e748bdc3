"""GLSL that a method's shader finds in place: frame constants, settings, and functions to read and write by name."""

from __future__ import annotations

from collections.abc import Mapping

from taubench_gl.conventions import GUARD_PX, NOT_COMPARABLE, Reason
from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shader import VERSION, Source, resolve
from taubench_gl.reuse.contract import FORMATS, RESULT, RESULT_FORMAT, Format, Method, PassInfo
from taubench_gl.reuse.frame import INPUTS

FRAME = Struct(
    "ReuseFrame",
    Field("clip_from_current", "mat4", "clip <- relative to the current camera, world axes"),
    Field("prev_clip_from_prev", "mat4", "previous clip <- relative to the previous camera, world axes"),
    Field("key_clip_from_key", "mat4", "key frame's clip <- relative to the key frame's camera, world axes"),
    Field("sky_origin", "vec4", "view ray of pixel (0, 0), world axes; w = 0 direction, 1 far-plane point"),
    Field("sky_dx", "vec4", "its step per pixel to the right"),
    Field("sky_dy", "vec4", "its step per pixel up"),
    Field("prev_forward", "vec4", "xyz: unit, where the previous camera looked"),
    Field("camera_delta", "vec4", "xyz: current - previous camera position, metres"),
    Field("key_delta", "vec4", "xyz: current - key frame's camera position, metres"),
    Field("size", "ivec4", "xy: pixels"),
    Field("jitter_px", "vec2", "pixels, sub-pixel offset of this frame's samples, +x right, +y up"),
    Field("prev_jitter_px", "vec2", "pixels, of the last frame's"),
    Field("time", "float", "seconds"),
    Field("exposure", "float", "factor already on radiance, not on emission"),
    Field("near", "float", "metres, current camera's near plane"),
    Field("prev_near", "float", "metres, previous camera's near plane"),
    Field("index", "int", "number of the frame in its sequence"),
    Field("has_history", "uint", "1 if prev_ values are the last frame's, 0 if they are zeros (first frame, cut)"),
    Field("is_key", "uint", "1 if this frame is the key frame (methods that declare one)"),
    Field("key_age", "int", "frames since the key frame"),
)

_REJECT = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)
_CHANGED = int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR)
_INPUT_FORMAT = {(f.components, f.dtype): f for f in FORMATS.values()}
_SAMPLER = {"f": "sampler2D", "u": "usampler2D"}
_NEAREST_SURFACE = """\
// The pixel of the 3x3 neighborhood whose surface is nearest to the camera; p itself where none is nearer.
ivec2 nearest_surface(ivec2 p) {
    ivec2 found = p;
    float own = fetch_position(p).w, depth = own > 0.0 ? own : 1.0e30;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            float d = fetch_position(p + ivec2(x, y)).w;
            if (d > 0.0 && d < depth) { depth = d; found = p + ivec2(x, y); }
        }
    return clamp(found, ivec2(0), frame.size.xy - 1);
}"""
_SWIZZLE = {1: "x", 2: "xy", 4: "xyzw"}


def format_of(method: Method, name: str) -> Format:
    """Of anything a pass can read or write."""
    if name in INPUTS:
        return _INPUT_FORMAT[INPUTS[name].components, INPUTS[name].dtype]
    kept = {**method.history, **method.buffers, RESULT: RESULT_FORMAT}
    return kept[name if name in kept else name.removeprefix("prev_")]


def preamble(method: Method, info: PassInfo) -> str:
    """GLSL text in front of the shader of ``info``."""
    lines = [FRAME.glsl, "layout(std430, binding = 0) readonly buffer FrameBlock { ReuseFrame frame; };"]
    lines += [f"const uint {bit.name} = {bit.value}u;" for bit in Reason]
    lines += [
        "bool in_picture(ivec2 p) { return all(greaterThanEqual(p, ivec2(0))) && all(lessThan(p, frame.size.xy)); }",
        f"bool inside(vec2 at) {{ return all(greaterThanEqual(at, vec2({-GUARD_PX}))) && "
        f"all(lessThanEqual(at, vec2(frame.size.xy - 1) + {GUARD_PX})); }}",
    ]
    lines.append("uniform int iteration; // 0 .. repeat - 1")
    for s in method.settings.values():
        glsl = {"float": "float", "bool": "bool"}.get(s.kind, "int")
        lines.append(f"uniform {glsl} {s.name}; // {' '.join(s.doc.split())}")
        lines += [f"const int {s.name.upper()}_{c.upper()} = {i};" for i, c in enumerate(s.choices)]
    for name in info.reads:
        lines += _reader(name, format_of(method, name))
    for binding, name in enumerate(info.writes):
        lines += _writer(name, format_of(method, name), binding)
    for name, bits in (("mask", _REJECT), ("truth_mask", _REJECT | _CHANGED)):
        if name in info.reads:
            end = "" if name == "mask" else "_in_truth"
            lines.append(f"bool reusable{end}(ivec2 p) {{ return frame.has_history == 1u && "
                         f"(fetch_{name}(p) & {bits}u) == 0u; }}")  # fmt: skip
    if "motion" in info.reads:
        lines.append("vec2 previous_px(ivec2 p) { return vec2(p) + fetch_motion(p); }")
    if "position" in info.reads:
        lines += _NEAREST_SURFACE.splitlines()
    return "\n".join(lines)


def _reader(name: str, form: Format) -> list[str]:
    swizzle, value = _SWIZZLE[form.components], form.glsl
    texture = f"{name}_texture"
    lines = [
        f"uniform {_SAMPLER[form.dtype[0]]} {texture};",
        f"{value} fetch_{name}(ivec2 p) {{ return texelFetch({texture}, "
        f"clamp(p, ivec2(0), frame.size.xy - 1), 0).{swizzle}; }}",
        f"{value} nearest_{name}(vec2 at) {{ return fetch_{name}(ivec2(floor(at + 0.5))); }}",
    ]
    if form.dtype[0] == "f":
        # By hand in float32: texture units weigh in steps of 1/256, and a still pixel must come back bit for bit.
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


def _writer(name: str, form: Format, binding: int) -> list[str]:
    image = f"{name}_image"
    prefix = "u" if form.dtype[0] == "u" else ""
    padded = {1: f"{prefix}vec4(v, 0, 0, 0)", 2: f"{prefix}vec4(v, 0, 0)", 4: "v"}[form.components]
    lines = [
        f"layout({form.name}, binding = {binding}) writeonly uniform {prefix}image2D {image};",
        f"void write_{name}(ivec2 p, {form.glsl} v) {{ imageStore({image}, p, {padded}); }}",
    ]
    if name == RESULT:  # a = -1: the method does not say how much of this is history
        lines.append(f"void write_{name}(ivec2 p, vec3 v) {{ imageStore({image}, p, vec4(v, -1.0)); }}")
    return lines


def build_source(method: Method, info: PassInfo, group: tuple[int, int]) -> Source:
    """The whole shader of one pass; faults in it are told by the user's own file and line.  Raises MethodError."""
    lines = [VERSION.rstrip("\n"), f"layout(local_size_x = {group[0]}, local_size_y = {group[1]}) in;"]
    origin = ["version", "group"]

    def append(text: str, names: Mapping[int, str] | tuple[str, ...]) -> None:
        lines.extend(text.splitlines())
        origin.extend(names)

    common = resolve("common/reuse.glsl")
    append("\n".join(common.text.splitlines()[1:]), common.origin[1:])
    generated = preamble(method, info)
    append(generated, tuple(f"what {info.shader} is given, line {i}" for i in range(1, generated.count("\n") + 2)))
    try:
        own = resolve(info.shader, root=method.folder)
    except GraphicsError as error:
        raise MethodError(error.what, where=method.label) from None
    append("\n".join(own.text.splitlines()[1:]), tuple(f"{method.folder.name}/{o}" for o in own.origin[1:]))
    append(
        "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); if (all(lessThan(p, frame.size.xy))) reuse(p); }",
        ("main",),
    )
    return Source("\n".join(lines) + "\n", tuple(origin))

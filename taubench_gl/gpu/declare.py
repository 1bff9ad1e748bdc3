"""Passes declared once.  No OpenGL.

A declaration yields the shader's interface and bindings, the dispatch size, the barriers, the check of the order of
passes, the resources that a frame allocates, and which effects depend on which.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from taubench_gl.gpu.layout import Struct

TEXTURE, IMAGE, BUFFER, CONSTANTS = "texture", "image", "buffer", "constants"
READ, WRITE, UPDATE = "read", "write", "update"
_COMPONENT_BYTES = {"f4": 4, "f2": 2, "u4": 4, "f1": 1}


@dataclass(frozen=True, slots=True)
class Resource:
    """A texture or buffer that a pass owns; a frame allocates it and counts its bytes."""

    name: str
    bytes: int
    label: str  # what `inspect` calls it; resources that share a label are listed as one
    size: tuple[int, int] | None = None  # texels; None: a buffer
    components: int = 4
    dtype: str = "f4"  # as moderngl, or "depth": 32-bit float depth
    what: str = ""  # what it is, in the error of a device that has no room for it
    hint: str = ""  # what to do, in that error

    @classmethod
    def texture(
        cls,
        name: str,
        size: tuple[int, int],
        *,
        components: int = 4,
        dtype: str = "f4",
        label: str = "",
        what: str = "",
        hint: str = "",
    ) -> Resource:
        """A texture of ``size`` texels that the frame allocates; ``label``: ``name`` if empty."""
        texel = 4 if dtype == "depth" else components * _COMPONENT_BYTES[dtype]
        return cls(name, texel * size[0] * size[1], label or name, size, components, dtype, what, hint)

    @classmethod
    def buffer(cls, name: str, size: int, *, label: str = "", what: str = "", hint: str = "") -> Resource:
        """A buffer of ``size`` bytes that the frame allocates; ``label``: ``name`` if empty."""
        return cls(name, size, label or name, what=what, hint=hint)


@dataclass(frozen=True, slots=True)
class Use:
    """One resource as one pass has it."""

    form: str  # TEXTURE | IMAGE | BUFFER | CONSTANTS
    name: str  # name in the shader
    type: str  # sampler type, image format, element type of a buffer, or struct of constants
    access: str = READ
    resource: str = ""  # name in the frame; "": as ``name``
    history: bool = False  # a channel of the frame before
    filled: bool = False  # a table that the CPU fills, so that no pass has to write it
    count: int = 0  # > 0: constants are an array

    @property
    def key(self) -> str:
        """The resource by the name under which a frame holds it."""
        return ("history_" if self.history else "") + (self.resource or self.name)

    @property
    def reads(self) -> bool:
        return self.access != WRITE

    @property
    def writes(self) -> bool:
        return self.access != READ

    def glsl(self, binding: int) -> str:
        """The declaration in GLSL, and ``<name>_at(texel)`` for what is read texel by texel."""
        layout = f"layout(binding = {binding})"
        if self.form == TEXTURE:
            return f"{layout} uniform {self.type} {self.name};\n{self._accessor('texelFetch', ', 0')}"
        if self.form == IMAGE:
            qualifier = {READ: "readonly ", WRITE: "writeonly ", UPDATE: ""}[self.access]
            kind = "uimage2D" if self.type.endswith("ui") else "image2D"
            text = f"layout({self.type}, binding = {binding}) {qualifier}uniform {kind} {self.name};"
            return f"{text}\n{self._accessor('imageLoad', '')}" if self.reads else text
        block = self.name.title().replace("_", "")
        if self.form == BUFFER:
            qualifier = {READ: "readonly", WRITE: "writeonly", UPDATE: "coherent"}[self.access]
            layout = f"layout(std430, binding = {binding}) {qualifier}"
            return f"{layout} buffer {block}Buffer {{ {self.type} {self.name}[]; }};"
        array = f"[{self.count}]" if self.count else ""
        return f"layout(std140, binding = {binding}) uniform {block}Constants {{ {self.type} {self.name}{array}; }};"

    def _accessor(self, function: str, rest: str) -> str:
        return f"#define {self.name}_at(texel) {function}({self.name}, texel{rest})"


Fill = Callable[[Any], Any]
"""Values of constants for one frame: a mapping of fields, or rows of an array."""


@dataclass(slots=True)
class Pass:
    """A pass, built up call by call.  Every method returns the pass.

    Bindings are numbered in the order of declaration, each form from 0, so no two uses of a form share one.
    """

    name: str  # as timers and `inspect` call it; several dispatches may share it
    shaders: tuple[str, ...]  # entry points: one of a compute pass, vertex and fragment of a raster pass
    uses: list[Use] = field(default_factory=list)
    resources: list[Resource] = field(default_factory=list)
    defines: dict[str, object] = field(default_factory=dict)
    text: list[str] = field(default_factory=list)  # GLSL structs and constants derived in Python
    fills: dict[str, tuple[Struct, Fill]] = field(default_factory=dict)

    def define(self, **values: object) -> Self:
        """Add macros; the names of those that are true are part of the variant's name."""
        self.defines |= values
        return self

    def glsl(self, *text: str | Struct) -> Self:
        """Add GLSL that the shader needs before its own text."""
        for part in text:
            part = part.glsl if isinstance(part, Struct) else part
            if part not in self.text:
                self.text.append(part)
        return self

    def constants(self, name: str, struct: Struct, fill: Fill, *, count: int = 0) -> Self:
        """Add a uniform block.  ``fill(frame)``: its values; ``count`` > 0: an array of so many records."""
        self.glsl(struct)
        self.fills[name] = struct, fill
        return self.use(Use(CONSTANTS, name, struct.name, count=count, filled=True))

    def use(self, *uses: Use) -> Self:
        for use in uses:
            if any(other.name == use.name for other in self.uses):
                raise ValueError(f"pass {self.name} declares {use.name} twice")
            self.uses.append(use)
        return self

    def texture(
        self, name: str, kind: str = "sampler2D", *, resource: str = "", history: bool = False, filled: bool = False
    ) -> Self:
        """Add a texture to read through a sampler; keywords as in ``Use``."""
        return self.use(Use(TEXTURE, name, kind, READ, resource, history, filled))

    def image(
        self, name: str, form: str = "rgba32f", *, access: str = READ, resource: str = "", filled: bool = False
    ) -> Self:
        """Add an image, whose texels are read or written one by one; keywords as in ``Use``."""
        return self.use(Use(IMAGE, name, form, access, resource, filled=filled))

    def buffer(
        self, name: str, element: str | Struct, *, access: str = READ, resource: str = "", filled: bool = False
    ) -> Self:
        """Add a shader storage buffer, an array of ``element``; keywords as in ``Use``."""
        if isinstance(element, Struct):
            self.glsl(element)
            element = element.name
        return self.use(Use(BUFFER, name, element, access, resource, filled=filled))

    def allocate(self, *resources: Resource) -> Self:
        """Add resources that exist because of this pass: a frame that has it allocates them."""
        self.resources += resources
        return self

    @property
    def reads(self) -> tuple[str, ...]:
        """Resources of this frame that some pass must have written before."""
        return tuple(u.key for u in self.uses if u.access == READ and not u.filled and not u.history)

    @property
    def history(self) -> tuple[str, ...]:
        """Channels of the frame before that the pass reads."""
        return tuple(u.resource or u.name for u in self.uses if u.history)

    @property
    def writes(self) -> tuple[str, ...]:
        return tuple(u.key for u in self.uses if u.writes)

    def bindings(self) -> list[tuple[Use, int]]:
        """Every use with its unit or binding point."""
        numbers: dict[str, int] = {}
        out = []
        for use in self.uses:
            out.append((use, numbers.get(use.form, 0)))
            numbers[use.form] = numbers.get(use.form, 0) + 1
        return out

    def interface(self) -> str:
        """GLSL that declares everything the shader may name."""
        return "\n".join([*self.text, *(use.glsl(binding) for use, binding in self.bindings())])

    def variants(self) -> Iterable[str]:
        """Shader programs of this pass, by name."""
        yield variant_name(self.shaders, self.defines)


def variant_name(shaders: Sequence[str], defines: Mapping[str, object]) -> str:
    """Entry points with the macros that are on."""
    on = sorted(name for name, value in defines.items() if value is True)
    return " + ".join(shaders) + (f" [{' '.join(on)}]" if on else "")


@dataclass(slots=True)
class ComputePass(Pass):
    """A pass of one compute shader."""

    invocations: tuple[int, int] = (1, 1)
    group: tuple[int, int] = (1, 1)
    each: int = 1  # invocations' worth of work along x that one invocation does

    def dispatch(self, invocations: tuple[int, int] | int, group: tuple[int, int] | int, each: int = 1) -> Self:
        """Set the size of the dispatch.  ``invocations``: pieces of work, one number or (columns, rows); ``group``:
        work-group size.
        """
        self.invocations = (invocations, 1) if isinstance(invocations, int) else invocations
        self.group = (group, 1) if isinstance(group, int) else group
        self.each = each
        return self

    @property
    def groups(self) -> tuple[int, int]:
        return -(-self.invocations[0] // (self.group[0] * self.each)), -(-self.invocations[1] // self.group[1])

    def interface(self) -> str:
        size = f"layout(local_size_x = {self.group[0]}, local_size_y = {self.group[1]}) in;"
        sizes = f"const int GROUP_X = {self.group[0]}, PIXELS_EACH = {self.each};" if self.each > 1 else ""
        return "\n".join(filter(None, (size, sizes, Pass.interface(self))))


@dataclass(slots=True)
class RasterPass(Pass):
    """A pass that draws geometry.  Each group of draws has a variant of its shaders; all share one interface."""

    outputs: list[tuple[str, str, str]] = field(default_factory=list)  # name, GLSL type, resource of each attachment
    drawn: list[Mapping[str, object]] = field(default_factory=list)  # macros of every variant that the scene needs

    def attachment(self, name: str, kind: str = "vec4", resource: str = "") -> Self:
        """Add a render target; its location is the order of declaration.  The fragment shader has it as
        ``out_<name>``.
        """
        self.outputs.append((name, kind, resource or name))
        return self

    def fragment_outputs(self) -> str:
        return "\n".join(f"layout(location = {i}) out {o[1]} out_{o[0]};" for i, o in enumerate(self.outputs))

    @property
    def writes(self) -> tuple[str, ...]:
        return (*(resource for _, _, resource in self.outputs), *Pass.writes.fget(self))

    def variants(self) -> Iterable[str]:
        for defines in self.drawn:
            yield variant_name(self.shaders, {**self.defines, **defines})


Declare = Callable[[Any], Sequence[Pass]]


@dataclass(frozen=True, slots=True)
class Stage:
    """Passes that exist together.  ``effects``: all must be enabled, the first is what the stage is for;
    ``options``: effects that change what the passes do."""

    declare: Declare
    effects: tuple[str, ...] = ()
    options: tuple[str, ...] = ()

    def __call__(self, spec: Any) -> Sequence[Pass]:
        """The passes for ``spec``, which has ``enabled``, the names of the enabled effects."""
        return self.declare(spec) if set(self.effects) <= spec.enabled else ()


def stage(*effects: str, options: Iterable[str] = ()) -> Callable[[Declare], Stage]:
    """Make a function that declares passes into a Stage."""
    return lambda declare: Stage(declare, effects, tuple(options))


def dependencies(stages: Iterable[Stage]) -> dict[str, frozenset[str]]:
    """What each effect depends on: it has nothing to work on while one of those is disabled.

    The first effect of a stage depends on the stage's other effects.  An effect that is only an option depends on the
    effects that all stages with that option have in common.
    """
    stages = tuple(stages)
    out: dict[str, frozenset[str]] = {}
    for s in stages:
        if s.effects:
            effect, *needed = s.effects
            out[effect] = out.get(effect, frozenset()) | frozenset(needed)
    for option in {o for s in stages for o in s.options} - out.keys():
        known = [frozenset(s.effects) for s in stages if option in s.options]
        out[option] = frozenset.intersection(*known)
    return out


def without_dependents(enabled: Iterable[str], depends: Mapping[str, frozenset[str]]) -> frozenset[str]:
    """``enabled`` less the effects that depend on a disabled one."""
    left = frozenset(enabled)
    while True:
        kept = frozenset(e for e in left if depends.get(e, frozenset()) <= left)
        if kept == left:
            return left
        left = kept


def order_faults(passes: Iterable[Pass]) -> list[str]:
    """Everything wrong with the order of ``passes``; empty where a frame can run."""
    passes, faults = tuple(passes), []
    written: dict[str, str] = {}
    for p in passes:
        faults += [f"{p.name} reads {name}, which no pass before it writes" for name in p.reads if name not in written]
        for use in (u for u in p.uses if u.access == WRITE):
            if written.get(use.key, p.name) != p.name:
                faults.append(f"{p.name} writes {use.key}, which {written[use.key]} has written")
        written |= dict.fromkeys(p.writes, p.name)
    faults += [
        f"{p.name} reads {name} of the frame before, which no pass writes"
        for p in passes
        for name in p.history
        if name not in written
    ]
    return faults

"""The mask pass: reprojection, reason bits and their counts in one compute dispatch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypedDict, Unpack

import numpy as np

from taubench_gl import conventions
from taubench_gl.conventions import HISTOGRAM_BINS, HISTOGRAM_MANTISSA_BITS, Reason
from taubench_gl.features import FEATURE, FEATURES, GEOMETRY, LIGHT_FEATURES, MASK_WORDS, OTHERS, TABLE, VALUES, Feature
from taubench_gl.frame.pair_record import PAIR_FIELDS, pair_values
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import IMAGE, READ, TEXTURE, UPDATE, WRITE, ComputePass, Pass, Use, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import CompiledCompute, GpuContext
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.reprojection import NEAR_GUARD, Reprojection
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    import moderngl

REPROJECTION = Struct(
    "Reprojection",
    *PAIR_FIELDS,
    Field("size", "ivec4", "xy: pixels; z: 0"),
    Field("prev_near", "float", "meters, previous camera's near plane minus NEAR_GUARD"),
    Field("near", "float", "meters, current camera's near plane"),
    Field("guard_px", "float", "pixels, guard of the outside test"),
    *(Field(f"threshold_{f.name}", "float", f"{f.distance.value}; {f.unit}") for f in TABLE),
    Field("exposure", "float", "factor on direct and indirect radiance before they are compared"),
    Field("declared", "uint", "FIRST or CUT for the whole frame, else 0"),
)


class ComparedSource(Protocol):
    """What of a source of frames (``frame.sources.Source``) decides how its pairs are compared."""

    size: tuple[int, int]
    reprojection: str  # camera | motion
    radiance: tuple[str, ...]
    others: tuple[str, ...]
    cuts: bool


class Comparison(TypedDict, total=False):
    """Keywords of ``MaskPass.for_source`` that evaluators of pairs pass on."""

    reprojection: str | None  # camera | motion; None: that of the source
    radiance: tuple[str, ...] | None  # light features to compare; None: those of the source
    images: bool  # mask and motion are written, False
    distances: bool  # also the distances of every pixel, False
    absent: bool  # surfaces that ``ids`` mark as ABSENT are CUT, False
    both: bool  # the other reprojection is counted too, False


@dataclass(frozen=True, slots=True)
class MaskOptions:
    """What the mask pass compares, and what it writes besides counts."""

    reprojection: str = "camera"  # camera | motion
    sampling: str = "nearest"  # nearest | bilinear
    radiance: tuple[str, ...] = ()  # of LIGHT_FEATURES
    others: tuple[str, ...] = ()  # of OTHERS
    cuts: bool = False  # channel ``ids`` marks surfaces without history
    absent: bool = False  # and surfaces that are ABSENT in the other frame, which are CUT too
    both: bool = False  # also counts the masks of the other reprojection
    write_mask: bool = False
    write_motion: bool = False
    write_distances: bool = False  # channels ``distances`` and ``changes`` of masks.comp.glsl

    @property
    def values(self) -> tuple[Feature, ...]:
        """What is compared besides position and normal, in the order of the bits."""
        return tuple(FEATURE[name] for name in VALUES if name in self.radiance or name in self.others)

    def geometry(self) -> list[Use]:
        """Geometry channels that the pass reads, declared as samplers."""
        names = [Use(TEXTURE, name, "sampler2D") for name in ("position", "normal")]
        names += [Use(TEXTURE, f"history_{n.name}", "sampler2D", READ, n.name, history=True) for n in names]
        motion = self.both or self.reprojection == "motion"
        return names + [Use(TEXTURE, "prev_position", "sampler2D")] * motion


_PLACES = [*(("distances", i) for i in range(4)), ("changes", 0), ("changes", 3)]


def _places(features: Sequence[str]) -> dict[str, tuple[str, int]]:
    """Name of a feature -> its place.  Raises IndexError for a seventh, which needs another texture."""
    return {name: _PLACES[i] for i, name in enumerate(features)}


PLACES = _places((*GEOMETRY, *VALUES))
"""Texture and component into which the distance of each feature is written."""


def _each_value(features: Sequence[Feature]) -> str:
    """The macro that expands VALUE for each feature: index, now, before, distance, limit, bit, histogram, place."""
    return " ".join(
        f"VALUE({i}, {f.channel}_at(at).{f.part}, history_{f.channel}_at(at).{f.part}, distance_{f.name}, "
        f"P.threshold_{f.name}, {f.name.upper()}, FEATURE_{f.name.upper()}, pixel_{image}[{component}])"
        for i, f in enumerate(features)
        for image, component in [PLACES[f.name]]
    )


def mask_pass(
    options: MaskOptions, size: tuple[int, int], tuning: Tuning, *, images: bool = False, vectors: bool = False
) -> ComputePass:
    """The declaration of the mask pass.  ``images``: read geometry channels, of 32-bit floats, as images; ``vectors``:
    motion reprojection samples history where the texture ``vectors`` points, that of stored motion.
    """
    group, each = tuning.mask_group
    features = [f"const int FEATURE_{name.upper()} = {i};" for i, name in enumerate(FEATURES)]
    geometry = options.geometry()
    p = (
        ComputePass("masks", ("masks/masks.comp.glsl",))
        .define(MOTION=options.reprojection == "motion", BOTH=options.both, VECTORS=vectors)
        .define(BILINEAR=options.sampling == "bilinear", CUTS=options.cuts)
        .define(WRITE_MASK=options.write_mask, WRITE_MOTION=options.write_motion)
        .define(WRITE_DISTANCES=options.write_distances, **tuning.defines)
        .define(**{f"HAS_{name.upper()}": FEATURE[name] in options.values for name in VALUES})
        .define(**tuning.kept_fields(REPROJECTION))
        .glsl(*(f"const uint {bit.name} = {bit.value}u;" for bit in Reason), *features)
        .glsl(f"#define VALUES {len(options.values)}", f"#define EACH_VALUE {_each_value(options.values)}")
        .glsl(*(f"const int VALUE_{f.name.upper()} = {i};" for i, f in enumerate(options.values)))
        .glsl(f"const uint NO_HISTORY = {conventions.NO_HISTORY | conventions.ABSENT * options.absent}u;")
        .glsl(f"const int HISTOGRAM_BINS = {HISTOGRAM_BINS}, HISTOGRAM_MANTISSA_BITS = {HISTOGRAM_MANTISSA_BITS};")
        .glsl(f"const int HISTOGRAM_MIN_EXPONENT = {conventions.HISTOGRAM_MIN_EXPONENT};")
        .constants("parameters", REPROJECTION, lambda record: record)
        .use(*(replace(use, form=IMAGE, type="rgba32f") for use in geometry) if images else geometry)
        .buffer("mask_histogram", "uint", access=UPDATE, filled=True)
        .buffer("histograms", "uint", access=UPDATE, filled=True)
        .dispatch(size, group, each)
    )
    for name in dict.fromkeys(f.channel for f in options.values):
        p.texture(name).texture(f"history_{name}", resource=name, history=True)
    if options.both:
        p.buffer("other_histogram", "uint", access=UPDATE, filled=True)
    if options.cuts:
        p.texture("ids", "usampler2D")
    if vectors:
        p.texture("vectors")
    if options.write_mask:
        p.image("mask_out", "r32ui", access=WRITE, resource="mask")
    if options.write_motion:
        p.image("motion_out", "rg32f", access=WRITE, resource="motion")
    if options.write_distances:
        for name in ("distances", "changes"):
            p.image(f"{name}_out", "rgba32f", access=WRITE, resource=name)
    return p


@stage(options=("previous_pose", "cuts", *LIGHT_FEATURES))
def masks(spec: FrameSpec) -> Sequence[Pass]:
    metrics, moves = spec.settings.metrics, "previous_pose" in spec.enabled
    mode = metrics.reprojection if moves else "camera"
    radiance = tuple(name for name in LIGHT_FEATURES if name in spec.enabled)
    others = tuple(name for name in OTHERS if name in metrics.columns)
    options = MaskOptions(mode, metrics.sampling, radiance, others, "cuts" in spec.enabled, both=moves)
    return (mask_pass(options, spec.size, spec.tuning),)


class MaskPass(Owner):
    """Compares current channels with history channels; ``release`` frees its buffers.

    Owns textures ``mask``, ``motion``, ``distances`` and ``changes`` where the options say so.
    """

    def __init__(self, context: GpuContext, size: tuple[int, int], options: MaskOptions):
        """Allocates counters, and the textures that ``options`` write.  ``size``: (width, height) in pixels."""
        super().__init__()
        self._context, self._size, self.options = context, size, options
        self._tuning = Tuning(context.gpu.software)
        self._compiled: dict[tuple[bool, bool], CompiledCompute] = {}  # by ``images`` and ``vectors`` of ``mask_pass``
        ctx = context.gpu.ctx
        sizes = [4 * MASK_WORDS, 4 * len(FEATURES) * HISTOGRAM_BINS] + [4 * MASK_WORDS] * options.both
        self._counters, self._zeros = (tuple(self.own(ctx.buffer(bytes(n))) for n in sizes) for _ in range(2))
        # What is read are copies, of the last two runs: NVIDIA's driver moves a buffer that is read or mapped to the
        # memory of the host, where atomics take a hundred times as long.
        self._copies = [tuple(self.own(ctx.buffer(reserve=n)) for n in sizes) for _ in range(2)]
        self._runs = 0
        self.mask = self.own(ctx.texture(size, 1, dtype="u4") if options.write_mask else None)
        self.motion = self.own(ctx.texture(size, 2, dtype="f4") if options.write_motion else None)
        self.distances, self.changes = (
            self.own(ctx.texture(size, 4, dtype="f4") if options.write_distances else None) for _ in range(2)
        )

    @classmethod
    def for_source(
        cls,
        context: GpuContext,
        source: ComparedSource,
        settings: Settings,
        **options: Unpack[Comparison],
    ) -> MaskPass:
        """The mask pass of ``source`` with the metric of ``settings``; ``options``: what differs from its defaults."""
        reprojection, radiance = options.get("reprojection"), options.get("radiance")
        images, absent = options.get("images", False), options.get("absent", False)
        options = MaskOptions(
            reprojection=source.reprojection if reprojection is None else reprojection,
            sampling=settings.metrics.sampling,
            radiance=source.radiance if radiance is None else radiance,
            others=source.others,
            cuts=source.cuts or absent,
            absent=absent,
            both=options.get("both", False),
            write_mask=images,
            write_motion=images,
            write_distances=options.get("distances", False),
        )
        return cls(context, source.size, options)

    def run(
        self,
        pair: Reprojection,
        thresholds: Mapping[str, float],
        current: Mapping[str, moderngl.Texture],
        history: Mapping[str, moderngl.Texture],
        declared: int = 0,
        exposure: float = 1.0,
    ) -> int:
        """Submit the pass.  ``thresholds``: a_B of every feature; ``declared``: Reason.FIRST or CUT
        for the whole frame, else 0.  The number of this run, for ``read``."""
        record = {
            **pair_values(pair),
            "size": (*self._size, 0, 0),
            "prev_near": pair.prev_near * (1.0 - NEAR_GUARD),
            "near": pair.near,
            "guard_px": conventions.GUARD_PX,
            "declared": int(declared),
            "exposure": exposure,
            **{f"threshold_{feature}": thresholds[feature] for feature in FEATURES},
        }
        self._runs += 1
        copy = self._context.gpu.ctx.copy_buffer
        for counter, zeros in zip(self._counters, self._zeros, strict=True):
            copy(counter, zeros)
        words, histograms, *other = self._counters
        resources = {**current, **{f"history_{name}": texture for name, texture in history.items()}}
        resources |= {"mask_histogram": words, "histograms": histograms, "mask": self.mask, "motion": self.motion}
        resources["other_histogram"] = other[0] if other else None
        resources |= {"distances": self.distances, "changes": self.changes}
        # A pass has eight images at most.
        dtypes = {resources[use.key].dtype for use in self.options.geometry()}
        images = not self.options.write_distances and self._tuning.mask_images(dtypes)
        key = images, "vectors" in current and (self.options.both or self.options.reprojection == "motion")
        if key not in self._compiled:  # textures of a source are known only now
            declaration = mask_pass(self.options, self._size, self._tuning, images=images, vectors=key[1])
            self._compiled[key] = self.own(self._context.compute(declaration))
        self._compiled[key].run(record, resources)
        self._context.gpu.hazards.publish()
        for target, counter in zip(self._copies[self._runs % 2], self._counters, strict=True):
            copy(target, counter)
        return self._runs

    def read(self, run: int | None = None) -> Counts:
        """Wait for a run, the latest or the one before it, and read its counts back.

        Reading a run after the next one was submitted is what keeps a GPU busy: it waits for work long done.
        """
        run = self._runs if run is None else run
        if not self._runs - 1 <= run <= self._runs or run < 1:
            raise ValueError(f"run {run} of {self._runs} is not kept: only the last two are")
        words, histograms, *other = (np.frombuffer(b.read(), dtype=np.uint32) for b in self._copies[run % 2])
        # uint32 wraps around, so differences below 0 add up.
        of_other = words + other[0] if other else None
        return Counts(words, histograms.reshape(len(FEATURES), HISTOGRAM_BINS), of_other)

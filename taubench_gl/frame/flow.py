"""What every pass of a frame reads and writes: the frame on one page.  No OpenGL.

A channel exists because some pass, or whoever looks at the frame, wants it; ``plan`` allocates what this page names.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from taubench_gl.channels import CHANNELS
from taubench_gl.effects.decide import Effect
from taubench_gl.frame.indirect_layout import CHANNEL_NAMES

SURFACE = ("position", "normal", "geometric_normal", "base_color", "material")
"""Channels that direct light reads, exact or drawn at random."""

LOBES = ("direct_diffuse", "direct_glossy")
RADIANCE = ("direct", "indirect", "color")
SUMMED = ("direct", "indirect", "emission")
"""What colour is the sum of."""


@dataclass(frozen=True, slots=True)
class PassFlow:
    """Channels of one pass.  ``reads`` and ``writes`` are of the current frame, ``history`` is of the one before."""

    name: str
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    history: tuple[str, ...] = ()


def frame_flow(effects: Mapping[str, Effect], extra: Iterable[str] = ()) -> tuple[PassFlow, ...]:
    """The passes of a frame in the order in which they run, for what is on.

    ``extra``: channels that are wanted besides; the geometry pass writes those it can, a lobe makes direct light write
    both.  Raises ValueError where a pass would read what nobody has written (``faults_of``).
    """
    extra = tuple(extra)
    after = (*light_flow(effects, extra), _masks(effects))
    wanted = {name for p in after for name in (*p.reads, *p.history)} | set(extra)
    if "emission" in wanted:
        wanted.add("base_color")  # what is unlit sends out its base colour
    attachments = tuple(name for name, info in CHANNELS.items() if info.attachment and name in wanted)
    flow = (PassFlow("gbuffer", writes=attachments), *after)
    faults = faults_of(flow)
    if faults:
        raise ValueError("; ".join(faults))
    return flow


def light_flow(effects: Mapping[str, Effect], extra: Iterable[str] = ()) -> tuple[PassFlow, ...]:
    """The passes of the light stage that write channels; none where no light is simulated.

    Light drawn at random (``frame.shading``) has one pass in the place of ``direct`` and ``indirect``.
    """
    out = []
    if effects["direct"].enabled:
        lobes = LOBES if set(LOBES) & set(extra) else ()  # one shader writes both
        out.append(PassFlow("direct", reads=SURFACE, writes=("direct", *lobes)))
    if effects["indirect"].enabled:
        out.append(PassFlow("indirect", reads=CHANNEL_NAMES, writes=("indirect",)))
    if effects["color"].enabled:
        sums = tuple(name for name in SUMMED if effects[name].enabled)
        out.append(PassFlow("color", reads=("position", *sums), writes=("color",)))
    return tuple(out)


def _masks(effects: Mapping[str, Effect]) -> PassFlow:
    radiance = tuple(name for name in RADIANCE if effects[name].enabled)
    own = (("prev_position", "previous_pose"), ("ids", "cuts"))
    reads = tuple(channel for channel, effect in own if effects[effect].enabled)
    both = ("position", "normal", *radiance)
    return PassFlow("masks", reads=(*both, *reads), history=both)


def faults_of(flow: Iterable[PassFlow]) -> list[str]:
    """Everything that is wrong with an order of passes, all of it at once; empty where it can run."""
    flow, faults = tuple(flow), []
    written: dict[str, str] = {}
    for p in flow:
        for name in dict.fromkeys((*p.reads, *p.writes, *p.history)):
            if name not in CHANNELS:
                faults.append(f"{p.name} names {name}, which is no channel")
        for name in p.reads:
            if name in CHANNELS and name not in written:
                faults.append(f"{p.name} reads {name}, which no pass before it writes")
        for name in p.writes:
            if name in written:
                faults.append(f"{p.name} writes {name}, which {written[name]} has written")
            written[name] = p.name
    faults += [
        f"{p.name} reads {name} of the frame before, which no pass writes"
        for p in flow
        for name in p.history
        if name in CHANNELS and name not in written
    ]
    return faults


def channels_of(flow: Iterable[PassFlow], extra: Iterable[str] = ()) -> tuple[str, ...]:
    """Every channel of a frame, in the order of the channel table."""
    named = {name for p in flow for name in (*p.reads, *p.writes, *p.history)} | set(extra)
    return tuple(name for name in CHANNELS if name in named)

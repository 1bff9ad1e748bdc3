"""Channels of a file -> canonical quantities: pass mappings, channel lookup, and conversion of axes, units and signs.

A mapping (TOML or JSON; ``presets/`` holds the built-in ones) gives, for each pass, its name in the files of one
program, and that program's conventions.  ``ChannelIndex`` finds the channels; ``read_frame`` converts them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from taubench_gl.data_files import convert, one_line, read_json, read_toml
from taubench_gl.errors import PathTracedError
from taubench_gl.lobes import BOUNCES, FILE_COLORS, LOBES
from taubench_gl.metrics.color import PRIMARIES, rec709_from
from taubench_gl.pathtraced.exr import ExrImage
from taubench_gl.setting_values import FLOAT32_MAX

Array = np.ndarray

COMPONENTS = {
    "combined": 3, "depth": 1, "position": 3, "normal": 3, "motion": 2, "emission": 3, "environment": 3,
    "direct": 3, "indirect": 3, "prev_position": 3, "rejected": 1, "history_weight": 1,
    **{f"{lobe}_{part}": 3 for lobe in LOBES for part in (*BOUNCES, *("color",) * (lobe in FILE_COLORS))},
}  # fmt: skip
"""Canonical passes and their number of components.  ``direct`` and ``indirect``, if not mapped, are sums over lobes.

``rejected``: 1 where the program that made the frames rejected its history; ``history_weight``: 0 there.
"""

NAME_IT = "name it in a mapping, --mapping FILE, or switch it on in the renderer if the files lack it"
"""What to do where a pass is not found."""

UNIT_ROUNDING = 5e-7
"""Normals whose length differs from 1 by at most this (float32 rounding) are kept bit for bit."""

SHORT_NORMAL = 0.99
"""Normals that are shorter are means of several: rounding to half floats or 8 bits changes a length by less."""

_LIGHT = ("combined", "emission", "environment", "diffuse_color", "glossy_color")
_LETTERS = {1: ("Z", "V", "T", "Y", "R", "X"), 2: ("XY", "RG", "UV"), 3: ("XYZ", "RGB")}
PRESETS = Path(__file__).parent / "presets"
"""Folder of the built-in mappings."""
EXPORT_PRESET, EXPORT_ATTRIBUTE = "taubench", "taubench.positions"
"""The mapping of files that ``export`` wrote, and an attribute that only they have."""
Up = Literal["z", "y", "z-left", "y-left"]
Depth = Literal["planar", "distance", "view-z"]
Primaries = Literal["file", "rec709", "rec2020", "p3-d65", "ap0", "ap1"]
Pixels = Annotated[int, msgspec.Meta(ge=-65536, le=65536)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=FLOAT32_MAX)]


class MotionMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Conventions of a motion pass: the table ``[motion]`` of a pass mapping.

    ``encoding``: cube-root: a value less ``zero``, twice that for zero 0.5, is the signed cube root of the motion.
    ``no_data``: the stored value of both components where there is no vector; None: all pixels have one.
    """

    unit: Literal["px", "uv", "ndc"] = "px"
    direction: Literal["previous-current", "current-previous"] = "previous-current"
    y: Literal["up", "down"] = "up"
    zero: Literal["0", "0.5"] = "0"  # the stored value of no motion
    jitter: Literal["excluded", "included"] = "excluded"  # whether vectors contain the difference of the offsets
    encoding: Literal["linear", "cube-root"] = "linear"
    no_data: float | None = None

    def factors(self, size: tuple[int, int]) -> Array:
        """(2,) float32: pixels, previous - current, +y down, of a decoded vector (1, 1).  ``size``: width, height."""
        unit = {"px": 1.0, "uv": np.array(size), "ndc": 0.5 * np.array(size)}[self.unit]
        sign = 1.0 if self.direction == "previous-current" else -1.0
        return (unit * np.array([sign, -sign if self.y == "up" else sign])).astype(np.float32)


class ChannelNames(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Full channel names of a pass, in component order."""

    channels: tuple[str, ...]


Alternative = str | ChannelNames


class PassMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pass names and conventions of one program's files.  ``presets/blender.toml`` documents each field.

    ``passes``: canonical pass -> its name in the files, the full names of its channels, or several alternatives, of
    which the first that a file has is used.
    """

    passes: dict[str, Alternative | tuple[Alternative, ...]]
    name: str = ""
    up: Up = "z"
    rows: Literal["top", "bottom"] = "top"  # the row that is stored first
    principal_point: tuple[Pixels, Pixels] = (0, 0)  # right and down, of the camera's axis from the image center
    depth: Depth = "planar"
    depth_offset: Annotated[float, msgspec.Meta(ge=0, le=FLOAT32_MAX)] = 0.0  # planar, where depth starts: near plane
    background_depth: Positive = 1e9
    sky: Literal["depth", "normal"] = "depth"  # normal: where it is zero
    color: Literal["linear", "encoded"] = "linear"
    primaries: Primaries = "file"  # file: by its attribute chromaticities, without it rec709
    positions: Literal["world", "relative"] = "world"  # relative: to the camera, prev_position to that of its frame
    normals: Literal["world", "view"] = "world"  # view: +x right, +y up, +z towards the camera
    meters: Positive = 1.0  # per unit of position, depth and background_depth
    motion: MotionMap = MotionMap()

    def alternatives(self, name: str) -> tuple[Alternative, ...]:
        """Names of the canonical pass ``name`` in files, the preferred one first; empty if it is not mapped."""
        entry = self.passes.get(name, ())
        return entry if isinstance(entry, tuple) else (entry,)

    def file_name(self, name: str) -> str:
        """Name of the canonical pass ``name`` in files, for messages: its first alternative."""
        first = next(iter(self.alternatives(name)), None)
        return first if isinstance(first, str) and first else name


def presets() -> tuple[str, ...]:
    """Names of the built-in mappings, in alphabetical order."""
    return tuple(sorted(p.stem for p in PRESETS.glob("*.toml")))


def load_mapping(source: str | Path | None) -> PassMap:
    """Load a preset by name, or a TOML or JSON file; None: blender.  Raises PathTracedError naming the faulty key."""
    source = "blender" if source is None else source
    path = PRESETS / f"{source}.toml" if str(source) in presets() else Path(source)
    hint = f"give a TOML or JSON file or one of {', '.join(presets())}"
    if not path.exists():
        raise PathTracedError("is no pass mapping", where=str(source), hint=hint)
    read = read_json if path.suffix.lower() == ".json" else read_toml
    values = read(path, fault=PathTracedError, hint=hint)
    with one_line(path, PathTracedError, hint="see the built-in preset 'blender' for an example"):
        mapping = convert(values, PassMap)
    for name in mapping.passes:
        if name not in COMPONENTS:
            hint = f"choose from {', '.join(COMPONENTS)}"
            raise PathTracedError(f"passes: no pass is named {name!r}", where=str(source), hint=hint)
        count = COMPONENTS[name]
        for item in mapping.alternatives(name):
            if isinstance(item, ChannelNames) and len(item.channels) != count:
                what = f"passes.{name} has {len(item.channels)} channels, expected {count}"
                raise PathTracedError(what, where=str(source))
    return mapping if mapping.name else msgspec.structs.replace(mapping, name=str(source))


class ChannelIndex:
    """Finds passes among channel names ``Layer.Pass.Component``, in files of several views
    ``Layer.Pass.View.Component``; any layer name is accepted.

    ``notes``: layers and views that the files have and that were not chosen.  Raises PathTracedError if ``layer`` or
    ``view`` does not exist.
    """

    def __init__(
        self,
        names: Iterable[str],
        mapping: PassMap,
        layer: str | None = None,
        view: str | None = None,
        views: Sequence[str] = (),
    ):
        """``view``: one of ``views``, those of the files; None: the first, to which channels without a view belong."""
        self.names, self.mapping, self.notes = tuple(names), mapping, []
        if view is not None and view not in views:
            raise PathTracedError(f"no view {view!r}", hint=f"it has {', '.join(views) or 'one view, without a name'}")
        self.view = view or next(iter(views), "")
        self._channels: dict[str, tuple[str, ...]] = {}
        known = {name: mapping.alternatives(name) for name in mapping.passes}
        pass_names = {n.casefold() for names in known.values() for n in names if isinstance(n, str)}
        tables: dict[str, dict[str, dict[str, str]]] = {}  # layer -> pass -> component -> channel
        for channel in self.names:
            parts = channel.split(".")
            component = parts[-1].upper()
            if views and (parts[-2] if parts[-2:-1] and parts[-2] in views else views[0]) != self.view:
                continue
            if views and parts[-2:-1] == [self.view]:
                del parts[-2]
            # Pass names may contain dots ("dd.y"): try every split, longest pass name first.
            for first in range(len(parts)):
                name = ".".join(parts[first:-1]).casefold()
                if name in pass_names:
                    tables.setdefault(".".join(parts[:first]), {}).setdefault(name, {})[component] = channel
                    break
        if layer is not None and layer not in tables:
            listed = ", ".join(repr(name) for name in tables) or "none with a known pass"
            raise PathTracedError(f"no layer {layer!r}", hint=f"it has {listed}")
        # Take the layer with most passes.  Passes that it lacks may be at the root of the file (combined as R, G, B).
        order = [layer] if layer is not None else sorted(tables, key=lambda name: -len(tables[name]))
        self.layer = order[0] if order else ""
        others = {"view": [v for v in views if v != self.view] if view is None else [],
                  "layer": [n for n in order[1:] if len(tables[n]) > 1 and n] if layer is None else []}  # fmt: skip
        for kind, rest in others.items():
            if rest:
                text = f"the files have the {kind}s {', '.join([getattr(self, kind), *rest])}"
                self.notes.append(f"{text}: {getattr(self, kind)!r} is read, --{kind} chooses another")
        for name, alternatives in known.items():
            searched = [tables[layer] for layer in order if layer in (self.layer, "")]
            if channels := self._search(alternatives, COMPONENTS[name], searched):
                self._channels[name] = channels

    def _search(self, alternatives: tuple[Alternative, ...], count: int, tables: list[dict]) -> tuple[str, ...] | None:
        for name in alternatives:
            if isinstance(name, ChannelNames):
                if all(channel in self.names for channel in name.channels):
                    return name.channels
                continue
            for table in tables:
                components = table.get(name.casefold(), {})
                for letters in _LETTERS[count]:
                    if all(letter in components for letter in letters):
                        return tuple(components[letter] for letter in letters)
        return None

    def __contains__(self, name: str) -> bool:
        return name in self._channels

    def channels(self, name: str) -> tuple[str, ...]:
        """Full channel names of a canonical pass, in component order."""
        return self._channels[name]


@dataclass(frozen=True, slots=True)
class PathTracedFrame:
    """One path-traced frame.  Row 0 is the top row; glTF axes (+Y up); meters.  None: the file has no such pass.

    NaN marks pixels outside the data window.
    """

    mapping: PassMap  # what was read; passes are converted but for ``normals``, ``color`` and ``principal_point``
    size: tuple[int, int]
    sky: Array  # (h, w) bool, True where no surface is visible
    normal: Array | None  # (h, w, 3) float32, unit, axes as ``mapping.normals`` says
    position: Array | None  # (h, w, 3) float32, world
    depth: Array | None  # (h, w) float32, as ``depth_kind``
    depth_kind: str  # planar: along the view direction; distance: from the camera position
    prev_position: Array | None  # (h, w, 3) float32, world
    motion: Array | None  # (h, w, 2) float32, previous - current, pixels, +x right, +y down
    combined: Array | None  # (h, w, 3) float32, linear radiance unless ``mapping.color`` is encoded
    emission: Array | None  # (h, w, 3) float32, linear radiance
    environment: Array | None  # (h, w, 3) float32, linear radiance
    radiance: Mapping[str, Array]  # direct, indirect: (h, w, 3) float32, linear
    lobes: Mapping[str, Array]  # requested lobes, "diffuse_direct", ...: (h, w, 3) float32, linear
    diffuse_color: Array | None = None  # (h, w, 3) float32, albedo of the diffuse lobe
    glossy_color: Array | None = None  # (h, w, 3) float32, albedo of the glossy lobe
    relative: bool = False  # position is relative to the frame's camera, prev_position to the previous frame's
    depth_offset: float = 0.0  # meters in front of the camera, along its axis, where ``depth`` starts
    half_position: bool = False  # positions are rounded to half floats
    finer_depth: bool = False  # there is depth, which is not
    short_normals: float = 0.0  # share of the surface pixels whose stored normal was shorter than SHORT_NORMAL, not 0
    no_normals: float = 0.0  # share of the surface pixels whose normal is zero
    kept: Array | None = None  # (h, w) float32, weight that the frames' program gave its history; 0: rejected


def linear_radiance(combined: Array | None, mapping: PassMap, exposure: float, where: str) -> Array:
    """A combined pass times ``exposure``, linear, (h, w, 3) float32.

    ``combined`` (h, w, 3), or None where the file has none, as ``mapping`` says.  Raises PathTracedError for none, and
    for one that is tone-mapped and sRGB-encoded.
    """
    if combined is None:
        raise PathTracedError("has no combined pass", where=where, hint=NAME_IT)
    if mapping.color == "encoded":
        raise PathTracedError("its combined pass is display-encoded, not linear radiance", where=where)
    return combined[..., :3].astype(np.float32) * np.float32(exposure)


def read_pass(image: ExrImage, index: ChannelIndex, name: str) -> Array | None:
    """A pass as the file has it, but top row first, (h, w, components) float32; None if the file lacks it."""
    if name not in index:
        return None
    values = np.stack([image.plane(channel) for channel in index.channels(name)], axis=-1)
    return values[::-1] if index.mapping.rows == "bottom" else values


def read_light(image: ExrImage, index: ChannelIndex, name: str) -> Array | None:
    """``read_pass`` of radiance or color, with the primaries of Rec. 709.  Raises PathTracedError."""
    return _rec709(image, index.mapping)(read_pass(image, index, name))


def _rec709(image: ExrImage, mapping: PassMap) -> Callable[[Array | None], Array | None]:
    """What converts light (h, w, 3) of a file to the primaries of Rec. 709.  Raises PathTracedError."""
    stored = PRIMARIES.get(mapping.primaries, image.chromaticities or PRIMARIES["rec709"])
    if np.allclose(stored, PRIMARIES["rec709"], atol=1e-3):
        return lambda light: light
    if mapping.color == "encoded":
        message = "encoded color has other primaries than Rec. 709"
        raise PathTracedError(message, where=str(image.path), hint="write linear color")
    try:
        matrix = rec709_from(stored).astype(np.float32)
    except np.linalg.LinAlgError:
        hint = "set primaries in the mapping"
        raise PathTracedError("its chromaticities are no primaries", where=str(image.path), hint=hint) from None
    return lambda light: None if light is None else light @ matrix.T


def read_frame(
    image: ExrImage, index: ChannelIndex, lobes: Collection[str] = (), *, geometry: bool = True
) -> PathTracedFrame:
    """Convert the channels of one frame.  ``lobes``: lobes to return separately too.

    Raises PathTracedError if the file has neither a position nor a depth pass, unless ``geometry`` is False: then no
    pixel of such a file is sky.
    """
    mapping = index.mapping

    def take(name: str) -> Array | None:
        return read_pass(image, index, name)

    position, normal, depth = take("position"), take("normal"), take("depth")
    if geometry and position is None and depth is None:
        names = f"{mapping.file_name('position')} and {mapping.file_name('depth')}"
        hint = f"{NAME_IT}; it has {_listed(image.names)}"
        raise PathTracedError(f"has neither of the passes {names}", where=str(image.path), hint=hint)
    depth = None if depth is None else _forward(depth[..., 0], mapping, str(image.path))
    sky = find_sky(position, normal, depth, mapping, image.size)
    meters = np.float32(mapping.meters)
    light = _rec709(image, mapping)
    radiance, separate = _light(index, take, lobes)
    prev = take("prev_position")
    length = np.linalg.norm(normal[~sky], axis=-1) if normal is not None and not sky.all() else np.ones(1)
    rejected, weight = take("rejected"), take("history_weight")
    kept = weight if rejected is None else np.where(np.isnan(rejected), rejected, np.float32(1) - rejected)
    return PathTracedFrame(
        mapping=mapping,
        size=image.size,
        sky=sky,
        normal=None if normal is None else unit(to_y_up(normal, "y" if mapping.normals == "view" else mapping.up)),
        position=None if position is None else to_y_up(position, mapping.up) * meters,
        depth=None if depth is None else depth * meters,
        depth_kind="distance" if mapping.depth == "distance" else "planar",
        prev_position=None if prev is None else to_y_up(prev, mapping.up) * meters,
        motion=_motion(take("motion"), mapping, image.size),
        **{name: light(take(name)) for name in _LIGHT},
        radiance={name: light(values) for name, values in radiance.items()},
        lobes={name: light(values) for name, values in separate.items()},
        relative=mapping.positions == "relative",
        depth_offset=mapping.depth_offset * mapping.meters,
        half_position=position is not None and _in_halves(position[~sky]),
        finer_depth=depth is not None and not _in_halves(depth[~sky]),
        short_normals=float(((length > 0) & (length < SHORT_NORMAL)).mean()),
        no_normals=float((length == 0).mean()),
        kept=None if kept is None else kept[..., 0],
    )


def _forward(depth: Array, mapping: PassMap, where: str) -> Array:
    """Depth (h, w) that grows away from the camera.  Raises PathTracedError where most of it has the other sign."""
    if mapping.depth == "view-z":
        depth = -depth
    surface = depth[np.isfinite(depth) & (depth != 0)]
    if len(surface) and (surface < 0).mean() > 0.5:
        sign, kind = ("positive", "planar") if mapping.depth == "view-z" else ("negative", "view-z")
        hint = f"set depth = '{kind}' in the mapping; view-z is view-space z, negative in front of the camera"
        raise PathTracedError(f"its depth is {sign}, which {mapping.depth} depth is not", where=where, hint=hint)
    return depth


def _in_halves(values: Array) -> bool:
    """Whether all finite values, at least one, are rounded to half floats."""
    values = values[np.isfinite(values)]
    with np.errstate(over="ignore"):
        return len(values) > 0 and bool((values.astype(np.float16) == values).all())


def find_sky(
    position: Array | None, normal: Array | None, depth: Array | None, mapping: PassMap, size: tuple[int, int]
) -> Array:
    """Pixels without a surface, (h, w) bool; none where nothing shows it.  ``size``: width, height in pixels.

    Depth is 0 or at least ``background_depth`` (Cycles writes 1e10); the position is infinite (LuxCore); position and
    normal are exactly 0 (EEVEE), or the position alone where there are neither normals nor depth.  With ``sky``
    "normal": the normal is 0.  NaN pixels are invalid, not sky.
    """
    none = np.zeros(size[::-1], dtype=bool)
    no_normal = none if normal is None else np.all(normal == 0, axis=-1)
    if mapping.sky == "normal" and normal is not None:
        return no_normal
    sky = none if depth is None else (depth >= mapping.background_depth) | (depth == 0)
    if position is not None:
        zero = np.all(position == 0, axis=-1)
        zero &= no_normal if normal is not None else np.full_like(none, depth is None)
        sky = sky | zero | np.isinf(position).any(axis=-1)
    return sky


def to_y_up(vectors: Array, up: str) -> Array:
    """Convert (..., 3) vectors to glTF axes, which are "y".

    "z" (Blender): (x, y, z) -> (x, z, -y); "z-left" (Unreal, as its glTF exporter): (x, z, y); "y-left" (Unity, as
    UnityGLTF): (-x, y, z).
    """
    if up == "y":
        return vectors
    x, y, z = (vectors[..., i] for i in range(3))
    turned = {"z": (x, z, -y), "z-left": (x, z, y), "y-left": (-x, y, z)}[up]
    return np.stack(turned, axis=-1)


def unit(normals: Array) -> Array:
    """Normalize (h, w, 3) normals.  Cycles averages normals over the pixel, which shortens them.

    Zero and NaN are kept.  Vectors of unit length within UNIT_ROUNDING are kept bit for bit.
    """
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    scale = np.where((length > 0) & (np.abs(length - 1) > UNIT_ROUNDING), length, 1)
    return normals / scale.astype(normals.dtype)


def _motion(motion: Array | None, mapping: PassMap, size: tuple[int, int]) -> Array | None:
    if motion is None:
        return None
    stored = mapping.motion
    decoded = motion - np.float32(stored.zero)
    if stored.encoding == "cube-root":
        decoded = (decoded * np.float32(2.0 if stored.zero == "0.5" else 1.0)) ** 3
    decoded = decoded * stored.factors(size) + np.float32(0)  # + 0 turns -0 into 0
    if stored.no_data is not None:
        decoded[np.all(motion == np.float32(stored.no_data), axis=-1)] = np.nan
    return decoded


def _light(
    index: ChannelIndex, take: Callable[[str], Array | None], lobes: Collection[str]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """direct and indirect, and the requested lobes: sums over lobes of Direct x Color (volumes have no Color pass)."""
    radiance, separate = {}, {}
    # A lobe whose color the mapping does not name has light that contains it, as a volume's has.
    colors = {lobe: take(f"{lobe}_color") for lobe in FILE_COLORS if f"{lobe}_color" in index.mapping.passes}
    for bounce in BOUNCES:
        whole, total = take(bounce), None
        summed = whole is None and not _lacking(index, bounce)
        for lobe in LOBES:
            light = take(f"{lobe}_{bounce}") if summed or lobe in lobes else None
            if light is None or (lobe in colors and colors[lobe] is None):
                continue
            scattered = light * colors[lobe] if lobe in colors else light
            if lobe in lobes:
                separate[f"{lobe}_{bounce}"] = scattered
            if summed:
                total = scattered if total is None else total + scattered
        if whole is not None or total is not None:
            radiance[bounce] = total if whole is None else whole
    return radiance, separate


def missing_columns(index: ChannelIndex, lobes: Collection[str] = ()) -> dict[str, str]:
    """Columns and requested ``lobe_bounce`` entries that cannot be computed -> reason with the missing passes."""
    wanted = {"normal": ["normal"], "color": ["combined"]}
    for bounce in BOUNCES:
        wanted[bounce] = [] if bounce in index else _lacking(index, bounce)
        for lobe in lobes:
            color = [f"{lobe}_color"] * (f"{lobe}_color" in index.mapping.passes)
            wanted[f"{lobe}_{bounce}"] = [f"{lobe}_{bounce}", *color]
    missing = {column: [name for name in names if name not in index] for column, names in wanted.items()}
    return {column: _needs(names, index.mapping) for column, names in missing.items() if names}


def _lacking(index: ChannelIndex, bounce: str) -> list[str]:
    """Passes that the sum over lobes lacks: of those that the mapping names; the sum itself where it names none."""
    named = index.mapping.passes
    lobes = [lobe for lobe in FILE_COLORS if f"{lobe}_{bounce}" in named]
    required = [n for lobe in lobes for n in (f"{lobe}_{bounce}", f"{lobe}_color") if n in named]
    return [n for n in required or [bounce] if n not in index]


def _needs(names: list[str], mapping: PassMap) -> str:
    if not set(names) & set(mapping.passes):
        return f"the mapping names no pass {' or '.join(names)}"
    listed = ", ".join(mapping.file_name(n) for n in dict.fromkeys(names))
    return f"the files lack the {'passes' if len(set(names)) > 1 else 'pass'} {listed}"


def _listed(names: Collection[str], most: int = 8) -> str:
    return ", ".join(list(names)[:most]) + (", ..." if len(names) > most else "")

"""Which channel of a file is which pass of ours: mapping files (TOML or JSON) and the shipped presets."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.errors import PathTracedError

LOBES = ("diffuse", "glossy", "transmission", "volume")
BOUNCES = ("direct", "indirect")

COMPONENTS = {
    "combined": 3, "depth": 1, "position": 3, "normal": 3, "motion": 2, "emission": 3, "environment": 3,
    "direct": 3, "indirect": 3, "prev_position": 3,
    **{f"{lobe}_{what}": 3 for lobe in LOBES for what in (*BOUNCES, "color") if (lobe, what) != ("volume", "color")},
}  # fmt: skip
"""Our passes and their number of components.  ``direct`` and ``indirect`` are sums over lobes where not mapped."""

_LETTERS = {1: ("Z", "V", "T", "Y", "R", "X"), 2: ("XY", "RG", "UV"), 3: ("XYZ", "RGB")}
_PRESETS = Path(__file__).parent / "presets"
_CHOICES = {
    "up": ("z", "y"),
    "depth": ("planar", "distance"),
    "color": ("linear", "encoded"),
    "positions": ("world", "relative"),
    "motion.unit": ("px", "uv"),
    "motion.direction": ("previous-current", "current-previous"),
    "motion.y": ("up", "down"),
}


@dataclass(frozen=True, slots=True)
class PassMap:
    """Names and conventions of one program's files; see presets/blender.toml for the meaning of each."""

    name: str
    passes: Mapping[str, tuple[Any, ...]]  # pass -> alternatives: a pass name, or {"channels": [...]}
    up: str = "z"
    depth: str = "planar"
    background_depth: float = 1e9
    color: str = "linear"
    positions: str = "world"  # relative: to the frame's own camera, prev_position to the previous one; world axes
    motion_unit: str = "px"
    motion_direction: str = "previous-current"
    motion_y: str = "up"

    def file_name(self, name: str) -> str:
        """What the pass is called in files, for messages: the first alternative."""
        first = self.passes[name][0] if name in self.passes else None
        return first if isinstance(first, str) and first else name


def presets() -> tuple[str, ...]:
    return tuple(sorted(p.stem for p in _PRESETS.glob("*.toml")))


def load_mapping(source: str | Path | None) -> PassMap:
    """A preset's name, or a TOML or JSON file; None: Blender.  Raises PathTracedError naming the faulty key."""
    source = "blender" if source is None else source
    path = _PRESETS / f"{source}.toml" if str(source) in presets() else Path(source)
    try:
        text = path.read_text(encoding="utf-8")
        values = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        hint = f"give a TOML or JSON file or one of {', '.join(presets())}"
        what = f"is no pass mapping: {getattr(error, 'strerror', None) or error}"
        raise PathTracedError(what, where=str(source), hint=hint) from None
    return parse_mapping(values, str(source))


def parse_mapping(values: Any, where: str) -> PassMap:
    """The mapping in plain values; every key is checked."""
    if not isinstance(values, dict) or not isinstance(values.get("passes"), dict):
        raise PathTracedError("has no [passes]", where=where, hint="see the shipped preset 'blender' for an example")
    motion = values.get("motion", {})
    flat = {k: v for k, v in values.items() if k not in ("passes", "motion", "name", "background_depth")}
    flat |= {f"motion.{k}": v for k, v in (motion.items() if isinstance(motion, dict) else ())}
    for key, value in flat.items():
        if key not in _CHOICES:
            raise PathTracedError(f"unknown key {key!r}", where=where, hint=f"known: {', '.join(_CHOICES)}")
        if value not in _CHOICES[key]:
            raise PathTracedError(f"{key} is {value!r}", where=where, hint=f"choose from {', '.join(_CHOICES[key])}")
    background = values.get("background_depth", 1e9)
    if isinstance(background, bool) or not isinstance(background, int | float) or not background > 0:
        raise PathTracedError(f"background_depth is {background!r}", where=where, hint="give a number above 0")
    passes = {name: _alternatives(name, given, where) for name, given in values["passes"].items()}
    fields = {key.replace(".", "_"): value for key, value in flat.items()}
    return PassMap(str(values.get("name", where)), passes, background_depth=float(background), **fields)


def _alternatives(name: str, given: Any, where: str) -> tuple[Any, ...]:
    if name not in COMPONENTS:
        raise PathTracedError(
            f"passes: no pass is named {name!r}", where=where, hint=f"ours are {', '.join(COMPONENTS)}"
        )
    out = []
    for item in given if isinstance(given, list) else [given]:
        if isinstance(item, str):
            out.append(item)
            continue
        channels = item.get("channels") if isinstance(item, dict) else None
        count = COMPONENTS[name]
        if not (isinstance(channels, list) and all(isinstance(c, str) for c in channels) and len(channels) == count):
            hint = f"give a pass name, or {{ channels = [...] }} with {count} names"
            raise PathTracedError(f"passes.{name} is {item!r}", where=where, hint=hint)
        out.append(tuple(channels))
    return tuple(out)


class ChannelIndex:
    """Finds passes among the channel names of a file: ``Layer.Pass.Component``, the layer named in any way."""

    def __init__(self, names: Iterable[str], mapping: PassMap, layer: str | None = None):
        self.names, self.mapping = tuple(names), mapping
        self._found: dict[str, tuple[str, ...]] = {}
        known = {n.casefold() for alternatives in mapping.passes.values() for n in alternatives if isinstance(n, str)}
        tables: dict[str, dict[str, dict[str, str]]] = {}  # layer -> pass -> component -> channel
        for channel in self.names:
            parts = channel.split(".")
            component = parts[-1].upper()
            # A pass's own name may hold dots ("dd.y"): every split is offered, the longest known name first.
            for first in range(len(parts)):
                name = ".".join(parts[first:-1]).casefold()
                if name in known:
                    tables.setdefault(".".join(parts[:first]), {}).setdefault(name, {})[component] = channel
                    break
        self.layers = tuple(tables)
        if layer is not None and layer not in tables:
            listed = ", ".join(repr(name) for name in tables) or "none with a known pass"
            raise PathTracedError(f"no layer {layer!r}", hint=f"it has {listed}")
        # The layer with most passes; what it lacks may lie at the root of the file (combined as plain R, G, B).
        order = [layer] if layer is not None else sorted(tables, key=lambda name: -len(tables[name]))
        self.layer = order[0] if order else ""
        for name, alternatives in mapping.passes.items():
            found = self._search(alternatives, COMPONENTS[name], [tables[t] for t in order if t in (self.layer, "")])
            if found:
                self._found[name] = found

    def _search(self, alternatives: tuple[Any, ...], count: int, tables: list[dict]) -> tuple[str, ...] | None:
        for wanted in alternatives:
            if not isinstance(wanted, str):
                if all(channel in self.names for channel in wanted):
                    return wanted
                continue
            for table in tables:
                components = table.get(wanted.casefold(), {})
                for letters in _LETTERS[count]:
                    if all(letter in components for letter in letters):
                        return tuple(components[letter] for letter in letters)
        return None

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def channels(self, name: str) -> tuple[str, ...]:
        """Full channel names of one of our passes, in component order."""
        return self._found[name]

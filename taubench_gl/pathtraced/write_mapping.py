"""Writes a pass mapping for files that no preset knows: passes by their channels' names, conventions by a check."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from msgspec import structs, to_builtins

from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.check import Check
from taubench_gl.pathtraced.passes import COMPONENTS, ChannelIndex, ChannelNames, MotionMap, PassMap
from taubench_gl.pathtraced.readings import MOTION

GUESSES = {
    "prev_position": r"(prev|last|old).*pos|pos.*(prev|last|old)", "motion": r"motion|veloc|vector|flow|^mv|mvec",
    "position": r"pos|^pp?$|point", "normal": r"norm|^nn?$", "depth": r"depth|dist|^z$|^dd$",
    "rejected": r"reject", "history_weight": r"hist.*weight", "indirect": r"^indirect|^gi$", "direct": r"^direct",
    "emission": r"^emi", "combined": r"^$|combined|beauty|colou?r|radiance|output|final|^rgba?$|image",
}  # fmt: skip
"""Pass -> pattern of the name that its channels have before their last dot, the first that matches."""

_LETTERS = "XYZRGBUV"


def guess_passes(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Pass -> channels in component order, by the channels' names; passes without a guess are left out."""
    groups: dict[str, list[str]] = {}
    for channel in names:
        groups.setdefault(channel.rpartition(".")[0], []).append(channel)
    for layer, channels in list(groups.items()):  # one-channel passes without a component, such as "depth"
        groups |= {c: [c] for c in channels if not layer and c.upper() not in (*_LETTERS, "A")}
    out: dict[str, tuple[str, ...]] = {}
    for layer, channels in groups.items():
        name = layer.rpartition(".")[2].casefold()
        found = next((p for p, pattern in GUESSES.items() if re.search(pattern, name)), None)
        known = [c for c in channels if c.rpartition(".")[2].upper() in tuple(_LETTERS)] or channels
        known.sort(key=lambda c: _LETTERS.find(c.rpartition(".")[2].upper()))
        if found is not None and found not in out and len(known) >= COMPONENTS[found]:
            out[found] = tuple(known[: COMPONENTS[found]])
    return out


def write_guess(path: Path, names: Iterable[str]) -> None:
    """Write a mapping of the passes that ``guess_passes`` finds, with the conventions of glTF.  Raises OutputError."""
    passes = {name: ChannelNames(channels) for name, channels in guess_passes(names).items()}
    _write(path, names, PassMap(passes, name=path.stem, up="y", motion=MotionMap(y="down")), [])


def write_found(path: Path, index: ChannelIndex, check: Check) -> None:
    """Write the mapping again with the conventions that ``check`` found.  Raises OutputError.

    What no mapping can say (the camera, frame order) is left as a comment.
    """
    mapping = index.mapping
    passes = {name: ChannelNames(index.channels(name)) for name in mapping.passes if name in index}
    values, motion, comments = {}, {}, []
    for verdict in check.wrong:
        name, value = verdict.convention, verdict.value
        if name == "components":
            passes["motion"] = ChannelNames(passes["motion"].channels[::-1])
        elif name in ("up", "normals") or (name == "positions" and value != "view"):
            values[name] = value
        elif name == "rows":
            values["rows"] = "bottom" if mapping.rows == "top" else "top"
        elif name == "meters":
            values["meters"] = mapping.meters * check.reading.factor
        elif name in MOTION and value not in ("half", "double"):
            motion[name] = value
        elif name == "depth" and value.partition(",")[0] in ("planar", "distance"):
            values["depth"], _, offset = value.partition(", depth_offset = ")
            values["depth_offset"] = float(offset or 0.0)
        else:
            comments.append(f"{name}: {verdict.text}")
    motion = structs.replace(mapping.motion, **motion)
    _write(path, index.names, structs.replace(mapping, passes=passes, motion=motion, **values), comments)


def _write(path: Path, names: Iterable[str], mapping: PassMap, comments: list[str]) -> None:
    lines, values = ["# Channels of the files:", *(f"#   {name}" for name in names)], to_builtins(mapping)
    tables = {"\n[motion]": values.pop("motion"), "\n[passes]": values.pop("passes")}
    for heading, table in {"\n".join(f"# {text}" for text in comments): values, **tables}.items():
        lines += [heading, *(f"{key} = {_toml(value)}" for key, value in table.items() if value is not None)]
    write_atomically(path, "\n".join(lines) + "\n", parents=True)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)  # what JSON writes of texts, numbers and lists is TOML

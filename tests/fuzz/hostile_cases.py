"""Hostile inputs of every kind of file that the program reads, each made from a seed number.

A case is a folder with the files of one command.  A valid document is changed where its structure says that it hurts:
types, numbers at their limits, references, nesting, keys, counts, missing parts; then one of its files may become a
link, a pipe, a folder, a sparse file of gigabytes or a file with another name.
"""

from __future__ import annotations

import copy
import json
import os
import random
import shutil
import struct
import subprocess
import sys
import tomllib
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fixed import fixed_settings
from hostile_seeds import AFF, MTL, OBJ, PART, damaged_text, gltf_seed, write_gltf

from taubench_gl.paths import PACKAGE

SPARSE = 3 << 30
DEEP = "@deep@"
"""Stands for brackets nested a hundred thousand times, which no writer of JSON or TOML writes."""

MOST_PLACES = 100_000  # of a document that is changed again
MOST_BYTES = 4_000_000  # of values that are repeated
LONG = "y" * 100_000
NUMBERS: list[Any] = [
    -1, 0, 1, 3, 255, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**53 + 1, 2**63, 2**64, 10**30, -0.0, 0.5, 1e-45,
    1e-30, 1e19, 1e308, -1e308, float("nan"), float("inf"),
]  # fmt: skip
TEXTS: list[Any] = [
    "", "x", "../foreign/secret", "/etc/passwd", "/dev/zero", "pipe", "loop", "link", "empty", "..", ".", "a\0b",
    "\x1b[2J", "\ud800", "=1+1", "%n%s", "{}", "nan", "1e999", "-1", LONG, "a/" * 3000, "é\u202e", "data:,", "https://127.0.0.1/x",
]  # fmt: skip
SHAPES: list[Any] = [None, True, False, [], {}, [[]], [0], {"x": {}}, [1e38] * 3, [0] * 4, [[1, 2], 3], DEEP]


@dataclass(frozen=True)
class Case:
    """``command``: arguments of taubench-gl, or ``@name`` of ``hostile_server.CALLS`` and a file.

    ``named``: the file that the command names; what it links to may be read.  Folders of results may hold links to
    files elsewhere, which may be read too.
    """

    number: int
    kind: str
    command: list[str]
    named: Path


# ----------------------------------------------------------------------------------------------------------- documents


def places(value: Any) -> list[tuple[Any, Any]]:
    """(owner, key) of everything in nested objects and lists, up to ``MOST_PLACES``."""
    out, level = [], [value]
    while level and len(out) < MOST_PLACES:
        one = level.pop()
        items = one.items() if isinstance(one, dict) else enumerate(one) if isinstance(one, list) else ()
        for key, item in items:
            out.append((one, key))
            level.append(item)
    return out


def change(document: Any, rng: random.Random) -> None:
    """One change of a JSON or TOML document, in place."""
    found = places(document)
    if not 0 < len(found) < MOST_PLACES:
        return
    # Lists of numbers have most places: half of the changes are elsewhere.
    structure = [place for place in found if not (isinstance(place[0], list) and len(place[0]) > 2)]
    owner, key = rng.choice(structure if structure and rng.random() < 0.7 else found)
    value, kind = owner[key], rng.random()
    if kind < 0.12:
        del owner[key]
    elif kind < 0.4 and isinstance(value, (int, float)) and not isinstance(value, bool):
        owner[key] = value + rng.choice((-1, 1, 2, 1000, 10**9)) if rng.random() < 0.4 else rng.choice(NUMBERS)
    elif kind < 0.55:
        owner[key] = copy.deepcopy(rng.choice(NUMBERS))
    elif kind < 0.68:
        owner[key] = rng.choice(TEXTS)
    elif kind < 0.78:
        owner[key] = copy.deepcopy(rng.choice(SHAPES))
    elif kind < 0.84 and isinstance(value, list) and value:
        times = min(rng.choice((2, 300, 20_000)), MOST_BYTES // len(json_text(value)))
        owner[key] = [copy.deepcopy(one) for _ in range(times) for one in value]  # each may be changed
    elif kind < 0.88 and len(json_text(value)) < MOST_BYTES // 20:
        owner[key] = {f"key {i}": copy.deepcopy(value) if i < 10 else i for i in range(rng.choice((20, 50_000)))}
    elif kind < 0.91 and isinstance(owner, dict):
        owner[rng.choice(TEXTS)] = owner.pop(key)
    elif kind < 0.94:
        for _ in range(rng.choice((3, 30, 70))):
            value = [value] if rng.random() < 0.5 else {"a": value}
        owner[key] = value
    else:
        other, name = rng.choice(found)
        owner[key] = copy.deepcopy(other[name]) if name in other or isinstance(other, list) else None


def changed(document: Any, rng: random.Random) -> Any:
    out = copy.deepcopy(document)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change(out, rng)
    return out


def json_text(document: Any) -> str:
    try:
        text = json.dumps(document, ensure_ascii=False)
    except RecursionError:
        text = "[" * 3000 + "]" * 3000
    return text.replace(f'"{DEEP}"', "[" * 100_000 + "]" * 100_000)


def toml_text(document: dict[str, Any]) -> str:
    def text(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{json.dumps(str(k))} = {text(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(text, value)) + "]"
        if isinstance(value, float):
            return repr(value)
        return '"none"' if value is None else json.dumps(value)

    try:
        lines = [f"{json.dumps(str(key))} = {text(value)}" for key, value in document.items()]
    except RecursionError:
        lines = ["x = " + "[" * 3000 + "]" * 3000]
    return "\n".join(lines).replace(f'"{DEEP}"', "[" * 100_000 + "]" * 100_000) + "\n"


def encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def damaged_bytes(data: bytes, rng: random.Random, head: int = 1 << 30) -> bytes:
    """A few bytes of the first ``head`` changed, removed or doubled."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at, kind = rng.randrange(max(1, min(len(out), head))), rng.random()
        if kind < 0.7 and at < len(out):
            out[at] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        elif kind < 0.85:
            out[at:at] = struct.pack("<I", rng.choice((0, 1, 2**31 - 1, 2**32 - 1)))
        else:
            del out[at : at + rng.choice((1, 4, 64, 1 << 20))]
    return bytes(out)


# --------------------------------------------------------------------------------------------------------------- files


def surroundings(folder: Path) -> None:
    """A foreign file beside the inputs, and traps that documents may name."""
    (folder / "foreign").mkdir(parents=True)
    (folder / "foreign" / "secret").write_bytes(b"v 1 2 3\nnot yours\n" * 20)
    inputs = folder / "in"
    inputs.mkdir()
    os.mkfifo(inputs / "pipe")
    (inputs / "loop").symlink_to("loop")
    (inputs / "link").symlink_to("../foreign/secret")
    (inputs / "empty").touch()


def disguise(path: Path, rng: random.Random) -> Path:
    """``path`` as something else than the regular file with that name.  -> its new path."""
    kind = rng.randrange(9)
    if kind < 3:  # gigabytes without content, after the content or instead of it
        with open(path, "r+b" if kind else "wb") as file:
            file.truncate(SPARSE)
    elif kind == 3:
        path.unlink()
        os.mkfifo(path)
    elif kind == 4:
        path.unlink()
        path.symlink_to(rng.choice(("loop", "../foreign/secret", "/dev/zero", "pipe", path.name)))
    elif kind == 5:
        path.unlink()
        path.mkdir()
    elif kind == 6:
        name = os.fsencode(path.stem) + rng.choice((b"\xe9", b"\n", b"\x1b[2J", b" ", b"%d", b"y" * 200))
        other = Path(os.fsdecode(os.fsencode(path.parent) + b"/" + name + os.fsencode(path.suffix)))
        path.rename(other)
        return other
    elif kind == 7:
        target = path.with_name("target" + path.suffix)
        path.rename(target)
        path.symlink_to(target.name)
    else:
        contents = (b"", b"\0" * 5000, b"\xff\xfe" + b"[" * 5000, b"[" * 200_000, b"a." * 40_000 + b"a=1")
        path.write_bytes(rng.choice(contents))
    return path


def png(width: int, height: int) -> bytes:
    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = part(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + part(b"IDAT", zlib.compress(bytes(13 * 4))) + part(b"IEND", b"")


# ---------------------------------------------------------------------------------------------------------------- kinds


def scene_command(path: Path, out: Path, rng: random.Random) -> list[str]:
    kind = rng.random()
    if kind < 0.75:
        return ["@scene", str(path)]
    if kind < 0.85:
        return ["inspect", str(path), *rng.choice(([], ["--json"], ["--strict"]))]
    if kind < 0.95:
        return ["@evaluate", str(path)]
    size = ["--size", "24x16", "--frames", "0:3", "--shadow-size", "32", "--indirect", "none"]
    light = rng.choice(([], ["--light", "preview"], ["--light", "preview"]))
    return ["evaluate", str(path), "--out", str(out), *size, *light]


def amplify(document: dict, rng: random.Random) -> None:
    """A few bytes that stand for many: counts without data, shared data, instances, nodes, keys of animations."""
    accessors, nodes = document["accessors"], document["nodes"]
    kind, count = rng.randrange(7), rng.choice((10**5, 10**7, 2**31 - 1, 10**12))
    if kind == 0:
        accessor = rng.choice(accessors)
        accessor.pop("bufferView", None)
        accessor["count"] = count
    elif kind == 1:
        accessors.append({"componentType": 5126, "type": "VEC3", "count": count})
        instancing = {"attributes": {"TRANSLATION": len(accessors) - 1}}
        rng.choice(nodes)["extensions"] = {"EXT_mesh_gpu_instancing": instancing}
        document["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    elif kind == 2:
        mesh = rng.choice(document["meshes"])
        mesh["primitives"] = mesh["primitives"] * min(count, 3000)  # each is a draw
    elif kind == 3:
        start, more = len(nodes), min(count, 30_000)
        nodes += [{"mesh": 0, "children": [start + i + 1] if rng.random() < 0.999 else []} for i in range(more)]
        nodes.append({})
        document["scenes"][0]["nodes"].append(start)
    elif kind == 4:
        indices = {"bufferView": 0, "componentType": 5125}
        rng.choice(accessors)["sparse"] = {"count": count, "indices": indices, "values": {"bufferView": 1}}
    elif kind == 5:
        document["images"] = [{"uri": "huge.png"} for _ in range(min(count, 2000))]
        document["textures"] = [{"source": i} for i in range(len(document["images"]))]
        document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}}
                                 for i in range(len(document["images"]))]  # fmt: skip
    else:
        document["animations"] = document["animations"] * min(count, 3000)


def gltf(folder: Path, rng: random.Random, seeds: Path) -> Case:
    document, blob = gltf_seed()
    document["images"] = [{"uri": "tex.png"}]
    document["textures"] = [{"source": 0}]
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    (folder / "in" / "tex.png").write_bytes(png(1, 1) if rng.random() < 0.5 else png(60_000, 60_000))
    (folder / "in" / "huge.png").write_bytes(png(16384, 16384))
    if rng.random() < 0.35:
        amplify(document, rng)
        document = json.loads(json.dumps(document))  # nothing shared: each may be changed
    if rng.random() < 0.8:
        document = changed(document, rng)
    path = folder / "in" / rng.choice(("scene.gltf", "scene.glb"))
    buffer = {"uri": rng.choice(("scene.bin", "scene.bin", "link", "pipe", "loop"))} if rng.random() < 0.3 else None
    (folder / "in" / "scene.bin").write_bytes(blob)
    write_gltf(path, document, blob, buffer, json_text)
    if rng.random() < 0.15:
        path.write_bytes(damaged_bytes(path.read_bytes(), rng))
    other = rng.choice((path, folder / "in" / "tex.png", folder / "in" / "scene.bin"))
    if rng.random() < 0.2:
        found = disguise(other, rng)
        path = found if other == path else path
    return Case(0, "gltf", scene_command(path, folder / "out", rng), path)


LINES = {
    "obj": ["mtllib {}", "usemtl {}", "map_Kd {}", "f 1 2 {}", "v {} 0 0", "f " + "1 " * 90_000],
    "aff": ["i 0 {}", "i 9 {}", "tt {} 0 0 0 0 0 1 0 0 1 0 0 1 0 0 1", "p {} 0 0 0", "tpa {}", "k ball {{ transl {}",
            "xs 1 1 1 0 1 0 0 1 0 0 {{ " * 5000, "i 0 scene.aff"],
}  # fmt: skip
"""Lines with a reference or a count, to be filled in."""


def text_scene(folder: Path, rng: random.Random, seeds: Path) -> Case:
    kind = rng.choice(("obj", "aff"))
    text, beside, name = {"obj": (OBJ, MTL, "a.mtl"), "aff": (AFF, PART, "part.aff")}[kind]
    path, other = folder / "in" / f"scene.{kind}", folder / "in" / name
    lines = text.split("\n")
    if rng.random() < 0.3:  # references and counts
        line = rng.choice(LINES[kind])
        value = rng.choice([*TEXTS[:20], *map(str, NUMBERS)])
        lines.insert(rng.randrange(len(lines)), line.format(value))
    path.write_bytes(damaged_text("\n".join(lines).encode("utf-8", "surrogatepass").decode("utf-8", "replace"), rng))
    other.write_bytes(damaged_text(beside, rng) if rng.random() < 0.3 else beside.encode())
    if rng.random() < 0.25:
        chosen = rng.choice((path, other))
        found = disguise(chosen, rng)
        path = found if chosen == path else path
    return Case(0, kind, scene_command(path, folder / "out", rng), path)


def frames(folder: Path, rng: random.Random, seeds: Path) -> Case:
    """A folder of EXR frames with a camera file and a mapping of passes."""
    frames = folder / "in" / "frames"
    shutil.copytree(seeds / "exr", frames)
    mapping = folder / "in" / "mapping.toml"
    table = tomllib.loads((PACKAGE / "pathtraced" / "presets" / "taubench.toml").read_text())
    mapping.write_bytes(encoded(toml_text(changed(table, rng) if rng.random() < 0.3 else table)))
    camera = frames / "camera.json"
    sidecar = json.loads(camera.read_text())
    if rng.random() < 0.4:
        camera.write_bytes(encoded(json_text(changed(sidecar, rng))))
    images = sorted(frames.glob("*.exr"))
    for image in images:
        if rng.random() < 0.3:
            image.write_bytes(damaged_bytes(image.read_bytes(), rng, 1400))
        elif rng.random() < 0.1:  # the corners of the data window
            data = bytearray(image.read_bytes())
            at = data.find(b"dataWindow\0box2i\0") + 21
            corners = (rng.choice((0, -1, 30_000, 10**9, 2**31 - 1, -(2**31))) for _ in range(4))
            data[at : at + 16] = struct.pack("<4i", *corners)
            image.write_bytes(data)
    if rng.random() < 0.15:
        names = ("frame_99999999999999999999.exr", "frame_1.exr", "x.exr", "frame_00007.exr")
        images[1].rename(frames / rng.choice(names))
    elif rng.random() < 0.3:
        disguise(rng.choice((*images, camera, mapping)), rng)
    spec, kind = f"exr:{frames}", rng.random()
    if kind < 0.6:
        command = ["reference", "check", spec, "--camera-file", str(camera), "--mapping", str(mapping)]
    elif kind < 0.8:
        command = ["reference", "check", spec]
    else:
        command = ["evaluate", spec, "--out", str(folder / "out")]
    return Case(0, "exr", command, frames)


TOML_ENDS = (
    "a." * 40_000 + "a = 1\n", "[x]\n" * 50_000, '"' + "x" * 90_000, "x = 1_000_0", "[" + "a." * 4000 + "a]", "\0",
    "".join(f"[k{i}]\n" for i in range(60_000)), "x = 99999-01-01", "x = 0x" + "f" * 9000,
)  # fmt: skip


def toml(kind: str, name: str, document: Callable[[Path], dict], command: Callable[[Path, Path], list[str]]) -> Any:
    """A kind of TOML file: the valid document, and the command that reads it."""

    def made(folder: Path, rng: random.Random, seeds: Path) -> Case:
        path = folder / "in" / name
        text = toml_text(changed(document(folder), rng))
        if rng.random() < 0.1:
            text += rng.choice(TOML_ENDS)
        path.write_bytes(encoded(text))
        if rng.random() < 0.15:
            path.write_bytes(damaged_bytes(path.read_bytes(), rng))
        if rng.random() < 0.15:
            path = disguise(path, rng)
        return Case(0, kind, command(path, folder / "out"), path)

    return made


def method(folder: Path, rng: random.Random, seeds: Path) -> Case:
    """A reuse method or a rejection test in its folder."""
    method_folder = folder / "in" / "method"
    source = rng.choice([p.parent for p in sorted((PACKAGE / "reuse" / "methods").glob("*/method.toml"))])
    shutil.copytree(source, method_folder)
    table = tomllib.loads((method_folder / "method.toml").read_text())
    (method_folder / "method.toml").write_bytes(encoded(toml_text(changed(table, rng))))
    shaders = sorted(method_folder.glob("*.glsl"))
    if rng.random() < 0.25:
        disguise(rng.choice([method_folder / "method.toml", *shaders]), rng)
    command = ["reuse", "check" if rng.random() < 0.15 else "show", str(method_folder)]
    return Case(0, "method", command, method_folder)


def stored_run(folder: Path, rng: random.Random, seeds: Path) -> Case:
    run = folder / "in" / "run"
    shutil.copytree(seeds / "run", run)
    summary, rows, mask = run / "summary.json", run / "frames.csv", run / "masks" / "mask_00001.npz"
    kind = rng.random()
    if kind < 0.5:
        document = json.loads(summary.read_text())
        if kind < 0.4:
            document.pop("stored", None)  # with its checksum no change would reach the readers
        summary.write_bytes(encoded(json_text(changed(document, rng))))
    elif kind < 0.75:
        lines = [line.split(",") for line in rows.read_text().splitlines()]
        for _ in range(rng.choice((1, 2, 5))):
            row, action = rng.randrange(len(lines)), rng.randrange(5)
            if action == 0:
                del lines[row]
                lines = lines or [[""]]
            elif action == 1:
                lines.insert(row, list(rng.choice(lines)))
            elif action == 2:
                lines.append([*lines[row], *["0"] * rng.choice((1, 100_000))])
            else:
                line = lines[row]
                line[rng.randrange(len(line))] = str(rng.choice([*NUMBERS, *TEXTS]))
        rows.write_bytes(encoded("\n".join(map(",".join, lines)) + "\n"))
    else:
        mask.write_bytes(damaged_bytes(mask.read_bytes(), rng))
    if rng.random() < 0.2:
        disguise(rng.choice((summary, rows, mask)), rng)
    other, out = str(seeds / "run"), str(folder / "out")
    commands = (["compare", str(run)], ["compare", str(run), other], ["report", str(run), "--out", out + ".html"],
                ["reference", "compare", str(run), other, "--out", out])  # fmt: skip
    command = rng.choice(commands)
    return Case(0, "run", command, folder / "foreign" / "secret")


def stored_batch(folder: Path, rng: random.Random, seeds: Path) -> Case:
    out = folder / "out"  # batch report writes into it
    shutil.copytree(seeds / "batch", out)
    texts = sorted(path for path in out.rglob("*") if path.suffix in (".json", ".jsonl", ".csv", ".parquet"))
    path = rng.choice(texts)
    if path.suffix == ".json" and rng.random() < 0.8:
        path.write_bytes(encoded(json_text(changed(json.loads(path.read_text()), rng))))
    else:
        path.write_bytes(damaged_bytes(path.read_bytes(), rng))
    if rng.random() < 0.2:
        path.unlink()
        path.symlink_to(folder / "foreign" / "secret")
    return Case(0, "batch", ["batch", rng.choice(("status", "report")), str(out)], folder / "foreign" / "secret")


def spec_document(folder: Path) -> dict[str, Any]:
    demo = str(PACKAGE.parent / "assets" / "demo.glb")
    return {
        "name": "spec", "scenes": [demo, {"path": demo, "frames": "0:4", "thresholds": {"normal": 0.05}}],
        "frames": "0:9", "size": ["48x27", "64x36"], "fps": [24, 60], "columns": ["frustum", "position"],
        "light_unit": "candela", "exposure": 1.0, "environment": "none", "reprojection": ["camera", "motion"],
        "thresholds": {"color": [0.1, 0.2]},
    }  # fmt: skip


def suite_document(folder: Path) -> dict[str, Any]:
    case = {"scene": "demo", "track": "noisy", "input": "noisy", "seeds": 2, "exposure": 1.6}
    cases = [case | {"environment": [1.0, 1.0, 1.0]}, case | {"track": "cuts", "cut": [4]}]
    return {"schema": "suite/1", "name": "small", "size": "32x18", "frames": 3, "cases": cases}


def preset_document(folder: Path) -> dict[str, Any]:
    settings = {"light": "auto", "spp": 16, "indirect": "probes", "probes": 768, "thresholds": {"color": 0.1}}
    measured = {"scene": "demo", "wrong_percent": {"color": 0.7}}
    return {"schema": "taubench-gl/preset/1", "settings": settings, "measured": measured}


def registry_document(folder: Path) -> dict[str, Any]:
    return tomllib.loads((PACKAGE / "datasets" / "registry.toml").read_text())


KINDS: list[tuple[int, Callable[[Path, random.Random, Path], Case]]] = [
    (34, gltf),
    (14, text_scene),
    (14, frames),
    (8, toml("spec", "spec.toml", spec_document, lambda path, out: ["@spec", str(path)])),
    (6, toml("suite", "suite.toml", suite_document, lambda path, out: ["@suite", str(path)])),
    (5, toml("preset", "preset.toml", preset_document, lambda path, out: ["@preset", str(path)])),
    (3, toml("registry", "registry.toml", registry_document,
             lambda path, out: ["scenes", "list", "--registry", str(path)])),
    (8, method),
    (18, stored_run),
    (3, stored_batch),
]  # fmt: skip
"""Shares of the kinds of cases."""


def make_case(number: int, seed: int, folder: Path, seeds: Path) -> Case:
    """Case ``number`` of a series: its files in the new ``folder``.  ``seeds``: ``make_seeds``."""
    rng = random.Random(f"{seed} {number}")
    surroundings(folder)
    # One kind after the other, so that a short series has all of them.
    turn = [kind for round_ in range(max(w for w, _ in KINDS)) for weight, kind in KINDS if round_ < weight]
    case = turn[number % len(turn)](folder, rng, seeds)
    return Case(number, case.kind, case.command, case.named)


def make_seeds(folder: Path) -> None:
    """A run, a batch and EXR frames of the demo scene."""
    from taubench_gl import evaluate
    from taubench_gl.export.run import ExportOptions, export_scene

    demo = PACKAGE.parent / "assets" / "demo.glb"
    small: dict[str, Any] = {"columns": ("frustum", "position", "normal"), "light_unit": "candela", "exposure": 1.0,
                             "environment": "none"}  # fmt: skip
    evaluate(demo, out=folder / "run", size="24x16", frames=range(3), save="masks", **small)
    settings = fixed_settings(width=24, height=16, frames=(0, 3), reprojection="motion", **small)
    export_scene(demo, folder / "exr", settings, ExportOptions("exr", ("gbuffer", "flow")))
    spec = spec_document(folder) | {"scenes": [str(demo)], "frames": "0:3", "size": "24x16", "fps": 24}
    (folder / "spec.toml").write_text(toml_text(spec))
    batch = [sys.executable, "-m", "taubench_gl", "batch", "run", folder / "spec.toml", "--out", folder / "batch"]
    subprocess.run(batch, check=True, capture_output=True)

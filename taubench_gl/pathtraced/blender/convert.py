"""Files that Blender reads -> glTF, with Blender's importers and exporter."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.data_files import opened, read_bytes
from taubench_gl.errors import SceneError
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.blender.glb import Glb
from taubench_gl.pathtraced.blender.process import blender_python, require_blender, run_script
from taubench_gl.scene import CONVERTIBLE
from taubench_gl.scene.files import require_content

LIGHTING_MODE = "SPEC"
"""Mode of Blender's exporter: candela and lux at 683 lumens per watt, what ``light_unit`` expects of its files."""

VERSION = 2
"""Version of the files that a conversion writes: those of another version are not reused."""

WITH_TAKES = (".fbx", ".blend")
"""Suffixes of files with takes: of FBX files their takes, of .blend files their actions."""

_MAX_LOST = 40
MAX_BYTES = 4 << 30
"""Limit on a file that Blender has written: the largest binary glTF file."""
_KINDS = (("meshes", "MESH"), ("cameras", "CAMERA"), ("lights", "LIGHT"), ("armatures", "ARMATURE"))


@dataclass(frozen=True, slots=True)
class Conversion:
    """What was read and written.

    ``counts``: of meshes, cameras, lights, armatures and actions in the source.  ``lost``: one line for each kind of
    content that the written file lacks.  ``frames``: first and last of the source; the first is at 0 s.
    """

    blender: str
    counts: dict[str, int]
    lost: tuple[str, ...]
    fps: float
    frames: tuple[int, int]
    environment: Path | tuple[float, float, float] | None = None


def convert(
    source: str | Path,
    target: str | Path,
    *,
    take: str | None = None,
    up_axis: str | None = None,
    python: str | None = None,
) -> Conversion:
    """Write ``source`` as the .glb file ``target``, atomically: motion, cameras, and lights in candela and lux.

    ``take``: of an FBX file, None: its first; of a .blend file the action to play, None: the scene as it is.
    ``up_axis``: "Y" or "Z" (None: Z) of a PLY or STL file, which names none.  The world becomes an environment image
    beside ``target`` where it is not one color.  Raises SceneError for a file that Blender
    cannot read, PathTracedError without Blender, OutputError.
    """
    source, target, python = Path(source), Path(target), python or blender_python()
    _check(source, target, take, up_axis)
    require_blender(python)
    with tempfile.TemporaryDirectory(prefix="taubench-") as name:
        folder = Path(name)
        glb_file, image = folder / "scene.glb", folder / "environment.exr"
        job = {"source": str(source.resolve()), "target": str(glb_file), "environment": str(image),
               "lights": LIGHTING_MODE, "take": take, "up_axis": up_axis}  # fmt: skip
        event = _run(python, job, folder, source)
        environment = _environment(event, image, target)
        data = _finished(read_bytes(glb_file, max_bytes=MAX_BYTES), event, source, environment)
        if isinstance(environment, Path):
            write_atomically(environment, read_bytes(image, max_bytes=MAX_BYTES), parents=True)
        write_atomically(target, data, parents=True)
    counts = {name: event["counts"][kind] for name, kind in _KINDS} | {"actions": event["actions"]}
    first, last = event["frames"]
    return Conversion(event["blender"], counts, tuple(event["lost"]), event["fps"], (first, last), environment)


def _check(source: Path, target: Path, take: str | None, up_axis: str | None) -> None:
    """Raises SceneError for files that cannot be converted."""
    suffix = source.suffix.lower()
    if suffix not in CONVERTIBLE:
        raise SceneError("is no file that Blender converts", where=str(source), hint=f"known: {', '.join(CONVERTIBLE)}")
    if not source.is_file():
        raise SceneError("does not exist", where=str(source))
    if target.suffix.lower() != ".glb":
        raise SceneError("can only be written as .glb", where=str(target), hint="give a name that ends in .glb")
    if suffix not in WITH_TAKES and take is not None:
        raise SceneError("has no takes", where=str(source), hint="only FBX and .blend files have: omit --take")
    if suffix not in (".ply", ".stl") and up_axis is not None:
        raise SceneError("names its up axis", where=str(source), hint="only PLY and STL files do not: omit --up-axis")
    with opened(source, SceneError) as file:
        start = file.read(512)
    require_content(start, source)
    if suffix == ".stl" and not start.lstrip().startswith(b"solid"):
        # Blender reads the triangles of any bytes: an 80-byte header, their number, 50 bytes each.
        count = int.from_bytes(start[80:84], "little")
        if len(start) < 84 or source.stat().st_size < 84 + 50 * count:
            raise SceneError(f"ends before its {count} triangles", where=str(source), hint="is it a complete STL file?")


def _run(python: str, job: dict[str, Any], folder: Path, source: Path) -> dict[str, Any]:
    events: dict[str, dict[str, Any]] = {}
    failure = run_script(python, "convert_script.py", job, folder, lambda event: events.update({event["event"]: event}))
    if "failed" in events:
        raise SceneError(events["failed"]["why"], where=str(source))
    if "done" not in events:
        raise SceneError(failure or "Blender stopped without a result", where=str(source))
    return events["done"]


def _environment(event: dict[str, Any], image: Path, target: Path) -> Path | tuple[float, float, float] | None:
    """The environment of the written file: an image beside it, a radiance or None."""
    world = event["environment"]
    if world is None:
        return None
    if isinstance(world, str):
        return target.with_name(f"{target.stem}.environment.exr") if image.is_file() else None
    r, g, b = world
    return float(r), float(g), float(b)


def _finished(
    data: bytes, event: dict[str, Any], source: Path, environment: Path | tuple[float, float, float] | None
) -> bytes:
    """The file with exact times and visibility, and what the scene reader shows of its origin."""
    glb = Glb(data)
    if event["time_scale"] != 1.0:
        glb.scale_times(event["time_scale"])
    glb.match_intensities()
    glb.drop_still_channels()
    glb.hide(event["visible"], event["fps"])
    for animation in glb.root.get("animations", ()):
        animation["name"] = event.get("take") or animation.get("name", "Scene")
    first, last = event["frames"]
    note = f"converted from {source.name} by Blender {event['blender']}"
    if last > first:
        note += f": frame {first} is at 0 s, {event['fps']:.8g} frames per second (--fps {event['fps']:.8g})"
    if event["camera"]:
        note += "; rendered at {}x{}".format(*event["size"])
    facts: dict[str, Any] = {"name": source.stem, "note": note, "lost": event["lost"][:_MAX_LOST]}
    if event["camera"]:
        facts["camera"] = event["camera"]
    if isinstance(environment, Path):
        facts["environment"] = environment.name
    elif environment is not None:
        facts["environment"] = ",".join(f"{value:.6g}" for value in environment)
    glb.describe(facts)
    return glb.data()

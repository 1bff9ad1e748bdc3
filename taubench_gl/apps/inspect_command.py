"""``taubench-gl inspect``: contents of a scene file, and the exposure of its evaluations."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import AS_JSON, command, option_group
from taubench_gl.apps.screen import show_json, show_pairs
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.scene.model import Scene

MAX_INSPECTED = 10_000
"""Frames compared for scene statistics: seven minutes at 24 fps, seconds of work."""


@command(settings=option_group(only=("scene", "animation", "strict", "fps", "unit_scale")))
@click.argument("path", metavar="SCENE|DIR")
def inspect(path: str, settings: Settings, *, as_json: bool = AS_JSON) -> int | None:
    """Print what a scene contains: objects, armatures, lights, cameras, animations, size, and notes of the reader.

    Draws only to meter the exposure, which comes last and is not printed where there is no OpenGL.  Of an export DIR of
    format nss or noisebase: its arrays, and whether motion, depth, offsets, positions and light agree; the exit code is
    1 if something is wrong.

    Examples:
      taubench-gl inspect scene.glb
      taubench-gl inspect scene.gltf --animation walk --json
      taubench-gl inspect nss
    """
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.scene import load_scene

    if (Path(path) / "export.json").is_file():
        from taubench_gl.export.sequence_check import inspect_export

        return _show_export(inspect_export(Path(path)), as_json)
    path, row = resolve(path, settings.sequence.animation)
    settings = settings.replace(**row_settings(row))
    scene = load_scene(path, **settings.sequence.reading)
    contents = describe(scene, settings)
    if as_json:
        show_json(contents | {"exposure": metered_exposure(scene, settings)})
        return
    _show(contents)
    sys.stdout.flush()  # metering a large scene takes a while
    show_pairs("Exposure", {"of every evaluation": _exposure_text(**metered_exposure(scene, settings))})


def _show_export(found: dict[str, dict[str, Any]], as_json: bool) -> int:
    """Print the contents and checks of an export for learning; 1 if something is wrong, else 0."""
    if as_json:
        show_json(found)
    for heading, pairs in {} if as_json else found.items():
        show_pairs(heading.capitalize().replace("_", " "), pairs)
    return int(any(text.startswith("wrong") for text in found["checks"].values()))


def describe(scene: Scene, settings: Settings) -> dict[str, Any]:
    """Contents of a scene as JSON values; lengths in meters, angles in degrees, times in seconds.

    Statistics compare at most MAX_INSPECTED frames, evenly spaced (``frames_inspected``).
    """
    from taubench_gl.animation import OrbitCamera, Poser, bounding_sphere, camera_of_run
    from taubench_gl.effects.census import census
    from taubench_gl.effects.lighting import environment_for, light_unit_of, without_auto
    from taubench_gl.effects.path_tracing import left_out
    from taubench_gl.evaluation.appearance import transparency_notes
    from taubench_gl.evaluation.schedule import frame_total
    from taubench_gl.frame.memory import memory_of_frame
    from taubench_gl.frame.plan import effect_costs, frame_spec
    from taubench_gl.frame.spec import AnimatedScene

    poser, camera = Poser(scene, settings.sequence.fps), camera_of_run(scene, settings.sequence)
    frames = frame_total(scene, camera, settings)
    inspected = min(frames, MAX_INSPECTED)
    inspected_frames = (i if inspected == frames else i * (frames - 1) // (inspected - 1) for i in range(inspected))
    counts = census(scene, (i / settings.sequence.fps for i in inspected_frames), poser)
    center, radius = bounding_sphere(poser, [0.0])
    unit = settings.metrics.unit_scale
    animated, drawn = AnimatedScene(scene, camera, poser), without_auto(scene, settings)
    return {
        "name": scene.name,
        "path": None if scene.path is None else str(scene.path),
        "size": [drawn.sequence.width, drawn.sequence.height],
        "memory_bytes": memory_of_frame(frame_spec(animated, drawn)),
        "bytes": scene.path.stat().st_size if scene.path is not None and scene.path.is_file() else None,
        "sha256": scene.sha256,
        "scenes": list(scene.scene_names),
        "duration_s": scene.duration,
        "fps": settings.sequence.fps,
        "frames": frames,
        "frames_inspected": inspected,
        "bounds": {"center": (center / unit).tolist(), "radius_m": radius / unit},
        "census": counts,
        "camera": camera.describe(unit) if isinstance(camera, OrbitCamera) else camera.describe(),
        "cameras": [_camera(scene, int(node), unit) for node in scene.camera_nodes],
        "animations": [
            {"name": a.name, "duration_s": a.duration, "channels": len(a.channels), "plays": a.name in scene.playing}
            for a in scene.animations
        ],
        "lights": [_light(scene, int(node), unit) for node in scene.light_nodes],
        "generator": scene.generator,
        "light_unit": dataclasses.asdict(light_unit_of(scene)),
        "environment": dataclasses.asdict(environment_for(scene)),
        "effects": effect_costs(animated, drawn),
        "materials": len(scene.materials),
        "images": [{"name": image.name, "width": image.size[0], "height": image.size[1]} for image in scene.images],
        "notes": [
            *map(str, (*scene.notes, *left_out(scene, settings))),
            *transparency_notes(scene, settings.sequence.blend),
        ],
    }


def metered_exposure(scene: Scene, settings: Settings) -> dict[str, Any]:
    """The exposure of every evaluation of this scene with this camera, ``value``, and the ``reason`` for it.

    The value is None without OpenGL and without triangles.
    """
    from taubench_gl.errors import TaubenchError
    from taubench_gl.evaluation import plan_scene

    try:
        resolved = plan_scene(scene, settings.replace(light="raster")).lighting  # no samples to choose
    except TaubenchError as error:
        return {"value": None, "reason": error.what}
    return {"value": resolved.settings.lighting.exposure, "reason": resolved.reasons["exposure"]}


def _camera(scene: Scene, node: int, unit: float) -> dict[str, Any]:
    """The camera of a node; ``unit``: scene units per meter."""
    camera = scene.cameras[scene.nodes.camera[node]]
    lens = {"xmag_m": camera.xmag / unit, "ymag_m": camera.ymag / unit}
    if camera.kind == "perspective":
        lens = {"yfov_deg": math.degrees(camera.yfov)}
    far = camera.zfar / unit if math.isfinite(camera.zfar) else None
    named = {"node": scene.nodes.names[node], "name": camera.name, "kind": camera.kind}
    return named | lens | {"near_m": camera.znear / unit, "far_m": far}


def _light(scene: Scene, node: int, unit: float) -> dict[str, Any]:
    """The light of a node; ``unit``: scene units per meter."""
    light = scene.lights[scene.nodes.light[node]]
    return {
        "node": scene.nodes.names[node],
        "name": light.name,
        "kind": light.kind,
        "color": list(light.color),
        "intensity": light.intensity,
        "unit": "lx" if light.kind == "directional" else "cd",
        "range_m": light.range / unit if math.isfinite(light.range) else None,
    }


def _show(contents: dict[str, Any]) -> None:
    size = contents["bounds"]
    where = ", ".join(f"{x:.3g}" for x in size["center"])
    file = None if contents["bytes"] is None else f"{contents['path']} ({contents['bytes']:,} bytes)"
    show_pairs(
        f"Scene {contents['name']}",
        {
            "file": file,
            "sha256": contents["sha256"],
            "scenes": ", ".join(name or "(no name)" for name in contents["scenes"]) or None,
            "duration": f"{contents['duration_s']:.3f} s, {contents['frames']} frames at {contents['fps']:g} fps",
            "bounds": f"radius {size['radius_m']:.4g} m around ({where}) at time 0",
            "memory": _memory_line(contents["memory_bytes"], contents["size"]),
            "materials, images": f"{contents['materials']}, {len(contents['images'])}",
            "camera used": contents["camera"],
            "light unit": "{value} ({reason})".format(**contents["light_unit"]),
            "environment": "{value} ({reason})".format(**contents["environment"]),
        },
    )
    counts = {name.replace("_", " "): n for name, n in contents["census"].items() if not isinstance(n, dict | list)}
    compared = f"frames compared at {contents['fps']:g} fps"
    if contents["frames_inspected"] < contents["frames"]:
        compared = f"{contents['frames_inspected']} frames compared, evenly spaced"
    show_pairs(f"Contents ({compared})", counts)
    for heading, key in (("Cameras", "cameras"), ("Animations", "animations"), ("Lights", "lights")):
        entries = contents[key]
        lines = {f"{i}": _line(entry) for i, entry in enumerate(entries[:20])}
        if len(entries) > 20:
            lines["..."] = f"{len(entries) - 20} more, see --json"
        if lines:
            show_pairs(heading, lines)
    width, height = contents["size"]
    show_pairs(
        f"Effects of an evaluation at {width}x{height} with default settings", _effect_lines(contents["effects"])
    )
    if contents["notes"]:
        show_pairs("Notes of the reader", {f"{i}": note for i, note in enumerate(contents["notes"], start=1)})


def _exposure_text(value: float | None, reason: str) -> str:
    return f"{'not metered' if value is None else f'{value:g}'} ({reason})"


def _memory_line(memory: dict[str, int], size: list[int]) -> str:
    from taubench_gl.memory_budget import limit, shown_bytes

    parts = ", ".join(f"{kind} {shown_bytes(count)}" for kind, count in memory.items() if count)
    return f"{shown_bytes(sum(memory.values()))} of at most {shown_bytes(limit())} at {size[0]}x{size[1]} ({parts})"


def _effect_lines(effects: dict[str, Any]) -> dict[str, str]:
    """One line per effect: enabled or not, why, and what a frame has because of it, or would have."""
    lines = {}
    for name, effect in effects.items():
        parts = [f"{'on ' if effect['on'] else 'off'} {effect['reason']}"]
        cost = [f"pass {p}" for p in effect["passes"]]
        if effect["textures"]:
            shown = effect["textures"][:3] + (
                [f"and {len(effect['textures']) - 3} more"] * (len(effect["textures"]) > 3)
            )
            cost.append(", ".join(shown))
        if effect["shaders"]:
            cost.append(f"{len(effect['shaders'])} shader{'s' * (len(effect['shaders']) > 1)}")
        if effect["gpu_bytes"]:
            cost.append(f"{effect['gpu_bytes'] / 2**20:.1f} MiB")
        if cost:
            parts.append(("adds " if effect["on"] else "would add ") + "; ".join(cost))
        lines[name.replace("_", " ")] = " - ".join(parts)
    return lines


def _line(entry: dict[str, Any]) -> str:
    parts = []
    for name, value in entry.items():
        if value is None or value == "":
            continue
        if isinstance(value, list):
            value = "(" + ", ".join(f"{x:.3g}" for x in value) + ")"
        parts.append(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}")
    return ", ".join(parts)

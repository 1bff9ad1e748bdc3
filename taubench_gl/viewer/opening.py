"""What a person can open: a scene, path-traced files, or a finished run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.conventions import FEATURE_BIT, FEATURES
from taubench_gl.errors import OutputError
from taubench_gl.evaluation import require_triangles
from taubench_gl.gpu.context import Gpu
from taubench_gl.pathtraced.evaluation import PathTracedOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.run import SUMMARY_FILE, Run, load_run
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings
from taubench_gl.viewer.feeds import Feed, PathTracedFeed, SceneFeed

_OF_RUN = ("fps", "reprojection", "sampling", "unit_scale", "culling", "textures", "effects", "exposure", "tone_map",
           "shadow_size", "shadow_lights", "shadow_filter", "indirect", "indirect_samples", "probes", "light_error",
           "storage")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Asked:
    """What was asked for on the command line.  ``resolve``: from a name of the registry to a path and settings."""

    text: str
    settings: Settings
    reference: str | None = None
    options: PathTracedOptions = field(default_factory=PathTracedOptions)
    given: frozenset[str] = frozenset()  # settings that the user gave: these win over a run's
    resolve: Callable[[str], tuple[str, dict[str, Any]]] | None = None


@dataclass(slots=True)
class Opened:
    feed: Feed
    frame: int | None = None  # to start with
    notes: tuple[str, ...] = ()


def is_run(text: str) -> bool:
    path = Path(text)
    return path.name == SUMMARY_FILE or (path / SUMMARY_FILE).is_file()


def open_feed(gpu: Gpu, asked: Asked, timer: Any) -> Opened:
    """A feed of what ``asked`` names.  Raises TaubenchError for everything a user can cause."""
    if is_sequence(asked.text):
        return Opened(PathTracedFeed(gpu, asked.text, asked.settings, asked.options))
    if is_run(asked.text):
        run = load_run(asked.text)
        text, settings = _scene_of(run, asked)
        if is_sequence(text):
            return Opened(PathTracedFeed(gpu, text, settings, asked.options), worst_frame(run))
        feed = _scene_feed(gpu, text, settings, timer)
        return Opened(feed, worst_frame(run), (_said(run, feed.scene.sha256),))
    text, settings = asked.text, asked.settings
    if asked.resolve is not None:
        text, row = asked.resolve(text)
        settings = settings.replace(**row)
    return Opened(_scene_feed(gpu, text, settings, timer))


def _scene_feed(gpu: Gpu, text: str, settings: Settings, timer: Any) -> SceneFeed:
    scene = load_scene(text, scene=settings.sequence.scene, animation=settings.sequence.animation)
    require_triangles(scene)
    return SceneFeed(gpu, scene, settings, timer)


def _scene_of(run: Run, asked: Asked) -> tuple[str, Settings]:
    """The run's scene and settings.  Size, camera and threshold options that the user gave win."""
    path = (run.summary.get("scene") or {}).get("path")
    if path is None:
        raise OutputError("the run's scene was not read from a file", where=str(run.out), hint="open a scene instead")
    kept = run.summary.get("settings") or {}
    values = {n: kept[n] for n in _OF_RUN if n in kept and n not in asked.given}
    if "columns" in kept and "columns" not in asked.given:
        values["columns"] = tuple(kept["columns"])
    if "sky" in kept and "sky" not in asked.given:
        values["sky"] = tuple(kept["sky"])
    if "thresholds" not in asked.given and "thresholds" in kept:
        scale = float(kept.get("unit_scale") or 1.0)  # the run's own, whatever is asked for now
        limits = {f: float(v) for f, v in kept["thresholds"].items() if f in FEATURES and v is not None}
        if "position" in limits:
            limits["position"] /= scale  # the summary has it in scene units, Settings in metres
        values["thresholds"] = limits
    if "frames" not in asked.given and kept.get("first_frame") is not None:
        values["frames"] = (kept["first_frame"], kept["last_frame"] + 1)
    for name in ("width", "height"):
        if "size" not in asked.given and name in kept:
            values[name] = int(kept[name])
    path_traced, path = run.summary.get("path_traced") is not None, scene_path(run.out, str(path))
    return (f"exr:{path}" if path_traced else path), asked.settings.replace(**values)


def scene_path(out: Path | None, path: str) -> str:
    """Where the scene of the run in ``out`` is: ``path`` as the run was given it, else from a folder above the run's.

    A run keeps the path that it was given, often relative to a folder that nobody remembers.  Raises OutputError.
    """
    if Path(path).exists() or any(sign in path for sign in "*?[%@"):  # patterns are for the reader of sequences
        return path
    above = () if out is None or Path(path).is_absolute() else (out.resolve(), *out.resolve().parents)
    found = next((folder / path for folder in above if (folder / path).exists()), None)
    if found is None:
        hint = "start in the folder it was evaluated from, or open the scene itself"
        raise OutputError(f"the run's scene {path} is not here", where=str(out), hint=hint)
    return str(found)


def worst_frame(run: Run) -> int | None:
    """The later frame of the most discarded pair, as ``evaluate`` chooses its mask.png; None without pairs."""
    rows = [row for row in run.frames if row.get("frame") is not None]
    if not rows:
        return None
    return int(max(rows, key=lambda row: sum(row.get(n) or 0 for n in ("frustum", *FEATURE_BIT)))["frame"])


def _said(run: Run, sha256: str | None) -> str:
    scene = run.summary["scene"]
    changed = scene.get("sha256") is not None and scene["sha256"] != sha256
    told = "the scene has changed since" if changed else "its most discarded pair"
    return f"run of {scene.get('name', '?')}: {told}"

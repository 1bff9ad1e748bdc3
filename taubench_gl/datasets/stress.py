"""Writes a scene with another camera, and optionally moving lights and objects, as glTF.

A glTF file is extended and otherwise unchanged; other formats are converted to glTF first.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import Poser, camera_of_run
from taubench_gl.animation.state import FrameState
from taubench_gl.datasets.camera_path import CameraPath, CameraSpec, add_rig, generate
from taubench_gl.datasets.free_space import VoxelSpace
from taubench_gl.datasets.gltf_edit import GltfEditor
from taubench_gl.datasets.gltf_from_scene import write_scene
from taubench_gl.datasets.motion_stats import MotionStats, ordered_steps
from taubench_gl.effects.lighting import own_light, without_auto
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.exposure import meter
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import SequenceSettings, Settings

Array = np.ndarray

CAMERA_NAME, MOVES_NAME = "stress camera", "stress moves"
ANIMATIONS = (CAMERA_NAME, MOVES_NAME)
"""Names of the animations that ``stress`` adds."""

YFOV = math.radians(60.0)

LARGE = 0.35
"""Objects larger than this fraction of the scene's radius are ground or walls, and are not moved."""


@dataclass(frozen=True, slots=True)
class Moves:
    """How many lights and objects to move (-1: all), chosen by the seed, and their motion in meters per frame."""

    lights: int = 0
    objects: int = 0
    motion: MotionStats = field(default_factory=lambda: MotionStats(0.05, 0.001))

    def __post_init__(self) -> None:
        for name, count in (("lights", self.lights), ("objects", self.objects)):
            if count < -1:
                raise SettingsError(f"{count} {name} to move", hint="give a number, or all")


@dataclass(frozen=True, slots=True)
class StressResult:
    """What ``stress`` wrote: file, length, how many lights and objects move, and what was taken of a recorded camera.

    ``path``: None of a recorded camera.
    """

    file: Path
    path: CameraPath | None
    fps: float
    seconds: float
    lights: int
    objects: int
    taken: str = ""


def stress(
    source: str | Path,
    out: str | Path,
    camera: CameraSpec | SequenceSettings,
    moves: Moves | None = None,
    seed: int = 0,
    *,
    strict: bool = False,
) -> StressResult:
    """Write ``source``, any argument of ``load_scene``, with ``camera`` and ``moves`` to ``out`` (.glb, .gltf).

    ``camera``: of SequenceSettings, the recorded one.  ``strict``: as for ``load_scene``.

    Raises SceneError, SettingsError, OutputError.
    """
    if Path(out).suffix.lower() not in (".glb", ".gltf"):
        raise SettingsError(f"{Path(out).name} does not end in .glb or .gltf", hint="stress writes glTF")
    if Path(out).exists() and Path(source).exists() and Path(out).samefile(source):
        raise SettingsError(f"{out} is the scene itself", hint="give --out another name")
    moves = moves or Moves()
    scene, editor, lost = _opened(str(source), strict)
    scene_index = _scene_index(editor)
    path = None
    if isinstance(camera, SequenceSettings):
        recorded = camera_of_run(scene, camera)
        times, (position, rotation) = recorded.path.times.astype(np.float32), recorded.placed()
        times[:-1] = np.where(np.diff(times) > 0, times[:-1], np.nextafter(times[:-1], np.float32(-1.0)))  # jumps
        lens = editor.camera(CAMERA_NAME, *_lens(scene, recorded.path.yfov))
        node = editor.node(recorded.node, scene_index, name=CAMERA_NAME, camera=lens,
                           translation=position[0].tolist(), rotation=rotation[0].tolist())  # fmt: skip
        tracks = [(node, "translation", times, position, "LINEAR"), (node, "rotation", times, rotation, "LINEAR")]
        fps = recorded.path.fps
        frames, words = max(2, round(recorded.duration * fps) + 1), recorded.path.taken
    else:
        path = generate(camera, VoxelSpace(scene))
        lens = editor.camera(CAMERA_NAME, *_lens(scene))

        def node(name: str, parent: int | None, **properties: Any) -> int:
            return editor.node(parent, scene_index, name=name, **properties)

        tracks = add_rig(path, node, lens, CAMERA_NAME, keep_still=True)
        frames, fps = camera.frames, camera.fps
        words = f"a generated camera (translation {camera.translation}; yaw {camera.yaw}; pitch {camera.pitch}; " \
               f"roll {camera.roll}; seed {camera.seed})"  # fmt: skip
    editor.animation(CAMERA_NAME, tracks)
    lights, objects, tracks = _moved(editor, scene, moves, frames, fps, seed)
    editor.animation(MOVES_NAME, tracks)
    moved = f", {lights} moving lights and {objects} moving objects" if lights or objects else ""
    editor.note(camera=CAMERA_NAME, note=f"stressed: {words} at {fps:.6g} fps{moved}{lost}", **_exposure(scene))
    editor.save(out)
    return StressResult(Path(out), path, fps, (frames - 1) / fps, lights, objects, "" if path else words)


def _exposure(scene: Scene) -> dict[str, str]:
    """The exposure that the file records, so that added motion does not change it; nothing where none is metered."""
    settings = without_auto(scene, Settings(light_unit="auto", environment="auto"))
    if scene.exposure is not None or (settings.lighting.light_unit == "watt" and own_light(scene) is not None):
        return {}
    metered, _ = meter(scene, settings)
    return {} if metered is None else {"exposure": f"{metered:.6g}"}


def _opened(source: str, strict: bool) -> tuple[Scene, GltfEditor, str]:
    """The scene as read from its glTF file, an editor of that file, and losses of the conversion in words."""
    if source.startswith("exr:"):
        raise SettingsError(f"{source} holds images, which cannot be rendered with another camera", hint="give a scene")
    scene = load_scene(source, strict=strict)
    if Path(source).suffix.lower() in (".glb", ".gltf"):
        return scene, GltfEditor(source), ""
    with tempfile.TemporaryDirectory(prefix="taubench-gl-") as folder:
        file = Path(folder) / f"{scene.name or 'scene'}.glb".replace("/", "_")
        write_scene(scene, file)
        editor = GltfEditor(file)
        converted = load_scene(file)
    lost = len(scene.replacements)
    return converted, editor, f"; {lost} cuts of single objects are lost: glTF cannot store them" if lost else ""


def _lens(scene: Scene, recorded: Array | None = None) -> tuple[float, float, float | None]:
    """Field of view, the first of a recorded camera's if it has any, and clip planes of the scene's first perspective
    camera, or default ones."""
    cameras = [scene.cameras[k] for k in scene.nodes.camera[scene.camera_nodes]]
    for camera in cameras:
        if camera.kind == "perspective":
            return (
                camera.yfov if recorded is None else float(recorded[0]),
                camera.znear,
                camera.zfar if math.isfinite(camera.zfar) else None,
            )
    return YFOV if recorded is None else float(recorded[0]), 0.05, None


def _scene_index(editor: GltfEditor) -> int:
    """Index of the file's default scene; a file without scenes gets one with all its roots."""
    if not editor.root.get("scenes"):
        editor.root["scenes"] = [{"nodes": [i for i in _roots(editor)]}]
        editor.root["scene"] = 0
    return int(editor.root.get("scene", 0))


def _roots(editor: GltfEditor) -> list[int]:
    """Indices of the nodes that are no node's child."""
    nodes = editor.root.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", ())}
    return [i for i in range(len(nodes)) if i not in children]


def _moved(
    editor: GltfEditor, scene: Scene, moves: Moves, frames: int, fps: float, seed: int
) -> tuple[int, int, list[tuple]]:
    """Add a moving parent to each chosen node, so that its transform and animation stay unchanged."""
    if not (moves.lights or moves.objects):
        return 0, 0, []
    rng = np.random.default_rng([seed, 3])
    poser = Poser(scene)
    state = poser.sample(0.0)
    joints = {int(j) for skin in scene.skins for j in skin.joints}
    lights = [n for n in _pick(scene.light_nodes.tolist(), moves.lights, rng) if n not in joints]
    objects = [n for n in _pick(_movable(scene, state), moves.objects, rng) if n not in joints]
    times = np.arange(frames) / fps
    tracks, moved_nodes = [], set()
    for node in (*lights, *objects):
        if node in moved_nodes:  # a light on an object moves with it
            continue
        moved_nodes.add(node)
        above = editor.insert_above(node, f"stress move {scene.nodes.names[node] or node}")
        parent = int(scene.nodes.parent[node])
        linear = np.eye(3) if parent < 0 else state.world[parent][:3, :3]
        tracks.append((above, "translation", times, _drift(moves.motion, frames, linear, rng), "LINEAR"))
    return len(lights), len(objects), tracks


def _drift(motion: MotionStats, frames: int, parent: Array, rng: np.random.Generator) -> Array:
    """Displacements (frames, 3), in the space of ``parent`` (3, 3), whose world steps have exactly ``motion``."""
    steps = ordered_steps(motion, frames - 1, rng)
    reach = 12.0 * motion.mean
    out, direction = np.zeros((frames, 3)), rng.normal(size=3)
    for i, step in enumerate(steps.tolist()):
        # The direction turns back towards the start with increasing distance.
        direction = direction / np.linalg.norm(direction) + 0.35 * rng.normal(size=3) - out[i] / reach
        out[i + 1] = out[i] + step * direction / np.linalg.norm(direction)
    return out @ np.linalg.pinv(parent).T


def _movable(scene: Scene, state: FrameState) -> list[int]:
    """Visible rigid mesh nodes that are small compared with the scene."""
    centers, radii, nodes = [], [], []
    for node in scene.mesh_nodes[state.visible[scene.mesh_nodes]].tolist():
        points = [p.positions for p in scene.primitives(node)]
        if not points or scene.nodes.skin[node] >= 0 or node in scene.nodes.instances:
            continue
        low, high = np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)
        world = state.world[node]
        centers.append(world[:3, :3] @ (0.5 * (low + high)) + world[:3, 3])
        radii.append(0.5 * float(np.linalg.norm(world[:3, :3] @ (high - low))))
        nodes.append(node)
    if not nodes:
        return []
    middle = np.mean([np.min(centers, axis=0), np.max(centers, axis=0)], axis=0)
    whole = float(np.max(np.linalg.norm(np.array(centers) - middle, axis=1) + radii))
    return [node for node, radius in zip(nodes, radii, strict=True) if radius <= LARGE * whole]


def _pick(nodes: list[int], count: int, rng: np.random.Generator) -> list[int]:
    """Draw ``count`` of the nodes, in ascending order; -1: all of them."""
    if count == 0 or not nodes:
        return []
    if count < 0 or count >= len(nodes):
        return nodes
    return sorted(rng.choice(nodes, size=count, replace=False).tolist())


def with_stats(
    spec: CameraSpec,
    *,
    translation: MotionStats | None = None,
    yaw: MotionStats | None = None,
    pitch: MotionStats | None = None,
    roll: MotionStats | None = None,
) -> CameraSpec:
    """Replace quantities of a camera; None leaves a quantity unchanged."""
    stats = {"translation": translation, "yaw": yaw, "pitch": pitch, "roll": roll}
    return dataclasses.replace(spec, **{name: value for name, value in stats.items() if value is not None})

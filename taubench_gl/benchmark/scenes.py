"""Scenes of a suite: files, scenes of the package, and stressed variants, which are made once and cached.

A stressed variant has a camera of constant speed in free space (``rotation``: yaw, degrees per frame; ``translation``:
meters per frame) or a still camera and moving lights or objects (meters per frame); ``datasets.stress`` writes it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from taubench_gl.capture.arena import arena_file, arena_scenes
from taubench_gl.data_files import code_hash
from taubench_gl.datasets.camera_path import CameraSpec
from taubench_gl.datasets.gltf_edit import GltfEditor
from taubench_gl.datasets.motion_stats import MotionStats
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.datasets.stress import ANIMATIONS, Moves, stress
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.outputs import output_folder, replacing
from taubench_gl.paths import ASSETS, cache_folder
from taubench_gl.study.store import content_hash

STRESS = ("rotation", "translation", "light_speed", "object_speed")

LIGHT_SCENES = {path.stem: path for path in sorted((ASSETS / "light").glob("*.glb"))}
SHIPPED = {"demo": ASSETS / "demo.glb", **STAND_INS, **LIGHT_SCENES}
"""Scenes of the package -> their files."""


@dataclass(frozen=True, slots=True)
class SceneRecipe:
    """A scene of a suite, and how it is made.

    ``source``: one of SHIPPED or the recorded games, or an absolute path; ``axis``: one of STRESS, None for the source
    as it is; ``value``: speed along the axis, per frame at ``fps``; ``frames``: length of the camera path;
    ``still``: without the animations of the source.
    """

    source: str
    axis: str | None = None
    value: float = 0.0
    frames: int = 0
    fps: float = 0.0
    still: bool = False


def known_source(text: str, folder: Path) -> str:
    """The source that ``text`` names: a scene of the package, a recorded game, or a file beside the suite.

    Raises SettingsError.
    """
    names = (*SHIPPED, *arena_scenes())
    if text in names:
        return text
    path = folder / text
    if not path.is_file():
        hint = f"give {', '.join(names)}, or a file beside the suite"
        raise SettingsError(f"there is no scene {text!r}", hint=hint)
    return str(path.resolve())


def scene_file(recipe: SceneRecipe) -> Path:
    """The file of a scene; it is written to the cache on first use.  Raises TaubenchError."""
    if recipe.axis is None and recipe.source in arena_scenes():
        return arena_file(recipe.source)
    if recipe.axis is None:
        return SHIPPED.get(recipe.source) or Path(recipe.source)
    source = scene_file(SceneRecipe(recipe.source))
    name = f"{source.stem}-still" if not recipe.value else f"{source.stem}-{recipe.axis}-{recipe.value:g}"
    same = {**asdict(recipe), "axis": recipe.axis if recipe.value else None, "source": sha256_of(source)}
    path = _cached(name, same)
    if not path.is_file():
        camera, moves = _motion(recipe)
        with replacing(path, suffix=".glb") as file:
            stress(source, file, camera, moves)
            if recipe.still:
                _drop_own_animations(file)
    return path


def not_run(recipe: SceneRecipe) -> str | None:
    """Why a scene cannot be made on this machine: a recorded game needs the game's data files; None if it can."""
    if recipe.source not in arena_scenes():
        return None
    try:
        arena_file(recipe.source)
    except SceneError as error:
        return str(error)
    return None


def _drop_own_animations(path: Path) -> None:
    """Keep only what ``stress`` moves: everything else has the pose of the file's nodes."""
    editor = GltfEditor(path)
    editor.root["animations"] = [
        animation for animation in editor.root["animations"] if animation.get("name") in ANIMATIONS
    ]
    editor.save(path)


def _motion(recipe: SceneRecipe) -> tuple[CameraSpec, Moves]:
    """The camera and the moves of a stressed variant.

    The path is one frame longer than is evaluated: no frame lies at the end of the animation.
    """
    speed = MotionStats(recipe.value)
    turned = {"rotation": "yaw", "translation": "translation"}.get(recipe.axis or "")
    camera = CameraSpec(frames=recipe.frames + 1, fps=recipe.fps, **({turned: speed} if turned else {}))
    moving = -1 if recipe.value else 0
    lights, objects = (moving if recipe.axis == axis else 0 for axis in ("light_speed", "object_speed"))
    return camera, Moves(lights, objects, speed) if lights or objects else Moves()


def _cached(name: str, content: object) -> Path:
    """The file of a made scene in the cache; another version of the modules that make scenes has other files."""
    key = content_hash([_code(), content])
    return output_folder(cache_folder() / "scenes-made" / key) / f"{name}.glb"


@cache
def _code() -> str:
    return code_hash(("datasets", "benchmark/scenes.py"), shaders=())

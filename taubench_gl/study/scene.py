"""The scene that a worker keeps loaded from one unit of work to the next."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from typing import Self

from taubench_gl.animation import camera_of_run
from taubench_gl.errors import SceneError
from taubench_gl.evaluation import file_hashes, files_identity
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings
from taubench_gl.study.unit import Worker


class LoadedScene:
    """A scene with its camera.  Subclasses add what else the units of a study need again, and release it."""

    def __init__(self, path: str, settings: Settings):
        """Load ``path``, any argument of ``load_scene``, as ``settings`` say.  Raises SceneError."""
        self.path = path
        scene = load_scene(path, **settings.sequence.reading)
        camera = camera_of_run(scene, settings.sequence, settings.metrics.unit_scale)
        self.animated = AnimatedScene(scene, camera, fps=settings.sequence.fps)

    @classmethod
    def kept(cls, worker: Worker, path: str, settings: Settings, key: Hashable = None) -> Self:
        """The scene that ``worker`` has loaded; another one, or another ``key``, replaces it.  Raises SceneError."""
        sequence = settings.sequence
        every = (cls, key, path, replace(sequence, frames=(None, None), width=1, height=1), settings.metrics.unit_scale)
        return worker.kept(every, lambda: cls(path, settings))

    def require_unchanged(self, sha256: str | None, settings: Settings, hint: str) -> None:
        """Raise SceneError, with ``hint``, if the scene's files are not those of ``sha256`` (``files_identity``)."""
        if sha256 != files_identity(file_hashes(self.animated.scene, settings)):
            raise SceneError("changed while the study was running", where=self.path, hint=hint)

    def release(self) -> None:
        """Free what the scene holds on the GPU."""

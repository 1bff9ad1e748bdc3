"""The state of a scene and a view of it at one time.  ``pose`` and ``views`` compute them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.model import Camera, Light

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class FrameState:
    """A scene at ``time``: a pure function of (scene, rate, time), independent of earlier frames."""

    time: float  # seconds
    world: Array  # (N, 4, 4) float64 world_from_node
    visible: Array  # (N,) bool, inherited; False for nodes outside the selected scene
    weights: Mapping[int, Array]  # node -> (M,) float64 morph weights, for nodes whose mesh has targets
    cameras: tuple[Camera, ...]  # the scene's cameras with animated parameters
    lights: tuple[Light, ...]  # the scene's lights with animated parameters


@dataclass(frozen=True, slots=True)
class View:
    """One camera at one time.  The rotation is proper: scale and mirror of the camera's node are removed."""

    position: Array  # (3,) float64, world, scene units
    world_from_view: Array  # (3, 3) float64 rotation
    camera: Camera
    jitter_px: Array = field(default_factory=lambda: np.zeros(2))
    """Offset of samples, (2,) float64, pixels, +x right, +y up: pixel i is sampled at i + ``jitter_px``, not at i."""
    principal_px: tuple[float, float] = (0.0, 0.0)
    """Offset of the camera's axis from the image center, pixels, +x right, +y up: the image is shifted as a whole."""
    shift: float = 0.0
    """Off-axis projection: the center of the image shows the direction with this tangent to the right of the axis."""

    def clip_from_view(self, width: int, height: int) -> Array:
        """Projection matrix, (4, 4) float64, reversed Z in [0, 1].  ``yfov`` and ``ymag`` are kept; the aspect is the
        viewport's.

        Jitter shifts the image in the opposite direction: the point at i + ``jitter_px`` is drawn at i.
        """
        aspect = width / height
        c = self.camera
        if c.kind == "perspective":
            out = math3d.perspective_reversed(c.yfov, aspect, c.znear, c.zfar)
        else:
            out = math3d.orthographic_reversed(c.ymag * aspect, c.ymag, c.znear, c.zfar)
        if self.shift:
            out[0] -= self.shift * out[0, 0] * out[3]
        if np.any(self.offset_px):  # without it the matrix is unchanged bit for bit
            shift = 2.0 * self.offset_px / (width, height)
            out[:2] -= shift[:, None] * out[3]
        return out

    @property
    def offset_px(self) -> Array:
        """Shift of the image, (2,) float64, pixels, +x right, +y up: pixel i shows what the unshifted camera sees at i
        + ``offset_px``.
        """
        return np.asarray(self.jitter_px, dtype=np.float64) - self.principal_px

    @property
    def towards_parallel_camera(self) -> tuple[float, float, float, float]:
        """Direction to a parallel camera: xyz unit, world, from every point; w 1.  Zeros for a perspective camera."""
        return (*self.world_from_view[:, 2], 1.0) if self.camera.parallel else (0.0,) * 4

    def centered(self) -> View:
        """This view without jitter."""
        return replace(self, jitter_px=np.zeros(2)) if np.any(self.jitter_px) else self

    def clip_from_relative(self, width: int, height: int, origin: Array | None = None) -> Array:
        """Clip from world axes, relative to ``origin`` (default: this camera's position).  (4, 4) float64.

        Composed relative to a camera in float64, so that float32 on the GPU contains no world offset.
        """
        offset = np.zeros(3) if origin is None else np.asarray(origin) - self.position
        view_from_world = self.world_from_view.T
        return self.clip_from_view(width, height) @ math3d.affine(view_from_world, view_from_world @ offset)

"""Scene + seconds -> FrameState, and the View of a camera.  Float64 NumPy, no GL."""

from taubench_gl.animation.pose import Poser, pose_normals, pose_vertices, sample, skin_matrices
from taubench_gl.animation.state import FrameState, View
from taubench_gl.animation.views import (
    CameraTrack,
    FileCamera,
    OrbitCamera,
    bounding_box,
    bounding_sphere,
    choose_camera,
)

__all__ = [
    "CameraTrack",
    "FileCamera",
    "FrameState",
    "OrbitCamera",
    "Poser",
    "View",
    "bounding_box",
    "bounding_sphere",
    "choose_camera",
    "pose_normals",
    "pose_vertices",
    "sample",
    "skin_matrices",
]

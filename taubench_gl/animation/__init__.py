"""Scene + seconds -> FrameState, and the View of a camera.  Float64 NumPy, no GL."""

from taubench_gl.animation.pose import Poser, pose_normals, pose_vertices, sample, skin_matrices
from taubench_gl.animation.recorded_camera import RecordedCamera
from taubench_gl.animation.state import FrameState, View
from taubench_gl.animation.views import (
    CameraTrack,
    FileCamera,
    OrbitCamera,
    bounding_box,
    bounding_sphere,
    camera_of_run,
    choose_camera,
    is_still,
)

__all__ = [
    "CameraTrack",
    "FileCamera",
    "FrameState",
    "OrbitCamera",
    "Poser",
    "RecordedCamera",
    "View",
    "bounding_box",
    "bounding_sphere",
    "camera_of_run",
    "choose_camera",
    "is_still",
    "pose_normals",
    "pose_vertices",
    "sample",
    "skin_matrices",
]

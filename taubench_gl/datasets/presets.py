"""Camera statistics of the paper's two game captures, per frame, as the generator is asked for them."""

from __future__ import annotations

from taubench_gl.datasets.camera_path import CameraSpec
from taubench_gl.datasets.motion_stats import MotionStats

CAPTURE_FPS = 60.0
"""Rate at which both were captured (section 4.1).  Table 2's VR row needs at least 317 samples, which 6 s have at this
rate and not at the 24 fps of the paper's renders: so the camera tables are met at 60 fps, and only there."""

CAPTURE_SECONDS = 6.0
CAPTURE_FRAMES = 361

FPS = CameraSpec(
    translation=MotionStats(1.892, 0.826, 5.475),
    yaw=MotionStats(3.365, 8.887),
    pitch=MotionStats(1.550, 2.839),
    frames=CAPTURE_FRAMES,
    fps=CAPTURE_FPS,
)

# Over 360 pairs a single jump of 7.163 leaves too little variance: 51.3 of the 58.2 square metres in all, so that steps
# of a metre or two, jumps themselves, would have to make up the rest.  With the jump 4 % longer and the variance 4 %
# smaller, both within the 5 % asked for, it is one jump among steps of a walking head.
VR = CameraSpec(
    translation=MotionStats(0.041, 0.160 * 0.96, 7.163 * 1.04, usual_maximum=0.24),
    yaw=MotionStats(8.222, 72.563),
    pitch=MotionStats(3.174, 10.539),
    roll=MotionStats(1.871, 3.469),
    frames=CAPTURE_FRAMES,
    fps=CAPTURE_FPS,
)

PRESETS = {"fps": FPS, "vr": VR, "still": CameraSpec(frames=CAPTURE_FRAMES, fps=CAPTURE_FPS)}
